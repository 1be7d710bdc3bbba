//! The colour bar of the layers that show numbers.

use egui::{Rect, Ui, vec2};

use super::overlay::color_bar;
use crate::app::state::app_state::AppState;
use crate::color::map::ColorMap;
use crate::render::Layer;
use crate::render::diagnostic::{SAMPLES_RANGE, depth_range};

/// Draws the bar at the left top of the viewport, under the caption, where the layer has one.
pub(super) fn layer_bar_ui(ui: &Ui, rect: Rect, state: &AppState) {
    let at = rect.left_top() + vec2(10.0, 96.0);
    let sequential = |t: f32| ColorMap::Sequential.srgb8(t);
    match state.layer {
        Layer::Depth => {
            let Some(object) = state.object() else {
                return;
            };
            let eye = state.view.viewpoint.camera.position();
            let [near, far] = depth_range(&object.tracer, eye);
            let marks = [far, 0.5 * (near + far), near].map(|v| format!("{v:.3}"));
            color_bar(ui, at, "Distance, scene units", &marks, &sequential);
        }
        Layer::Visibility | Layer::Roughness => {
            let marks = ["0", "0.5", "1"].map(str::to_owned);
            let grey = |t: f32| [(t * 255.0) as u8; 3];
            let legend = match state.layer {
                Layer::Roughness => "Roughness",
                _ => "Share of the sky seen",
            };
            color_bar(ui, at, legend, &marks, &grey);
        }
        Layer::Samples => {
            let [low, high] = SAMPLES_RANGE;
            let marks = [low, (low * high).sqrt(), high].map(|v| format!("{v:.0}"));
            color_bar(ui, at, "Field samples a pixel", &marks, &sequential);
        }
        _ => {}
    }
}
