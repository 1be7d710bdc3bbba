//! The choice of the pace.

use egui::Ui;

use crate::app::panels::widgets::weak;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::work::pace::{Pace, PaceCommand};

/// Draws the choice.
pub(super) fn pace_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        ui.label(weak(ui, "Pace"));
        for pace in Pace::ALL {
            let button = ui.selectable_label(state.pace == pace, pace.name());
            if button.on_hover_text(pace.hint()).clicked() {
                commands.push(Command::Pace(PaceCommand::Choose(pace)));
            }
        }
    });
}
