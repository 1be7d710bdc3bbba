//! The help: what has a key or a gesture in the table of commands.

use egui::{Grid, RichText, ScrollArea, Ui};

use crate::app::binding::Binding;
use crate::app::command::Command;
use crate::app::keys::BINDINGS;
use crate::app::panels::widgets::{modal, weak};
use crate::app::state::AppState;

/// Groups in the left column; the others stand in the right one.
const LEFT_GROUPS: [&str; 5] = ["File", "Edit", "Camera", "Environment", "Photos"];

/// Height of heading, button, margins and the rim that is left around the window, points.
const REST_HEIGHT: f32 = 140.0;

/// Draws the help over everything, while it is open.
pub fn help_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.overlays.is_help_open {
        return;
    }
    let modal = modal(ui, "help").show(ui.ctx(), |ui| {
        ui.heading("Mouse and keys");
        ui.add_space(4.0);
        // The table is taller than a small window.
        let room = ui.ctx().content_rect().height() - REST_HEIGHT;
        // Without the least height it would grow to that from picture to picture.
        let scroll = ScrollArea::vertical()
            .max_height(room)
            .min_scrolled_height(room);
        scroll.show(ui, |ui| {
            ui.horizontal_top(|ui| {
                let listed = || BINDINGS.iter().filter(|binding| !binding.keys.is_empty());
                let is_left = |binding: &&Binding| LEFT_GROUPS.contains(&binding.group);
                column(ui, "help left", listed().filter(is_left));
                ui.add_space(16.0);
                let is_right = |binding: &&Binding| !is_left(binding);
                column(ui, "help right", listed().filter(is_right));
            })
        });
        ui.add_space(6.0);
        ui.button("Close").clicked()
    });
    if modal.inner || modal.should_close() {
        commands.push(Command::ToggleHelp);
    }
}

fn column<'a>(ui: &mut Ui, id: &str, bindings: impl Iterator<Item = &'a Binding>) {
    Grid::new(id)
        .num_columns(2)
        .spacing([14.0, 4.0])
        .show(ui, |ui| {
            let mut group = "";
            for binding in bindings {
                if binding.group != group {
                    group = binding.group;
                    ui.label(RichText::new(group).strong());
                    ui.end_row();
                }
                ui.label(RichText::new(binding.keys).monospace());
                ui.label(weak(ui, binding.what));
                ui.end_row();
            }
        });
}
