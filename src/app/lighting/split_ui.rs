//! A left and B right of a line that can be dragged: two looks beside each other.

use egui::{
    Align2, Color32, CursorIcon, Pos2, Rect, Role, Sense, Stroke, TextureId, Ui, WidgetInfo, pos2,
};

use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::overlay::label;

/// Width of the strip that catches the line, in points.
const GRAB: f32 = 14.0;

/// Draws the picture `a` into all of `rect`, or `b` right of the line while both are compared.
pub fn pictures_ui(ui: &Ui, rect: Rect, state: &AppState, a: TextureId, b: Option<TextureId>) {
    let split = state.lighting.split.filter(|_| b.is_some()).unwrap_or(1.0);
    let x = rect.left() + split * rect.width();
    let part = |texture, from: f32, to: f32, area| {
        let seen = Rect::from_min_max(pos2(from, 0.0), pos2(to, 1.0));
        ui.painter().image(texture, area, seen, Color32::WHITE);
    };
    part(
        a,
        0.0,
        split,
        Rect::from_min_max(rect.min, pos2(x, rect.bottom())),
    );
    if let Some(b) = b.filter(|_| split < 1.0) {
        part(
            b,
            split,
            1.0,
            Rect::from_min_max(pos2(x, rect.top()), rect.max),
        );
    }
}

/// Draws the line with its names, and takes drags of it.
pub fn line_ui(ui: &Ui, rect: Rect, state: &AppState, commands: &mut Vec<Command>) {
    let Some(split) = state.lighting.split else {
        return;
    };
    let x = rect.left() + split * rect.width();
    let strip = Rect::from_x_y_ranges(x - 0.5 * GRAB..=x + 0.5 * GRAB, rect.y_range());
    let handle = ui
        .interact(strip, ui.scope_id().with("split"), Sense::drag())
        .on_hover_cursor(CursorIcon::ResizeHorizontal);
    handle.widget_info(|| WidgetInfo::labeled(Role::Slider, true, "Line between A and B"));
    if let Some(Pos2 { x, .. }) = handle.interact_pointer_pos().filter(|_| handle.dragged()) {
        let at = (x - rect.left()) / rect.width().max(1.0);
        commands.push(Command::Lighting(LightingCommand::MoveSplit(at)));
    }
    let is_hot = handle.hovered() || handle.dragged();
    let width = if is_hot { 3.0 } else { 1.5 };
    for (stroke, color) in [
        (width + 2.0, Color32::from_black_alpha(120)),
        (width, Color32::WHITE),
    ] {
        let stroke = Stroke::new(stroke, color);
        ui.painter().vline(x, rect.y_range(), stroke);
    }
    let y = rect.top() + 10.0;
    label(ui, pos2(x - 10.0, y), Align2::RIGHT_TOP, "A");
    label(ui, pos2(x + 10.0, y), Align2::LEFT_TOP, "B");
}
