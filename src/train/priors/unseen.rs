//! Rays from where no camera stood: what they meet should be made of planes.
//!
//! A few photos of a room can be explained by wrong depths that show as fragments from everywhere else. Seen through a
//! pinhole, one over the depth of a plane is linear, so three neighbouring rays show whether it bends. After the
//! depths of unseen views in `RegNeRF` (Niemeyer et al. 2022, Eq. 2), which knows planes that face the camera only.

use std::f32::consts::TAU;
use std::ops::Range;

use glam::Vec3;

use super::add_weight_gradient;
use crate::geometry::orthonormal_basis;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::train::fast::step_context::StepContext;
use crate::train::pixels::store::BackgroundSample;
use crate::train::random::SlotRandom;

/// Angles between neighbouring rays, in pixels.
const LEAST_PIXELS: f32 = 3.0;
const MOST_PIXELS: f32 = 43.0;
/// Nearest depth that is distinguished, in half sides of the inner box.
const LEAST_DEPTH: f32 = 0.05;
/// Bend, as a share of one over the depth, below which the error is a square, and above which it is an absolute value.
const KNEE: f32 = 0.01;
/// Slots of the random numbers: beyond those of the pixels.
const FIRST_SLOT: u64 = 1 << 33;

/// Three neighbouring rays of a batch.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Triple {
    /// The first of them.
    first: usize,
    /// Lengths of their directions where the middle one's is 1: they end on a line.
    lengths: [f32; 3],
}

/// Adds the rays of triples number `slots` to the batch: from between two cameras, along a direction in which one of
/// them looked.
pub(in crate::train) fn draw(
    context: &StepContext<'_>,
    slots: Range<usize>,
    batch: &mut FieldBatch,
    triples: &mut Vec<Triple>,
) {
    triples.clear();
    for slot in slots {
        let slot = FIRST_SLOT + slot as u64;
        let mut random = SlotRandom::new(context.config.seed, context.step, slot);
        let (origin, a) = look(context, &mut random);
        let origin = context.frame.field_from_world(origin).to_array();
        let pixels = LEAST_PIXELS + (MOST_PIXELS - LEAST_PIXELS) * random.uniform();
        let phi = random.uniform() * TAU;
        let (tangent, bitangent) = orthonormal_basis(a.direction);
        let step = (tangent * phi.cos() + bitangent * phi.sin()) * (a.spread * pixels);
        let first = batch.rays.len();
        let lengths = [-1.0, 0.0, 1.0].map(|k| {
            let direction = a.direction + k * step;
            let length = direction.length();
            let unit = (direction / length).to_array();
            batch
                .rays
                .push(FieldRay::of_pixel(origin, unit, 0.0, a.spread));
            length
        });
        triples.push(Triple { first, lengths });
    }
}

/// A point between two cameras, world coordinates, and a pixel of the first, in whose direction to look.
pub(in crate::train) fn look(
    context: &StepContext<'_>,
    random: &mut SlotRandom,
) -> (Vec3, BackgroundSample) {
    let [a, b] = [(); 2].map(|()| context.pixels.draw_background(random, 0.0));
    (a.origin.lerp(b.origin, random.uniform()), a)
}

/// Sum of how much one over the depth bends, as a share of itself; adds `scale` times its gradient by the compositing
/// weights to `batch.d_weights`. That share counts as a constant: nothing is pulled nearer or farther as such.
pub(in crate::train) fn bend(triples: &[Triple], scale: f32, batch: &mut FieldBatch) -> f64 {
    add_weight_gradient(batch, |batch, samples_of, d_weights| {
        let mut sum = 0.0;
        for Triple { first, lengths } in triples {
            let nearness =
                |k: usize, at: usize| lengths[k] / batch.distances()[at].max(LEAST_DEPTH);
            let mean = [0, 1, 2].map(|k| {
                let shares = samples_of(first + k).map(|at| batch.weights()[at] * nearness(k, at));
                shares.sum::<f32>()
            });
            let (value, d_middle) = bend_of(mean);
            sum += f64::from(value);
            for (k, part) in [-0.5, 1.0, -0.5].into_iter().enumerate() {
                for at in samples_of(first + k) {
                    d_weights[at] += scale * d_middle * part * nearness(k, at);
                }
            }
        }
        sum
    })
}

/// How far the middle of three numbers lies off the line between the others, as a share of them, and the derivative
/// by the middle one while that share stays; those by the others are half of it, with the other sign.
fn bend_of([before, middle, after]: [f32; 3]) -> (f32, f32) {
    let share = 1.0 / ((before + middle + after) / 3.0 + LEAST_DEPTH);
    let bend = (middle - 0.5 * (before + after)) * share;
    let size = bend.hypot(KNEE);
    (size - KNEE, bend / size * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One over the depths along three directions that end on a line, of what lies at `distance(unit direction)`.
    fn nearness(distance: impl Fn(Vec3) -> f32) -> [f32; 3] {
        [-1.0, 0.0, 1.0].map(|k| {
            let direction = Vec3::new(0.6, 0.0, 0.8) + k * Vec3::new(0.1, 0.2, 0.0);
            direction.length() / distance(direction.normalize_or_zero())
        })
    }

    #[test]
    fn a_slanted_plane_does_not_bend_and_a_step_does() {
        let normal = Vec3::new(0.3, -0.5, 0.9);
        let plane = nearness(|direction| 2.0 / normal.dot(direction));
        assert!(bend_of(plane).0 < 1e-6, "{:?}", bend_of(plane));
        let step = nearness(|direction| if direction.y > 0.1 { 1.0 } else { 3.0 });
        assert!(bend_of(step).0 > 0.2, "{:?}", bend_of(step));
    }

    #[test]
    fn the_derivative_is_that_of_the_bend_with_its_share_held() {
        for [before, middle, after] in [[1.0, 1.004, 1.0], [0.5, 0.9, 0.4], [2.0, 1.0, 3.0]] {
            let (_, d_middle) = bend_of([before, middle, after]);
            // What the middle gains the others lose: their mean, and with it the share, stays.
            let h = 1e-3;
            let value = |h: f32| bend_of([before - 0.5 * h, middle + h, after - 0.5 * h]).0;
            let numeric = (value(h) - value(-h)) / (2.0 * h);
            assert!(
                (1.5 * d_middle - numeric).abs() < 0.02 * numeric.abs() + 1e-3,
                "{middle}: {} against {numeric}",
                1.5 * d_middle
            );
        }
    }
}
