//! The photo at hand while the object is selected: its outline, the brush, and what the mouse does there.

use egui::{
    Align2, Color32, CursorIcon, PointerButton, Pos2, Rect, Response, Role, Sense, Stroke, Ui,
    WidgetInfo, pos2, vec2,
};
use glam::Vec2;

use super::state::{ObjectCommand, Search};
use crate::app::panels::widgets::log_place;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::viewport::compare_view::photo_area;
use crate::app::viewport::overlay::{Pictures, WHOLE, label};
use crate::data::View;
use crate::train::masks;

/// Change of the logarithm of the brush's size for one point of scrolling.
const BRUSH_PER_POINT: f32 = 0.004;
/// Colours of strokes that add and that remove.
const ADDS: Color32 = Color32::from_rgba_premultiplied(30, 130, 60, 130);
const REMOVES: Color32 = Color32::from_rgba_premultiplied(140, 30, 30, 130);

/// Draws the photo at hand into all of `rect`.
pub(in crate::app) fn object_view_ui(
    ui: &Ui,
    rect: Rect,
    state: &AppState,
    pictures: &Pictures,
    commands: &mut Vec<Command>,
) {
    ui.painter()
        .rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    let view = state.object_view().and_then(|i| state.view_at(i));
    let (Some(view), Some(photo)) = (view, pictures.object.outlined.or(pictures.photo)) else {
        let text = "Choose a photo at the left";
        label(ui, rect.center(), Align2::CENTER_CENTER, text);
        return;
    };
    let area = photo_area(ui, rect, state);
    ui.painter().image(photo, area, WHOLE, Color32::WHITE);
    let response = ui.interact(rect, ui.scope_id().with("object"), Sense::click_and_drag());
    let name = "Photo in which the object is selected";
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, name));
    log_place(ui, "object photo", area);
    let frame = PhotoFrame { area, view };
    let unheard = state.object.unheard();
    for stroke in unheard.filter(|stroke| Some(stroke.view) == state.object_view()) {
        stroke_ui(ui, stroke, frame);
    }
    if state.object.found.is_some() {
        brush_ui(ui, &response, state, frame, commands);
    } else if let Some(at) = response
        .interact_pointer_pos()
        .filter(|_| response.clicked())
    {
        commands.extend(
            frame
                .inside(at)
                .map(|at| Command::Object(ObjectCommand::PointAt(at))),
        );
    }
    if response.hovered() && !matches!(state.object.search, Search::Busy(..)) {
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
    }
    let at = rect.left_top() + vec2(10.0, 10.0);
    label(ui, at, Align2::LEFT_TOP, &view.full_name());
    if let Some(hint) = hint(state) {
        let at = rect.center_bottom() - vec2(0.0, 10.0);
        label(ui, at, Align2::CENTER_BOTTOM, &hint);
    }
}

/// Shows a stroke until the outline follows it.
fn stroke_ui(ui: &Ui, stroke: &masks::Stroke, frame: PhotoFrame<'_>) {
    let color = if stroke.adds { ADDS } else { REMOVES };
    let places: Vec<Pos2> = stroke.places.iter().map(|at| frame.point(*at)).collect();
    let radius = stroke.radius * frame.scale();
    let painter = ui.painter().with_clip_rect(frame.area);
    if let [place] = places[..] {
        painter.circle_filled(place, radius, color);
    }
    painter.line(places, Stroke::new(2.0 * radius, color));
}

/// What to do, or what is done.
fn hint(state: &AppState) -> Option<String> {
    let object = &state.object;
    match &object.search {
        Search::Busy(what, share) => Some(format!("{what}… {:.0} %", 100.0 * share)),
        Search::Failed(_) => None,
        Search::Idle if object.selection.is_none() => Some("Click on the object".to_owned()),
        Search::Idle if object.found.is_none() => Some("Finding the object…".to_owned()),
        Search::Idle => {
            Some("Drag: correct the outline. Shift or right button: the other way.".to_owned())
        }
    }
}

/// Where a photo lies in the window.
#[derive(Clone, Copy)]
struct PhotoFrame<'a> {
    area: Rect,
    view: &'a View,
}

impl PhotoFrame<'_> {
    fn size(self) -> Vec2 {
        Vec2::new(
            self.view.camera.width as f32,
            self.view.camera.height as f32,
        )
    }

    /// A point of the window in pixels of the photo.
    fn pixel(self, at: Pos2) -> Vec2 {
        let share = (at - self.area.min) / self.area.size();
        Vec2::new(share.x, share.y) * self.size()
    }

    /// The same where it lies in the photo.
    fn inside(self, at: Pos2) -> Option<Vec2> {
        self.area.contains(at).then(|| self.pixel(at))
    }

    /// A pixel of the photo in the window.
    fn point(self, at: Vec2) -> Pos2 {
        let share = at / self.size();
        self.area.min + vec2(share.x, share.y) * self.area.size()
    }

    /// Points of the window that a pixel of the photo is wide.
    fn scale(self) -> f32 {
        self.area.width() / self.size().x
    }
}

fn brush_ui(
    ui: &Ui,
    response: &Response,
    state: &AppState,
    frame: PhotoFrame<'_>,
    commands: &mut Vec<Command>,
) {
    let object = &state.object;
    let is_other = ui.input(|input| input.modifiers.shift);
    let buttons = [
        (PointerButton::Primary, object.adds),
        (PointerButton::Secondary, !object.adds),
    ];
    for (button, adds) in buttons {
        let adds = adds ^ is_other;
        let is_down = response.dragged_by(button) || response.clicked_by(button);
        if is_down && let Some(at) = response.interact_pointer_pos() {
            if response.drag_started_by(button)
                && let Some(origin) = ui.input(|input| input.pointer.press_origin())
            {
                let at = frame.pixel(origin);
                commands.push(Command::Object(ObjectCommand::Draw { at, adds }));
            }
            let at = frame.pixel(at);
            commands.push(Command::Object(ObjectCommand::Draw { at, adds }));
        }
        if response.drag_stopped_by(button) || response.clicked_by(button) {
            commands.push(Command::Object(ObjectCommand::Lift));
        }
    }
    let shorter = frame.size().min_element();
    let radius = object.brush * shorter * frame.scale();
    let Some(at) = response.hover_pos() else {
        return;
    };
    for (width, color) in [(2.5, Color32::BLACK), (1.2, Color32::WHITE)] {
        ui.painter()
            .circle_stroke(at, radius, Stroke::new(width, color));
    }
    // A sign in the middle says what the brush does.
    let adds = object.adds ^ is_other;
    let arm = 3.5;
    let lines = [
        [pos2(at.x - arm, at.y), pos2(at.x + arm, at.y)],
        [pos2(at.x, at.y - arm), pos2(at.x, at.y + arm)],
    ];
    for line in &lines[..if adds { 2 } else { 1 }] {
        ui.painter()
            .line_segment(*line, Stroke::new(1.5, Color32::WHITE));
    }
    let scroll = ui.input(egui::InputState::smooth_scroll_delta);
    if scroll.y != 0.0 {
        let brush = object.brush * (scroll.y * BRUSH_PER_POINT).exp();
        commands.push(Command::Object(ObjectCommand::SetBrush(brush)));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::app::changes::apply::apply;
    use crate::app::object::panel::object_panel_ui;
    use crate::app::state::command::Effect;
    use crate::app::state::source::Source;
    use crate::train::masks::{Selection, find_object, test_capture};

    #[derive(Default)]
    struct Shown {
        state: AppState,
        effects: Vec<Effect>,
    }

    /// A photo of two balls, one of which is found.
    fn harness() -> Harness<'static, Shown> {
        let dataset = Arc::new(test_capture::dataset());
        let asked = (&Selection::default(), &[][..]);
        let (place, never) = (test_capture::place(), AtomicBool::new(false));
        let found = find_object(&dataset, &place, asked, &never, &|_| ()).expect("a ball");
        let mut shown = Shown::default();
        let state = &mut shown.state;
        state.source = Source::Capture("/photos".into());
        state.set_dataset(dataset);
        state.object.is_open = true;
        state.object.selection = Some(Selection::default());
        state.object.found = Some(Arc::new(found));
        let draw = |ui: &mut Ui, shown: &mut Shown| {
            let pictures = Pictures {
                photo: Some(egui::TextureId::default()),
                ..Pictures::default()
            };
            let mut commands = Vec::new();
            egui::Panel::left("left").show(ui, |ui| {
                object_panel_ui(ui, &shown.state, &pictures.object, &mut commands);
            });
            object_view_ui(
                ui,
                ui.available_rect_before_wrap(),
                &shown.state,
                &pictures,
                &mut commands,
            );
            for command in commands {
                apply(&mut shown.state, command, &mut shown.effects);
            }
        };
        let mut harness = Harness::builder()
            .with_size([900.0, 600.0])
            .build_ui_state(draw, shown);
        harness.run_steps(3);
        harness
    }

    fn click(harness: &mut Harness<'_, Shown>, label: &str) {
        harness.get_by_label(label).click();
        harness.run_steps(3);
    }

    #[test]
    fn a_drag_draws_a_stroke_in_the_photo_s_pixels_which_buttons_take_back() {
        let mut harness = harness();
        harness.get_by_label_contains("Found in 14 photos");
        let name = "Photo in which the object is selected";
        let middle = harness.get_by_label(name).rect().center();
        click(&mut harness, "Remove");
        harness.hover_at(middle);
        harness.run_steps(2);
        harness.drag_at(middle);
        harness.run_steps(1);
        for i in 1..=4 {
            harness.hover_at(middle + vec2(15.0 * i as f32, 0.0));
            harness.run_steps(1);
        }
        assert!(
            harness.state().state.object.drawing.is_some(),
            "not lifted yet"
        );
        harness.drop_at(middle + vec2(60.0, 0.0));
        harness.run_steps(3);
        let [stroke] = &harness.state().state.object.strokes[..] else {
            panic!("{:?}", harness.state().state.object.strokes);
        };
        assert!(!stroke.adds && stroke.view == 0);
        // The photo of 96 pixels fills the height of 600 points.
        let (first, last) = (stroke.places[0], stroke.places[stroke.places.len() - 1]);
        assert!(first.distance(Vec2::splat(48.0)) < 0.6, "{first}");
        let length = 60.0 * 96.0 / 600.0;
        assert!((last.distance(first) - length).abs() < 1.0, "{last}");
        assert_eq!(
            harness.state().state.object.unheard().count(),
            1,
            "shown as it is drawn"
        );
        click(&mut harness, "Undo");
        assert!(harness.state().state.object.strokes.is_empty());
        click(&mut harness, "Redo");
        assert_eq!(harness.state().state.object.strokes.len(), 1);
    }

    #[test]
    fn what_looks_right_is_trained() {
        let mut harness = harness();
        click(&mut harness, "train / r_05");
        assert_eq!(harness.state().state.object_view(), Some(5));
        click(&mut harness, "Export masks…");
        let dialog = harness.state().state.overlays.path_dialog.as_ref();
        assert!(dialog.is_some_and(|dialog| dialog.typed.ends_with("masks")));
        click(&mut harness, "Looks right: train");
        assert_eq!(harness.state().effects, [Effect::TrainObject]);
        click(&mut harness, "Another object");
        let object = &harness.state().state.object;
        assert!(object.is_open && object.selection.is_none() && object.found.is_none());
        click(&mut harness, "Cancel");
        assert!(!harness.state().state.object.is_open);
    }
}
