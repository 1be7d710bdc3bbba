//! The material panel: roughness, specular tint, diffuse, before and after.

use egui::{Button, Ui};

use super::scope::{reach_ui, scope_ui};
use crate::app::inspect::InspectCommand;
use crate::app::panels::section::section_row;
use crate::app::panels::widgets::{Setting, color_row, on_click, slider_row, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::neif::{MaterialEdit, RoughnessEdit};

const ROUGHNESS_SCALE: Setting = Setting {
    name: "Scale",
    range: 0.0..=3.0,
    default: 1.0,
    hint: "Multiplies the learned roughness",
};
const ROUGHNESS_OFFSET: Setting = Setting {
    name: "Offset",
    range: -1.0..=1.0,
    default: 0.0,
    hint: "Added to the learned roughness",
};
const ROUGHNESS_VALUE: Setting = Setting {
    name: "Value",
    range: 0.0..=1.0,
    default: 0.3,
    hint: "0 is a mirror, 1 is dull",
};
const TINT_SCALE: Setting = Setting {
    name: "Strength",
    range: 0.0..=2.0,
    default: 1.0,
    hint: "Multiplies all reflections",
};
const DIFFUSE_GAIN: Setting = Setting {
    name: "Brightness",
    range: 0.0..=3.0,
    default: 1.0,
    hint: "Multiplies the diffuse colour",
};

/// Draws the panel.
pub fn material_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let scope = state.scope();
    let before = scope.map_or(state.look.edit, |(_, region)| region.edit);
    let command = |edit: MaterialEdit| match scope {
        Some((index, _)) => Command::Inspect(InspectCommand::Edit(index, edit)),
        None => Command::Edit(edit),
    };
    let is_open = section_row(ui, state, Section::Material, commands, |ui, commands| {
        let learned = MaterialEdit::default();
        let reset = ui.add_enabled(before != learned, Button::new("Reset material"));
        let reset = reset.on_hover_text("All of it back to what was learned");
        on_click(&reset, command(learned), commands);
    });
    if !is_open {
        return;
    }
    if state.snapshot.is_some() && state.object().is_none() {
        ui.label(weak(ui, "There is no object to edit."));
        return;
    }
    scope_ui(ui, state, commands);
    let mut edit = before;
    roughness_ui(ui, &mut edit.roughness);
    ui.label(weak(ui, "Specular tint"));
    slider_row(ui, &TINT_SCALE, &mut edit.tint_scale);
    color_row(ui, "Colour", &mut edit.tint_color);
    ui.label(weak(ui, "Diffuse"));
    diffuse_ui(ui, &mut edit);
    reach_ui(ui, state, commands);
    if edit != before {
        commands.push(command(edit));
    }
}

fn roughness_ui(ui: &mut Ui, roughness: &mut RoughnessEdit) {
    ui.label(weak(ui, "Roughness"));
    ui.horizontal(|ui| {
        let is_map = matches!(roughness, RoughnessEdit::Map { .. });
        let map = ui
            .radio(is_map, "Learned map")
            .on_hover_text("Keeps differences between places");
        if map.clicked() && !is_map {
            *roughness = RoughnessEdit::default();
        }
        let one = ui
            .radio(!is_map, "One value")
            .on_hover_text("The same everywhere");
        if one.clicked() && is_map {
            *roughness = RoughnessEdit::Constant(ROUGHNESS_VALUE.default);
        }
    });
    match roughness {
        RoughnessEdit::Map { scale, offset } => {
            slider_row(ui, &ROUGHNESS_SCALE, scale);
            slider_row(ui, &ROUGHNESS_OFFSET, offset);
        }
        RoughnessEdit::Constant(value) => {
            slider_row(ui, &ROUGHNESS_VALUE, value);
            // As high as the map's two rows: what is below stays where it is when a region with the other is chosen.
            ui.allocate_space(egui::vec2(0.0, ui.spacing().interact_size.y));
        }
    }
}

/// Brightness and colour of the diffuse part are one gain: brightness is its largest channel.
fn diffuse_ui(ui: &mut Ui, edit: &mut MaterialEdit) {
    let mut brightness = edit.diffuse_gain.max_element();
    let mut color = if brightness > 0.0 {
        edit.diffuse_gain / brightness
    } else {
        glam::Vec3::ONE
    };
    let is_changed = slider_row(ui, &DIFFUSE_GAIN, &mut brightness)
        | color_row(ui, "Diffuse colour", &mut color);
    if is_changed {
        edit.diffuse_gain = color * brightness;
    }
}
