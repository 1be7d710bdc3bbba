//! A left and B right of a line that can be dragged: two looks beside each other.

use egui::{Align2, Color32, Rect, TextureId, Ui, pos2, vec2};

use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::overlay::{self, label};

/// Draws the picture `a` into all of `rect`, or `b` right of the line while both are compared.
pub(in crate::app) fn pictures_ui(
    ui: &Ui,
    rect: Rect,
    state: &AppState,
    a: TextureId,
    b: Option<TextureId>,
) {
    let split = state.lighting.split.filter(|_| b.is_some()).unwrap_or(1.0);
    let (left, right) = rect.split_left_right_at_fraction(split);
    let part = |texture, from: f32, to: f32, area| {
        let seen = Rect::from_min_max(pos2(from, 0.0), pos2(to, 1.0));
        ui.painter().image(texture, area, seen, Color32::WHITE);
    };
    part(a, 0.0, split, left);
    if let Some(b) = b.filter(|_| split < 1.0) {
        part(b, split, 1.0, right);
    }
}

/// Draws the line with its names, and takes drags of it.
pub(in crate::app) fn line_ui(ui: &Ui, rect: Rect, state: &AppState, commands: &mut Vec<Command>) {
    let Some(split) = state.lighting.split else {
        return;
    };
    let at = overlay::line_ui(ui, rect, split, "split", "Line between A and B");
    let moved = at.map(LightingCommand::MoveSplit);
    commands.extend(moved.map(Command::Lighting));
    let at = pos2(rect.left() + split * rect.width(), rect.top() + 10.0);
    label(ui, at - vec2(10.0, 0.0), Align2::RIGHT_TOP, "A");
    label(ui, at + vec2(10.0, 0.0), Align2::LEFT_TOP, "B");
}
