//! The bar over the viewport: which layer it shows, and how it is compared with the photo.

use egui::containers::menu::MenuButton;
use egui::{Align, Button, Layout, TextStyle, Ui};
use strum::VariantArray as _;

use crate::app::panels::widgets::on_click;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::watch::{Comparison, WatchCommand};
use crate::render::Layer;

/// Between two buttons.
const GAP: f32 = 4.0;

/// Draws the bar.
pub fn view_bar_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.spacing_mut().item_spacing.x = GAP;
    // From the right first, so that the layers know what room there is.
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        compare_ui(ui, state, commands);
        ui.separator();
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            layers_ui(ui, state, commands);
        });
    });
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
        Layer::Albedo => "Albedo",
        Layer::Irradiance => "Irradiance",
        Layer::Seen => "Seen",
    }
}

fn layers_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let n_buttons = n_that_fit(ui);
    let row = |ui: &mut Ui, i: usize| {
        let layer = Layer::VARIANTS[i];
        let button = ui.selectable_label(state.layer == layer, layer_name(layer));
        let button = match i {
            0..10 => button.on_hover_text(format!("Key {}", (i + 1) % 10)),
            _ => button,
        };
        button.clicked().then_some(layer)
    };
    let mut chosen = (0..n_buttons).fold(None, |chosen, i| row(ui, i).or(chosen));
    let in_menu = n_buttons..Layer::VARIANTS.len();
    if !in_menu.is_empty() {
        let shown = Layer::VARIANTS[in_menu.clone()]
            .iter()
            .find(|layer| **layer == state.layer);
        let title = shown.map_or(MORE, |layer| layer_name(*layer));
        let title = Button::selectable(shown.is_some(), format!("{title}…"));
        let (menu, inside) = MenuButton::from_button(title).ui(ui, |ui| {
            in_menu.fold(None, |chosen, i| row(ui, i).or(chosen))
        });
        menu.on_hover_text(
            "What is shown: also depth (8), visibility (9), samples (0), albedo, irradiance, seen by photos",
        );
        chosen = inside.and_then(|inside| inside.inner).or(chosen);
    }
    commands.extend(chosen.map(Command::ShowLayer));
}

/// The menu of the layers without a button, while none of them is shown.
const MORE: &str = "Layers";

/// Layers for which there is a button each; those that do not fit are in a menu after them.
fn n_that_fit(ui: &Ui) -> usize {
    let font = TextStyle::Button.resolve(ui.style());
    let padding = 2.0 * ui.spacing().button_padding.x + GAP;
    let width = |name: &str| {
        let text = ui
            .painter()
            .layout_no_wrap(name.to_owned(), font.clone(), egui::Color32::WHITE);
        text.size().x + padding
    };
    let room = ui.available_width();
    let layers = Layer::VARIANTS.iter();
    let widths: Vec<f32> = layers.map(|layer| width(layer_name(*layer))).collect();
    if widths.iter().sum::<f32>() <= room {
        return widths.len();
    }
    // The menu may bear the name of any layer in it.
    let menu = widths.iter().copied().fold(0.0, f32::max) + width("…") - padding;
    let mut left = room - menu;
    let fits = |width: &&f32| {
        left -= **width;
        left >= 0.0
    };
    widths.iter().take_while(fits).count()
}

fn compare_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let has_photos = state.view_at(0).is_some();
    let now = state.compare.with_photo;
    // Right to left, so in reverse.
    let are_shown = state.watch.are_cameras_shown;
    let cameras = ui.add_enabled(has_photos, Button::selectable(are_shown, "Cameras"));
    let cameras = cameras.on_hover_text("Where the photos were taken; click one to go there (C)");
    let cameras = cameras.on_disabled_hover_text("There are no photos");
    let show = WatchCommand::ShowCameras(!are_shown);
    on_click(&cameras, Command::Watch(show), commands);
    ui.add_enabled_ui(has_photos, |ui| {
        let is_on = now != Comparison::Off;
        let title = if is_on { now.name() } else { "Compare" };
        let title = Button::selectable(is_on, format!("{title}…"));
        let (menu, _) = MenuButton::from_button(title).ui(ui, |ui| {
            for comparison in Comparison::ALL {
                let is_on = now == comparison;
                let row = ui.selectable_label(is_on, comparison.name());
                let next = if is_on { Comparison::Off } else { comparison };
                let next = WatchCommand::Compare(next);
                on_click(&row, Command::Watch(next), commands);
            }
        });
        menu.on_hover_text("With the photo: side by side (Shift+W), flicker (T), differences (D)");
    });
    let is_on = state.compare.wipe.is_some();
    let wipe = ui.add_enabled(has_photos, Button::selectable(is_on, "Wipe"));
    let wipe = wipe.on_hover_text(
        "Photo left of the line, rendering right of it (W). Hold G for the photo alone",
    );
    let wipe = wipe.on_disabled_hover_text("There is no photo to compare with");
    let next = (!is_on).then_some(0.5);
    on_click(&wipe, Command::SetWipe(next), commands);
}
