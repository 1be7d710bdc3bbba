//! Watching training: comparison with the photo, the capture's cameras, plots and figures.

use egui_kittest::kittest::Queryable as _;
use neif::app::Effect;
use neif::app::state::training_state::Phase;
use neif::app::state::watch::{Comparison, ErrorKind, MeasuredView};
use neif::render::Layer;
use neif::train::fast::skips::SkipShares;
use neif::train::measure::view_error::ViewFigures;
use neif::train::session::events::{FinishReason, TrainCommand, TrainEvent};
use neif::train::session::plan::Budget;

use super::{click, effects, harness, training_state, with_picture};

#[test]
fn comparisons_follow_menu_and_keys_and_end_when_the_camera_moves() {
    let (mut harness, center) = with_picture();
    let with = |h: &egui_kittest::Harness<'_, super::Shown>| h.state().state.compare.with_photo;
    click(&mut harness, "Compare…");
    click(&mut harness, "Side by side");
    assert_eq!(with(&harness), Comparison::Beside);
    let preview = harness.get_by_label("Preview of the scene").rect();
    assert!(
        preview.left() > center.x,
        "the rendering has the right half"
    );
    harness.key_press(egui::Key::T);
    harness.run_steps(2);
    assert_eq!(with(&harness), Comparison::Flicker);
    harness.key_press(egui::Key::D);
    harness.run_steps(2);
    assert_eq!(with(&harness), Comparison::Error(ErrorKind::Absolute));
    harness.key_press(egui::Key::W);
    harness.run_steps(2);
    assert_eq!(
        with(&harness),
        Comparison::Off,
        "the wipe takes the place of the map"
    );
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::W);
    harness.run_steps(2);
    assert_eq!(with(&harness), Comparison::Beside);
    let from = center + egui::vec2(100.0, 0.0);
    let by = egui::vec2(40.0, 0.0);
    super::drag(&mut harness, from, by, egui::Modifiers::NONE);
    assert_eq!(with(&harness), Comparison::Off);
}

#[test]
fn a_camera_in_the_viewport_is_visited_by_a_click() {
    let (mut harness, _) = with_picture();
    click(&mut harness, "Cameras");
    assert!(harness.state().state.watch.are_cameras_shown);
    let state = &harness.state().state;
    let rect = harness.get_by_label("Preview of the scene").rect();
    let window = (rect.width() as u32, rect.height() as u32);
    let camera = state.view.viewpoint.camera_for(window.0, window.1);
    let other = super::dataset().val[0].camera;
    let at = camera.project(other.position()).expect("across the table");
    let at = rect.min + egui::vec2(at.x, at.y);
    assert!(rect.contains(at), "{at} is outside {rect}");
    harness.hover_at(at);
    harness.run_steps(2);
    harness.drag_at(at);
    harness.run_steps(1);
    harness.drop_at(at);
    harness.run_steps(2);
    assert_eq!(harness.state().state.view.at_view, Some(2));
}

#[test]
fn the_list_shows_what_is_known_of_each_view() {
    let mut state = training_state();
    state
        .training
        .take(TrainEvent::ViewsValidated(vec![Some(27.25)]));
    let figures = ViewFigures {
        psnr: Some(31.0),
        psnr_object: Some(24.5),
        ..ViewFigures::default()
    };
    let measured = MeasuredView {
        view: 0,
        step: 5,
        is_edited: false,
        figures,
    };
    state.watch.by_view.insert(0, measured);
    let harness = harness(state);
    harness.get_by_label_contains("27.2 dB");
    harness.get_by_label_contains("24.5 dB");
}

#[test]
fn training_longer_takes_one_click_with_the_seconds_chosen() {
    let mut state = training_state();
    state.training.phase = Phase::Finished(FinishReason::Budget);
    let mut harness = harness(state);
    harness
        .get_by_label("Seconds more")
        .set_value_accesskit(45.0);
    harness.run_steps(2);
    click(&mut harness, "Train longer");
    let more = TrainCommand::Extend(Budget::Seconds(45.0));
    assert_eq!(effects(&mut harness), [Effect::Train(more)]);
}

#[test]
fn the_figures_are_written_where_the_person_says() {
    let mut harness = harness(training_state());
    click(&mut harness, "Export CSV…");
    click(&mut harness, "Export");
    let effects = effects(&mut harness);
    let [Effect::WriteLog(path)] = effects.as_slice() else {
        panic!("{effects:?}");
    };
    assert!(path.ends_with("neif-runs/capture.csv"), "{path:?}");
    let csv = harness.state().state.training.log.to_csv();
    assert!(
        csv.lines()
            .nth(1)
            .is_some_and(|row| row.starts_with("1234,"))
    );
}

#[test]
fn shortcuts_are_listed_with_what_they_leave_out() {
    let mut state = training_state();
    state.training.progress.skips = Some(SkipShares {
        empty_space: 0.78,
        ..SkipShares::default()
    });
    let mut harness = harness(state);
    click(&mut harness, "What skipping saves now");
    harness.get_by_label("Empty space");
    harness.get_by_label("Finer than footprint");
}

#[test]
fn diagnostic_layers_are_reached_by_menu_and_key() {
    let mut harness = harness(training_state());
    click(&mut harness, "Layers…");
    click(&mut harness, "Depth");
    assert_eq!(harness.state().state.layer, Layer::Depth);
    harness.key_press(egui::Key::Num0);
    harness.run_steps(2);
    assert_eq!(harness.state().state.layer, Layer::Samples);
    harness.get_by_label("Samples…");
}

#[test]
fn the_slice_is_made_while_its_header_is_open_and_follows_its_controls() {
    let mut harness = harness(training_state());
    click(&mut harness, "Density slice");
    assert!(harness.state().state.watch.is_slice_shown);
    harness
        .get_by_label("Place of the slice")
        .set_value_accesskit(0.25);
    harness.run_steps(2);
    assert_eq!(harness.state().state.watch.slice.share, 0.25);
    click(&mut harness, "Density slice");
    harness.run_steps(3);
    assert!(!harness.state().state.watch.is_slice_shown);
}
