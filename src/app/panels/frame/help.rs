//! The help: what has a key or a gesture in the table of commands.

use egui::{RichText, ScrollArea, Ui};

use crate::app::keys::binding::Binding;
use crate::app::keys::table::BINDINGS;
use crate::app::panels::widgets::{modal_ui, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;

/// Groups of each column.
const COLUMNS: [&[&str]; 3] = [
    &["File", "Edit", "Camera", "Object", "Training"],
    &["Environment", "Photos"],
    &["Layers", "Window"],
];
/// Width of a column and, within it, of the keys; between columns, points.
const WIDTHS: [f32; 3] = [366.0, 132.0, 18.0];

/// Height of heading, button, margins and the rim that is left around the window, points.
const REST_HEIGHT: f32 = 140.0;
/// Width of the margins, the scroll bar and that rim.
const MARGINS: f32 = 72.0;

/// Draws the help over everything, while it is open.
pub fn help_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.overlays.is_help_open {
        return;
    }
    modal_ui(ui, "help", Command::ToggleHelp, commands, |ui, _| {
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
                // Less on a small window.
                let [width, keys, gap] = WIDTHS;
                let most = (ui.ctx().content_rect().width() - MARGINS) / COLUMNS.len() as f32 - gap;
                ui.spacing_mut().item_spacing.x = gap;
                for groups in COLUMNS {
                    ui.vertical(|ui| column(ui, groups, [width.min(most), keys]));
                }
            });
        });
        ui.add_space(6.0);
        ui.button("Close").clicked()
    });
}

fn column(ui: &mut Ui, groups: &[&str], [width, keys]: [f32; 2]) {
    ui.set_width(width);
    ui.spacing_mut().item_spacing = egui::vec2(8.0, 3.0);
    for group in groups {
        ui.label(RichText::new(*group).strong());
        let is_listed = |binding: &&Binding| binding.group == *group && !binding.keys.is_empty();
        for binding in BINDINGS.iter().filter(is_listed) {
            ui.horizontal_top(|ui| {
                for (text, width) in [
                    (RichText::new(binding.keys).monospace().size(12.0), keys),
                    (weak(ui, binding.what), width - keys - 8.0),
                ] {
                    ui.vertical(|ui| {
                        ui.set_width(width);
                        ui.add(egui::Label::new(text).wrap());
                    });
                }
            });
        }
        ui.add_space(4.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_group_of_keys_has_its_column() {
        for binding in BINDINGS.iter().filter(|binding| !binding.keys.is_empty()) {
            let columns = COLUMNS
                .iter()
                .filter(|groups| groups.contains(&binding.group));
            assert_eq!(columns.count(), 1, "{}", binding.group);
        }
    }
}
