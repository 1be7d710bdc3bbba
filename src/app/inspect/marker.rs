//! Picking in the viewport, and the mark on the picked point.

use egui::{Color32, Pos2, Rect, Response, Stroke, Ui, vec2};
use glam::Vec2;

use crate::app::inspect::{InspectCommand, Pick};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::geometry::{Camera, Ray};

/// Radius of the mark, points.
const RADIUS: f32 = 5.0;
/// Opacity where the object hides the point.
const HIDDEN: f32 = 0.35;

/// A click without a drag and without other keys picks what is under the pointer.
pub fn pick_ui(ui: &Ui, response: &Response, window: (u32, u32), commands: &mut Vec<Command>) {
    let is_plain = ui.input(|input| input.modifiers.is_none());
    // The second click of two sets the pivot, and the first has picked the point already.
    if !response.clicked() || response.double_clicked() || !is_plain {
        return;
    }
    if let Some(at) = response.interact_pointer_pos() {
        let at = (at - response.rect.min) * ui.ctx().pixels_per_point();
        let at = Vec2::new(at.x, at.y);
        commands.push(Command::Inspect(InspectCommand::PickAt { at, window }));
    }
}

/// Draws the mark where the camera of a window of that size in pixels sees the picked point.
pub fn marker_ui(ui: &Ui, rect: Rect, state: &AppState, window: (u32, u32)) {
    let Some(pick) = state.inspect.pick.filter(|_| state.layer.shows_object()) else {
        return;
    };
    let camera = state.view.viewpoint.camera_for(window.0, window.1);
    let Some(place) = camera.project(pick.position) else {
        return;
    };
    let at = rect.min + vec2(place.x, place.y) / ui.ctx().pixels_per_point();
    if rect.contains(at) {
        let opacity = if is_hidden(state, &pick, &camera) {
            HIDDEN
        } else {
            1.0
        };
        draw(ui, rect, at, opacity);
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
    let snapshot = state.snapshot.as_ref();
    let Some(object) = snapshot.and_then(|snapshot| snapshot.object.as_ref()) else {
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
