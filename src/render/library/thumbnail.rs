//! Small panoramas of environments, for lists.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use crate::color::luminance;
use crate::data::Rgba8;
use crate::neif::Environment;
use crate::neif::light::display::Display;
use crate::render::output::panorama::{PanoramaView, panorama_of};
use crate::render::scene::Scene;

/// Pixels per row; half as many rows.
pub const THUMBNAIL_WIDTH: u32 = 176;
/// What the median luminance becomes, so that pictures of any exposure can be distinguished.
const MEDIAN: f32 = 0.2;
/// Most that a picture is brightened or darkened by, as a factor.
const MOST_GAIN: f32 = 64.0;

/// What the middle of the environment sees all around, its up axis upwards.
pub fn thumbnail(environment: Arc<Environment>) -> Rgba8 {
    let view = PanoramaView {
        at: environment.inner_box().center(),
        up: environment.up(),
        roughness: 0.0,
        width: THUMBNAIL_WIDTH,
    };
    let gamma = environment.gamma();
    let display = Display { gamma };
    let scene = Scene::new(None, environment);
    let seen = panorama_of(&scene, &view, &AtomicBool::new(false));
    let seen = seen.expect("nothing cancels it");
    let gain = gain(&seen.pixels);
    let shown = |v: f32| (display.value((v * gain).max(0.0)).min(1.0) * 255.0 + 0.5) as u8;
    let pixel = |pixel: &[f32; 3]| {
        let [r, g, b] = pixel.map(shown);
        [r, g, b, 255]
    };
    Rgba8 {
        width: seen.width,
        height: seen.height,
        pixels: seen.pixels.iter().map(pixel).collect(),
    }
}

/// Brings the median luminance to [`MEDIAN`].
fn gain(pixels: &[[f32; 3]]) -> f32 {
    let mut light: Vec<f32> = pixels.iter().map(|p| luminance(Vec3::from(*p))).collect();
    light.sort_by(f32::total_cmp);
    let median = light.get(light.len() / 2).copied().unwrap_or(MEDIAN);
    // A black environment stays black.
    (MEDIAN / median.max(1e-9)).clamp(1.0 / MOST_GAIN, MOST_GAIN)
}

#[cfg(test)]
pub(crate) mod tests {
    use glam::Quat;

    use super::*;
    use crate::neif::distant::{DistantConfig, DistantLight};

    /// A sky of one colour, black below the horizon.
    pub(crate) fn sky(color: [f32; 3], up: Vec3) -> Environment {
        let config = DistantConfig {
            width: 16,
            height: 8,
            world_from_picture: Quat::IDENTITY,
            has_floor: false,
        };
        // The upper half (towards +z) has the colour, the lower one is black.
        let pixel = |i: usize| if i < 64 { color } else { [0.0; 3] };
        let pixels: Vec<f32> = (0..128).flat_map(pixel).collect();
        let light = DistantLight::new(config, &pixels).expect("a picture");
        Environment::of_distant("sky".to_owned(), up, light)
    }

    #[test]
    fn the_up_axis_is_up_in_a_thumbnail() {
        let top = |up| {
            let picture = thumbnail(Arc::new(sky([3.0, 1.0, 1.0], up)));
            let row = picture.width as usize;
            (
                picture.pixels[row * 4][0],
                picture.pixels[picture.pixels.len() - row * 4][0],
            )
        };
        let (above, below) = top(Vec3::Z);
        assert!(above > 100 && below < 50, "{above} {below}");
        let (above, below) = top(Vec3::NEG_Z);
        assert!(above < 50 && below > 100, "{above} {below}");
    }
}
