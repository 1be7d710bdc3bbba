//! The capture's cameras in the viewport: small pyramids, coloured by split, to be named and visited.

use egui::{Color32, Pos2, Response, Stroke, Ui};
use glam::Vec3;

use super::overlay::label;
use super::screen::Screen;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::data::{Split, View};
use crate::geometry::Camera;

/// Height of a pyramid in mean distances of the cameras from what they look at.
const DEPTH: f32 = 0.07;
/// How near the pointer must be to a camera to mean it, in points.
const REACH: f32 = 12.0;

/// The colour of a split; they differ in lightness too.
pub(super) fn split_color(split: Split) -> Color32 {
    match split {
        Split::Train => Color32::from_rgb(70, 150, 235),
        Split::Val => Color32::from_rgb(255, 190, 90),
        Split::Test => Color32::from_rgb(235, 235, 235),
    }
}

/// Draws the cameras over the preview; the one under the pointer is named and visited on a click.
/// Whether one is under the pointer.
pub(super) fn frustums_ui(
    ui: &Ui,
    screen: Screen,
    response: &Response,
    state: &AppState,
    commands: &mut Vec<Command>,
) -> bool {
    if !state.watch.are_cameras_shown {
        return false;
    }
    let depth = DEPTH * mean_distance(state);
    let pointer = response.hover_pos();
    let hovered = pointer.and_then(|at| nearest(state, screen, at));
    let painter = ui.painter_at(screen.rect);
    for (i, view) in state.views().enumerate() {
        if state.view.at_view == Some(i) {
            continue;
        }
        let width = if hovered == Some(i) { 2.5 } else { 1.0 };
        let stroke = Stroke::new(width, split_color(view.split));
        for [a, b] in edges(&view.camera, depth) {
            if let (Some(a), Some(b)) = (seen(screen, a), seen(screen, b)) {
                painter.line_segment([a, b], stroke);
            }
        }
    }
    let Some((index, view)) = hovered.and_then(|i| Some((i, state.view_at(i)?))) else {
        return false;
    };
    if let Some(at) = seen(screen, view.camera.position()) {
        let name = view.full_name();
        let anchor = egui::Align2::LEFT_BOTTOM;
        label(ui, at + egui::vec2(8.0, -8.0), anchor, &name);
    }
    ui.ctx().set_cursor_icon(egui::CursorIcon::PointingHand);
    if response.clicked() {
        commands.push(Command::GoToView(index));
    }
    true
}

/// Where a world point is seen; farther out, lines only cost time.
fn seen(screen: Screen, p_world: Vec3) -> Option<Pos2> {
    let at = screen.camera.project(p_world)?;
    (at.abs().max_element() < 1e5).then(|| screen.to_points(at))
}

/// The camera whose place is nearest to the pointer, if one is near.
fn nearest(state: &AppState, screen: Screen, pointer: Pos2) -> Option<usize> {
    let distance = |(i, view): (usize, &View)| {
        let at = seen(screen, view.camera.position())?;
        (state.view.at_view != Some(i)).then_some((i, at.distance(pointer)))
    };
    let cameras = state.views().enumerate().filter_map(distance);
    let near = cameras.filter(|(_, distance)| *distance < REACH);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// Mean distance of the cameras from the pivot: the measure of the capture.
fn mean_distance(state: &AppState) -> f32 {
    let pivot = state.view.home.pivot;
    let distances = state
        .views()
        .map(|view| (view.camera.position() - pivot).length());
    distances.sum::<f32>() / state.views().count().max(1) as f32
}

/// The four edges from the lens and the four around the picture, and a tick that says where up is.
fn edges(camera: &Camera, depth: f32) -> [[Vec3; 2]; 9] {
    let (w, h) = (camera.width as f32, camera.height as f32);
    let (eye, forward) = (camera.position(), camera.forward());
    let at = |x: f32, y: f32| {
        let direction = camera.ray(x, y).direction;
        // Along the axis all corners are equally far; a fisheye's corners may look sideways.
        eye + direction * (depth / direction.dot(forward).max(0.3))
    };
    let corners = [at(0.0, 0.0), at(w, 0.0), at(w, h), at(0.0, h)];
    let top = at(0.5 * w, 0.0);
    let tick = [top, top + camera.up() * (0.25 * depth)];
    let mut edges = [tick; 9];
    for i in 0..4 {
        edges[i] = [eye, corners[i]];
        edges[4 + i] = [corners[i], corners[(i + 1) % 4]];
    }
    edges
}
