//! What the material panel changes: the whole object, or a region of it.

use egui::Ui;

use crate::app::command::Command;
use crate::app::inspect::InspectCommand;
use crate::app::panels::widgets::{Setting, slider_row, weak};
use crate::app::state::AppState;
use crate::neif::{Extent, Likeness, Region};

const LIKENESS: Setting = Setting {
    name: "Tolerance",
    range: 0.0..=0.6,
    default: 0.15,
    hint: "How much roughness, tint and diffuse colour may differ from the picked point's",
};
const SOFTNESS: Setting = Setting {
    name: "Soft edge",
    range: 0.0..=1.0,
    default: 0.3,
    hint: "How gradually the edit fades out",
};

/// Draws the list of regions and how far the chosen one reaches.
pub fn scope_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let regions = &state.look.regions;
    let mut hovered = None;
    if regions.is_empty() {
        ui.label(weak(
            ui,
            "Click the object to look into a point,\nor to edit a part of it.",
        ));
    } else {
        let chosen = state.scope().map(|(index, _)| index);
        if ui.radio(chosen.is_none(), "Whole object").clicked() {
            push(commands, InspectCommand::ChooseScope(None));
        }
        for (i, region) in regions.iter().enumerate() {
            let is_chosen = chosen == Some(i);
            let row = ui.scope(|ui| region_ui(ui, i, region, is_chosen, commands));
            if row.response.contains_pointer() {
                hovered = Some(i);
            }
        }
    }
    if hovered != state.inspect.hovered {
        push(commands, InspectCommand::Hover(hovered));
    }
}

fn region_ui(
    ui: &mut Ui,
    index: usize,
    region: &Region,
    is_chosen: bool,
    commands: &mut Vec<Command>,
) {
    let number = index + 1;
    ui.horizontal(|ui| {
        let what = match region.extent {
            Extent::Part => "part",
            Extent::Material(_) => "like material",
        };
        let row = ui.radio(is_chosen, format!("Region {number} ({what})"));
        if row
            .on_hover_text("Shown in the picture while the pointer is here")
            .clicked()
        {
            push(commands, InspectCommand::ChooseScope(Some(index)));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.small_button(format!("Delete region {number}")).clicked() {
                push(commands, InspectCommand::RemoveRegion(index));
            }
        });
    });
    if let (true, Extent::Material(like)) = (is_chosen, region.extent) {
        let mut changed = like;
        likeness_ui(ui, &mut changed);
        if changed != like {
            let extent = Extent::Material(changed);
            push(commands, InspectCommand::SetExtent(index, extent));
        }
    }
}

fn likeness_ui(ui: &mut Ui, like: &mut Likeness) {
    slider_row(ui, &LIKENESS, &mut like.threshold);
    slider_row(ui, &SOFTNESS, &mut like.softness);
    ui.checkbox(&mut like.within_part, "Connected part only")
        .on_hover_text("Keeps to the part of the mesh that was clicked");
}

fn push(commands: &mut Vec<Command>, command: InspectCommand) {
    commands.push(Command::Inspect(command));
}
