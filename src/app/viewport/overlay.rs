//! What is drawn over the picture: words, and bars of colours.

use std::path::Path;
use std::sync::Arc;

use egui::{
    Align2, Color32, CursorIcon, FontId, Pos2, Rect, Role, Sense, Stroke, TextureId, Ui,
    WidgetInfo, pos2, vec2,
};

use crate::app::object::pictures::ObjectPictures;

/// All of a texture.
pub(in crate::app) const WHOLE: Rect = Rect {
    min: pos2(0.0, 0.0),
    max: pos2(1.0, 1.0),
};

/// Pictures on the graphics card.
#[derive(Clone, Debug, Default)]
pub struct Pictures {
    /// The preview.
    pub preview: Option<TextureId>,
    /// The preview of B, while both are compared.
    pub preview_b: Option<TextureId>,
    /// The photo of the view at which the camera stands.
    pub photo: Option<TextureId>,
    /// The error map that is asked for.
    pub error: Option<TextureId>,
    /// The slice through the environment.
    pub slice: Option<TextureId>,
    /// A photo of a capture that is being read, or the object's surface as it grows; its size in pixels, and what is said of it.
    pub first: Option<(TextureId, [usize; 2], &'static str)>,
    /// The environment as the picked point sees it.
    pub panorama: Option<TextureId>,
    /// Those of the object while it is selected.
    pub object: ObjectPictures,
    /// Small pictures of environments, with their files.
    pub thumbnails: Vec<(Arc<Path>, TextureId)>,
    /// The same of the environment that was opened or trained.
    pub own_thumbnail: Option<TextureId>,
}

/// White text on a dark ground, readable over any picture; returns where it is.
pub(in crate::app) fn label(ui: &Ui, at: Pos2, anchor: Align2, text: &str) -> Rect {
    let galley =
        ui.painter()
            .layout_no_wrap(text.to_owned(), FontId::proportional(13.0), Color32::WHITE);
    let rect = anchor.anchor_size(at, galley.size() + vec2(12.0, 6.0));
    ui.painter()
        .rect_filled(rect, 4.0, Color32::from_black_alpha(150));
    ui.painter()
        .galley(rect.min + vec2(6.0, 3.0), galley, Color32::WHITE);
    rect
}

/// Width of the strip that catches a line, in points.
const LINE_GRAB: f32 = 14.0;

/// An upright line between two pictures, at `share` of the width of `rect`; the share that it is dragged to.
pub(in crate::app) fn line_ui(
    ui: &Ui,
    rect: Rect,
    share: f32,
    id: &str,
    name: &str,
) -> Option<f32> {
    let x = rect.left() + share * rect.width();
    let strip = Rect::from_x_y_ranges(x - 0.5 * LINE_GRAB..=x + 0.5 * LINE_GRAB, rect.y_range());
    let handle = ui
        .interact(strip, ui.scope_id().with(id), Sense::drag())
        .on_hover_cursor(CursorIcon::ResizeHorizontal);
    handle.widget_info(|| WidgetInfo::labeled(Role::Slider, true, name));
    let is_hot = handle.hovered() || handle.dragged();
    let width = if is_hot { 3.0 } else { 1.5 };
    for (width, color) in [
        (width + 2.0, Color32::from_black_alpha(120)),
        (width, Color32::WHITE),
    ] {
        ui.painter()
            .vline(x, rect.y_range(), Stroke::new(width, color));
    }
    let at = handle.interact_pointer_pos().filter(|_| handle.dragged())?;
    Some((at.x - rect.left()) / rect.width().max(1.0))
}

/// Size of the colour bar.
const BAR: egui::Vec2 = vec2(180.0, 10.0);

/// Steps of colour in it.
const BAR_STEPS: usize = 60;

/// A horizontal bar of the colours from 0 to 1 with numbers at equal distances under it; `at` is its left bottom.
pub(in crate::app) fn color_bar(
    ui: &Ui,
    at: Pos2,
    legend: &str,
    marks: &[String],
    color: &dyn Fn(f32) -> [u8; 3],
) {
    let (pad, text_height) = (8.0, 16.0);
    let size = BAR + vec2(2.0 * pad + 16.0, 2.0 * text_height + 10.0);
    let ground = Rect::from_min_size(at - vec2(0.0, size.y), size);
    let painter = ui.painter();
    painter.rect_filled(ground, 4.0, Color32::from_black_alpha(150));
    let font = FontId::proportional(12.0);
    let text = |at: Pos2, anchor: Align2, text: &str| {
        painter.text(at, anchor, text, font.clone(), Color32::WHITE);
    };
    let left_top = ground.min + vec2(pad + 8.0, 4.0);
    text(left_top - vec2(8.0, 0.0), Align2::LEFT_TOP, legend);
    let bar = Rect::from_min_size(left_top + vec2(0.0, text_height), BAR);
    for i in 0..BAR_STEPS {
        let x = |i: usize| bar.left() + bar.width() * i as f32 / BAR_STEPS as f32;
        let part = Rect::from_x_y_ranges(x(i)..=x(i + 1), bar.y_range());
        let [r, g, b] = color((i as f32 + 0.5) / BAR_STEPS as f32);
        painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
    }
    let last = marks.len().saturating_sub(1).max(1) as f32;
    for (i, mark) in marks.iter().enumerate() {
        let x = bar.left() + bar.width() * i as f32 / last;
        let tick = bar.bottom()..=bar.bottom() + 3.0;
        painter.vline(x, tick, Stroke::new(1.0, Color32::WHITE));
        text(pos2(x, bar.bottom() + 3.0), Align2::CENTER_TOP, mark);
    }
}
