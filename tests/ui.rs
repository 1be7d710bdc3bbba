//! The window's panels, driven by their accessible labels; no display and no GPU.
#![cfg(feature = "gui")]

#[path = "ui/camera.rs"]
mod camera;
#[path = "ui/commands.rs"]
mod commands;
#[path = "ui/export.rs"]
mod export;
#[path = "ui/history.rs"]
mod history;
#[path = "ui/inspect.rs"]
mod inspect;
#[path = "ui/lighting.rs"]
mod lighting;
#[path = "ui/object.rs"]
mod object;
#[path = "ui/photos.rs"]
mod photos;
#[path = "ui/pictures.rs"]
mod pictures;
#[path = "ui/training.rs"]
mod training;
#[path = "ui/watch.rs"]
mod watch;

use std::path::PathBuf;
use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::{Affine3A, Quat, Vec3};
use neif::app::changes::history as app_history;
use neif::app::changes::leaving;
use neif::app::keys::{shortcuts, table};
use neif::app::state::app_state::PathPurpose;
use neif::app::state::command::Browse;
use neif::app::state::source::Source;
use neif::app::state::source::{EnvironmentContent, EnvironmentEntry};
use neif::app::state::training_state::{Level, Phase};
use neif::app::viewport::camera_control::CameraMove;
use neif::app::viewport::overlay::Pictures;
use neif::app::work::pace::Pace;
use neif::app::{AppState, Command, Effect, apply, shell, theme};
use neif::data::{Dataset, Origin, Photo, Split, View};
use neif::geometry::{Camera, Mesh};
use neif::neif::distant::{DistantConfig, DistantLight};
use neif::neif::{Environment, EnvironmentTransform, RoughnessEdit};
use neif::render::Layer;
use neif::train::session::events::{Progress, TrainCommand, TrainEvent};
use neif::train::session::handle::Threads;

/// The state with what its commands asked of the world.
#[derive(Default)]
struct Shown {
    state: AppState,
    effects: Vec<Effect>,
    pictures: Pictures,
}

fn harness(state: AppState) -> Harness<'static, Shown> {
    let shown = Shown {
        state,
        ..Shown::default()
    };
    let mut is_set_up = false;
    let draw = move |ui: &mut egui::Ui, shown: &mut Shown| {
        if !is_set_up {
            theme::set_up(ui.ctx());
            is_set_up = true;
        }
        let mut commands = Vec::new();
        shortcuts::pressed(ui.ctx(), &shown.state, &mut commands);
        shell::draw(ui, &shown.state, &shown.pictures, &mut commands);
        for command in commands {
            apply(&mut shown.state, command, &mut shown.effects);
        }
        app_history::watch(&mut shown.state);
        leaving::after_news(&mut shown.state, &mut shown.effects);
    };
    let mut harness = Harness::builder()
        .with_size([1280.0, 800.0])
        .build_ui_state(draw, shown);
    harness.run_steps(3);
    harness
}

fn click(harness: &mut Harness<'_, Shown>, label: &str) {
    harness.get_by_label(label).click();
    harness.run_steps(3);
}

fn effects(harness: &mut Harness<'_, Shown>) -> Vec<Effect> {
    std::mem::take(&mut harness.state_mut().effects)
}

fn view(name: &str, eye: Vec3) -> View {
    View {
        name: name.to_owned(),
        file: PathBuf::new(),
        split: Split::Train,
        camera: Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.8, 32, 24),
        photo: Photo::Ldr {
            width: 32,
            height: 24,
            pixels: vec![[0; 3]; 32 * 24],
        },
        mask: None,
    }
}

fn dataset() -> Arc<Dataset> {
    let positions = vec![Vec3::X, Vec3::Y, Vec3::Z];
    let mesh = Mesh::new(positions, None, vec![[0, 1, 2]]).expect("a triangle is a mesh");
    Arc::new(Dataset {
        name: "test".to_owned(),
        root: PathBuf::from("/capture"),
        origin: Origin::default(),
        train: vec![
            view("a", Vec3::new(3.0, 0.0, 1.0)),
            view("b", Vec3::new(0.0, 3.0, 1.0)),
        ],
        val: vec![view("c", Vec3::new(-3.0, 0.0, 1.0))],
        test: Vec::new(),
        mesh: Some(Arc::new(mesh)),
        first_box: None,
        mesh_path: None,
        environment_visible: true,
        problems: Vec::new(),
    })
}

fn training_state() -> AppState {
    let mut state = AppState {
        source: Source::Capture(PathBuf::from("/capture")),
        ..AppState::default()
    };
    state.set_dataset(dataset());
    state.training.take(TrainEvent::Loaded {
        n_train: 2,
        n_val: 1,
        width: 32,
        height: 24,
        has_object: true,
        problems: Vec::new(),
        found: Vec::new(),
    });
    state.training.take(TrainEvent::Progress(Progress {
        step: 1234,
        loss: 0.01,
        steps_per_sec: 56.0,
        ..Progress::default()
    }));
    state
}

/// An infinitely far, evenly white environment.
fn white_sky() -> Environment {
    let config = DistantConfig {
        width: 16,
        height: 8,
        world_from_picture: Quat::IDENTITY,
        has_floor: false,
    };
    let light = DistantLight::new(config, &[0.5; 16 * 8 * 3]).expect("a picture");
    Environment::of_distant("sky".to_owned(), Vec3::Z, light)
}

#[test]
fn an_empty_window_offers_to_open_something() {
    let mut harness = harness(AppState::default());
    harness.get_by_label("Open a capture to relight it");
    click(&mut harness, "Open the bundled demo");
    assert_eq!(effects(&mut harness), [Effect::OpenDemo]);
}

#[test]
fn roughness_changes_between_map_and_one_value_and_resets() {
    let mut harness = harness(training_state());
    click(&mut harness, "One value");
    let roughness = |harness: &Harness<'_, Shown>| harness.state().state.look.edit.roughness;
    assert!(matches!(roughness(&harness), RoughnessEdit::Constant(_)));
    let slider = harness
        .get_all_by_label("Value")
        .last()
        .expect("a triangle is a mesh");
    slider.set_value_accesskit(0.75);
    harness.run_steps(2);
    assert_eq!(roughness(&harness), RoughnessEdit::Constant(0.75));
    click(&mut harness, "Reset material");
    assert_eq!(
        harness.state().state.look,
        neif::app::state::look::Look::default()
    );
}

#[test]
fn edits_are_hidden_for_comparison() {
    let mut state = training_state();
    state.look.edit.tint_scale = 0.5;
    let mut harness = harness(state);
    click(&mut harness, "Show before edits");
    assert!(harness.state().state.is_original_shown);
    harness.key_press(egui::Key::B);
    harness.run_steps(2);
    assert!(!harness.state().state.is_original_shown);
}

#[test]
fn layers_follow_buttons_and_keys() {
    let mut harness = harness(training_state());
    click(&mut harness, "Normals");
    assert_eq!(harness.state().state.layer, Layer::Normal);
    harness.key_press(egui::Key::Num3);
    harness.run_steps(2);
    assert_eq!(harness.state().state.layer, Layer::Specular);
}

#[test]
fn a_typed_path_is_opened_and_typing_triggers_no_shortcuts() {
    let mut harness = harness(training_state());
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::O);
    harness.run_steps(3);
    harness.get_by_label("Path").type_text("/data/b w 3");
    harness.run_steps(3);
    assert_eq!(
        harness.state().state.layer,
        Layer::Final,
        "a typed 3 is no shortcut"
    );
    click(&mut harness, "Open path");
    assert_eq!(effects(&mut harness), [], "training would be lost");
    click(&mut harness, "Open without saving");
    assert_eq!(
        effects(&mut harness),
        [Effect::Open(PathBuf::from("/data/b w 3"))]
    );
    assert_eq!(harness.state().state.overlays.path_dialog, None);
}

#[test]
fn a_missing_file_dialog_leaves_the_typed_path() {
    let mut harness = harness(AppState::default());
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::O);
    harness.run_steps(3);
    click(&mut harness, "Browse for a folder…");
    assert_eq!(
        effects(&mut harness),
        [Effect::Browse(Browse::Folder, PathPurpose::Open)]
    );
    let mut asked = Vec::new();
    let answer = Command::Browsed(Err("There is no file dialog".to_owned()));
    apply(&mut harness.state_mut().state, answer, &mut asked);
    harness.run_steps(2);
    harness.get_by_label("There is no file dialog");
}

#[test]
fn recent_paths_open_again() {
    let state = AppState {
        recent: vec![PathBuf::from("/data/mug")],
        ..AppState::default()
    };
    let mut harness = harness(state);
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::O);
    harness.run_steps(3);
    click(&mut harness, "mug   /data");
    assert_eq!(
        effects(&mut harness),
        [Effect::Open(PathBuf::from("/data/mug"))]
    );
}

#[test]
fn another_environment_is_read_when_it_is_chosen() {
    let mut state = training_state();
    state.environments.push(EnvironmentEntry {
        name: "gallery".to_owned(),
        path: PathBuf::from("/env/gallery.safetensors"),
        about: String::new(),
        content: EnvironmentContent::NotLoaded,
    });
    let mut harness = harness(state);
    click(&mut harness, "gallery");
    assert_eq!(effects(&mut harness), [Effect::LoadEnvironment(0)]);
    harness.get_by_label("gallery (loading…)");
    click(&mut harness, "As captured");
    assert_eq!(harness.state().state.look.environment, None);
}

#[test]
fn the_environment_moves_by_numbers() {
    let mut harness = harness(training_state());
    harness.get_by_label("Rotate Z").set_value_accesskit(90.0);
    harness.run_steps(2);
    harness.get_by_label("Move X").set_value_accesskit(0.5);
    harness.run_steps(2);
    let transform = harness.state().state.look.transform;
    assert_eq!(
        (transform.rotate_deg, transform.translate),
        (Vec3::new(0.0, 0.0, 90.0), Vec3::X * 0.5)
    );
    click(&mut harness, "Reset environment");
    assert_eq!(
        harness.state().state.look.transform,
        EnvironmentTransform::default()
    );
}

#[test]
fn long_numbers_leave_the_panels_their_width() {
    let mut harness = harness(training_state());
    let width = |harness: &Harness<'static, Shown>| {
        harness.get_by_label("Reset environment").rect().right()
    };
    let before = width(&harness);
    let transform = &mut harness.state_mut().state.look.transform;
    transform.rotate_deg = Vec3::new(-142.348, -99.761, -150.333);
    transform.translate = Vec3::new(-1234.567, -33.333, -0.777);
    harness.run_steps(3);
    assert_eq!(width(&harness), before);
    harness.get_by_label("Rotate X");
}

/// A harness whose viewport shows a picture, and a point inside the viewport.
fn with_picture() -> (Harness<'static, Shown>, egui::Pos2) {
    let mut harness = harness(training_state());
    harness.state_mut().pictures.preview = Some(egui::TextureId::default());
    harness.state_mut().pictures.photo = Some(egui::TextureId::default());
    harness.run_steps(2);
    let center = harness.get_by_label("Preview of the scene").rect().center();
    (harness, center)
}

fn drag(
    harness: &mut Harness<'_, Shown>,
    from: egui::Pos2,
    by: egui::Vec2,
    modifiers: egui::Modifiers,
) {
    harness.event(egui::Event::ModifiersChanged(modifiers));
    harness.hover_at(from);
    harness.run_steps(2);
    harness.drag_at(from);
    harness.run_steps(1);
    for i in 1..=4 {
        harness.hover_at(from + by * (i as f32 / 4.0));
        harness.run_steps(1);
    }
    harness.drop_at(from + by);
    harness.event(egui::Event::ModifiersChanged(egui::Modifiers::NONE));
    harness.run_steps(2);
}

#[test]
fn a_drag_orbits_and_leaves_the_photo() {
    let (mut harness, center) = with_picture();
    let before = harness.state().state.view.viewpoint;
    drag(
        &mut harness,
        center,
        egui::vec2(80.0, 0.0),
        egui::Modifiers::NONE,
    );
    let after = harness.state().state.view;
    assert_eq!(after.at_view, None);
    assert!((after.viewpoint.distance() - before.distance()).abs() < 1e-3);
    assert_ne!(after.viewpoint.camera, before.camera);
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::F);
    harness.run_steps(2);
    assert_eq!(
        harness.state().state.view.viewpoint,
        before,
        "Shift+F goes back"
    );
}

#[test]
fn a_drag_with_shift_turns_the_environment_only() {
    let (mut harness, center) = with_picture();
    let before = harness.state().state.view.viewpoint;
    drag(
        &mut harness,
        center,
        egui::vec2(100.0, 0.0),
        egui::Modifiers::SHIFT,
    );
    let state = &harness.state().state;
    assert_eq!(state.view.viewpoint, before);
    let rotation = state.look.transform.rotate_deg;
    assert!(
        rotation.z.abs() > 5.0 && rotation.truncate() == glam::Vec2::ZERO,
        "{rotation}"
    );
}

#[test]
fn help_lists_every_binding() {
    let mut harness = harness(training_state());
    harness.key_press(egui::Key::Questionmark);
    harness.run_steps(3);
    for binding in table::BINDINGS.iter().filter(|b| !b.keys.is_empty()) {
        assert!(
            harness.query_all_by_label(binding.what).next().is_some(),
            "{} is missing",
            binding.what
        );
    }
    harness.run_steps(12);
    click(&mut harness, "Close");
    assert!(!harness.state().state.overlays.is_help_open);
}

#[test]
fn errors_stay_until_they_are_dismissed() {
    let mut state = training_state();
    state
        .messages
        .say(Level::Error, "/capture/x.json: field `frames` is missing");
    state.messages.now_secs = 1e4;
    let mut harness = harness(state);
    harness.get_by_label("/capture/x.json: field `frames` is missing");
    click(&mut harness, "Dismiss");
    assert!(
        harness
            .query_by_label("/capture/x.json: field `frames` is missing")
            .is_none()
    );
}

#[test]
fn a_failed_capture_says_why_in_the_viewport() {
    let mut state = AppState {
        source: Source::Capture(PathBuf::from("/capture")),
        ..AppState::default()
    };
    state
        .training
        .take(TrainEvent::Failed("no photo could be read".to_owned()));
    let mut harness = harness(state);
    harness.get_by_label("This cannot be used");
    click(&mut harness, "Train again");
    assert_eq!(effects(&mut harness), [Effect::StartTraining]);
}

#[test]
fn the_software_chip_is_shown_on_a_processor_adapter() {
    let mut state = AppState::default();
    state.adapter.is_software = true;
    state.adapter.name = "llvmpipe".to_owned();
    let harness = harness(state);
    harness.get_by_label("software rendering");
}

#[test]
fn another_environment_says_where_it_is_and_can_be_matched() {
    let mut state = training_state();
    state.environments.push(EnvironmentEntry {
        name: "sky".to_owned(),
        path: PathBuf::from("/sky.hdr"),
        about: String::new(),
        content: EnvironmentContent::Ready(Arc::new(white_sky())),
    });
    let mut harness = harness(state);
    assert!(
        harness.query_by_label_contains("infinitely far").is_none(),
        "not yet chosen"
    );
    click(&mut harness, "sky");
    assert!(
        harness
            .query_by_label_contains("Up +z · infinitely far")
            .is_some(),
        "what it is"
    );
    click(&mut harness, "Match exposure");
    assert_eq!(effects(&mut harness), [Effect::MatchExposure]);
}
