//! The viewport: the preview picture, the photo over it, and what the mouse does there.

use egui::{Align2, Color32, CursorIcon, PointerButton, Rect, Response, Sense, Ui, vec2};
use glam::Vec2;

use super::camera_control::CameraMove;
use super::compare_view::{self, photo_ui};
use super::environment_control::{DEGREES_PER_POINT, shifted, turned};
use super::fly::fly_ui;
use super::frustums::frustums_ui;
use super::layer_bar::layer_bar_ui;
use super::overlay::{Pictures, WHOLE, label};
use crate::app::inspect::marker::{marker_ui, pick_ui};
use crate::app::lighting::{gizmo_ui, lines_ui, split_ui};
use crate::app::panels::widgets::{tell_place, weak};
use crate::app::state::app_state::{AppState, Compare, PathPurpose};
use crate::app::state::command::Command;
use crate::app::state::source::Source;
use crate::app::state::training_state::Phase;
use crate::neif::distant::is_environment_file;

/// Radians the camera turns for a drag by one point.
const ORBIT_PER_POINT: f32 = 0.008;
/// Change of the logarithm of the distance for one point of scrolling.
const DOLLY_PER_POINT: f32 = 0.003;

/// Draws the viewport into all of `ui`; returns the size of the preview in it, in physical pixels.
pub fn viewport_ui(
    ui: &mut Ui,
    state: &AppState,
    pictures: &Pictures,
    commands: &mut Vec<Command>,
) -> (u32, u32) {
    let whole = ui.max_rect();
    let (beside, rect) = match pictures.preview {
        Some(_) => compare_view::split(whole, state),
        None => (None, whole),
    };
    let per_point = ui.ctx().pixels_per_point();
    let size = (rect.size() * per_point).round();
    let window = (size.x.max(1.0) as u32, size.y.max(1.0) as u32);
    match (pictures.preview, pictures.first) {
        (Some(preview), _) => {
            let response = ui.interact(
                rect,
                ui.scope_id().with("viewport"),
                Sense::click_and_drag(),
            );
            describe(&response);
            tell_place(ui, "viewport", rect);
            mouse_ui(ui, &response, state, window, commands);
            fly_ui(ui, &response, state, commands);
            split_ui::pictures_ui(ui, rect, state, preview, pictures.preview_b);
            // A click on a camera goes there instead of looking into what is behind it.
            if !frustums_ui(ui, rect, &response, state, window, commands) {
                pick_ui(ui, &response, window, commands);
            }
            photo_ui(ui, (beside, rect), state, pictures, commands);
            marker_ui(ui, rect, state, window);
            lines_ui::lines_ui(ui, rect, state, window);
            split_ui::line_ui(ui, rect, state, commands);
            gizmo_ui::gizmo_ui(ui, rect, state, window, commands);
            caption_ui(ui, rect, state);
            layer_bar_ui(ui, rect, state);
        }
        (None, Some((picture, size, words))) => {
            let area = fit(rect, vec2(size[0] as f32, size[1] as f32));
            ui.painter().image(picture, area, WHOLE, Color32::WHITE);
            label(
                ui,
                area.left_top() + vec2(10.0, 10.0),
                Align2::LEFT_TOP,
                words,
            );
        }
        (None, None) => empty_ui(ui, rect, state, commands),
    }
    drop_ui(ui, whole);
    window
}

fn describe(response: &Response) {
    response
        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Preview of the scene"));
}

/// The largest rectangle of that shape inside `rect`, centred.
fn fit(rect: Rect, size: egui::Vec2) -> Rect {
    let size = size.max(egui::Vec2::splat(1.0));
    let scale = (rect.width() / size.x).min(rect.height() / size.y);
    Rect::from_center_size(rect.center(), size * scale)
}

fn mouse_ui(
    ui: &Ui,
    response: &Response,
    state: &AppState,
    window: (u32, u32),
    commands: &mut Vec<Command>,
) {
    let modifiers = ui.input(|input| input.modifiers);
    let drag = response.drag_delta();
    let per_point = ui.ctx().pixels_per_point();
    let is_middle = response.dragged_by(PointerButton::Middle);
    if (response.dragged_by(PointerButton::Primary) || is_middle) && drag != egui::Vec2::ZERO {
        let is_pan = is_middle || modifiers.command;
        let transform = &state.look.transform;
        commands.push(match (modifiers.shift, is_pan) {
            (true, false) => Command::MoveEnvironment(turned(
                transform,
                state.view.up,
                -drag.x * DEGREES_PER_POINT,
            )),
            (true, true) => {
                let drag_px = Vec2::new(drag.x, drag.y) * per_point;
                Command::MoveEnvironment(shifted(transform, &state.view.viewpoint, drag_px, window))
            }
            (false, true) => Command::MoveCamera(pan(state, drag * per_point, window)),
            (false, false) => Command::MoveCamera(CameraMove::Orbit {
                yaw: drag.x * ORBIT_PER_POINT,
                pitch: drag.y * ORBIT_PER_POINT,
            }),
        });
    }
    if response.dragged() {
        ui.ctx().set_cursor_icon(if modifiers.shift {
            CursorIcon::Move
        } else {
            CursorIcon::Grabbing
        });
    }
    if response.double_clicked()
        && let Some(at) = response.interact_pointer_pos()
    {
        let at = (at - response.rect.min) * per_point;
        commands.push(Command::PivotAt {
            at: Vec2::new(at.x, at.y),
            window,
        });
    }
    if response.hovered() {
        let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta(), input.zoom_delta()));
        let factor = (-(scroll.y + scroll.x) * DOLLY_PER_POINT).exp() / zoom.max(1e-3);
        if factor != 1.0 {
            commands.push(Command::MoveCamera(CameraMove::Dolly(factor)));
        }
    }
}

/// The scene follows the pointer, so the camera goes the other way.
fn pan(state: &AppState, drag_px: egui::Vec2, window: (u32, u32)) -> CameraMove {
    let photo_height = state
        .view
        .viewpoint
        .photo_area(window.0, window.1)
        .size
        .y
        .max(1.0);
    CameraMove::Pan {
        right: -drag_px.x / photo_height,
        up: drag_px.y / photo_height,
    }
}

/// Where the camera stands and what of the picture is not what was learned.
fn caption_ui(ui: &Ui, rect: Rect, state: &AppState) {
    let view = state.view.at_view.and_then(|i| state.view_at(i));
    if let Some(view) = view {
        label(
            ui,
            rect.left_top() + vec2(10.0, 10.0),
            Align2::LEFT_TOP,
            &view.full_name(),
        );
    }
    if state.is_original_shown {
        label(
            ui,
            rect.center_top() + vec2(0.0, 10.0),
            Align2::CENTER_TOP,
            "Before edits (B shows them again)",
        );
    }
    if let Some(shown) = state
        .shown
        .filter(|shown| shown.step > 0 && state.training.phase == Phase::Training)
        // What a comparison says stands in the same place.
        .filter(|_| state.compare == Compare::default())
    {
        label(
            ui,
            rect.left_bottom() + vec2(10.0, -10.0),
            Align2::LEFT_BOTTOM,
            &format!("as of step {}", shown.step),
        );
    }
}

fn empty_ui(ui: &mut Ui, rect: Rect, state: &AppState, commands: &mut Vec<Command>) {
    let content = Rect::from_center_size(rect.center(), vec2(rect.width().min(420.0), 160.0));
    ui.scope_builder(egui::UiBuilder::new().max_rect(content), |ui| {
        ui.vertical_centered(|ui| match (&state.source, &state.training.phase) {
            (Source::Nothing, _) => {
                ui.heading("Open a capture to relight it");
                ui.label(weak(ui, "Posed photos of a glossy object, a saved run or an environment.\nDrop it here, or:"));
                ui.add_space(8.0);
                if ui.button("Open…").clicked() {
                    commands.push(Command::AskPath(PathPurpose::Open));
                }
                if ui.button("Open the bundled demo").clicked() {
                    commands.push(Command::OpenDemo);
                }
            }
            (_, Phase::Failed(reason)) => {
                ui.heading("This cannot be used");
                ui.label(reason);
                ui.add_space(8.0);
                if ui.button("Open something else…").clicked() {
                    commands.push(Command::AskPath(PathPurpose::Open));
                }
            }
            (_, Phase::Idle) => {
                ui.label(weak(ui, "Press “Start training”, or open a saved run."));
            }
            _ => {
                ui.spinner();
                ui.label(weak(ui, "Reading…"));
            }
        });
    });
}

/// While a file hovers over the window: says what dropping it will do.
fn drop_ui(ui: &Ui, rect: Rect) {
    let hovered = ui.input(|input| input.raw.hovered_files.clone());
    let Some(first) = hovered.first() else { return };
    let name = first.path.as_ref().map_or_else(
        || "this".to_owned(),
        |path| crate::app::state::source::file_name(path),
    );
    let is_environment = first
        .path
        .as_ref()
        .is_some_and(|path| is_environment_file(path));
    let text = if is_environment {
        format!("Drop to light the scene with “{name}”")
    } else {
        format!("Drop to open “{name}”")
    };
    ui.painter()
        .rect_filled(rect, 0.0, Color32::from_black_alpha(170));
    let style = egui::TextStyle::Heading.resolve(ui.style());
    ui.painter().text(
        rect.center(),
        Align2::CENTER_CENTER,
        text,
        style,
        Color32::WHITE,
    );
}
