//! Lays the panels out around the viewport.

use egui::{CentralPanel, Frame, Margin, Panel, ScrollArea, Ui};

use super::object::panel::object_panel_ui;
use super::panels::frame::help::help_ui;
use super::panels::frame::palette::palette_ui;
use super::panels::frame::path_dialog::path_dialog_ui;
use super::panels::frame::questions::{leaving_question_ui, recovery_ui, stop_question_ui};
use super::panels::frame::status::status_ui;
use super::panels::frame::toasts::toasts_ui;
use super::panels::frame::top_bar::top_bar_ui;
use super::panels::frame::view_bar::view_bar_ui;
use super::panels::side::cameras::cameras_ui;
use super::panels::side::environment::environment_ui;
use super::panels::side::export::export_ui;
use super::panels::side::inspect::inspect_ui;
use super::panels::side::log::log_ui;
use super::panels::side::material::material_ui;
use super::panels::side::picture::picture_ui;
use super::panels::side::plots::plots_ui;
use super::panels::side::skips::skips_ui;
use super::panels::side::slice::slice_ui;
use super::panels::side::training::training_ui;
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
    Panel::top("top")
        .frame(bar)
        .show(ui, |ui| top_bar_ui(ui, state, commands));
    Panel::bottom("status")
        .frame(bar)
        .show(ui, |ui| status_ui(ui, state, commands));
    side_panel(ui, state, Side::Left, commands, |ui, commands| {
        if state.object.is_open {
            object_panel_ui(ui, state, &pictures.object, commands);
            return;
        }
        let is_folded = state.preferences.folded.contains(&Section::Photos);
        let photos = if is_folded {
            FOLDED_HEIGHT
        } else {
            PHOTOS_HEIGHT
        };
        let room = (ui.available_height() - photos).max(0.0);
        ScrollArea::vertical()
            .id_salt("training")
            .max_height(room)
            .show(ui, |ui| {
                training_ui(ui, state, commands);
                skips_ui(ui, state, commands);
                slice_ui(ui, state, pictures.slice, commands);
                plots_ui(ui, state, commands);
            });
        cameras_ui(ui, state, commands);
    });
    side_panel(ui, state, Side::Right, commands, |ui, commands| {
        let scroll = ScrollArea::vertical().auto_shrink([false, false]);
        scroll.show(ui, |ui| {
            material_ui(ui, state, commands);
            ui.separator();
            inspect_ui(ui, state, pictures, commands);
            environment_ui(ui, state, pictures, commands);
            ui.separator();
            picture_ui(ui, state, commands);
        });
    });
    Panel::top("view")
        .frame(bar)
        .show(ui, |ui| view_bar_ui(ui, state, commands));
    let size = CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
        let size = viewport_ui(ui, state, pictures, commands);
        toasts_ui(ui, state, commands);
        recovery_ui(ui, state, commands);
        size
    });
    help_ui(ui, state, commands);
    palette_ui(ui, state, commands);
    path_dialog_ui(ui, state, commands);
    export_ui(ui, state, commands);
    log_ui(ui, state, commands);
    stop_question_ui(ui, state, commands);
    leaving_question_ui(ui, state, commands);
    size.inner
}

/// A panel beside the viewport, unless it is hidden. Its width is kept once it was dragged; a point more or less is the
/// layout's own doing.
fn side_panel(
    ui: &mut Ui,
    state: &AppState,
    side: Side,
    commands: &mut Vec<Command>,
    content: impl FnOnce(&mut Ui, &mut Vec<Command>),
) {
    let shown = state.preferences.panels.side(side);
    if shown.is_hidden {
        return;
    }
    let (panel, usual, least) = match side {
        Side::Left => (Panel::left("left"), LEFT_WIDTH, 220.0),
        Side::Right => (Panel::right("right"), RIGHT_WIDTH, 280.0),
    };
    let known = shown.width.unwrap_or(usual);
    let panel = panel
        .frame(Frame::NONE.inner_margin(Margin::symmetric(10, 4)))
        .default_size(known)
        .size_range(least..=420.0)
        .show(ui, |ui| content(ui, commands));
    let width = panel.response.rect.width();
    let is_dragged = ui.input(|input| input.pointer.any_down());
    if !is_dragged && (width - known).abs() > 2.0 {
        let resize = PreferencesCommand::Resize(side, width);
        commands.push(Command::Preferences(resize));
    }
}
