//! The bar at the top: menus, what is open, layers, comparison, help.

use egui::containers::menu::{MenuBar, MenuButton};
use egui::style::StyleModifier;
use egui::{Align, Button, Layout, RichText, Role, Ui, WidgetInfo};

use crate::app::command::Command;
use crate::app::history::{HistoryCommand, can_redo, can_undo};
use crate::app::panels::export::running_export_ui;
use crate::app::panels::menus_ui;
use crate::app::panels::widgets::weak;
use crate::app::state::{AppState, Source};
use crate::app::watch::{Comparison, WatchCommand};
use crate::render::Layer;

/// Draws the bar.
pub fn top_bar_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    // The menu style would take the frames off all buttons of the bar.
    let bar = MenuBar::new().style(StyleModifier::default());
    bar.ui(ui, |ui| {
        menus_ui(ui, state, commands);
        ui.separator();
        history_ui(ui, state, commands);
        ui.separator();
        running_export_ui(ui, state, commands);
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

fn history_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let buttons = [
        ("↺", "Undo", can_undo(state), HistoryCommand::Undo),
        ("↻", "Redo", can_redo(state), HistoryCommand::Redo),
    ];
    for (sign, name, is_enabled, command) in buttons {
        let button = ui.add_enabled(is_enabled, Button::new(RichText::new(sign).monospace()));
        button.widget_info(|| WidgetInfo::labeled(Role::Button, is_enabled, name));
        if button.on_hover_text(name).clicked() {
            commands.push(Command::History(command));
        }
    }
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
        Layer::Depth => "Depth",
        Layer::Visibility => "Visibility",
        Layer::Samples => "Samples",
    }
}

/// Layers with a button of their own; the others are in the menu.
const N_BUTTONS: usize = 7;
/// Room under which all layers are in the menu.
const BUTTONS_WIDTH: f32 = 560.0;

fn layers_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let n_buttons = if ui.available_width() < BUTTONS_WIDTH {
        0
    } else {
        N_BUTTONS
    };
    let row = |ui: &mut Ui, i: usize| {
        let layer = Layer::ALL[i];
        let button = ui.selectable_label(state.layer == layer, layer_name(layer));
        let hint = format!("Key {}", (i + 1) % 10);
        button.on_hover_text(hint).clicked().then_some(layer)
    };
    // Right to left, so in reverse.
    let in_menu = n_buttons..Layer::ALL.len();
    let shown = Layer::ALL[in_menu.clone()]
        .iter()
        .find(|layer| **layer == state.layer);
    let title = shown.map_or("Layers", |layer| layer_name(*layer));
    let title = Button::selectable(shown.is_some(), format!("{title}…"));
    let (menu, inside) = MenuButton::from_button(title).ui(ui, |ui| {
        in_menu.fold(None, |chosen, i| row(ui, i).or(chosen))
    });
    menu.on_hover_text("What is shown: also depth (8), visibility (9), samples (0)");
    let mut chosen = inside.and_then(|inside| inside.inner);
    for i in (0..n_buttons).rev() {
        chosen = row(ui, i).or(chosen);
    }
    commands.extend(chosen.map(Command::ShowLayer));
}

fn compare_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let has_photos = state.view_at(0).is_some();
    let now = state.compare.with_photo;
    // Right to left, so in reverse.
    let are_shown = state.watch.are_cameras_shown;
    let cameras = ui.add_enabled(has_photos, Button::selectable(are_shown, "Cameras"));
    let cameras = cameras.on_hover_text("Where the photos were taken; click one to go there (C)");
    if cameras
        .on_disabled_hover_text("There are no photos")
        .clicked()
    {
        commands.push(Command::Watch(WatchCommand::ShowCameras(!are_shown)));
    }
    ui.add_enabled_ui(has_photos, |ui| {
        let is_on = now != Comparison::Off;
        let title = if is_on { now.name() } else { "Compare" };
        let title = Button::selectable(is_on, format!("{title}…"));
        let (menu, _) = MenuButton::from_button(title).ui(ui, |ui| {
            for comparison in Comparison::ALL {
                let row = ui.selectable_label(now == comparison, comparison.name());
                if row.clicked() {
                    let is_again = now == comparison;
                    let next = if is_again {
                        Comparison::Off
                    } else {
                        comparison
                    };
                    commands.push(Command::Watch(WatchCommand::Compare(next)));
                }
            }
        });
        menu.on_hover_text("With the photo: side by side (Shift+W), flicker (T), differences (D)");
    });
    let is_on = state.compare.wipe.is_some();
    let wipe = ui.add_enabled(has_photos, Button::selectable(is_on, "Photo wipe"));
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
