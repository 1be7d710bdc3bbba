//! Picking in the viewport, and the mark on the picked point.

use egui::{Color32, Pos2, Rect, Response, Stroke, Ui};

use crate::app::inspect::{InspectCommand, Pick};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::screen::Screen;
use crate::geometry::{Camera, Ray};

/// Radius of the mark, points.
const RADIUS: f32 = 5.0;
/// Opacity where the object hides the point.
const HIDDEN: f32 = 0.35;

/// A click without a drag and without other keys picks what is under the pointer.
pub(in crate::app) fn pick_ui(
    ui: &Ui,
    response: &Response,
    screen: Screen,
    commands: &mut Vec<Command>,
) {
    let is_plain = ui.input(|input| input.modifiers.is_none());
    // The second click of two sets the pivot, and the first has picked the point already.
    if !response.clicked() || response.double_clicked() || !is_plain {
        return;
    }
    if let Some(at) = response.interact_pointer_pos() {
        commands.push(Command::Inspect(InspectCommand::PickAt {
            at: screen.to_pixels(at),
            window: screen.window,
        }));
    }
}

/// Draws the mark where the picked point is seen.
pub(in crate::app) fn marker_ui(ui: &Ui, screen: Screen, state: &AppState) {
    let Some(pick) = state.inspect.pick.filter(|_| state.layer.shows_object()) else {
        return;
    };
    if let Some(at) = screen.place(pick.position)
        && screen.rect.contains(at)
    {
        let is_hidden = is_hidden(state, &pick, &screen.camera);
        let opacity = if is_hidden { HIDDEN } else { 1.0 };
        draw(ui, screen.rect, at, opacity);
    }
}

/// White on black: seen on any picture.
fn draw(ui: &Ui, rect: Rect, at: Pos2, opacity: f32) {
    let painter = ui.painter().with_clip_rect(rect);
    let color = |color: Color32| color.gamma_multiply(opacity);
    painter.circle_stroke(at, RADIUS, Stroke::new(3.5, color(Color32::BLACK)));
    painter.circle_stroke(at, RADIUS, Stroke::new(1.5, color(Color32::WHITE)));
    painter.circle_filled(at, 1.5, color(Color32::WHITE));
}

/// Whether the object is between the point and the camera.
fn is_hidden(state: &AppState, pick: &Pick, camera: &Camera) -> bool {
    let Some(object) = state.object() else {
        return false;
    };
    let to_eye = camera.position() - pick.position;
    let ray = Ray {
        origin: pick.position,
        direction: to_eye.normalize_or_zero(),
    };
    let start = object.tracer.self_distance();
    pick.face_normal.dot(to_eye) <= 0.0 || object.tracer.occluded(&ray, start, to_eye.length())
}
