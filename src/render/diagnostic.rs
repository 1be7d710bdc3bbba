//! Layers that say how a picture comes about rather than what it looks like: depth, visibility, field samples.

use glam::Vec3;

use super::path::trace::is_hidden;
use super::scene::{Layer, Scene};
use crate::color::map::ColorMap;
use crate::geometry::{SurfaceTracer, irradiance_directions};
use crate::neif::light::shading::SurfacePoint;

/// Rays that look for the open from a point of a light path.
const VISIBILITY_RAYS: usize = 8;
/// Field samples a pixel at both ends of the colours.
pub const SAMPLES_RANGE: [f32; 2] = [8.0, 2048.0];

/// Distances from `eye` at both ends of the colours of [`Layer::Depth`]: the nearest and farthest that the object's
/// bounding ball allows, world units.
pub fn depth_range(tracer: &SurfaceTracer, eye: Vec3) -> [f32; 2] {
    let (center, radius) = tracer.bounding_ball();
    let distance = (center - eye).length();
    let near = (distance - radius).max(0.0);
    // A ball of a single point would divide by nothing.
    [near, (distance + radius).max(near + 1e-6)]
}

/// Place of a distance in a range, 0 to 1.
pub(super) fn depth_share(tracer: &SurfaceTracer, eye: Vec3, position: Vec3) -> f32 {
    let [near, far] = depth_range(tracer, eye);
    (((position - eye).length() - near) / (far - near)).clamp(0.0, 1.0)
}

/// Share of the light of a uniform sky that the object itself does not keep from the point, 0 to 1; `turn` (radians)
/// turns the rays.
pub(super) fn visibility(tracer: &SurfaceTracer, point: &SurfacePoint, turn: f32) -> f32 {
    let directions = irradiance_directions(point.normal, VISIBILITY_RAYS, turn);
    let is_open =
        |(toward, _): &(Vec3, f32)| !is_hidden(tracer, point.position, *toward, f32::INFINITY);
    let n_open = directions.filter(is_open);
    n_open.count() as f32 / VISIBILITY_RAYS as f32
}

/// Place of a value in a range of positive numbers by its logarithm, 0 to 1.
pub(super) fn logarithmic_share(value: f32, [low, high]: [f32; 2]) -> f32 {
    ((value.max(low) / low).ln() / (high / low).ln()).min(1.0)
}

/// The sRGB colour of a diagnostic layer where the object covers `coverage` of the pixel and has `value`; `None` for the
/// layers that are pictures.
pub(super) fn diagnostic_color(
    scene: &Scene,
    layer: Layer,
    coverage: f32,
    value: f32,
) -> Option<[f32; 3]> {
    let (share, coverage) = match layer {
        Layer::Depth => (1.0 - value, coverage),
        Layer::Visibility => return Some([(value * coverage).clamp(0.0, 1.0); 3]),
        Layer::Samples => {
            let behind = if coverage < 1.0 {
                scene.environment.n_samples() as f32
            } else {
                0.0
            };
            (logarithmic_share(value + behind, SAMPLES_RANGE), 1.0)
        }
        _ => return None,
    };
    let rgb = ColorMap::Sequential.srgb8(share);
    Some(rgb.map(|c| f32::from(c) / 255.0 * coverage))
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{camera, picture, scene};
    use super::*;
    use crate::neif::RoughnessEdit;

    fn pixels(scene: &Scene, layer: Layer) -> Vec<[f32; 3]> {
        picture(scene, &camera(24, 24), layer).pixels
    }

    #[test]
    fn nearer_is_lighter_and_nothing_is_black() {
        let depth = pixels(&scene(), Layer::Depth);
        let brightness = |p: &[f32; 3]| p.iter().sum::<f32>();
        assert_eq!(depth[0], [0.0; 3], "no object in the corner");
        let all = depth.iter().map(brightness);
        assert!(all.fold(0.0, f32::max) > 1.0, "the front of the object");
    }

    #[test]
    fn an_edited_roughness_costs_more_samples_on_the_object_alone() {
        let learned = scene();
        let mut edited = scene();
        edited.edit.roughness = RoughnessEdit::Constant(0.9);
        let (before, after) = (
            pixels(&learned, Layer::Samples),
            pixels(&edited, Layer::Samples),
        );
        assert_eq!(before[0], after[0], "the environment costs the same");
        assert_ne!(before, after, "wide lobes take several cones");
    }

    #[test]
    fn counts_have_places_in_their_range() {
        let [low, high] = SAMPLES_RANGE;
        let share = |value| logarithmic_share(value, SAMPLES_RANGE);
        assert_eq!([0.0, low, high, 1e9].map(share), [0.0, 0.0, 1.0, 1.0]);
        assert!((share((low * high).sqrt()) - 0.5).abs() < 1e-5);
    }
}
