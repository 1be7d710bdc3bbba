//! The light that comes down on the floor around an object, and the share of it that the object leaves.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::square::Square;
use super::{Cancelled, GroundResolution};
use crate::geometry::{Ray, irradiance_directions};
use crate::neif::edit::EnvironmentFromWorld;
use crate::neif::environment::LightScratch;
use crate::neif::material::MaterialBatch;
use crate::neif::radiance_field::{FieldBatch, FieldRay};
use crate::neif::{Environment, ObjectModel};
use crate::render::lamps::Lamps;

/// Sine of the elevations between which cameras look down on a floor.
const CAMERA_BAND: std::ops::Range<f32> = 0.17..0.97;
/// Vertices whose material stands for the object's.
const N_MATERIAL_POINTS: usize = 512;
/// Most of the light that an object sends on.
const MAX_REFLECTANCE: f32 = 0.9;
/// Height above the floor from which shadow rays start, half sides of the square.
const LIFT: f32 = 1e-3;

/// An object in surroundings.
pub(super) struct Stand<'a> {
    pub(super) object: &'a ObjectModel,
    pub(super) environment: &'a Environment,
    pub(super) motion: EnvironmentFromWorld,
    /// Of the environment.
    pub(super) lamps: &'a Lamps,
}

/// Where an object stands, field coordinates.
pub(super) struct Foot {
    /// Below the middle of the object, as low as its lowest point.
    pub(super) center: Vec3,
    /// Middle of the object.
    pub(super) middle: Vec3,
    /// Farthest from the vertical through the middle.
    pub(super) radius: f32,
    pub(super) height: f32,
}

/// Light from above in directions of equal share.
pub(super) struct Sky {
    /// Unit, in axes of the surroundings.
    directions: Vec<Vec3>,
    radiance: Vec<Vec3>,
    mean: Vec3,
}

/// What the object does to a point of the floor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Share {
    /// Share of the light that arrives, a colour.
    pub(super) light: Vec3,
    /// Share of the directions that cameras look from that is free.
    pub(super) seen: f32,
}

impl Stand<'_> {
    fn field(&self, p_world: Vec3) -> Vec3 {
        let frame = self.environment.frame();
        frame.field_from_world(self.motion.point(p_world))
    }

    /// Where the object stands.
    pub(super) fn foot(&self) -> Foot {
        let up = self.environment.up();
        let points = &self.object.tracer.mesh().positions;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        let middle = self.field(self.object.tracer.mesh().bounds().center());
        let mut radius = 0.0_f32;
        for &p in points {
            let from_middle = self.field(p) - middle;
            let height = from_middle.dot(up);
            (low, high) = (low.min(height), high.max(height));
            radius = radius.max((from_middle - height * up).length());
        }
        Foot {
            center: middle + low * up,
            middle,
            radius,
            height: high - low,
        }
    }

    /// The light from above where the object is.
    pub(super) fn sky(&self, middle: Vec3, resolution: GroundResolution) -> Sky {
        let up = self.environment.up();
        let n = resolution.n_directions;
        let (mut batch, mut directions) = (FieldBatch::default(), Vec::with_capacity(n));
        for (direction, height) in irradiance_directions(up, n, 0.0) {
            let variance = 1.0 / (4.0 * n as f32 * height);
            directions.push(direction);
            batch
                .rays
                .push(FieldRay::of_cone(middle, direction, variance, 0.0));
        }
        self.environment
            .light(&mut batch, &mut LightScratch::default());
        let radiance = batch
            .radiance
            .iter()
            .map(|v| self.lamps.below(Vec3::from(*v)));
        let radiance: Vec<Vec3> = radiance.collect();
        let mean = radiance.iter().sum::<Vec3>() / n.max(1) as f32;
        Sky {
            directions,
            radiance,
            mean,
        }
    }

    /// Light that the object sends on, of what falls on it: mean over its surface, a colour.
    fn reflectance(&self, sky: &Sky) -> Vec3 {
        let points = &self.object.tracer.mesh().positions;
        let some: Vec<Vec3> = points
            .iter()
            .step_by(points.len().div_ceil(N_MATERIAL_POINTS).max(1))
            .copied()
            .collect();
        let mut batch = MaterialBatch::default();
        self.object
            .material
            .forward(&some, &mut batch, &mut Vec::new());
        let n = batch.surfaces.len().max(1) as f32;
        let tint = batch.surfaces.iter().map(|s| s.tint).sum::<Vec3>() / n;
        let diffuse = batch.surfaces.iter().map(|s| s.diffuse).sum::<Vec3>() / n;
        let albedo = diffuse / sky.mean.max(Vec3::splat(1e-3));
        (tint + albedo).clamp(Vec3::ZERO, Vec3::splat(MAX_REFLECTANCE))
    }

    /// What the object does to each point of a square.
    pub(super) fn shares(
        &self,
        square: &Square,
        sky: &Sky,
        cancel: &AtomicBool,
    ) -> Result<Vec<Share>, Cancelled> {
        let reflectance = self.reflectance(sky);
        let (tracer, frame) = (&*self.object.tracer, self.environment.frame());
        let start = tracer.self_distance();
        let up = square.up;
        let up_world = self.motion.world_direction(up);
        let lamps = self.lamps.points(&self.motion);
        let directions: Vec<Vec3> = sky
            .directions
            .iter()
            .map(|d| self.motion.world_direction(*d))
            .collect();
        let free = |point: Vec3| -> Share {
            let lifted = point + up * (LIFT * square.half_side);
            let origin = self.motion.world_point(frame.world_from_field(lifted));
            let (mut light, mut n_free) = (Vec3::ZERO, 0_usize);
            let (mut n_seen, mut n_band) = (0_usize, 0_usize);
            for ((&direction, own), radiance) in
                directions.iter().zip(&sky.directions).zip(&sky.radiance)
            {
                let is_free = !tracer.occluded(&Ray { origin, direction }, start, f32::INFINITY);
                let is_in_band = CAMERA_BAND.contains(&own.dot(up));
                n_band += usize::from(is_in_band);
                if is_free {
                    light += *radiance;
                    n_free += 1;
                    n_seen += usize::from(is_in_band);
                }
            }
            let n = directions.len().max(1) as f32;
            let free = n_free as f32 / n;
            // As mean radiances from above: a lamp's irradiance over pi.
            let by_lamps = |tracer| lamps.irradiance(tracer, origin, up_world) / PI;
            let all = sky.mean + by_lamps(None);
            // What is blocked sends on light of the mean, less so the closer it is to the floor.
            let sent = (1.0 - free) * free * reflectance * all;
            let light = light / n + by_lamps(Some(tracer)) + sent;
            Share {
                light: (light / all.max(Vec3::splat(f32::MIN_POSITIVE)))
                    .clamp(Vec3::ZERO, Vec3::ONE),
                seen: n_seen as f32 / n_band.max(1) as f32,
            }
        };
        let shares: Vec<Share> = (0..square.len())
            .into_par_iter()
            .map(|i| {
                if cancel.load(Ordering::Relaxed) {
                    return Share::default();
                }
                free(square.point(i))
            })
            .collect();
        if cancel.load(Ordering::Relaxed) {
            return Err(Cancelled);
        }
        Ok(blurred(&shares, square.side))
    }
}

/// Means over 3 x 3 points: each direction casts a hard shadow of its own.
fn blurred(shares: &[Share], side: usize) -> Vec<Share> {
    (0..shares.len())
        .map(|i| {
            let (x, y) = (i % side, i / side);
            let (mut sum, mut n) = (Share::default(), 0.0);
            for y in y.saturating_sub(1)..(y + 2).min(side) {
                for x in x.saturating_sub(1)..(x + 2).min(side) {
                    let share = &shares[y * side + x];
                    sum.light += share.light;
                    sum.seen += share.seen;
                    n += 1.0;
                }
            }
            Share {
                light: sum.light / n,
                seen: sum.seen / n,
            }
        })
        .collect()
}

/// Radiance of the surroundings straight down on each point of a square, and whether they have a floor there, `[0, 1]`.
pub(super) fn look_down(
    environment: &Environment,
    square: &Square,
    from_height: f32,
    slab: f32,
) -> Vec<(Vec3, f32)> {
    let points: Vec<usize> = (0..square.len()).collect();
    let direction = -square.up;
    let looks: Vec<Vec<(Vec3, f32)>> = points
        .par_chunks(square.side)
        .map_init(
            <(FieldBatch, LightScratch)>::default,
            |(batch, scratch), points| {
                batch.rays.clear();
                batch.rays.extend(points.iter().map(|&i| {
                    let origin = (square.point(i) + square.up * from_height).to_array();
                    let base = 0.3 * square.point_size();
                    FieldRay::of_pixel(origin, direction.to_array(), base, 0.0)
                }));
                environment.light(batch, scratch);
                let n = batch.weights().len() / batch.rays.len().max(1);
                let floor = |i: usize| -> f32 {
                    let samples = batch.distances().iter().zip(batch.weights());
                    samples
                        .skip(i * n)
                        .take(n)
                        .filter(|(t, _)| (**t - from_height).abs() < slab)
                        .map(|(_, weight)| weight)
                        .sum()
                };
                let radiance = batch.radiance.iter().map(|v| Vec3::from(*v));
                radiance.enumerate().map(|(i, v)| (v, floor(i))).collect()
            },
        )
        .collect();
    looks.into_iter().flatten().collect()
}

/// Whether there is a floor in most of the shadow, of what is known: `floor` and `known` in `[0, 1]` each point.
pub(super) fn is_floor(shares: &[Share], floor: &[f32], known: &[f32]) -> bool {
    let (mut on, mut all) = (0.0, 0.0);
    for ((share, floor), known) in shares.iter().zip(floor).zip(known) {
        let shadow = known * (1.0 - lightness(share.light));
        on += floor * shadow;
        all += shadow;
    }
    on > 0.5 * all
}

/// Lightness of a share: its mean over the colours.
pub(super) fn lightness(share: Vec3) -> f32 {
    share.element_sum() / 3.0
}
