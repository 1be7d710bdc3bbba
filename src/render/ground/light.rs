//! The light that comes down on the floor around an object, and the share of it that the object leaves.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::Cancelled;
use super::bounce::Bounce;
use super::square::Square;
use crate::geometry::{Ray, irradiance_directions};
use crate::neif::edit::EnvironmentFromWorld;
use crate::neif::environment::LightScratch;
use crate::neif::radiance_field::{FieldBatch, FieldRay};
use crate::neif::{Environment, ObjectModel};
use crate::render::lamps::Lamps;

/// Sine of the elevations between which cameras look down on a floor.
const CAMERA_BAND: std::ops::Range<f32> = 0.17..0.97;
/// Most light that is left of a unit: an object may mirror light onto a floor.
const MOST_SHARE: f32 = 2.0;
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
    /// Farthest from the vertical through the middle.
    pub(super) radius: f32,
    pub(super) height: f32,
}

/// A direction that light comes from, all of equal share.
struct FromAbove {
    /// Unit.
    world: Vec3,
    radiance: Vec3,
    /// Whether cameras look along it.
    is_in_band: bool,
}

/// What the object does to a point of the floor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Share {
    /// Light that arrives with the object over that without it, a colour.
    pub(super) light: Vec3,
    /// Share of the directions that cameras look from that is free.
    pub(super) seen: f32,
}

impl Stand<'_> {
    fn field(&self, p_world: Vec3) -> Vec3 {
        let frame = self.environment.frame();
        frame.field_from_world(self.motion.point(p_world))
    }

    /// Middle of the object, field coordinates.
    pub(super) fn middle(&self) -> Vec3 {
        self.field(self.object.tracer.mesh().bounds().center())
    }

    /// Where the object stands.
    pub(super) fn foot(&self) -> Foot {
        let up = self.environment.up();
        let points = &self.object.tracer.mesh().positions;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        let middle = self.middle();
        let mut radius = 0.0_f32;
        for &p in points {
            let from_middle = self.field(p) - middle;
            let height = from_middle.dot(up);
            (low, high) = (low.min(height), high.max(height));
            radius = radius.max((from_middle - height * up).length());
        }
        Foot {
            center: middle + low * up,
            radius,
            height: high - low,
        }
    }

    /// What the object does to each point of a square.
    pub(super) fn shares(
        &self,
        square: &Square,
        bounce: &Bounce<'_>,
        n_directions: usize,
        cancel: &AtomicBool,
    ) -> Result<Vec<Share>, Cancelled> {
        let from_above: Vec<FromAbove> = irradiance_directions(square.up, n_directions, 0.0)
            .map(|(direction, _)| FromAbove {
                world: self.motion.world_direction(direction),
                radiance: bounce.around().radiance(direction),
                is_in_band: CAMERA_BAND.contains(&direction.dot(square.up)),
            })
            .collect();
        let shares: Vec<Share> = (0..square.len())
            .into_par_iter()
            .map(|i| {
                if cancel.load(Ordering::Relaxed) {
                    return Share::default();
                }
                self.share(square.point(i), square, &from_above, bounce)
            })
            .collect();
        if cancel.load(Ordering::Relaxed) {
            return Err(Cancelled);
        }
        Ok(blurred(&shares, square.side))
    }

    /// What the object does to a point of a square: keeps light from it, and sends some of its own.
    fn share(
        &self,
        point: Vec3,
        square: &Square,
        from_above: &[FromAbove],
        bounce: &Bounce<'_>,
    ) -> Share {
        let (tracer, frame) = (&*self.object.tracer, self.environment.frame());
        let start = tracer.self_distance();
        let up_world = self.motion.world_direction(square.up);
        let lifted = point + square.up * (LIFT * square.half_side);
        let origin = self.motion.world_point(frame.world_from_field(lifted));
        let (mut light, mut all) = (Vec3::ZERO, Vec3::ZERO);
        let (mut n_seen, mut n_band) = (0_usize, 0_usize);
        for from in from_above {
            let direction = from.world;
            let hit = tracer.intersect(&Ray { origin, direction }, start, f32::INFINITY);
            all += from.radiance;
            n_band += usize::from(from.is_in_band);
            if let Some(hit) = hit {
                light += bounce.radiance(&hit, direction);
            } else {
                light += from.radiance;
                n_seen += usize::from(from.is_in_band);
            }
        }
        // As mean radiances from above: a lamp's irradiance over pi.
        let n = from_above.len().max(1) as f32;
        let by_lamps = |tracer| bounce.lamps().irradiance(tracer, origin, up_world) / PI;
        let light = light / n + by_lamps(Some(tracer));
        let all = all / n + by_lamps(None);
        Share {
            light: (light / all.max(Vec3::splat(f32::MIN_POSITIVE)))
                .clamp(Vec3::ZERO, Vec3::splat(MOST_SHARE)),
            seen: n_seen as f32 / n_band.max(1) as f32,
        }
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

/// A look at a floor.
#[derive(Clone, Copy, Debug)]
pub(super) struct FloorLook {
    /// Radiance.
    pub(super) radiance: Vec3,
    /// Whether there is a floor, `[0, 1]`.
    pub(super) floor: f32,
    /// How surely photos showed what is there, `[0, 1]`.
    pub(super) seen: f32,
}

/// Looks straight down on each point of a square.
pub(super) fn look_down(
    environment: &Environment,
    square: &Square,
    from_height: f32,
    slab: f32,
) -> Vec<FloorLook> {
    let points: Vec<usize> = (0..square.len()).collect();
    let direction = -square.up;
    let looks: Vec<Vec<FloorLook>> = points
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
                let look = |i: usize| FloorLook {
                    radiance: Vec3::from(batch.radiance[i]),
                    floor: floor(i),
                    seen: environment.seen_share(batch, i),
                };
                (0..batch.rays.len()).map(look).collect()
            },
        )
        .collect();
    looks.into_iter().flatten().collect()
}

/// Whether there is a floor in most of the shadow, of what is known: `floor` and `known` in `[0, 1]` each point.
pub(super) fn is_floor(shares: &[Share], floor: &[f32], known: &[f32]) -> bool {
    let (mut on, mut all) = (0.0, 0.0);
    for ((share, floor), known) in shares.iter().zip(floor).zip(known) {
        let shadow = known * (1.0 - lightness(share.light)).max(0.0);
        on += floor * shadow;
        all += shadow;
    }
    on > 0.5 * all
}

/// Lightness of a share: its mean over the colours.
pub(super) fn lightness(share: Vec3) -> f32 {
    share.element_sum() / 3.0
}
