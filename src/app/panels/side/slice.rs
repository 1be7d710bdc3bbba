//! The density slice: a plane through the environment, its place and its colour bar.

use egui::{Color32, Rect, Sense, Stroke, TextureId, Ui, pos2, vec2};

use crate::app::panels::section::section_heading;
use crate::app::panels::widgets::{describe_number, weak};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::sections::Section;
use crate::app::state::watch::WatchCommand;
use crate::app::theme;
use crate::app::viewport::overlay::color_bar;
use crate::color::map::ColorMap;
use crate::neif::Environment;
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
        describe_number(&slider, "Place of the slice");
        slider.on_hover_text("Place along the axis, through the field's inner box");
        if let Some(environment) = environment(state) {
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
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(picture, square, whole, Color32::WHITE);
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
    color_bar(
        ui,
        all.left_bottom(),
        "Density a field unit",
        &marks,
        &color,
    );
}

fn environment(state: &AppState) -> Option<&Environment> {
    let own = state.snapshot.as_ref().map(|s| &s.environment);
    state.chosen_environment().or(own).map(|e| &**e)
}

/// Where the object's box lies in the picture, both 0 to 1 from its left top.
fn object_rect(state: &AppState, plane: SlicePlane) -> Option<Rect> {
    let frame = environment(state)?.frame();
    let bounds = state.view.bounds?;
    let place = |p| (frame.field_from_world(p) + 1.0) * 0.5;
    let (low, high) = (place(bounds.min), place(bounds.max));
    let [right, up] = plane.picture_axes();
    Some(Rect::from_min_max(
        pos2(low[right], 1.0 - high[up]),
        pos2(high[right], 1.0 - low[up]),
    ))
}
