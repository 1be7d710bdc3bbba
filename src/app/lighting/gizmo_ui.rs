//! Draws the gizmo over the picture and turns drags of its handles into commands. Lines only: large filled areas are
//! slow where the processor draws.

use egui::{
    Color32, CursorIcon, Pos2, Rect, Response, Role, Sense, Shape, Stroke, Ui, WidgetInfo, vec2,
};

use super::anchor::anchor;
use super::gizmo::{Axis, Gizmo, Grab, Handle, place};
use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::overlay::label;
use crate::app::viewport::screen::Screen;
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
pub(super) fn axis_color(axis: Axis) -> Color32 {
    match axis {
        Axis::X => Color32::from_rgb(240, 92, 92),
        Axis::Y => Color32::from_rgb(116, 205, 96),
        Axis::Z => Color32::from_rgb(98, 156, 255),
    }
}

/// Draws the gizmo into the viewport.
pub(in crate::app) fn gizmo_ui(
    ui: &Ui,
    screen: Screen,
    state: &AppState,
    commands: &mut Vec<Command>,
) {
    if !state.lighting.is_gizmo_shown || state.is_original_shown {
        return;
    }
    let Some(environment) = state.shown_environment() else {
        return;
    };
    let center = place(&state.look.transform, anchor(state));
    let Some(gizmo) = Gizmo::new(&screen.camera, center, ARROW * screen.per_point) else {
        return;
    };
    let handles = handles(environment);
    let grabbed = state.lighting.grab.as_ref().map(|grab| grab.handle);
    let pointer = ui.input(|input| input.pointer.hover_pos());
    let pointer = pointer.filter(|at| screen.rect.contains(*at) && grabbed.is_none());
    let nearest = pointer.and_then(|at| {
        let reach = REACH * screen.per_point;
        gizmo.nearest(screen.to_pixels(at), reach, &handles)
    });
    let painter = ui.painter().with_clip_rect(screen.rect);
    for &handle in &handles {
        let Some(knob) = gizmo.knob(handle).map(|knob| screen.to_points(knob)) else {
            continue;
        };
        // A line is wide enough to be held anywhere: what catches the pointer goes along with it.
        let spot = pointer.filter(|_| nearest == Some(handle)).unwrap_or(knob);
        let spot = Rect::from_center_size(spot, vec2(2.0 * REACH, 2.0 * REACH));
        let response = ui.interact(spot, ui.scope_id().with(handle), Sense::drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, handle.name()));
        drag_ui(ui, &response, handle, screen, commands);
        let is_hot = grabbed.map_or(nearest == Some(handle) || response.hovered(), |held| {
            held == handle
        });
        let outline = gizmo.outline(handle);
        let outline: Vec<Pos2> = outline.iter().map(|p| screen.to_points(*p)).collect();
        draw(&painter, handle, &outline, is_hot);
    }
    if let Some(grab) = &state.lighting.grab {
        let at = screen.place(center).unwrap_or(screen.rect.min);
        let at = at + vec2(0.0, ARROW + 14.0);
        label(ui, at, egui::Align2::CENTER_TOP, &amount(state, grab));
    }
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
    screen: Screen,
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
        Handle::Turn(_) | Handle::Move(_) => {
            for (width, color) in lines {
                painter.add(Shape::line(outline.to_vec(), Stroke::new(width, color)));
            }
        }
    }
    if let Handle::Move(_) = handle {
        let along = (*tip - *before).normalized();
        let across = along.rot90() * 5.5;
        let head = vec![*tip + along * 9.0, *tip + across, *tip - across];
        painter.add(Shape::convex_polygon(head, color, Stroke::NONE));
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
