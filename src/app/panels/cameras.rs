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
    let rows: Vec<_> = state
        .views()
        .enumerate()
        .map(|(i, (split, view))| {
            let name = format!("{} / {}", split.name(), view.name);
            let psnr = psnr_of(state, i);
            (name, psnr.map(|db| format!("{db:.1} dB")))
        })
        .collect();
    ScrollArea::vertical()
        .auto_shrink([false, false])
        .id_salt("photos")
        .show_rows(ui, row_height, n, |ui, shown| {
            for i in shown {
                let is_here = state.view.at_view == Some(i);
                let (name, psnr) = &rows[i];
                let mut row = Button::selectable(is_here, name.as_str())
                    .min_size(egui::vec2(ui.available_width(), row_height));
                if let Some(psnr) = psnr {
                    row = row.right_text(weak(ui, psnr.as_str()));
                }
                let row = ui.add(row);
                let hint = match psnr {
                    Some(_) => "Stand where this photo was taken; PSNR of the object in it, where there is one",
                    None => "Stand where this photo was taken",
                };
                if row
                    .on_hover_text(hint)
                    .clicked()
                {
                    commands.push(Command::GoToView(i));
                }
            }
        });
}

/// PSNR of a view by its index, dB: from its error map, else from the validation of the run. Of the object where there is
/// one.
fn psnr_of(state: &AppState, index: usize) -> Option<f64> {
    let measured = state.watch.by_view.get(&index).map(|m| m.figures);
    let n_train = state.dataset.as_ref().map_or(0, |d| d.train.len());
    let validated = || {
        let views = &state.training.view_psnr;
        index.checked_sub(n_train).and_then(|i| *views.get(i)?)
    };
    measured
        .and_then(|figures| figures.psnr_object.or(figures.psnr))
        .or_else(validated)
}
