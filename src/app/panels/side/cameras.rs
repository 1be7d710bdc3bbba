//! The list of photos: each is a camera to stand at.

use egui::{Button, ScrollArea, Ui};

use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{on_click, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::data::View;

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
            let button = ui.button(text).on_hover_text(hint);
            on_click(&button, Command::StepView(by), commands);
        }
        let at = state.view.at_view;
        let at = at.map_or("free camera".to_owned(), |i| format!("{} of {n}", i + 1));
        ui.label(weak(ui, at));
    });
    let row_height = ui.spacing().interact_size.y;
    let views: Vec<_> = state.views().collect();
    let mut scroll = ScrollArea::vertical()
        .auto_shrink([false, false])
        .id_salt("photos");
    if let Some(offset) = scroll_to_view(ui, state, row_height) {
        scroll = scroll.vertical_scroll_offset(offset);
    }
    scroll.show_rows(ui, row_height, n, |ui, shown| {
        for i in shown {
            let is_here = state.view.at_view == Some(i);
            let view = views[i];
            let mut row = Button::selectable(is_here, view.full_name())
                .min_size(egui::vec2(ui.available_width(), row_height));
            let (figure, hint) = figure_of(state, i, view);
            if let Some(figure) = figure {
                row = row.right_text(weak(ui, figure));
            }
            let row = ui.add(row).on_hover_text(hint);
            on_click(&row, Command::GoToView(i), commands);
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

/// What is known of a photo, by its index, and what the row says of that.
fn figure_of(state: &AppState, index: usize, view: &View) -> (Option<String>, &'static str) {
    if let Some(db) = psnr_of(state, index) {
        let hint = "Stand where this photo was taken; PSNR of the object in it, where there is one";
        return (Some(format!("{db:.1} dB")), hint);
    }
    let exposures = state.snapshot.as_ref().and_then(|s| s.exposures.as_ref());
    let gain = exposures.and_then(|exposures| exposures.trained(view));
    let stops = gain.map(|gain| format!("{:+.1} EV", gain.element_product().cbrt().log2()));
    let moved = state.training.moved_px.get(index);
    let moved = moved.map(|px| format!("{px:.1} px"));
    let found: Vec<String> = [stops, moved].into_iter().flatten().collect();
    if found.is_empty() {
        return (None, "Stand where this photo was taken");
    }
    let hint = "Stand where this photo was taken; its exposure beside the others', and by how far its camera was corrected, \
                as training found them";
    (Some(found.join(", ")), hint)
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::*;
    use crate::app::state::app_state::tests::one_photo;
    use crate::train::session::events::TrainEvent;

    #[test]
    fn photos_say_what_was_found_about_them() {
        let (dataset, snapshot) = one_photo(Vec3::splat(2.0));
        let mut state = AppState {
            dataset: Some(dataset),
            ..AppState::default()
        };
        let figure = |state: &AppState| figure_of(state, 0, state.view_at(0).expect("a view")).0;
        assert_eq!(figure(&state), None, "nothing is known yet");
        state.snapshot = Some(Arc::new(snapshot));
        assert_eq!(figure(&state).as_deref(), Some("+1.0 EV"));
        let poses = TrainEvent::Poses(vec![("a".to_owned(), 0.64)]);
        assert!(state.training.take(poses).is_empty());
        assert_eq!(figure(&state).as_deref(), Some("+1.0 EV, 0.6 px"));
    }
}
