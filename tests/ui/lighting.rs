//! How the environment is chosen, seen, grabbed and compared.

use neif::app::state::look::Look;
use neif::neif::field::contraction::FieldFrame;
use neif::neif::field::density_grid::DensityGrid;
use neif::neif::field::radiance_field::{FieldConfig, RadianceField};
use neif::neif::light::environment::EnvironmentPlace;
use neif::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};
use neif::render::Background;
use neif::train::Snapshot;

use super::*;

/// An environment that is near.
fn room() -> Arc<Environment> {
    let grid = GridConfig {
        n_levels: 2,
        coarsest: 2,
        finest: 4,
        log2_table_size: 6,
        least_weight: LEAST_WEIGHT,
    };
    let config = FieldConfig {
        grid,
        n_hidden: 16,
        view_dependent: true,
        integrated: true,
        is_far: false,
    };
    let place = EnvironmentPlace {
        name: "room".to_owned(),
        frame: FieldFrame {
            center: Vec3::ZERO,
            half_side: 2.0,
        },
        gamma: 1.0,
        n_samples: 8,
        up: Vec3::Z,
    };
    let field = RadianceField::new(config, || 0.3);
    Arc::new(Environment::new(place, field, DensityGrid::default()))
}

/// A harness that shows a picture of a model in a room.
fn with_room() -> Harness<'static, Shown> {
    let (mut harness, _) = with_picture();
    let snapshot = Snapshot {
        step: 1,
        object: None,
        environment: room(),
        exposures: None,
    };
    harness.state_mut().state.snapshot = Some(Arc::new(snapshot));
    harness.run_steps(2);
    harness
}

fn press(harness: &mut Harness<'_, Shown>, key: egui::Key) {
    harness.key_press(key);
    harness.run_steps(2);
}

#[test]
fn a_handle_moves_the_environment_along_its_axis_only() {
    let mut harness = with_room();
    assert!(harness.query_by_label("Move environment along X").is_none());
    press(&mut harness, egui::Key::M);
    let before = harness.state().state.view.viewpoint;
    for (label, part) in [
        ("Move environment along Y", 1),
        ("Move environment along Z", 2),
    ] {
        let knob = harness.get_by_label(label).rect().center();
        drag(
            &mut harness,
            knob,
            egui::vec2(30.0, -40.0),
            egui::Modifiers::NONE,
        );
        let transform = harness.state().state.look.transform;
        let mut moved = transform.translate;
        assert!(moved[part].abs() > 0.01, "{label}: {moved}");
        moved[part] = 0.0;
        assert!(moved.length() < 1e-5, "{label}: {moved}");
        click(&mut harness, "Reset environment");
    }
    assert_eq!(harness.state().state.view.viewpoint, before, "the camera");
}

#[test]
fn rings_turn_in_steps_with_ctrl_and_the_square_scales() {
    let mut harness = with_room();
    click(&mut harness, "Handles");
    let ring = harness
        .get_by_label("Rotate environment about Z")
        .rect()
        .center();
    drag(
        &mut harness,
        ring,
        egui::vec2(60.0, 0.0),
        egui::Modifiers::COMMAND,
    );
    let turned = harness.state().state.look.transform.rotate_deg;
    assert!(turned.z.abs() > 1.0, "{turned}");
    assert!(
        (turned.z / 15.0 - (turned.z / 15.0).round()).abs() < 1e-3,
        "{turned}"
    );
    let square = harness.get_by_label("Scale environment").rect().center();
    drag(
        &mut harness,
        square,
        egui::vec2(-40.0, 40.0),
        egui::Modifiers::NONE,
    );
    let scale = harness.state().state.look.transform.scale;
    assert!(scale > 1.2, "{scale}");
    assert_eq!(harness.state().state.lighting.grab, None, "let go");
}

#[test]
fn the_background_and_the_picture_s_exposure_are_chosen_by_button_and_key() {
    let mut harness = with_room();
    let background = |harness: &Harness<'_, Shown>| harness.state().state.lighting.background;
    click(&mut harness, "Blurred");
    assert_eq!(background(&harness), Background::Blurred);
    press(&mut harness, egui::Key::H);
    assert_eq!(background(&harness), Background::Hidden);
    press(&mut harness, egui::Key::E);
    press(&mut harness, egui::Key::E);
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::E);
    harness.run_steps(2);
    let state = &harness.state().state;
    assert_eq!(state.lighting.display_ev, 0.5);
    assert_eq!(state.look, Look::default(), "the light stays");
    let scene = state.scene().expect("a snapshot");
    assert_eq!(
        (scene.background, scene.display_ev),
        (Background::Hidden, 0.5)
    );
    click(&mut harness, "Reset view ev");
    assert_eq!(harness.state().state.lighting.display_ev, 0.0);
}

#[test]
fn a_and_b_are_compared_swapped_and_kept() {
    let mut harness = with_room();
    harness.state_mut().pictures.preview_b = Some(egui::TextureId::default());
    press(&mut harness, egui::Key::V);
    harness.get_by_label("Rotate Z").set_value_accesskit(90.0);
    harness.run_steps(2);
    let line = harness.get_by_label("Line between A and B").rect().center();
    drag(
        &mut harness,
        line,
        egui::vec2(-120.0, 0.0),
        egui::Modifiers::NONE,
    );
    let lighting = &harness.state().state.lighting;
    assert!(
        lighting.split.is_some_and(|at| at < 0.45),
        "{:?}",
        lighting.split
    );
    assert_eq!(lighting.kept, Some(Look::default()), "as it was");
    click(&mut harness, "Swap A and B");
    assert_eq!(harness.state().state.look, Look::default());
    press(&mut harness, egui::Key::X);
    assert_eq!(harness.state().state.look.transform.rotate_deg.z, 90.0);
    click(&mut harness, "Keep A as B");
    let state = &harness.state().state;
    assert_eq!(state.lighting.kept, Some(state.look));
    click(&mut harness, "A | B");
    assert!(harness.query_by_label("Line between A and B").is_none());
}

#[test]
fn an_environment_is_added_by_path_and_taken_off_the_list() {
    let mut harness = with_room();
    click(&mut harness, "Add environment…");
    harness.get_by_label("Path").type_text("/env/RUN");
    harness.run_steps(3);
    click(&mut harness, "Add path");
    assert_eq!(
        effects(&mut harness),
        [Effect::AddEnvironment(PathBuf::from("/env/RUN"))]
    );
    harness
        .state_mut()
        .state
        .environments
        .push(EnvironmentEntry {
            name: "hall".to_owned(),
            path: PathBuf::from("/env/hall.safetensors"),
            about: String::new(),
            content: EnvironmentContent::Ready(room()),
        });
    harness.run_steps(2);
    click(&mut harness, "hall");
    assert_eq!(harness.state().state.look.environment, Some(0));
    click(&mut harness, "Remove hall");
    assert_eq!(harness.state().state.look.environment, None);
    assert!(harness.query_by_label("hall").is_none(), "off the list");
}

#[test]
fn white_balance_is_typed_and_reset() {
    let mut harness = with_room();
    harness.get_by_label("White G").set_value_accesskit(0.5);
    harness.run_steps(2);
    let white = |harness: &Harness<'_, Shown>| harness.state().state.look.transform.white_balance;
    assert_eq!(white(&harness), Vec3::new(1.0, 0.5, 1.0));
    click(&mut harness, "Reset white");
    assert_eq!(white(&harness), Vec3::ONE);
}
