//! The list of everything that was said, with causes.

use egui::{ScrollArea, Ui};

use crate::app::diagnostics::diagnostics;
use crate::app::panels::frame::toasts::level_text;
use crate::app::panels::widgets::{duration, set_label, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::messages::Message;
use crate::app::theme;

/// Draws the list, while it is open.
pub fn log_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    if !state.preferences.is_log_open {
        return;
    }
    let mut is_open = true;
    egui::Window::new("Messages")
        .open(&mut is_open)
        .default_size([560.0, 320.0])
        // Out of the way of menus and panels, above the button that opens it.
        .pivot(egui::Align2::RIGHT_BOTTOM)
        .default_pos(ui.ctx().content_rect().right_bottom() - egui::vec2(12.0, 44.0))
        .show(ui.ctx(), |ui| {
            ui.horizontal(|ui| {
                if ui.button("Copy all").clicked() {
                    ui.ctx().copy_text(state.messages.to_text());
                }
                let button = ui.button("Copy diagnostics");
                let hint = "Version, system, graphics adapter, cores, what is open, and all messages: for a report of a fault";
                if button.on_hover_text(hint).clicked() {
                    ui.ctx().copy_text(diagnostics(state));
                }
            });
            ui.separator();
            ScrollArea::vertical()
                .auto_shrink([false, false])
                .stick_to_bottom(true)
                .show(ui, |ui| {
                    if state.messages.all().len() == 0 {
                        ui.label(weak(ui, "Nothing was said yet."));
                    }
                    for message in state.messages.all() {
                        message_ui(ui, message);
                    }
                });
        });
    if !is_open {
        commands.push(Command::ToggleLog);
    }
}

fn message_ui(ui: &mut Ui, message: &Message) {
    ui.horizontal_wrapped(|ui| {
        ui.label(weak(ui, duration(message.at_secs)));
        let color = theme::of_level(ui.visuals(), message.level);
        ui.label(level_text(message.level, color));
        ui.label(&message.text);
        let copy = ui.small_button("Copy");
        set_label(&copy, &format!("Copy message: {}", message.text));
        if copy.clicked() {
            ui.ctx().copy_text(message.to_text());
        }
    });
    for cause in &message.causes {
        ui.horizontal_wrapped(|ui| {
            ui.add_space(24.0);
            ui.label(weak(ui, format!("because {cause}")));
        });
    }
}
