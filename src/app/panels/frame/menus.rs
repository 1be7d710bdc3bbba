//! The menus: the table of commands by group.

use egui::{Button, Ui};

use crate::app::keys::binding::Binding;
use crate::app::keys::table::{BINDINGS, MENUS};
use crate::app::panels::widgets::set_label;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;

/// Draws the menus' names in a row; what they hold opens below them.
pub fn menus_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    for (name, groups) in MENUS {
        ui.menu_button(*name, |ui| {
            for (i, group) in groups.iter().enumerate() {
                if i > 0 {
                    ui.separator();
                }
                group_ui(ui, group, state, commands);
            }
        });
    }
}

fn group_ui(ui: &mut Ui, group: &str, state: &AppState, commands: &mut Vec<Command>) {
    let is_listed = |binding: &&Binding| binding.group == group && binding.is_command();
    for binding in BINDINGS.iter().filter(is_listed) {
        let command = binding.command(state);
        let button =
            Button::selectable(binding.is_on(state), binding.what).shortcut_text(binding.keys);
        let button = ui.add_enabled(command.is_some(), button);
        set_label(&button, binding.what);
        commands.extend(command.filter(|_| button.clicked()));
    }
}
