//! Draws the gizmo over the picture and turns drags of its handles into commands. Lines only: large filled areas are
//! slow where the processor draws.

use egui::{
    Color32, CursorIcon, Pos2, Rect, Response, Role, Sense, Shape, Stroke, Ui, WidgetInfo, vec2,
};
use glam::Vec2;

use super::anchor::anchor;
use super::gizmo::{Axis, Gizmo, Grab, Handle, place};
use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::overlay::label;
use crate::neif::Environment;

/// Length of an arrow in points.
const ARROW: f32 = 92.0;
/// How near the pointer must come to a handle, in points.
const REACH: f32 = 8.0;
/// The handle under the pointer.
const HIGHLIGHT: Color32 = Color32::from_rgb(255, 214, 74);
/// Below the lines, to be seen on any picture.
const SHADE: Color32 = Color32::from_black_alpha(130);

/// The colour of an axis.
pub fn axis_color(axis: Axis) -> Color32 {
    match axis {
        Axis::X => Color32::from_rgb(240, 92, 92),
        Axis::Y => Color32::from_rgb(116, 205, 96),
        Axis::Z => Color32::from_rgb(98, 156, 255),
    }
}

/// Draws the gizmo into the viewport `rect`, whose size in pixels is `window`.
pub fn gizmo_ui(
    ui: &Ui,
    rect: Rect,
    state: &AppState,
    window: (u32, u32),
    commands: &mut Vec<Command>,
) {
    if !state.lighting.is_gizmo_shown || state.is_original_shown {
        return;
    }
    let Some(environment) = shown_environment(state) else {
        return;
    };
    let screen = Screen {
        rect,
        window,
        per_point: ui.ctx().pixels_per_point(),
    };
    let camera = state.view.viewpoint.camera_for(window.0, window.1);
    let center = place(&state.look.transform, anchor(state));
    let Some(gizmo) = Gizmo::new(&camera, center, ARROW * screen.per_point) else {
        return;
    };
    let handles = handles(environment);
    let grabbed = state.lighting.grab.as_ref().map(|grab| grab.handle);
    let pointer = ui.input(|input| input.pointer.hover_pos());
    let pointer = pointer.filter(|at| rect.contains(*at) && grabbed.is_none());
    let nearest = pointer.and_then(|at| {
        let reach = REACH * screen.per_point;
        gizmo.nearest(screen.to_pixels(at), reach, &handles)
    });
    let painter = ui.painter().with_clip_rect(rect);
    for &handle in &handles {
        let Some(knob) = gizmo.knob(handle) else {
            continue;
        };
        let knob = screen.to_points(knob);
        // A line is wide enough to be held anywhere: what catches the pointer goes along with it.
        let spot = pointer.filter(|_| nearest == Some(handle)).unwrap_or(knob);
        let spot = Rect::from_center_size(spot, vec2(2.0 * REACH, 2.0 * REACH));
        let response = ui.interact(spot, ui.scope_id().with(handle), Sense::drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, handle.name()));
        drag_ui(ui, &response, handle, &screen, commands);
        let is_hot = grabbed.map_or(nearest == Some(handle) || response.hovered(), |held| {
            held == handle
        });
        let outline = gizmo.outline(handle);
        let outline: Vec<Pos2> = outline.iter().map(|p| screen.to_points(*p)).collect();
        draw(&painter, handle, &outline, is_hot);
    }
    if let Some(grab) = &state.lighting.grab {
        let at = screen.to_points(camera.project(center).unwrap_or_default());
        let at = at + vec2(0.0, ARROW + 14.0);
        label(ui, at, egui::Align2::CENTER_TOP, &amount(state, grab));
    }
}

/// The chosen environment, or the capture's own.
fn shown_environment(state: &AppState) -> Option<&Environment> {
    let own = state.snapshot.as_ref().map(|own| &own.environment);
    Some(state.chosen_environment().or(own)?)
}

/// What is infinitely far can only be turned.
fn handles(environment: &Environment) -> Vec<Handle> {
    let is_useful = |handle: &Handle| matches!(handle, Handle::Turn(_)) || !environment.is_far();
    Handle::ALL.into_iter().filter(is_useful).collect()
}

fn drag_ui(
    ui: &Ui,
    response: &Response,
    handle: Handle,
    screen: &Screen,
    commands: &mut Vec<Command>,
) {
    let mut send = |command| commands.push(Command::Lighting(command));
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
    }
    if response.drag_started()
        && let Some(at) = ui.input(|input| input.pointer.press_origin())
    {
        send(LightingCommand::Grab {
            handle,
            at: screen.to_pixels(at),
            window: screen.window,
            arrow_px: ARROW * screen.per_point,
        });
    }
    if response.dragged()
        && response.drag_delta() != egui::Vec2::ZERO
        && let Some(at) = response.interact_pointer_pos()
    {
        send(LightingCommand::Drag {
            at: screen.to_pixels(at),
            is_snapped: ui.input(|input| input.modifiers.command),
        });
    }
    if response.drag_stopped() {
        send(LightingCommand::LetGo);
    }
}

fn draw(painter: &egui::Painter, handle: Handle, outline: &[Pos2], is_hot: bool) {
    let [.., before, tip] = outline else { return };
    let (color, width) = match handle {
        _ if is_hot => (HIGHLIGHT, 3.0),
        Handle::Move(axis) => (axis_color(axis), 2.5),
        Handle::Turn(axis) => (axis_color(axis), 1.6),
        Handle::Scale => (Color32::WHITE, 1.6),
    };
    let lines = [(width + 2.0, SHADE), (width, color)];
    match handle {
        Handle::Scale => {
            let square = Rect::from_center_size(*tip, vec2(11.0, 11.0));
            for (width, color) in lines {
                let stroke = Stroke::new(width, color);
                painter.rect_stroke(square, 1.0, stroke, egui::StrokeKind::Middle);
            }
        }
        Handle::Turn(_) => {
            for (width, color) in lines {
                painter.add(Shape::line(outline.to_vec(), Stroke::new(width, color)));
            }
        }
        Handle::Move(_) => {
            for (width, color) in lines {
                painter.add(Shape::line(outline.to_vec(), Stroke::new(width, color)));
            }
            let along = (*tip - *before).normalized();
            let across = along.rot90() * 5.5;
            let head = vec![*tip + along * 9.0, *tip + across, *tip - across];
            painter.add(Shape::convex_polygon(head, color, Stroke::NONE));
        }
    }
}

/// What the drag has done so far.
fn amount(state: &AppState, grab: &Grab) -> String {
    let (start, now) = (&grab.start, &state.look.transform);
    match grab.handle {
        Handle::Move(axis) => {
            let moved = (now.translate - start.translate).dot(axis.unit());
            format!("{} {moved:+.2}", axis.name())
        }
        Handle::Turn(_) => {
            let [x, y, z] = now.rotate_deg.to_array();
            format!("{x:.0}°, {y:.0}°, {z:.0}°")
        }
        Handle::Scale => format!("× {:.2}", now.scale),
    }
}

/// Where the viewport is.
pub(super) struct Screen {
    pub(super) rect: Rect,
    pub(super) window: (u32, u32),
    pub(super) per_point: f32,
}

impl Screen {
    fn to_pixels(&self, at: Pos2) -> Vec2 {
        let at = (at - self.rect.min) * self.per_point;
        Vec2::new(at.x, at.y)
    }

    pub(super) fn to_points(&self, at: Vec2) -> Pos2 {
        self.rect.min + vec2(at.x, at.y) / self.per_point
    }
}
