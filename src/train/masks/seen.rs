//! What an environment shows of itself along the rays of a photo's pixels: light, and where it comes from.

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

use crate::geometry::{Camera, Projector, Ray};
use crate::neif::Environment;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::{EnvironmentField, LightScratch};
use crate::render::path::trace::PIXEL_STD;

/// Pixels along the longer side of the photos that depths are looked up in.
const SIDE: u32 = 160;
/// Rays that are traced together.
const BLOCK: usize = 1024;

/// What a ray meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Linear radiance.
    pub(super) radiance: [f32; 3],
    /// Where half of its light is from before and half from behind, world.
    pub(super) point: Vec3,
}

/// What a camera meets at `places` of its picture, in pixels, each as sharp as a pixel.
pub(super) fn look(environment: &Environment, camera: &Camera, places: &[Vec2]) -> Vec<Look> {
    let blocks = places.par_chunks(BLOCK);
    blocks
        .flat_map_iter(|places| look_at_block(environment, camera, places))
        .collect()
}

/// The surface point of the environment that a camera shows at a place of its picture (pixels), world; `None` where it has no
/// surfaces.
pub fn point_at(environment: &Environment, camera: &Camera, at_px: Vec2) -> Option<Vec3> {
    let has_surfaces = matches!(environment.field(), EnvironmentField::Grid { .. });
    let look = has_surfaces.then(|| look(environment, camera, &[at_px]));
    look.map(|look| look[0].point).filter(|p| p.is_finite())
}

fn look_at_block(environment: &Environment, camera: &Camera, places: &[Vec2]) -> Vec<Look> {
    let frame = environment.frame();
    let spread = camera.pixel_angle() * PIXEL_STD;
    let rays: Vec<_> = places.iter().map(|at| camera.ray(at.x, at.y)).collect();
    let mut batch = FieldBatch::default();
    batch.rays.extend(rays.iter().map(|ray| {
        let origin = frame.field_from_world(ray.origin).to_array();
        FieldRay::of_pixel(origin, ray.direction.to_array(), 0.0, spread)
    }));
    environment.light(&mut batch, &mut LightScratch::default());
    let look = |(i, ray): (usize, &Ray)| Look {
        radiance: batch.radiance[i],
        point: ray.origin + ray.direction * (batch.middle_of_light(i) * frame.half_side),
    };
    rays.iter().enumerate().map(look).collect()
}

/// A photo's camera with fewer pixels, and the surface that each of them shows.
#[derive(Debug)]
pub(super) struct SeenView {
    pub(super) camera: Camera,
    projector: Projector,
    /// `[height * width]` world.
    pub(super) points: Vec<Vec3>,
}

impl SeenView {
    pub(super) fn new(environment: &Environment, camera: &Camera) -> Self {
        let small = camera.within(SIDE);
        let (width, height) = (small.width as usize, small.height as usize);
        let scale = Vec2::new(camera.width as f32, camera.height as f32)
            / Vec2::new(small.width as f32, small.height as f32);
        let place = |i: usize| Vec2::new((i % width) as f32, (i / width) as f32) + 0.5;
        let places: Vec<Vec2> = (0..width * height).map(|i| place(i) * scale).collect();
        // With the photo's own pixels: surfaces are blurred by wider ones.
        let looks = look(environment, camera, &places);
        Self {
            camera: small,
            projector: small.projector(Affine3A::IDENTITY),
            points: looks.iter().map(|look| look.point).collect(),
        }
    }

    /// Where a point is seen, pixels; `None` behind the camera.
    pub(super) fn place(&self, p_world: Vec3) -> Option<Vec2> {
        Some(self.projector.project(p_world)?.0)
    }

    /// Whether a place, in pixels, is in the picture.
    pub(super) fn has(&self, at: Vec2) -> bool {
        let size = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        at.cmpge(Vec2::ZERO).all() && at.cmplt(size).all()
    }

    /// The pixel that shows a point; `None` beside the picture.
    pub(super) fn pixel(&self, p_world: Vec3) -> Option<usize> {
        let at = self.projector.pixel(p_world)?;
        Some(at.y as usize * self.camera.width as usize + at.x as usize)
    }
}
