//! The export window and its keys.

use std::path::Path;

use neif::app::changes::export::plan;
use neif::app::state::export::{ExportEffect, Order, RunningExport, Subject};
use neif::render::{Backdrop, Destination, FileKind, Spin};
use neif::train::Snapshot;

use super::*;

/// An environment without an object, which is there at once.
fn state() -> AppState {
    let mut state = AppState {
        source: Source::Environment(PathBuf::from("/sky.hdr")),
        snapshot: Some(Arc::new(Snapshot {
            step: 0,
            object: None,
            environment: Arc::new(white_sky()),
            exposures: None,
        })),
        ..AppState::default()
    };
    state.export.window_px = (640, 400);
    state
}

/// The only thing that was asked of the world.
fn order(harness: &mut Harness<'_, Shown>) -> Order {
    match effects(harness).as_slice() {
        [Effect::Export(ExportEffect::Write(order))] => order.clone(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn f12_takes_the_view_at_its_size_under_a_name_of_its_own() {
    let mut harness = harness(state());
    harness.key_press(egui::Key::F12);
    harness.run_steps(2);
    let order = order(&mut harness);
    assert!(!order.may_replace, "nothing is overwritten");
    assert!(order.path.ends_with("neif/sky.png"), "{order:?}");
    let (film, destination) = plan(&harness.state().state, &order).expect("a picture");
    assert_eq!(destination, Destination::File(order.path));
    let camera = film.shots[0].camera;
    assert_eq!(
        (film.shots.len(), camera.width, camera.height),
        (1, 640, 400)
    );
}

#[test]
fn a_turntable_of_the_environment_is_ordered_in_the_window() {
    let mut harness = harness(state());
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::F12);
    harness.run_steps(3);
    assert_eq!(
        harness.state().state.export.settings.subject,
        Subject::Turntable
    );
    let spin = harness.get_all_by_label("Environment").last();
    spin.expect("a choice").click();
    harness.run_steps(2);
    click(&mut harness, "With the environment");
    click(&mut harness, "PNG");
    click(&mut harness, "Start export");
    let order = order(&mut harness);
    assert!(order.path.ends_with("neif/sky_turntable"), "{order:?}");
    let settings = order.settings;
    assert_eq!(
        (settings.spin, settings.backdrop),
        (Spin::Environment, Backdrop::Transparent)
    );
    let (film, destination) = plan(&harness.state().state, &order).expect("pictures");
    assert_eq!(destination, Destination::Folder(order.path));
    assert_eq!(film.shots.len() as u32, settings.n_frames);
    let first = &film.shots[0];
    assert!(
        film.shots[1..]
            .iter()
            .all(|shot| shot.camera == first.camera
                && shot.transform.rotate_deg != first.transform.rotate_deg)
    );
}

#[test]
fn a_camera_path_needs_two_views_and_passes_through_them() {
    let mut harness = harness(state());
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::E);
    harness.run_steps(3);
    click(&mut harness, "Camera path");
    click(&mut harness, "Add this view");
    click(&mut harness, "Start export");
    assert_eq!(effects(&mut harness), []);
    let note = harness.state().state.export.note.clone();
    assert!(note.is_some_and(|note| note.contains("two key views")));
    let view = &mut harness.state_mut().state;
    let turn = CameraMove::Orbit {
        yaw: 1.0,
        pitch: 0.0,
    };
    apply(view, Command::MoveCamera(turn), &mut Vec::new());
    let end = view.view.viewpoint.camera_for(640, 400);
    click(&mut harness, "Add this view");
    click(&mut harness, "Start export");
    let order = order(&mut harness);
    let (film, _) = plan(&harness.state().state, &order).expect("a path");
    assert_eq!(film.shots.len(), 48, "two seconds");
    let last = film.shots[47].camera.position();
    assert!((last - end.position()).length() < 1e-4, "{last}");
    click(&mut harness, "Save cameras");
    let asked = effects(&mut harness);
    assert!(matches!(
        &asked[..],
        [Effect::Export(ExportEffect::SaveKeys(_))]
    ));
}

#[test]
fn a_typed_name_must_suit_its_kind_of_file() {
    let mut state = state();
    state.export.is_open = true;
    state.export.typed = Some("/pictures/a.jpg".to_owned());
    let mut harness = harness(state);
    click(&mut harness, "Start export");
    assert_eq!(effects(&mut harness), []);
    let note = harness.state().state.export.note.clone();
    assert!(note.is_some_and(|note| note.contains("a.jpg") && note.contains(".png")));
    click(&mut harness, "EXR");
    click(&mut harness, "Start export");
    let order = order(&mut harness);
    assert_eq!(order.settings.still_kind, FileKind::Exr);
    assert_eq!(order.path, Path::new("/pictures/a.exr"));
    assert!(order.may_replace, "as the window says");
}

#[test]
fn what_runs_shows_how_far_it_is_and_can_be_cancelled() {
    let mut state = state();
    state.export.is_open = true;
    state.export.running = Some(RunningExport {
        path: PathBuf::from("/pictures/a.gif"),
        fraction: 0.25,
        started_secs: 0.0,
    });
    let mut harness = harness(state);
    harness.get_by_label("Export 25 %");
    harness.get_by_label("a.gif");
    click(&mut harness, "Cancel export");
    assert_eq!(
        effects(&mut harness),
        [Effect::Export(ExportEffect::Cancel)]
    );
}
