//! The environment panel: which surroundings light the object, and where they stand.

use egui::{ScrollArea, Ui};
use glam::Vec3;

use crate::app::command::Command;
use crate::app::panels::widgets::{Setting, heading, slider_row, vector_row, weak};
use crate::app::state::{AppState, EnvironmentContent, Look, PathPurpose};
use crate::neif::EnvironmentTransform;

const SCALE: Setting = Setting {
    name: "Scale",
    range: 0.1..=10.0,
    default: 1.0,
    hint: "Size of the environment about the origin",
};
const EXPOSURE: Setting = Setting {
    name: "Exposure",
    range: -10.0..=10.0,
    default: 0.0,
    hint: "Brightness in stops: +1 is twice the light",
};

/// Draws the panel.
pub fn environment_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        heading(ui, "Environment");
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let is_moved = state.look.transform != EnvironmentTransform::default();
            let reset = ui.add_enabled(is_moved, egui::Button::new("Reset environment"));
            if reset
                .on_hover_text("Back to where it was captured")
                .clicked()
            {
                commands.push(Command::MoveEnvironment(EnvironmentTransform::default()));
            }
        });
    });
    list_ui(ui, state, commands);
    facts_ui(ui, state);
    transform_ui(ui, state, commands);
    ui.add_space(6.0);
    original_ui(ui, state, commands);
}

fn list_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ScrollArea::vertical()
        .max_height(130.0)
        .auto_shrink([false, true])
        .id_salt("environments")
        .show(ui, |ui| {
            let own = match &state.snapshot {
                Some(snapshot) if snapshot.object.is_none() => {
                    format!("{} (opened)", snapshot.environment.name())
                }
                _ => "As captured".to_owned(),
            };
            let row = ui.radio(state.look.environment.is_none(), own);
            if row
                .on_hover_text("The surroundings of the photos")
                .clicked()
            {
                commands.push(Command::ChooseEnvironment(None));
            }
            for (i, entry) in state.environments.iter().enumerate() {
                let text = match &entry.content {
                    EnvironmentContent::Loading => format!("{} (loading…)", entry.name),
                    EnvironmentContent::Failed(_) => format!("{} (cannot be used)", entry.name),
                    _ => entry.name.clone(),
                };
                let row = ui.radio(state.look.environment == Some(i), text);
                if row
                    .on_hover_text(entry.path.display().to_string())
                    .clicked()
                {
                    commands.push(Command::ChooseEnvironment(Some(i)));
                }
            }
        });
    if ui
        .button("Add environment…")
        .on_hover_text("A trained environment (.safetensors) or a panorama (.hdr, .exr)")
        .clicked()
    {
        commands.push(Command::AskPath(PathPurpose::Open));
    }
}

/// Where the shown surroundings have their top, how large they are, and whether they are near at all.
fn facts_ui(ui: &mut Ui, state: &AppState) {
    let own = state
        .snapshot
        .as_ref()
        .map(|snapshot| &snapshot.environment);
    let Some(environment) = state.chosen_environment().or(own) else {
        return;
    };
    let size = if environment.is_far() {
        "infinitely far".to_owned()
    } else {
        let side = environment.inner_box().extent().x * state.look.transform.scale;
        format!("inner box {side:.2}")
    };
    let facts = weak(ui, format!("Up {} · {size}", axis_name(environment.up())));
    ui.label(facts).on_hover_text(
        "The up axis, and the side of the box in which the surroundings are finest, in scene units. What is infinitely far does not move or scale.",
    );
}

/// `+z` for the z axis; the vector where it is none of the axes.
fn axis_name(axis: Vec3) -> String {
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
    vector_row(ui, "Rotate", &mut transform.rotate_deg, 0.5, "°");
    vector_row(
        ui,
        "Move",
        &mut transform.translate,
        f64::from(size) * 0.004,
        "",
    );
    slider_row(ui, &SCALE, &mut transform.scale);
    slider_row(ui, &EXPOSURE, &mut transform.exposure_ev);
    let button = egui::Button::new("Match exposure");
    let button = ui.add_enabled(state.chosen_environment().is_some(), button);
    let button = button
        .on_hover_text("Exposure and white balance by which these surroundings light the object as much as its own")
        .on_disabled_hover_text("Choose other surroundings first");
    if button.clicked() {
        commands.push(Command::MatchExposure);
    }
    ui.label(weak(
        ui,
        "In the picture: Shift+drag rotates,\nCtrl+Shift+drag moves.",
    ));
    if transform != state.look.transform {
        commands.push(Command::MoveEnvironment(transform));
    }
}

fn original_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut is_on = state.is_original_shown;
    let has_edits = state.look != Look::default();
    let toggle = ui.add_enabled(
        has_edits,
        egui::Checkbox::new(&mut is_on, "Show before edits"),
    );
    let toggle = toggle.on_hover_text("Hides all edits of material and environment (B)");
    if toggle.on_disabled_hover_text("Nothing is edited").changed() {
        commands.push(Command::ShowOriginal(is_on));
    }
}
