//! The list of photos: each is a camera to stand at.

use egui::{Button, ScrollArea, Ui};

use crate::app::command::Command;
use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::weak;
use crate::app::sections::Section;
use crate::app::state::AppState;

/// Draws the list.
pub fn cameras_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let n = state.views().count();
    ui.add_space(4.0);
    if !section_heading(ui, state, Section::Photos, commands) {
        return;
    }
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
    let mut scroll = ScrollArea::vertical()
        .auto_shrink([false, false])
        .id_salt("photos");
    if let Some(offset) = scroll_to_view(ui, state, row_height) {
        scroll = scroll.vertical_scroll_offset(offset);
    }
    scroll.show_rows(ui, row_height, n, |ui, shown| {
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
                Some(_) => {
                    "Stand where this photo was taken; PSNR of the object in it, where there is one"
                }
                None => "Stand where this photo was taken",
            };
            if row.on_hover_text(hint).clicked() {
                commands.push(Command::GoToView(i));
            }
        }
    });
}

/// Where to scroll to when the camera has come to another view: its row in the middle.
fn scroll_to_view(ui: &Ui, state: &AppState, row_height: f32) -> Option<f32> {
    let id = ui.scope_id().with("listed view");
    let shown: Option<usize> = ui.data(|data| data.get_temp(id)).flatten();
    if shown == state.view.at_view {
        return None;
    }
    ui.data_mut(|data| data.insert_temp(id, state.view.at_view));
    let step = row_height + ui.spacing().item_spacing.y;
    let middle = 0.5 * (ui.available_height() - row_height);
    Some((state.view.at_view? as f32 * step - middle).max(0.0))
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
