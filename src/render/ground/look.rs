//! Looks straight down on a plane: whether there is something to stand on.

use glam::Vec3;
use rayon::prelude::*;

use super::sight::Sight;
use super::square::Square;
use crate::neif::Environment;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;

/// Height from which the plane is looked at, and half the thickness within which its samples lie, half sides.
const FLOOR_LOOK: f32 = 0.5;
pub(super) const FLOOR_SLAB: f32 = 0.06;

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
pub(super) fn look_down(environment: &Environment, square: &Square) -> Vec<FloorLook> {
    let from_height = FLOOR_LOOK * square.half_side;
    let slab = FLOOR_SLAB * square.half_side;
    let points: Vec<usize> = (0..square.len()).collect();
    let direction = -square.up;
    let looks = points.par_chunks(square.side).map_init(
        <(FieldBatch, LightScratch)>::default,
        |(batch, scratch), points| {
            batch.rays.clear();
            batch.rays.extend(points.iter().map(|&i| {
                let origin = (square.point(i) + square.up * from_height).to_array();
                let base = 0.3 * square.point_size();
                FieldRay::of_pixel(origin, direction.to_array(), base, 0.0)
            }));
            environment.light(batch, scratch);
            let floor = |i: usize| -> f32 {
                let sight = Sight::of(batch, i);
                let samples = sight.samples();
                let on_plane = samples.filter(|(t, _)| (t - from_height).abs() < slab);
                on_plane.map(|(_, weight)| weight).sum()
            };
            let look = |i: usize| FloorLook {
                radiance: Vec3::from(batch.radiance[i]),
                floor: floor(i),
                seen: environment.seen_share(batch, i),
            };
            (0..batch.rays.len()).map(look).collect::<Vec<_>>()
        },
    );
    looks.flatten_iter().collect()
}

/// Whether there is a floor in most of the shadow, of what is known: `known` in `[0, 1]` each point.
pub(super) fn is_floor(shares: &[Share], looks: &[FloorLook], known: &[f32]) -> bool {
    let (mut on, mut all) = (0.0, 0.0);
    for ((share, look), known) in shares.iter().zip(looks).zip(known) {
        let shadow = known * (1.0 - lightness(share.light)).max(0.0);
        on += look.floor * shadow;
        all += shadow;
    }
    on > 0.5 * all
}

/// Lightness of a share: its mean over the colours.
pub(super) fn lightness(share: Vec3) -> f32 {
    share.element_sum() / 3.0
}

/// What the object does to a point of a surface.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Share {
    /// Light that arrives with the object over that without it, a colour.
    pub(super) light: Vec3,
    /// Share of the directions that cameras look from that is free.
    pub(super) seen: f32,
}
