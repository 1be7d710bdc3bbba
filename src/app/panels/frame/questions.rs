//! Questions before something is lost, and the offer to bring back what was left behind.

use egui::{Align2, Area, Frame, Ui, vec2};

use crate::app::panels::widgets::{modal, tell_place};
use crate::app::session::leaving::{Goal, LeavingCommand};
use crate::app::session::saving::SessionCommand;
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::{Command, Train};
use crate::app::state::source::file_name;

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
            n_unsaved(state)
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

fn n_unsaved(state: &AppState) -> u64 {
    let saved = state.training.saved_step.unwrap_or(0);
    state.training.progress.step.saturating_sub(saved)
}

/// Asks before closing or opening something else loses training.
pub fn leaving_question_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let is_choosing_folder = state.overlays.path_dialog.is_some();
    let Some(leaving) = state.leaving.as_ref().filter(|_| !is_choosing_folder) else {
        return;
    };
    let (heading, discard) = match &leaving.goal {
        Goal::Close => (
            "Close without saving the run?".to_owned(),
            "Close without saving",
        ),
        Goal::Open(path) => (
            format!("Save the run before opening “{}”?", file_name(path)),
            "Open without saving",
        ),
        Goal::OpenDemo => (
            "Save the run before opening the demo?".to_owned(),
            "Open without saving",
        ),
    };
    let modal = modal(ui, "leaving").show(ui.ctx(), |ui| {
        ui.set_width(400.0);
        ui.heading(heading);
        ui.label(format!(
            "{} steps of training would be lost.",
            n_unsaved(state)
        ));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if leaving.saving_after.is_some() {
                ui.spinner();
                ui.label("Saving…");
            } else if ui.button("Save the run").clicked() {
                commands.push(Command::Leaving(LeavingCommand::Save));
            }
            let button = ui.button(discard);
            tell_place(ui, discard, button.rect);
            if button.clicked() {
                commands.push(Command::Leaving(LeavingCommand::Discard));
            }
            ui.button("Cancel").clicked()
        })
        .inner
    });
    if modal.inner || modal.should_close() {
        commands.push(Command::Leaving(LeavingCommand::Cancel));
    }
}

/// Offers, at the top of `ui`, what a window that did not end properly has left behind.
pub fn recovery_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some(session) = &state.session.recovery else {
        return;
    };
    let name = session
        .source
        .as_ref()
        .map(|source| file_name(&source.path));
    let name = name.unwrap_or_else(|| "nothing open".to_owned());
    let at = ui.max_rect().center_top() + vec2(0.0, 40.0);
    let area = Area::new(egui::Id::unique("recovery"))
        .pivot(Align2::CENTER_TOP)
        .fixed_pos(at);
    area.show(ui.ctx(), |ui| {
        Frame::popup(ui.style())
            .shadow(egui::Shadow::NONE)
            .show(ui, |ui| {
                ui.label("neif was not closed properly.");
                ui.label(format!("Restore the last session ({name})?"));
                ui.horizontal(|ui| {
                    if ui.button("Restore session").clicked() {
                        commands.push(Command::Session(SessionCommand::Restore));
                    }
                    if ui.button("Forget it").clicked() {
                        commands.push(Command::Session(SessionCommand::Forget));
                    }
                });
            });
    });
}
