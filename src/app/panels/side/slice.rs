//! The density slice: a plane through the environment, its place and its colour bar.

use egui::{Color32, Rect, Sense, Stroke, TextureId, Ui, pos2, vec2};

use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{set_label, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::app::state::watch::WatchCommand;
use crate::app::theme;
use crate::app::viewport::overlay::{WHOLE, color_bar};
use crate::color::map::ColorMap;
use crate::render::output::slice::{DENSITY_RANGE, SlicePlane};

/// Side of the picture.
const SIDE: f32 = 200.0;
/// Room for the colour bar under it.
const BAR_HEIGHT: f32 = 56.0;

/// Draws the slice; `picture` is its newest picture.
pub fn slice_ui(
    ui: &mut Ui,
    state: &AppState,
    picture: Option<TextureId>,
    commands: &mut Vec<Command>,
) {
    let is_open = section_heading(ui, state, Section::Slice, commands);
    if is_open {
        plane_ui(ui, state, commands);
        picture_ui(ui, state, picture);
    }
    if is_open != state.watch.is_slice_shown {
        commands.push(Command::Watch(WatchCommand::ShowSlice(is_open)));
    }
}

fn plane_ui(ui: &mut Ui, state: &AppState, commands: &mut Vec<Command>) {
    let mut plane = state.watch.slice;
    ui.horizontal(|ui| {
        for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
            let button = ui.selectable_value(&mut plane.axis, axis, name);
            button.on_hover_text("The axis across the plane");
        }
        let slider = egui::Slider::new(&mut plane.share, 0.0..=1.0).show_value(false);
        let slider = ui.add(slider);
        set_label(&slider, "Place of the slice");
        slider.on_hover_text("Place along the axis, through the field's inner box");
        if let Some(environment) = state.shown_environment() {
            let bounds = environment.inner_box();
            let at = bounds.min + bounds.extent() * plane.share;
            ui.label(format!("{:.2}", at[plane.axis]));
        }
    });
    if plane != state.watch.slice {
        commands.push(Command::Watch(WatchCommand::MoveSlice(plane)));
    }
}

fn picture_ui(ui: &mut Ui, state: &AppState, picture: Option<TextureId>) {
    let Some(picture) = picture else {
        ui.label(weak(ui, "This environment has no density yet."));
        return;
    };
    let (all, response) = ui.allocate_exact_size(vec2(SIDE, SIDE + BAR_HEIGHT), Sense::hover());
    response
        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Density on a plane"));
    let square = Rect::from_min_size(all.min, vec2(SIDE, SIDE));
    ui.painter().image(picture, square, WHOLE, Color32::WHITE);
    if let Some(object) = object_rect(state, state.watch.slice) {
        let min = square.min + object.min.to_vec2() * SIDE;
        let object = Rect::from_min_size(min, object.size() * SIDE).intersect(square);
        let stroke = Stroke::new(1.0, theme::accent(ui.visuals()));
        ui.painter()
            .rect_stroke(object, 0.0, stroke, egui::StrokeKind::Outside);
    }
    let [low, high] = DENSITY_RANGE;
    let marks = [low, (low * high).sqrt(), high].map(|v| format!("{v}"));
    let color = |t: f32| ColorMap::Sequential.srgb8(t);
    let at = all.left_bottom();
    color_bar(ui, at, "Density a field unit", &marks, &color);
}

/// Where the object's box lies in the picture, both 0 to 1 from its left top.
fn object_rect(state: &AppState, plane: SlicePlane) -> Option<Rect> {
    let frame = state.shown_environment()?.frame();
    let bounds = state.view.bounds?;
    let place = |p| (frame.field_from_world(p) + 1.0) * 0.5;
    let (low, high) = (place(bounds.min), place(bounds.max));
    let [right, up] = plane.picture_axes();
    Some(Rect::from_min_max(
        pos2(low[right], 1.0 - high[up]),
        pos2(high[right], 1.0 - low[up]),
    ))
}
