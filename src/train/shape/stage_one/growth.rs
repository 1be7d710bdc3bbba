//! Pictures of a surface while it takes shape: as clay over a photo of the object.

use glam::Vec3;
use rayon::prelude::*;

use crate::data::View;
use crate::geometry::{Ray, ScalarGrid};

/// Longest side of a picture, pixels.
const LONGEST_PX: u32 = 480;
/// sRGB of clay that faces the camera, and at its rim.
const CLAY: [Vec3; 2] = [Vec3::new(0.88, 0.82, 0.76), Vec3::new(0.22, 0.20, 0.24)];

/// A photo with the surface over it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GrowthPicture {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// `[height * width]` sRGB.
    pub pixels: Vec<[u8; 3]>,
}

impl GrowthPicture {
    /// The surface of `distances` (scene units, negative inside) as `view` shows it, on the current thread pool.
    pub fn new(distances: &ScalarGrid, view: &View) -> Self {
        let photo = &view.photo;
        let (width, height) = (photo.width(), photo.height());
        let stride = width.max(height).div_ceil(LONGEST_PX).max(1);
        let camera = view
            .camera
            .resized(width.div_ceil(stride), height.div_ceil(stride));
        let size = [camera.width as usize, camera.height as usize];
        let pixels = (0..size[0] * size[1])
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % size[0], i / size[0]);
                let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
                let hit = distances.entered_by(&ray);
                let color = hit.map_or_else(
                    || photo.srgb((y * width as usize + x) * stride as usize),
                    |at| clay(distances.gradient(at), &ray).to_array(),
                );
                color.map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
            })
            .collect();
        Self { size, pixels }
    }
}

/// Clay with a lamp at the camera.
fn clay(gradient: Vec3, ray: &Ray) -> Vec3 {
    let cos = -gradient.normalize_or_zero().dot(ray.direction);
    CLAY[1].lerp(CLAY[0], cos.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Photo, Split};
    use crate::geometry::{Aabb, Camera};
    use crate::train::shape::stage_one::hull::raise;

    #[test]
    fn a_ball_of_clay_lies_over_the_photo() {
        let (min, max) = (-Vec3::ONE, Vec3::ONE);
        let mut grid = ScalarGrid::over(&Aabb { min, max }, 40, f32::NEG_INFINITY);
        raise(&mut grid, |p| p.length() - 0.5);
        // Three times as many pixels as are shown.
        let (width, height) = (1200, 900);
        let blue = [0, 0, 255];
        let view = View {
            name: "r_0".to_owned(),
            file: std::path::PathBuf::new(),
            split: Split::Train,
            camera: Camera::look_at(3.0 * Vec3::X, Vec3::ZERO, Vec3::Z, 0.6, width, height),
            photo: Photo::Rgb8 {
                width,
                height,
                pixels: vec![blue; (width * height) as usize],
                chroma_block: [1, 1],
            },
            mask: None,
        };
        let picture = GrowthPicture::new(&grid, &view);
        assert_eq!(picture.size, [400, 300]);
        assert_eq!(picture.pixels.len(), 400 * 300);
        let at = |x: usize, y: usize| picture.pixels[y * 400 + x];
        assert_eq!(at(0, 0), blue, "beside it is the photo");
        assert!(at(200, 150)[0] > 215, "the middle faces the lamp");
        // The rim: sin(rim) = 0.5 / 3, and half the picture's height is tan(0.3).
        let radius = (0.5_f32 / 3.0).asin().tan() / 0.3_f32.tan() * 150.0;
        let [inside, outside] = [radius - 2.0, radius + 2.0].map(|r| at(200 + r as usize, 150));
        let is_dark = inside != blue && inside[0] < 140;
        assert!(is_dark, "the rim: {inside:?}");
        assert_eq!(outside, blue, "and ends where the ball does");
    }
}
