//! The photo in the viewport: over the preview, beside it, in turn with it, or what is different about it.

use egui::{Align2, Color32, Pos2, Rect, TextureId, Ui, pos2, vec2};

use super::overlay::{self, Pictures, WHOLE, color_bar, label};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::watch::{Comparison, ErrorKind, MeasuredView};

/// Seconds that photo and rendering are shown in turn: two changes there and back a second, which disturbs nobody.
const FLICKER_SECS: f64 = 0.25;
/// Gap between two pictures side by side.
const GAP: f32 = 4.0;

/// The part of the viewport for the photo, if it is shown beside the rendering, and the part for the rendering.
pub(in crate::app) fn split(rect: Rect, state: &AppState) -> (Option<Rect>, Rect) {
    let is_beside = state.compare.with_photo == Comparison::Beside;
    if !is_beside || state.view.at_view.is_none() {
        return (None, rect);
    }
    let (left, right) = rect.split_left_right_at_fraction(0.5);
    let gap = vec2(0.5 * GAP, 0.0);
    let left = Rect::from_min_max(left.min, left.max - gap);
    (Some(left), Rect::from_min_max(right.min + gap, right.max))
}

/// Draws the photo as the state asks; `rect` is the rendering's part of the viewport, `beside` the photo's.
pub(super) fn photo_ui(
    ui: &Ui,
    (beside, rect): (Option<Rect>, Rect),
    state: &AppState,
    pictures: &Pictures,
    commands: &mut Vec<Command>,
) {
    if state.view.at_view.is_none() {
        return;
    }
    let area = photo_area(ui, rect, state);
    if let Comparison::Error(kind) = state.compare.with_photo {
        error_ui(ui, area, kind, state, pictures.error);
    }
    let Some(photo) = pictures.photo else { return };
    let whole = |area: Rect| {
        ui.painter().image(photo, area, WHOLE, Color32::WHITE);
    };
    let name = |text: &str| name_ui(ui, area, text);
    if let Some(beside) = beside {
        let area = photo_area(ui, beside, state);
        whole(area);
        name_ui(ui, area, "Photo");
        name("Rendering");
    } else if state.compare.is_photo_held {
        whole(area);
        name("Photo");
    } else if state.compare.with_photo == Comparison::Flicker {
        let turn = state.messages.now_secs / FLICKER_SECS;
        if (turn as u64).is_multiple_of(2) {
            whole(area);
            name("Photo");
        } else {
            name("Rendering");
        }
        let left = (1.0 - turn.fract()) * FLICKER_SECS;
        ui.ctx().request_repaint_after_secs(left.max(0.01) as f32);
    } else if let Some(wipe) = state.compare.wipe {
        wipe_ui(ui, photo, area, wipe, commands);
    }
}

/// Where the photo lies when the window shows all of it.
pub(in crate::app) fn photo_area(ui: &Ui, rect: Rect, state: &AppState) -> Rect {
    let per_point = ui.ctx().pixels_per_point();
    let size = (rect.size() * per_point).round().max(vec2(1.0, 1.0));
    let area = state
        .view
        .viewpoint
        .photo_area(size.x as u32, size.y as u32);
    let to_points = 1.0 / per_point;
    let min = rect.min + vec2(area.min.x, area.min.y) * to_points;
    Rect::from_min_size(min, vec2(area.size.x, area.size.y) * to_points)
}

/// Says what a picture is, out of the way of the caption.
fn name_ui(ui: &Ui, area: Rect, text: &str) {
    let at = area.left_bottom() + vec2(10.0, -10.0);
    label(ui, at, Align2::LEFT_BOTTOM, text);
}

fn wipe_ui(ui: &Ui, photo: TextureId, area: Rect, wipe: f32, commands: &mut Vec<Command>) {
    let (left, _) = area.split_left_right_at_fraction(wipe);
    let part = Rect::from_min_max(Pos2::ZERO, pos2(wipe, 1.0));
    ui.painter().image(photo, left, part, Color32::WHITE);
    let at = overlay::line_ui(ui, area, wipe, "wipe", "Wipe between photo and rendering");
    commands.extend(at.map(|at| Command::SetWipe(Some(at))));
    let at = left.right_bottom() - vec2(0.0, 10.0);
    label(ui, at - vec2(10.0, 0.0), Align2::RIGHT_BOTTOM, "Photo");
    label(ui, at + vec2(10.0, 0.0), Align2::LEFT_BOTTOM, "Rendering");
}

/// The error map with its colour bar and figures.
fn error_ui(ui: &Ui, area: Rect, kind: ErrorKind, state: &AppState, map: Option<TextureId>) {
    let at_bottom = area.left_bottom() + vec2(10.0, -10.0);
    let Some(map) = map else {
        let done = state.watch.measuring.unwrap_or(0.0);
        let text = format!("Comparing with the photo… {:.0} %", 100.0 * done);
        label(ui, at_bottom, Align2::LEFT_BOTTOM, &text);
        return;
    };
    ui.painter().image(map, area, WHOLE, Color32::WHITE);
    let line = state.watch.measured.map_or_else(String::new, figures_line);
    let height = label(ui, at_bottom, Align2::LEFT_BOTTOM, &line).height();
    let at = at_bottom - vec2(0.0, height + 6.0);
    let ends = kind.range();
    let marks = [ends[0], 0.5 * (ends[0] + ends[1]), ends[1]];
    let marks = marks.map(|v| format!("{v}"));
    let color = |t: f32| kind.map().srgb8(t);
    color_bar(ui, at, kind.legend(), &marks, &color);
}

/// The figures of a view in one line.
pub fn figures_line(measured: MeasuredView) -> String {
    let figures = measured.figures;
    let db = |value: Option<f64>| value.map_or("–".to_owned(), |v| format!("{v:.2} dB"));
    let share = |value: Option<f64>| value.map_or("–".to_owned(), |v| format!("{v:.3}"));
    // The step of an environment alone is not known.
    let step = match measured.step {
        0 => String::new(),
        step => format!("   step {step}"),
    };
    let mut line = format!(
        "PSNR {} whole, {} object   FLIP {} whole, {} object{step}",
        db(figures.psnr),
        db(figures.psnr_object),
        share(figures.flip),
        share(figures.flip_object),
    );
    if measured.is_edited {
        line.push_str(", with edits");
    }
    line
}
