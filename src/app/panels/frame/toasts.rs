//! Messages over the viewport.

use egui::{Align, Align2, Area, Color32, Frame, Label, Layout, RichText, Ui, vec2};

use crate::app::panels::widgets::weak;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::messages::Message;
use crate::app::state::training_state::Level;
use crate::app::theme;

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
                let dismiss = ui.with_layout(Layout::top_down(Align::Min), |ui| {
                    ui.add(Label::new(&message.text).wrap());
                    for cause in &message.causes {
                        ui.add(Label::new(weak(ui, cause)).wrap());
                    }
                    ui.small_button("Dismiss").clicked()
                });
                dismiss.inner
            })
            .inner
        })
        .inner
}

/// The level, as a coloured word.
pub(in crate::app::panels) fn level_text(level: Level, color: Color32) -> RichText {
    let text = match level {
        Level::Info => "Note",
        Level::Warning => "Warning",
        Level::Error => "Error",
    };
    RichText::new(text).color(color).strong()
}
