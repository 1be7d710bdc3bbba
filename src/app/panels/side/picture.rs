//! The picture panel: how the scene is shown, apart from its light: background, lens, exposure, A beside B.

use egui::{Button, Response, Ui};
use glam::Vec3;
use strum::VariantArray as _;

use super::environment::axis_name;
use crate::app::lighting::{LARGEST_DISPLAY_EV, LightingCommand};
use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{Setting, choices_ui, name_label, on_click, slider_row};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::app::viewport::camera_control::{CameraMove, LENS_RANGE};
use crate::render::{Background, ToneMap};

const DISPLAY_EV: Setting = Setting {
    name: "View EV",
    range: -LARGEST_DISPLAY_EV..=LARGEST_DISPLAY_EV,
    default: 0.0,
    hint: "Exposure of the picture in stops; the light stays as it is (E, Shift+E)",
};

/// Draws the panel.
pub fn picture_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !section_heading(ui, state, Section::Picture, commands) {
        return;
    }
    background_ui(ui, state, commands);
    camera_ui(ui, state, commands);
    let mut ev = state.lighting.display_ev;
    if slider_row(ui, &DISPLAY_EV, &mut ev) {
        commands.push(Command::Lighting(LightingCommand::SetDisplayEv(ev)));
    }
    ui.horizontal(|ui| {
        name_label(ui, "Bright light").on_hover_text("What becomes of light brighter than white");
        let maps = ToneMap::VARIANTS.iter().copied().map(tone_map);
        if let Some(map) = choices_ui(ui, state.lighting.tone_map, maps) {
            commands.push(Command::Lighting(LightingCommand::SetToneMap(map)));
        }
    });
    let mut send = |button: Response, command| {
        on_click(&button, Command::Lighting(command), commands);
    };
    ui.horizontal(|ui| {
        let is_on = state.lighting.split.is_some();
        let both = ui.add(Button::selectable(is_on, "A | B"));
        let what =
            "Two looks side by side: A as edited, B as kept when this was first switched on (V)";
        send(both.on_hover_text(what), LightingCommand::ToggleSplit);
        let swap = ui.add_enabled(state.lighting.kept.is_some(), Button::new("Swap A and B"));
        send(swap.on_hover_text("X"), LightingCommand::SwapSides);
        let copy = ui.button("Keep A as B");
        let what = "B becomes what A is now: material, environment and where it stands";
        send(copy.on_hover_text(what), LightingCommand::CopyToB);
    });
}

/// What stands behind the object.
fn background_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        name_label(ui, "Background").on_hover_text("What stands behind the object (H)");
        ui.spacing_mut().item_spacing.x = 2.0;
        let backgrounds = Background::VARIANTS.iter().copied().map(background);
        if let Some(chosen) = choices_ui(ui, state.lighting.background, backgrounds) {
            commands.push(Command::Lighting(LightingCommand::SetBackground(chosen)));
        }
    });
}

/// The lens and the way up.
fn camera_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let [narrow, wide] = LENS_RANGE.map(f32::to_degrees);
    let lens = Setting {
        name: "Field of view",
        range: narrow.round()..=wide.round(),
        default: tenths(state.view.home.field_of_view().to_degrees()),
        hint: "Vertical angle of the picture, degrees",
    };
    // The slider rounds what it is given, which is no change by a person.
    let shown = tenths(state.view.viewpoint.field_of_view().to_degrees());
    let mut degrees = shown;
    if slider_row(ui, &lens, &mut degrees) && degrees != shown {
        let lens = CameraMove::Lens(degrees.to_radians());
        commands.push(Command::MoveCamera(lens));
    }
    ui.horizontal(|ui| {
        let hint =
            "What the camera turns about and keeps upright; the environment turns about it too";
        name_label(ui, "Up axis").on_hover_text(hint);
        ui.spacing_mut().item_spacing.x = 2.0;
        let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        let now = axes.clone().find(|axis| state.view.up.dot(*axis) > 0.999);
        let axes = axes.map(|axis| (Some(axis), axis_name(axis), hint));
        let chosen = choices_ui(ui, now, axes).flatten();
        commands.extend(chosen.map(Command::SetUp));
    });
}

fn tenths(value: f32) -> f32 {
    (value * 10.0).round() / 10.0
}

/// With its name and a hint.
fn tone_map(map: ToneMap) -> (ToneMap, &'static str, &'static str) {
    let (name, hint) = match map {
        ToneMap::Photo => ("As in photos", "Clipped at white; what training compares"),
        ToneMap::Neutral => (
            "Neutral",
            "Compressed, so that lamps keep their shape (Khronos PBR Neutral)",
        ),
    };
    (map, name, hint)
}

/// With its name and a hint.
fn background(background: Background) -> (Background, &'static str, &'static str) {
    let (name, hint) = match background {
        Background::Auto => (
            "Auto",
            "As sharp as it is; out of focus where no photo showed it",
        ),
        Background::Shown => ("Shown", "As sharp as it is"),
        Background::Blurred => ("Blurred", "Out of focus; reflections stay sharp"),
        Background::Hidden => ("Hidden", "Black; its light stays"),
    };
    (background, name, hint)
}
