//! Draws the lines of [`super::lines`] over the picture, and a compass of the world's axes in its corner.

use egui::{Align2, Color32, FontId, Pos2, Shape, Stroke, Ui, vec2};

use super::anchor::{object_size, shown_transform};
use super::gizmo_ui::axis_color;
use super::lines::{LineKind, compass, lines, on_screen};
use crate::app::state::app_state::AppState;
use crate::app::viewport::screen::Screen;
use crate::geometry::Camera;

/// Length of the compass' axes, in points.
const COMPASS: f32 = 20.0;
/// Its centre, in points from the viewport's top right corner.
const COMPASS_AT: egui::Vec2 = egui::Vec2::new(-36.0, 36.0);

/// Draws both into the viewport.
pub(in crate::app) fn lines_ui(ui: &Ui, screen: Screen, state: &AppState) {
    let painter = ui.painter().with_clip_rect(screen.rect);
    let corner = screen.rect.right_top();
    compass_ui(&painter, corner + COMPASS_AT, &screen.camera);
    let shown = state.shown_environment();
    let Some(environment) = shown.filter(|_| state.lighting.are_lines_shown) else {
        return;
    };
    let length = 0.6 * object_size(state);
    for line in lines(environment, &shown_transform(state), length) {
        for run in on_screen(&screen.camera, &line) {
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
            let color = axis_color(axis);
            painter.add(Shape::line(run.to_vec(), Stroke::new(2.0, color)));
            if let Some(end) = run.last() {
                let at = *end + vec2(6.0, 0.0);
                let font = FontId::proportional(12.0);
                painter.text(at, Align2::LEFT_CENTER, axis.name(), font, color);
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
        let text = |at, color| {
            painter.text(at, Align2::CENTER_CENTER, axis.name(), font.clone(), color);
        };
        text(at + vec2(1.0, 1.0), Color32::from_black_alpha(160));
        text(at, color);
    }
}
