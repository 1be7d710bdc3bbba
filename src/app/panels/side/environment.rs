//! The environment panel: which environment lights the object, and where it stands.

use egui::{Button, Ui};
use glam::Vec3;

use super::gallery::gallery_ui;
use crate::app::lighting::LightingCommand;
use crate::app::lighting::anchor::foot;
use crate::app::panels::section::section_row;
use crate::app::panels::widgets::{Setting, gain_row, on_click, slider_row, vector_row, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::look::Look;
use crate::app::state::sections::Section;
use crate::app::viewport::overlay::Pictures;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::{Environment, EnvironmentTransform};

const SCALE: Setting = Setting {
    name: "Scale",
    range: 0.1..=10.0,
    default: 1.0,
    hint: "Size of the environment about the point that the object stands on",
};
const EXPOSURE: Setting = Setting {
    name: "Exposure",
    range: -10.0..=10.0,
    default: 0.0,
    hint: "Brightness in stops: +1 is twice the light",
};

/// Draws the panel.
pub fn environment_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &Pictures,
    commands: &mut Vec<Command>,
) {
    let is_open = section_row(ui, state, Section::Environment, commands, |ui, commands| {
        let still = EnvironmentTransform::default();
        let is_moved = state.look.transform != still;
        let reset = ui.add_enabled(is_moved, Button::new("Reset environment"));
        let reset = reset.on_hover_text("Back to where it was captured");
        on_click(&reset, Command::MoveEnvironment(still), commands);
    });
    if !is_open {
        return;
    }
    gallery_ui(ui, state, pictures, commands);
    facts_ui(ui, state);
    transform_ui(ui, state, commands);
    ui.add_space(6.0);
    original_ui(ui, state, commands);
}

/// Where the shown environment has its top, how large it is, and whether it is near at all.
fn facts_ui(ui: &mut Ui, state: &AppState) {
    let Some(environment) = state.shown_environment() else {
        return;
    };
    let transform = &state.look.transform;
    let place = if environment.is_far() {
        "infinitely far".to_owned()
    } else {
        let motion = transform.environment_from_world();
        let bounds = environment.inner_box();
        let side = bounds.extent().x * transform.scale;
        let [x, y, z] = motion.world_point(bounds.center()).to_array();
        format!("inner box {side:.2} at {x:.2}, {y:.2}, {z:.2}")
    };
    // The name under its picture, where it is chosen there.
    let chosen = state.chosen_environment().and(state.look.environment);
    let listed = chosen.and_then(|index| state.environments.get(index));
    let name = listed.map_or(environment.name(), |entry| &entry.name);
    let (kind, up) = (kind(environment), axis_name(environment.up()));
    let (scale, ev) = (transform.scale, transform.exposure_ev);
    let facts = format!("{name} · {kind}\nUp {up} · {place}\nScale {scale:.2} · {ev:+.1} EV");
    let facts = weak(ui, facts);
    ui.label(facts).on_hover_text(
        "The up axis, and the side of the box in which the environment is finest, in scene units. What is infinitely far does not move or scale.",
    );
}

fn kind(environment: &Environment) -> &'static str {
    match environment.field() {
        EnvironmentField::Grid { .. } => "trained field",
        EnvironmentField::Paper(_) => "trained network",
        EnvironmentField::Distant(_) => "panorama",
    }
}

/// The name of an axis, `+z`; numbers where it is none of the six.
pub(super) fn axis_name(axis: Vec3) -> String {
    for (name, unit) in ["x", "y", "z"].into_iter().zip(Vec3::AXES) {
        for (sign, unit) in [("+", unit), ("-", -unit)] {
            if axis.dot(unit) > 0.999 {
                return format!("{sign}{name}");
            }
        }
    }
    format!("({:.2}, {:.2}, {:.2})", axis.x, axis.y, axis.z)
}

fn transform_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut transform = state.look.transform;
    let size = state.view.bounds.map_or(1.0, |bounds| bounds.diagonal());
    let speed = f64::from(size) * 0.004;
    vector_row(ui, "Rotate", &mut transform.rotate_deg, 0.5, "°");
    vector_row(ui, "Move", &mut transform.translate, speed, "");
    slider_row(ui, &SCALE, &mut transform.scale);
    let growth = transform.scale / state.look.transform.scale;
    if growth.is_normal() && growth != 1.0 {
        // What the object stands on stays below it.
        let foot = foot(state);
        transform.translate = foot + growth * (transform.translate - foot);
    }
    slider_row(ui, &EXPOSURE, &mut transform.exposure_ev);
    gain_row(ui, "White", &mut transform.white_balance);
    tools_ui(ui, state, commands);
    ui.label(weak(
        ui,
        "In the picture: Shift+drag rotates,\nCtrl+Shift+drag moves.",
    ));
    if transform != state.look.transform {
        commands.push(Command::MoveEnvironment(transform));
    }
}

fn tools_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        let button = Button::new("Match exposure");
        let button = ui.add_enabled(state.chosen_environment().is_some(), button);
        let button = button
            .on_hover_text("Exposure and white balance by which this environment lights the object as much as its own")
            .on_disabled_hover_text("Choose another environment first");
        on_click(&button, Command::MatchExposure, commands);
        let chosen = state.chosen_environment();
        if chosen.is_some_and(|chosen| chosen.lacks_floor()) {
            let button = ui.button("Put on a floor");
            let what = "Objects float in a panorama, which is infinitely far. This makes one of it with a floor below the object";
            on_click(&button.on_hover_text(what), Command::PutOnFloor, commands);
        }
        let set_down = Button::selectable(state.lighting.is_setting_down, "Set down");
        let what = "Press or drag in the picture: the object stands on the surface under the pointer (P)";
        let toggle = Command::Lighting(LightingCommand::ToggleSettingDown);
        on_click(&ui.add(set_down).on_hover_text(what), toggle, commands);
        let handles = Button::selectable(state.lighting.is_gizmo_shown, "Handles");
        let what = "Arrows, rings and a square in the picture to move, turn and scale the environment; Ctrl for round steps (M)";
        let toggle = Command::Lighting(LightingCommand::ToggleGizmo);
        on_click(&ui.add(handles).on_hover_text(what), toggle, commands);
        let lines = Button::selectable(state.lighting.are_lines_shown, "Axes");
        let what = "Bounds and axes of the environment (dashed) and the world's axes (L)";
        let toggle = Command::Lighting(LightingCommand::ToggleLines);
        on_click(&ui.add(lines).on_hover_text(what), toggle, commands);
    });
}

fn original_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut is_on = state.is_original_shown;
    let has_edits = state.look != Look::default();
    let toggle = egui::Checkbox::new(&mut is_on, "Show before edits");
    let toggle = ui.add_enabled(has_edits, toggle);
    let toggle = toggle.on_hover_text("Hides all edits of material and environment (B)");
    if toggle.on_disabled_hover_text("Nothing is edited").changed() {
        commands.push(Command::ShowOriginal(is_on));
    }
}
