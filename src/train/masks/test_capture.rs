//! Photos of a red and a blue ball on a white floor, in a place whose surfaces are known.

use std::path::PathBuf;

use glam::Vec3;

use super::agreed::agreement_of;
use super::learn::LearnedPlace;
use crate::data::{Dataset, Mask, Photo, Split, View};
use crate::geometry::Camera;
use crate::render::test_scene::fog_where;

/// Middles of the balls, world, and their radii.
pub(crate) const BALLS: [Vec3; 2] = [Vec3::new(0.0, 0.0, -0.24), Vec3::new(0.4, 0.3, -0.28)];
pub(crate) const RADII: [f32; 2] = [0.16, 0.12];
/// sRGB of the balls and of everything else.
const COLORS: [[u8; 3]; 2] = [[200, 30, 30], [30, 60, 180]];
const WHITE: [u8; 3] = [255; 3];

fn is_in(ball: usize, p: Vec3) -> bool {
    p.distance(BALLS[ball]) < RADII[ball]
}

/// The place as it would be learned: white everywhere.
pub(crate) fn place() -> LearnedPlace {
    LearnedPlace::as_given(fog_where(|p| p.z < -0.4 || is_in(0, p) || is_in(1, p)))
}

pub(crate) fn cameras() -> Vec<Camera> {
    let camera = |i: usize| {
        let (sin, cos) = (i as f32 * 0.9).sin_cos();
        let eye = Vec3::new(0.8 * cos, 0.8 * sin, 0.1 + 0.08 * (i % 4) as f32);
        Camera::look_at(eye, BALLS[0], Vec3::Z, 0.9, 96, 96)
    };
    (0..14).map(camera).collect()
}

/// Photos without masks.
pub(crate) fn dataset() -> Dataset {
    let view = |(i, camera): (usize, Camera)| {
        // The nearer ball hides the other.
        let mut order = [0, 1];
        order.sort_by_key(|ball| camera.position().distance(BALLS[*ball]).to_bits());
        let masks = order.map(|ball| true_mask(&camera, &[ball]));
        let pixel = |i: u32| {
            let shown = (0..2).find(|k| masks[*k].is_object(i as usize));
            shown.map_or(WHITE, |k| COLORS[order[k]])
        };
        View {
            name: format!("r_{i:02}"),
            file: PathBuf::new(),
            split: Split::Train,
            camera,
            photo: Photo::Rgb8 {
                width: camera.width,
                height: camera.height,
                pixels: (0..camera.width * camera.height).map(pixel).collect(),
                chroma_block: [1, 1],
            },
            mask: None,
        }
    };
    Dataset::of_views(cameras().into_iter().enumerate().map(view).collect())
}

/// The silhouettes of some of the balls.
pub(crate) fn true_mask(camera: &Camera, balls: &[usize]) -> Mask {
    let (width, height) = (camera.width, camera.height);
    let meets = |i: u32| {
        let ray = camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        balls.iter().any(|ball| {
            let along = (BALLS[*ball] - ray.origin).dot(ray.direction);
            is_in(*ball, ray.at(along))
        })
    };
    let coverage = (0..width * height).map(|i| 255 * u8::from(meets(i)));
    Mask {
        width,
        height,
        coverage: coverage.collect(),
    }
}

/// Silhouettes in common with those of some of the balls, 0..1.
pub(crate) fn likeness<'a>(
    cameras: impl Iterator<Item = &'a Camera>,
    masks: &[Mask],
    balls: &[usize],
) -> f32 {
    let pairs = cameras.zip(masks);
    let each = pairs.map(|(camera, mask)| agreement_of(&true_mask(camera, balls), mask));
    each.sum::<f32>() / masks.len() as f32
}
