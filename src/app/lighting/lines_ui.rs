//! Draws the lines of [`super::lines`] over the picture, and a compass of the world's axes in its corner.

use egui::{Align2, Color32, FontId, Pos2, Rect, Shape, Stroke, Ui, vec2};

use super::anchor::{object_size, shown_transform};
use super::gizmo_ui::{Screen, axis_color};
use super::lines::{LineKind, compass, lines, on_screen};
use crate::app::state::app_state::AppState;
use crate::geometry::Camera;

/// Length of the compass' axes, in points.
const COMPASS: f32 = 20.0;
/// Its centre, in points from the viewport's top right corner.
const COMPASS_AT: egui::Vec2 = egui::Vec2::new(-36.0, 36.0);

/// Draws both into the viewport `rect`, whose size in pixels is `window`.
pub fn lines_ui(ui: &Ui, rect: Rect, state: &AppState, window: (u32, u32)) {
    let camera = state.view.viewpoint.camera_for(window.0, window.1);
    let painter = ui.painter().with_clip_rect(rect);
    compass_ui(&painter, rect.right_top() + COMPASS_AT, &camera);
    let own = state.snapshot.as_ref().map(|own| &own.environment);
    let chosen = state.chosen_environment().or(own);
    let Some(environment) = chosen.filter(|_| state.lighting.are_lines_shown) else {
        return;
    };
    let screen = Screen {
        rect,
        window,
        per_point: ui.ctx().pixels_per_point(),
    };
    let length = 0.6 * object_size(state);
    for line in lines(environment, &shown_transform(state), length) {
        for run in on_screen(&camera, &line) {
            let run: Vec<Pos2> = run.iter().map(|p| screen.to_points(*p)).collect();
            draw(&painter, line.kind, &run);
        }
    }
}

fn draw(painter: &egui::Painter, kind: LineKind, run: &[Pos2]) {
    let thin = Stroke::new(1.0, Color32::from_white_alpha(150));
    match kind {
        LineKind::Bounds => {
            painter.add(Shape::line(run.to_vec(), thin));
        }
        // Dashed, to be distinguished from the world's.
        LineKind::Environment(axis) => {
            let stroke = Stroke::new(1.5, axis_color(axis));
            painter.extend(Shape::dashed_line(run, stroke, 6.0, 4.0));
        }
        LineKind::World(axis) => {
            painter.add(Shape::line(
                run.to_vec(),
                Stroke::new(2.0, axis_color(axis)),
            ));
            if let Some(end) = run.last() {
                let at = *end + vec2(6.0, 0.0);
                let font = FontId::proportional(12.0);
                painter.text(at, Align2::LEFT_CENTER, axis.name(), font, axis_color(axis));
            }
        }
    }
}

fn compass_ui(painter: &egui::Painter, center: Pos2, camera: &Camera) {
    let mut axes = compass(camera);
    axes.sort_by(|a, b| a.2.total_cmp(&b.2));
    for (axis, to, towards) in axes {
        // What points away is dimmer, and what points at the viewer comes last.
        let color = axis_color(axis).gamma_multiply(0.75 + 0.25 * towards);
        let to = vec2(to.x, to.y);
        let line = [center, center + to * COMPASS];
        painter.line_segment(line, Stroke::new(3.5, Color32::from_black_alpha(110)));
        painter.line_segment(line, Stroke::new(2.0, color));
        let at = center + to * (COMPASS + 8.0);
        let font = FontId::proportional(11.0);
        painter.text(
            at + vec2(1.0, 1.0),
            Align2::CENTER_CENTER,
            axis.name(),
            font.clone(),
            Color32::from_black_alpha(160),
        );
        painter.text(at, Align2::CENTER_CENTER, axis.name(), font, color);
    }
}
