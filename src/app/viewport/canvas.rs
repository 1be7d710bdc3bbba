//! The viewport: the preview picture, the photo over it, and what the mouse does there.

use egui::{
    Align2, Color32, CursorIcon, PointerButton, Rect, Response, Role, Sense, Ui, WidgetInfo, vec2,
};
use glam::Vec2;

use super::camera_control::CameraMove;
use super::compare_view::{self, photo_ui};
use super::environment_control::{DEGREES_PER_POINT, shifted, turned_about};
use super::fly::fly_ui;
use super::frustums::frustums_ui;
use super::layer_bar::layer_bar_ui;
use super::overlay::{Pictures, WHOLE, label};
use super::screen::Screen;
use crate::app::inspect::marker::{marker_ui, pick_ui};
use crate::app::lighting::anchor::anchor;
use crate::app::lighting::{LightingCommand, gizmo_ui, lines_ui, split_ui};
use crate::app::object::view::object_view_ui;
use crate::app::panels::widgets::{log_place, on_click, weak};
use crate::app::state::app_state::{AppState, Compare, PathPurpose};
use crate::app::state::command::Command;
use crate::app::state::source::{Source, file_name, is_light};
use crate::app::state::training_state::Phase;

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
    let screen = Screen::new(ui.ctx(), rect, state);
    if state.object.is_open {
        object_view_ui(ui, rect, state, pictures, commands);
        drop_ui(ui, whole);
        return screen.window;
    }
    match (pictures.preview, pictures.first) {
        (Some(preview), _) => {
            let id = ui.scope_id().with("viewport");
            let response = ui.interact(rect, id, Sense::click_and_drag());
            let name = "Preview of the scene";
            response.widget_info(|| WidgetInfo::labeled(Role::Image, true, name));
            log_place(ui, "viewport", rect);
            mouse_ui(ui, &response, state, screen, commands);
            fly_ui(ui, &response, state, commands);
            split_ui::pictures_ui(ui, rect, state, preview, pictures.preview_b);
            // A click on a camera goes there instead of looking into what is behind it.
            let is_free = !state.lighting.is_setting_down;
            if !frustums_ui(ui, screen, &response, state, commands) && is_free {
                pick_ui(ui, &response, screen, commands);
            }
            photo_ui(ui, (beside, rect), state, pictures, commands);
            marker_ui(ui, screen, state);
            lines_ui::lines_ui(ui, screen, state);
            split_ui::line_ui(ui, rect, state, commands);
            gizmo_ui::gizmo_ui(ui, screen, state, commands);
            caption_ui(ui, rect, state);
            layer_bar_ui(ui, rect, state);
        }
        (None, Some((picture, size, words))) => {
            let area = fit(rect, vec2(size[0] as f32, size[1] as f32));
            ui.painter().image(picture, area, WHOLE, Color32::WHITE);
            let at = area.left_top() + vec2(10.0, 10.0);
            label(ui, at, Align2::LEFT_TOP, words);
        }
        (None, None) => empty_ui(ui, rect, state, commands),
    }
    drop_ui(ui, whole);
    screen.window
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
    screen: Screen,
    commands: &mut Vec<Command>,
) {
    let modifiers = ui.input(|input| input.modifiers);
    let is_setting_down = state.lighting.is_setting_down && !modifiers.any();
    if is_setting_down && set_down_ui(ui, response, screen, commands) {
        return;
    }
    let drag = response.drag_delta();
    let drag_px = Vec2::new(drag.x, drag.y) * screen.per_point;
    let is_middle = response.dragged_by(PointerButton::Middle);
    if (response.dragged_by(PointerButton::Primary) || is_middle) && drag != egui::Vec2::ZERO {
        let is_pan = is_middle || modifiers.command;
        let (transform, view) = (&state.look.transform, &state.view);
        commands.push(match (modifiers.shift, is_pan) {
            (true, false) => {
                let degrees = -drag.x * DEGREES_PER_POINT;
                let center = anchor(state);
                Command::MoveEnvironment(turned_about(transform, center, view.up, degrees))
            }
            (true, true) => {
                let shifted = shifted(transform, &view.viewpoint, drag_px, screen.window);
                Command::MoveEnvironment(shifted)
            }
            (false, true) => Command::MoveCamera(pan(state, drag_px, screen.window)),
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
        commands.push(Command::PivotAt {
            at: screen.to_pixels(at),
            window: screen.window,
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

/// A press or drag that sets the object down; whether it is one.
fn set_down_ui(ui: &Ui, response: &Response, screen: Screen, commands: &mut Vec<Command>) -> bool {
    if response.hovered() {
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
    }
    let is_dragged = response.dragged_by(PointerButton::Primary);
    let is_new = response.drag_started_by(PointerButton::Primary)
        || response.clicked_by(PointerButton::Primary)
        || is_dragged && response.drag_delta() != egui::Vec2::ZERO;
    if is_new && let Some(at) = response.interact_pointer_pos() {
        let (at, window) = (screen.to_pixels(at), screen.window);
        let command = LightingCommand::SetDown { at, window };
        commands.push(Command::Lighting(command));
    }
    is_dragged || is_new
}

/// The scene follows the pointer, so the camera goes the other way.
fn pan(state: &AppState, drag_px: Vec2, (width, height): (u32, u32)) -> CameraMove {
    let photo = state.view.viewpoint.photo_area(width, height);
    let by = drag_px / photo.size.y.max(1.0);
    CameraMove::Pan {
        right: -by.x,
        up: by.y,
    }
}

/// Where the camera stands and what of the picture is not what was learned.
fn caption_ui(ui: &Ui, rect: Rect, state: &AppState) {
    if let Some(view) = state.view.at_view.and_then(|i| state.view_at(i)) {
        let at = rect.left_top() + vec2(10.0, 10.0);
        label(ui, at, Align2::LEFT_TOP, &view.full_name());
    }
    if state.is_original_shown {
        let at = rect.center_top() + vec2(0.0, 10.0);
        let text = "Before edits (B shows them again)";
        label(ui, at, Align2::CENTER_TOP, text);
    }
    // What a comparison says stands in the same place.
    let is_free = state.compare == Compare::default();
    if let Some(shown) = state.shown.filter(|shown| shown.step > 0 && is_free)
        && state.training.phase == Phase::Training
    {
        let at = rect.left_bottom() + vec2(10.0, -10.0);
        let text = format!("as of step {}", shown.step);
        label(ui, at, Align2::LEFT_BOTTOM, &text);
    }
}

fn empty_ui(ui: &mut Ui, rect: Rect, state: &AppState, commands: &mut Vec<Command>) {
    let content = Rect::from_center_size(rect.center(), vec2(rect.width().min(420.0), 160.0));
    ui.scope_builder(egui::UiBuilder::new().max_rect(content), |ui| {
        ui.vertical_centered(|ui| match (&state.source, &state.training.phase) {
            (Source::Nothing, _) => {
                ui.heading("Open a capture to relight it");
                ui.label(weak(ui, "Posed photos of a glossy object, a saved run, an environment or a scan.\nDrop it here, or:"));
                ui.add_space(8.0);
                let open = Command::AskPath(PathPurpose::Open);
                on_click(&ui.button("Open…"), open, commands);
                let demo = ui.button("Open the bundled demo");
                on_click(&demo, Command::OpenDemo, commands);
            }
            (_, Phase::Failed(reason)) => {
                ui.heading("This cannot be used");
                ui.label(reason);
                ui.add_space(8.0);
                let open = Command::AskPath(PathPurpose::Open);
                on_click(&ui.button("Open something else…"), open, commands);
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
    let path = first.path.as_ref();
    let name = path.map_or("this".to_owned(), |path| file_name(path));
    let text = if path.is_some_and(|path| is_light(path)) {
        format!("Drop to light the scene with “{name}”")
    } else {
        format!("Drop to open “{name}”")
    };
    let (painter, shade) = (ui.painter(), Color32::from_black_alpha(170));
    painter.rect_filled(rect, 0.0, shade);
    let style = egui::TextStyle::Heading.resolve(ui.style());
    let (at, anchor) = (rect.center(), Align2::CENTER_CENTER);
    painter.text(at, anchor, text, style, Color32::WHITE);
}
