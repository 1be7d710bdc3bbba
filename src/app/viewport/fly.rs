//! Looking around and flying while the right mouse button is held.

use egui::{Context, Key, PointerButton, Response, Ui};
use glam::Vec3;

use super::camera_control::CameraMove;
use super::environment_control::{DEGREES_PER_POINT, turned_about};
use crate::app::lighting::anchor::anchor;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;

/// Radians the view turns for a drag by one point.
const LOOK_PER_POINT: f32 = 0.004;
/// Distances to the pivot flown in a second.
const SPEED: f32 = 0.7;
/// Times that with Shift.
const FAST: f32 = 4.0;
/// Times that with Alt.
const SLOW: f32 = 0.25;
/// The longest time between two frames that is flown through, seconds.
const LONGEST: f32 = 0.1;
/// Where each key flies: right, up, forward.
const KEYS: [(Key, Vec3); 6] = [
    (Key::W, Vec3::Z),
    (Key::S, Vec3::NEG_Z),
    (Key::D, Vec3::X),
    (Key::A, Vec3::NEG_X),
    (Key::E, Vec3::Y),
    (Key::Q, Vec3::NEG_Y),
];

/// Whether letters fly instead of being shortcuts.
pub fn takes_keys(ctx: &Context) -> bool {
    ctx.input(|input| input.pointer.secondary_down())
}

/// The camera's movement by the right button over the viewport; with Shift alone the environment turns.
pub(super) fn fly_ui(ui: &Ui, response: &Response, state: &AppState, commands: &mut Vec<Command>) {
    if !(response.is_pointer_button_down_on() && takes_keys(ui.ctx())) {
        return;
    }
    let (modifiers, secs) = ui.input(|input| (input.modifiers, input.stable_dt.min(LONGEST)));
    let way: Vec3 = ui.input(|input| {
        let held = KEYS.iter().filter(|(key, _)| input.key_down(*key));
        held.map(|(_, way)| *way).sum()
    });
    let is_drag = response.dragged_by(PointerButton::Secondary);
    let drag = response.drag_delta();
    if is_drag && drag != egui::Vec2::ZERO {
        commands.push(if modifiers.shift && way == Vec3::ZERO {
            let degrees = -drag.x * DEGREES_PER_POINT;
            let (transform, center) = (&state.look.transform, anchor(state));
            Command::MoveEnvironment(turned_about(transform, center, state.view.up, degrees))
        } else {
            Command::MoveCamera(CameraMove::Look {
                yaw: drag.x * LOOK_PER_POINT,
                pitch: drag.y * LOOK_PER_POINT,
            })
        });
    }
    if way != Vec3::ZERO {
        let pace = match (modifiers.shift, modifiers.alt) {
            (true, _) => FAST,
            (false, true) => SLOW,
            (false, false) => 1.0,
        };
        let by = way.normalize_or_zero() * (SPEED * pace * secs);
        commands.push(Command::MoveCamera(CameraMove::Fly(by)));
        ui.ctx().request_repaint();
    }
}
