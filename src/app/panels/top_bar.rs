//! The bar at the top: open and save, what is open, layers, comparison, help.

use egui::{Align, Layout, RichText, Ui};

use crate::app::command::Command;
use crate::app::panels::widgets::weak;
use crate::app::state::{AppState, PathPurpose, Source};
use crate::render::Layer;

/// Draws the bar.
pub fn top_bar_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        if ui
            .button("Open…")
            .on_hover_text("A capture, a saved run or an environment (Ctrl+O)")
            .clicked()
        {
            commands.push(Command::AskPath(PathPurpose::Open));
        }
        let can_save = state.training.phase.takes_commands();
        let save = ui.add_enabled(can_save, egui::Button::new("Save run…"));
        let save =
            save.on_hover_text("Keeps the trained model and everything to go on with it (Ctrl+S)");
        if save
            .on_disabled_hover_text("There is no training to save")
            .clicked()
        {
            commands.push(Command::AskPath(PathPurpose::Save));
        }
        ui.separator();
        source_ui(ui, state);
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            if ui
                .button("Help")
                .on_hover_text("Keys and mouse (?)")
                .clicked()
            {
                commands.push(Command::ToggleHelp);
            }
            ui.separator();
            compare_ui(ui, state, commands);
            ui.separator();
            layers_ui(ui, state, commands);
        });
    });
}

fn source_ui(ui: &mut Ui, state: &AppState) {
    let name = ui.label(RichText::new(state.source.name()).strong());
    if let Some(path) = state.source.path() {
        name.on_hover_text(path.display().to_string());
    }
    let kind = match state.source {
        Source::Nothing | Source::Demo(_) => return,
        Source::Capture(_) => "capture",
        Source::Run(_) => "saved run",
        Source::Environment(_) => "environment",
    };
    ui.label(weak(ui, kind));
}

/// A layer's name for people.
pub fn layer_name(layer: Layer) -> &'static str {
    match layer {
        Layer::Final => "Lit",
        Layer::Diffuse => "Diffuse",
        Layer::Specular => "Specular",
        Layer::Roughness => "Roughness",
        Layer::Tint => "Tint",
        Layer::Normal => "Normals",
        Layer::Environment => "Environment",
    }
}

fn layers_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    // Right to left, so in reverse.
    for (i, layer) in Layer::ALL.into_iter().enumerate().rev() {
        let button = ui.selectable_label(state.layer == layer, layer_name(layer));
        if button.on_hover_text(format!("Key {}", i + 1)).clicked() {
            commands.push(Command::ShowLayer(layer));
        }
    }
}

fn compare_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let has_photos = state.view_at(0).is_some();
    let is_on = state.compare.wipe.is_some();
    let wipe = ui.add_enabled(has_photos, egui::Button::selectable(is_on, "Photo wipe"));
    let wipe = wipe.on_hover_text(
        "Photo left of the line, rendering right of it (W). Hold G for the photo alone",
    );
    if wipe
        .on_disabled_hover_text("There is no photo to compare with")
        .clicked()
    {
        commands.push(Command::SetWipe(if is_on { None } else { Some(0.5) }));
    }
}
