//! Lays the panels out around the viewport.

use egui::{CentralPanel, Frame, Margin, Panel, ScrollArea, Ui};

use super::panels;
use super::session::preferences::{PreferencesCommand, Side};
use super::state::app_state::AppState;
use super::state::command::Command;
use super::state::sections::Section;
use super::viewport::canvas::viewport_ui;
use super::viewport::overlay::Pictures;

/// Width of the panel at the left.
const LEFT_WIDTH: f32 = 262.0;
/// Room that the list of photos keeps under the training panel.
const PHOTOS_HEIGHT: f32 = 130.0;
/// The same where it is folded.
const FOLDED_HEIGHT: f32 = 36.0;
/// Width of the panel at the right.
const RIGHT_WIDTH: f32 = 306.0;

/// Draws everything; returns the viewport's size in physical pixels. The only way to change
/// anything is through `commands`.
pub fn draw(
    ui: &mut Ui,
    state: &AppState,
    pictures: &Pictures,
    commands: &mut Vec<Command>,
) -> (u32, u32) {
    let bar = Frame::NONE.inner_margin(Margin::symmetric(10, 5));
    let side = Frame::NONE.inner_margin(Margin::symmetric(10, 4));
    Panel::top("top")
        .frame(bar)
        .show(ui, |ui| panels::top_bar_ui(ui, state, commands));
    Panel::bottom("status")
        .frame(bar)
        .show(ui, |ui| panels::status_ui(ui, state, commands));
    let shown = state.preferences.panels;
    let shown_photos = !state.preferences.folded.has(Section::Photos);
    if !shown.left.is_hidden {
        let width = shown.left.width.unwrap_or(LEFT_WIDTH);
        let panel = Panel::left("left")
            .frame(side)
            .default_size(width)
            .size_range(220.0..=420.0)
            .show(ui, |ui| {
                let photos = if shown_photos {
                    PHOTOS_HEIGHT
                } else {
                    FOLDED_HEIGHT
                };
                let room = (ui.available_height() - photos).max(0.0);
                ScrollArea::vertical()
                    .id_salt("training")
                    .max_height(room)
                    .show(ui, |ui| {
                        panels::training_ui(ui, state, commands);
                        panels::skips_ui(ui, state, commands);
                        panels::slice_ui(ui, state, pictures.slice, commands);
                        panels::plots_ui(ui, state, commands);
                    });
                panels::cameras_ui(ui, state, commands);
            });
        note_width(ui, Side::Left, width, panel.response.rect.width(), commands);
    }
    if !shown.right.is_hidden {
        let width = shown.right.width.unwrap_or(RIGHT_WIDTH);
        let panel = Panel::right("right")
            .frame(side)
            .default_size(width)
            .size_range(280.0..=420.0)
            .show(ui, |ui| {
                ScrollArea::vertical()
                    .auto_shrink([false, false])
                    .show(ui, |ui| {
                        panels::material_ui(ui, state, commands);
                        ui.separator();
                        panels::inspect_ui(ui, state, pictures, commands);
                        panels::environment_ui(ui, state, pictures, commands);
                        ui.separator();
                        panels::picture_ui(ui, state, commands);
                    });
            });
        note_width(
            ui,
            Side::Right,
            width,
            panel.response.rect.width(),
            commands,
        );
    }
    Panel::top("view")
        .frame(bar)
        .show(ui, |ui| panels::view_bar_ui(ui, state, commands));
    let size = CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
        let size = viewport_ui(ui, state, pictures, commands);
        panels::toasts_ui(ui, state, commands);
        panels::recovery_ui(ui, state, commands);
        size
    });
    panels::help_ui(ui, state, commands);
    panels::palette_ui(ui, state, commands);
    panels::path_dialog_ui(ui, state, commands);
    panels::export_ui(ui, state, commands);
    panels::log_ui(ui, state, commands);
    panels::stop_question_ui(ui, state, commands);
    panels::leaving_question_ui(ui, state, commands);
    size.inner
}

/// Keeps a panel's width once it was dragged; a point more or less is the layout's own doing.
fn note_width(ui: &Ui, side: Side, known: f32, width: f32, commands: &mut Vec<Command>) {
    let is_dragged = ui.input(|input| input.pointer.any_down());
    if !is_dragged && (width - known).abs() > 2.0 {
        commands.push(Command::Preferences(PreferencesCommand::Resize(
            side, width,
        )));
    }
}
