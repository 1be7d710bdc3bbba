//! The field in which a command is looked for, with the answers below it.

use egui::{Button, Key, Modifiers, ScrollArea, TextEdit, Ui};

use crate::app::changes::palette::found;
use crate::app::panels::widgets::{modal_ui, on_click, set_label, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::palette::{Palette, PaletteCommand};

/// Width of the field.
const WIDTH: f32 = 460.0;
/// Height of the answers.
const HEIGHT: f32 = 300.0;

/// Draws it over everything, while it is open.
pub fn palette_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some(palette) = &state.overlays.palette else {
        return;
    };
    let close = Command::Palette(PaletteCommand::Toggle);
    modal_ui(ui, "palette", close, commands, |ui, commands| {
        ui.set_width(WIDTH);
        // Before the field sees them: in it they would move the cursor.
        commands.extend(keys(ui, palette).map(Command::Palette));
        field_ui(ui, palette, commands);
        ui.add_space(4.0);
        answers_ui(ui, state, palette, commands);
        false
    });
}

fn keys(ui: &Ui, palette: &Palette) -> Option<PaletteCommand> {
    let pressed = |key| ui.input_mut(|input| input.consume_key(Modifiers::NONE, key));
    if pressed(Key::ArrowDown) {
        Some(PaletteCommand::Step(1))
    } else if pressed(Key::ArrowUp) {
        Some(PaletteCommand::Step(-1))
    } else {
        pressed(Key::Enter).then_some(PaletteCommand::Run(palette.chosen))
    }
}

fn field_ui(ui: &mut Ui, palette: &Palette, commands: &mut Vec<Command>) {
    let mut typed = palette.typed.clone();
    let field = TextEdit::singleline(&mut typed)
        .desired_width(f32::INFINITY)
        .hint_text("Find a command");
    let field = ui.add(field);
    set_label(&field, "Find a command");
    field.request_focus();
    if field.changed() {
        commands.push(Command::Palette(PaletteCommand::Type(typed)));
    }
}

fn answers_ui(ui: &mut Ui, state: &AppState, palette: &Palette, commands: &mut Vec<Command>) {
    let answers = found(state, &palette.typed);
    // Always of the same height, so that the field stays where it is.
    let scroll = ScrollArea::vertical()
        .auto_shrink([false, false])
        .min_scrolled_height(HEIGHT)
        .max_height(HEIGHT);
    scroll.show(ui, |ui| {
        if answers.is_empty() {
            ui.label(weak(ui, "No command of that name is possible now."));
        }
        for (i, (binding, _)) in answers.iter().enumerate() {
            let is_chosen = i == palette.chosen;
            let text = format!("{}: {}", binding.group, binding.what);
            let button = Button::selectable(is_chosen, text)
                .shortcut_text(binding.keys)
                .min_size(egui::vec2(ui.available_width(), 0.0));
            let button = ui.add(button);
            set_label(&button, binding.what);
            if is_chosen {
                button.scroll_to_me(None);
            }
            on_click(&button, Command::Palette(PaletteCommand::Run(i)), commands);
        }
    });
}
