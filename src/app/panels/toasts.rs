//! Messages over the viewport, the list of all of them, and the question before stopping.

use egui::{Align2, Area, Color32, Frame, Label, RichText, ScrollArea, Ui, vec2};

use crate::app::command::{Command, Train};
use crate::app::messages::Message;
use crate::app::panels::widgets::{duration, modal, weak};
use crate::app::state::{AppState, PathPurpose};
use crate::app::theme;
use crate::app::training_state::Level;

/// Width of a message.
const WIDTH: f32 = 340.0;

/// Draws the newest messages at the bottom right of `ui`.
pub fn toasts_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let corner = ui.max_rect().right_bottom() - vec2(12.0, 12.0);
    let mut bottom = corner.y;
    for (i, message) in state.messages.shown() {
        let area = Area::new(egui::Id::unique(("toast", i)))
            .pivot(Align2::RIGHT_BOTTOM)
            .fixed_pos(egui::pos2(corner.x, bottom));
        let response = area.show(ui.ctx(), |ui| toast(ui, message));
        if response.inner {
            commands.push(Command::Dismiss(i));
        }
        bottom -= response.response.rect.height() + 6.0;
    }
}

fn toast(ui: &mut Ui, message: &Message) -> bool {
    let color = theme::of_level(ui.visuals(), message.level);
    let frame = Frame::popup(ui.style())
        .stroke(egui::Stroke::new(1.0, color))
        .shadow(egui::Shadow::NONE);
    frame
        .show(ui, |ui| {
            ui.set_max_width(WIDTH);
            ui.horizontal_top(|ui| {
                ui.label(level_text(message.level, color));
                ui.add(Label::new(&message.text).wrap());
                ui.small_button("Dismiss").clicked()
            })
            .inner
        })
        .inner
}

fn level_text(level: Level, color: Color32) -> RichText {
    let text = match level {
        Level::Info => "Note",
        Level::Warning => "Warning",
        Level::Error => "Error",
    };
    RichText::new(text).color(color).strong()
}

/// Draws the list of all messages, while it is open.
pub fn log_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.overlays.is_log_open {
        return;
    }
    let mut is_open = true;
    egui::Window::new("Messages")
        .open(&mut is_open)
        .default_size([520.0, 300.0])
        .show(ui.ctx(), |ui| {
            if ui.button("Copy all").clicked() {
                ui.ctx().copy_text(state.messages.to_text());
            }
            ui.separator();
            ScrollArea::vertical()
                .auto_shrink([false, false])
                .stick_to_bottom(true)
                .show(ui, |ui| {
                    if state.messages.all().len() == 0 {
                        ui.label(weak(ui, "Nothing was said yet."));
                    }
                    for message in state.messages.all() {
                        ui.horizontal_wrapped(|ui| {
                            ui.label(weak(ui, duration(message.at_secs)));
                            ui.label(level_text(
                                message.level,
                                theme::of_level(ui.visuals(), message.level),
                            ));
                            ui.label(&message.text);
                        });
                    }
                });
        });
    if !is_open {
        commands.push(Command::ToggleLog);
    }
}

/// Asks before training that was never saved is ended.
pub fn stop_question_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.overlays.is_stop_asked {
        return;
    }
    let modal = modal(ui, "stop").show(ui.ctx(), |ui| {
        ui.set_width(360.0);
        ui.heading("Stop without saving?");
        ui.label(format!(
            "{} steps were never saved. The result stays on screen, but it cannot be trained further.",
            state.training.progress.step - state.training.saved_step.unwrap_or(0)
        ));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if ui.button("Save first…").clicked() {
                commands.push(Command::CloseOverlays);
                commands.push(Command::AskPath(PathPurpose::Save));
            }
            if ui.button("Stop without saving").clicked() {
                commands.push(Command::Train(Train::StopForSure));
            }
            ui.button("Keep training").clicked()
        })
        .inner
    });
    if modal.inner || modal.should_close() {
        commands.push(Command::CloseOverlays);
    }
}
