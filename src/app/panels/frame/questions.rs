//! Questions before something is lost, and the offer to bring back what was left behind.

use egui::{Align2, Area, Frame, Ui, vec2};

use crate::app::panels::widgets::{log_place, modal_ui, on_click};
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
    modal_ui(
        ui,
        "stop",
        Command::CloseOverlays,
        commands,
        |ui, commands| {
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
                let stop = ui.button("Stop without saving");
                on_click(&stop, Command::Train(Train::StopForSure), commands);
                ui.button("Keep training").clicked()
            })
            .inner
        },
    );
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
    let (what, discard) = match &leaving.goal {
        Goal::Close => (None, "Close without saving"),
        Goal::Open(path) => (
            Some(format!("“{}”", file_name(path))),
            "Open without saving",
        ),
        Goal::OpenDemo => (Some("the demo".to_owned()), "Open without saving"),
    };
    let heading = what.map_or("Close without saving the run?".to_owned(), |what| {
        format!("Save the run before opening {what}?")
    });
    let close = Command::Leaving(LeavingCommand::Cancel);
    modal_ui(ui, "leaving", close, commands, |ui, commands| {
        ui.set_width(400.0);
        ui.heading(heading);
        let n = n_unsaved(state);
        ui.label(format!("{n} steps of training would be lost."));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if leaving.saving_after.is_some() {
                ui.spinner();
                ui.label("Saving…");
            } else {
                let save = ui.button("Save the run");
                on_click(&save, Command::Leaving(LeavingCommand::Save), commands);
            }
            let button = ui.button(discard);
            log_place(ui, discard, button.rect);
            on_click(&button, Command::Leaving(LeavingCommand::Discard), commands);
            ui.button("Cancel").clicked()
        })
        .inner
    });
}

/// Offers, at the top of `ui`, what a window that did not end properly has left behind.
pub fn recovery_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let Some(session) = &state.session.recovery else {
        return;
    };
    let source = session.source.as_ref();
    let name = source.map_or("nothing open".to_owned(), |source| file_name(&source.path));
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
                    for (text, command) in [
                        ("Restore session", SessionCommand::Restore),
                        ("Forget it", SessionCommand::Forget),
                    ] {
                        on_click(&ui.button(text), Command::Session(command), commands);
                    }
                });
            });
    });
}
