//! Working memory of shading, and the light that its rays bring.

use glam::Vec3;

use super::trace::PIXEL_STD;
use crate::geometry::Camera;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;
use crate::neif::light::light_path::LitVertex;
use crate::neif::light::shading::SurfacePoint;
use crate::neif::{EditedSurfaces, Environment, ObjectModel};
use crate::render::{BLUR_STD, Background, Scene};

/// Rays evaluated together: split lobes have thousands in a tile, whose samples would take gigabytes.
pub(super) const PIECE: usize = 128;

/// Pixels shaded together: their samples stay in the core's cache.
pub(in crate::render) const TILE: usize = 64;

/// What a pixel sees of the environment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::render) struct SeenLight {
    /// Where, in the field's coordinates; far away where nothing is met.
    pub(in crate::render) position: Vec3,
    /// Linear radiance before the transform's gain.
    pub(in crate::render) radiance: [f32; 3],
}

/// Working memory of one thread, reused from call to call.
#[derive(Debug, Default)]
pub struct ShadeScratch {
    /// Rays to evaluate, and after [`Self::light`] their linear radiance before the transform's gain.
    pub(in crate::render) rays: Vec<FieldRay>,
    pub(in crate::render) radiance: Vec<[f32; 3]>,
    /// Those that were evaluated last, with their samples.
    pub(super) batch: FieldBatch,
    /// The surfaces that were last evaluated.
    pub(in crate::render) edited: EditedSurfaces,
    light: LightScratch,
    /// Of each path, its pixel in the tile.
    pub(super) pixel_of_path: Vec<usize>,
    pub(in crate::render) lit: Vec<LitVertex>,
    /// Cones of split lobes that meet the object, the surfaces there, and the rays that go on.
    pub(in crate::render) blocked: Vec<BlockedCone>,
    pub(in crate::render) beyond: EditedSurfaces,
    pub(super) contributions: Vec<Contribution>,
    /// Most samples a ray; none leaves the number to the environment.
    most_samples: Option<usize>,
}

impl ShadeScratch {
    /// For pictures in motion: at most so many samples a ray.
    pub(in crate::render) fn with_most_samples(n: usize) -> Self {
        Self {
            most_samples: Some(n),
            ..Self::default()
        }
    }

    /// The rays of pixels (`y * width + x` of `camera`) into the environment.
    pub(super) fn aim_at_background(&mut self, scene: &Scene, camera: &Camera, pixels: &[u32]) {
        let motion = scene.transform.environment_from_world();
        let frame = scene.environment.frame();
        let spread = camera.pixel_angle() * PIXEL_STD;
        let is_blurred = scene.shown_background() == Background::Blurred;
        self.rays.clear();
        for &pixel in pixels {
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            let direction = motion.direction(ray.direction).to_array();
            let origin = frame.field_from_world(motion.point(ray.origin)).to_array();
            self.rays.push(if is_blurred {
                let variance = BLUR_STD * BLUR_STD;
                FieldRay::of_cone(origin.into(), direction.into(), variance, 0.0)
            } else {
                FieldRay::of_pixel(origin, direction, 0.0, spread)
            });
        }
    }

    /// Evaluates the environment along the rays, [`PIECE`] at a time.
    pub(in crate::render) fn light(&mut self, scene: &Scene) {
        let environment = &scene.environment;
        let most = self.most_samples.unwrap_or(usize::MAX);
        self.radiance.clear();
        for rays in self.rays.chunks(PIECE) {
            self.batch.rays.clear();
            self.batch.rays.extend_from_slice(rays);
            environment.light_by(most, &mut self.batch, &mut self.light);
            if let Some(ground) = &scene.ground {
                ground.apply(&mut self.batch);
            }
            if scene.marks_unseen {
                mark_unseen(environment, &mut self.batch);
            }
            self.radiance.extend_from_slice(&self.batch.radiance);
        }
    }
}

/// What light that no photo showed looks like where that is marked, linear: rare in photos of things.
const UNSEEN: Vec3 = Vec3::new(0.6, 0.05, 0.5);

/// Where light comes from that has no place, in half sides of the inner box.
pub(super) const FAR: f32 = 1e5;

/// Evaluates the edited surfaces at world points with unit normals, their diffuse part in the light of the scene: with
/// the edges of shadows where the point of that number `is_seen` directly, interpolated from the probes elsewhere.
pub(in crate::render) fn light_surfaces(
    edited: &mut EditedSurfaces,
    scene: &Scene,
    object: &ObjectModel,
    points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
    is_seen: impl Fn(usize) -> bool,
) {
    edited.evaluate(object, &scene.edit, &scene.regions, points.clone());
    let gain = scene.transform.environment_from_world().gain;
    let surfaces = edited.surfaces_mut().iter_mut();
    for (i, (surface, at)) in surfaces.zip(points).enumerate() {
        surface.diffuse *= scene.diffuse_response(at, gain, is_seen(i));
    }
}

/// Gives the signal colour to light of an evaluated batch that no photo showed.
fn mark_unseen(environment: &Environment, batch: &mut FieldBatch) {
    for ray in 0..batch.rays.len() {
        let share = environment.seen_share(batch, ray);
        let seen = Vec3::from(batch.radiance[ray]);
        batch.radiance[ray] = UNSEEN.lerp(seen, share).to_array();
    }
}

/// A cone of a split lobe that meets the object, on its way to the environment.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct BlockedCone {
    /// The lit vertex whose lobe it is of.
    pub(super) owner: usize,
    /// Where it is; `to_eye` looks back along it.
    pub(in crate::render) point: SurfacePoint,
    /// Variance of its directions per axis, radians squared.
    pub(in crate::render) variance: f32,
    /// Share of what it finds in the owner's lobe.
    pub(super) throughput: Vec3,
    /// Its number among the lobe's cones.
    pub(in crate::render) index: u32,
    /// Cones that the next lobes are shared among.
    pub(in crate::render) n: u32,
}

/// What a ray of the batch brings to a split lobe.
#[derive(Clone, Copy, Debug)]
pub(in crate::render) struct Contribution {
    /// The lit vertex whose lobe it is.
    pub(super) owner: usize,
    /// The ray.
    pub(in crate::render) ray: usize,
    /// The factor of its radiance.
    pub(super) throughput: Vec3,
}
