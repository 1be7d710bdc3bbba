//! From the keys pressed in a frame to the commands of the table.

use egui::{FocusDirection, Key, KeyboardShortcut, Modifiers};

use super::binding::Binding;
use super::table::BINDINGS;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::fly;

/// What the keys pressed in this frame cause; nothing while text is typed.
pub fn pressed(ctx: &egui::Context, state: &AppState, commands: &mut Vec<Command>) {
    let has_focus = ctx.memory(|memory| memory.focused().is_some());
    if ctx.text_edit_focused() || fly::takes_keys(ctx) {
        return;
    }
    let is_key = |event: &egui::Event| matches!(event, egui::Event::Key { pressed: true, .. });
    if ctx.input(|input| input.events.iter().any(is_key)) {
        for (shortcut, binding) in by_modifiers() {
            // The space bar presses the button that has the focus.
            if shortcut.logical_key == Key::Space && has_focus {
                continue;
            }
            // It closes an open menu first.
            if shortcut.logical_key == Key::Escape && egui::Popup::is_any_open(ctx) {
                continue;
            }
            if shortcut.logical_key == Key::Tab {
                // Among controls, and in windows over the main one, it goes to the next control.
                let is_shifted = ctx.input(|input| input.modifiers.any());
                if has_focus || is_shifted || state.is_asking() {
                    continue;
                }
            }
            if ctx.input_mut(|input| input.consume_shortcut(&shortcut)) {
                commands.extend(binding.command(state));
                if shortcut.logical_key == Key::Tab {
                    ctx.memory_mut(|memory| memory.move_focus(FocusDirection::None));
                }
            }
        }
    }
    let is_held = ctx.input(|input| input.key_down(Key::G) && input.modifiers.is_none());
    if is_held != state.compare.is_photo_held {
        commands.push(Command::HoldPhoto(is_held));
    }
}

/// All shortcuts, those with more modifiers first: `Ctrl+S` also answers to `Ctrl+Shift+S`.
fn by_modifiers() -> Vec<(KeyboardShortcut, &'static Binding)> {
    let mut all: Vec<_> = BINDINGS
        .iter()
        .flat_map(|binding| binding.shortcuts().map(move |shortcut| (shortcut, binding)))
        .collect();
    let n_modifiers =
        |m: Modifiers| usize::from(m.alt) + usize::from(m.shift) + usize::from(m.command);
    all.sort_by_key(|(shortcut, _)| std::cmp::Reverse(n_modifiers(shortcut.modifiers)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_has_two_commands() {
        let all = by_modifiers();
        for (i, (later, binding)) in all.iter().enumerate() {
            let other = all[..i].iter().find(|(earlier, _)| earlier == later);
            assert!(other.is_none(), "{binding:?} and {other:?}");
        }
    }
}
