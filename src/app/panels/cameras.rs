//! The list of photos: each is a camera to stand at.

use egui::{Button, ScrollArea, Ui};

use crate::app::command::Command;
use crate::app::panels::widgets::{heading, weak};
use crate::app::state::AppState;

/// Draws the list.
pub fn cameras_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let n = state.views().count();
    ui.add_space(4.0);
    heading(ui, "Photos");
    if n == 0 {
        ui.label(weak(ui, "None yet."));
        return;
    }
    ui.horizontal(|ui| {
        for (text, hint, by) in [("Previous", "Key [", -1), ("Next", "Key ]", 1)] {
            if ui.button(text).on_hover_text(hint).clicked() {
                commands.push(Command::StepView(by));
            }
        }
        let at = state
            .view
            .at_view
            .map_or_else(|| "free camera".to_owned(), |i| format!("{} of {n}", i + 1));
        ui.label(weak(ui, at));
    });
    let row_height = ui.spacing().interact_size.y;
    let names: Vec<_> = state
        .views()
        .map(|(split, view)| format!("{} / {}", split.name(), view.name))
        .collect();
    ScrollArea::vertical()
        .auto_shrink([false, false])
        .id_salt("photos")
        .show_rows(ui, row_height, n, |ui, rows| {
            for i in rows {
                let is_here = state.view.at_view == Some(i);
                let row = Button::selectable(is_here, names[i].as_str())
                    .min_size(egui::vec2(ui.available_width(), row_height));
                if ui
                    .add(row)
                    .on_hover_text("Stand where this photo was taken")
                    .clicked()
                {
                    commands.push(Command::GoToView(i));
                }
            }
        });
}
