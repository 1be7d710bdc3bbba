//! Photos are visited, and compared with the picture.

use super::*;

#[test]
fn photos_are_visited_by_key_list_and_button() {
    let mut harness = harness(training_state());
    let at = |harness: &Harness<'_, Shown>| harness.state().state.view.at_view;
    assert_eq!(at(&harness), Some(0));
    harness.key_press(egui::Key::OpenBracket);
    harness.run_steps(2);
    assert_eq!(at(&harness), Some(2), "the list goes around");
    click(&mut harness, "train / b");
    assert_eq!(at(&harness), Some(1));
    click(&mut harness, "Next");
    assert_eq!(at(&harness), Some(2));
    let camera = harness.state().state.view.viewpoint.camera;
    assert_eq!(
        camera,
        dataset().val[0].camera,
        "exactly where the photo was taken"
    );
}

#[test]
fn the_wipe_is_switched_by_key_and_dragged() {
    let (mut harness, _) = with_picture();
    harness.key_press(egui::Key::W);
    harness.run_steps(2);
    assert_eq!(harness.state().state.compare.wipe, Some(0.5));
    let line = harness
        .get_by_label("Wipe between photo and rendering")
        .rect()
        .center();
    drag(
        &mut harness,
        line,
        egui::vec2(-100.0, 0.0),
        egui::Modifiers::NONE,
    );
    let wipe = harness.state().state.compare.wipe.expect("still on");
    assert!(wipe < 0.45, "{wipe}");
    assert_eq!(
        harness.state().state.view.at_view,
        Some(0),
        "the camera stayed"
    );
}

#[test]
fn holding_g_shows_the_photo() {
    let (mut harness, _) = with_picture();
    harness.key_down(egui::Key::G);
    harness.run_steps(2);
    assert!(harness.state().state.compare.is_photo_held);
    harness.key_up(egui::Key::G);
    harness.run_steps(2);
    assert!(!harness.state().state.compare.is_photo_held);
}

#[test]
fn away_from_all_photos_the_wipe_goes_to_the_nearest() {
    let mut state = training_state();
    let mut asked = Vec::new();
    let near_b =
        Affine3A::from_translation(Vec3::splat(0.01)) * dataset().train[1].camera.world_from_camera;
    state.view.viewpoint.camera.world_from_camera = near_b;
    apply(
        &mut state,
        Command::MoveCamera(CameraMove::Dolly(1.01)),
        &mut asked,
    );
    assert_eq!(state.view.at_view, None);
    apply(&mut state, Command::SetWipe(Some(0.5)), &mut asked);
    assert_eq!(state.view.at_view, Some(1));
}
