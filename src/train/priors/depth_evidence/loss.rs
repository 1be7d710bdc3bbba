//! The light of a pixel should come from where neighbouring photos say it does: after the depth supervision of DS-NeRF
//! (Deng et al. 2022), with a cost that is bounded, since some of what they say is wrong.

use crate::neif::field::radiance_field::FieldBatch;
use crate::train::priors::add_weight_gradient;

/// Nearest distance that is distinguished from nearer ones, in half sides of the inner box.
const LEAST_DEPTH: f32 = 0.05;
/// Error of one over a distance, as a share of it, up to which it is right, and from which on it is no more wrong.
const RIGHT: f32 = 0.03;
const WRONG: f32 = 0.3;
/// The same far away, in one over half sides of the inner box.
const LEAST_NEARNESS: f32 = 0.1;

/// Steps after which the weight is half of what it was: once surfaces stand, the photos themselves determine better where.
const HALF_LIFE: f32 = 1000.0;

/// What is left of the weight at step `step`.
pub(in crate::train) fn fading(step: u64) -> f32 {
    1.0 / (1.0 + step as f32 / HALF_LIFE)
}

/// The sum over `rays` of the share of their light that comes from elsewhere than it should, 0 to 1 each; adds `scale` times
/// its gradient to `batch.d_weights`. `rays`: each with one over the distance that light should come from, field units.
pub(in crate::train) fn misplacement(
    rays: impl Iterator<Item = (usize, f32)>,
    scale: f32,
    batch: &mut FieldBatch,
) -> f64 {
    add_weight_gradient(batch, |batch, samples_of, d_weights| {
        let mut sum = 0.0;
        for (ray, nearness) in rays {
            sum += 1.0;
            for at in samples_of(ray) {
                let cost = cost(batch.distances()[at], nearness);
                sum += f64::from(batch.weights()[at] * cost);
                d_weights[at] += scale * cost;
            }
        }
        sum
    })
}

/// -1 where light comes from about the right distance, 0 where it does not.
fn cost(distance: f32, nearness: f32) -> f32 {
    let off = (1.0 / distance.max(LEAST_DEPTH) - nearness).abs() / nearness.max(LEAST_NEARNESS);
    ((off - RIGHT) / (WRONG - RIGHT)).clamp(0.0, 1.0) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_the_right_distance_is_rewarded_and_none_is_punished_without_end() {
        for nearness in [0.5, 2.0] {
            let right = 1.0 / nearness;
            assert_eq!(cost(right, nearness), -1.0);
            assert_eq!([cost(1e-6, nearness), cost(1e6, nearness)], [0.0; 2]);
            assert!((-1.0..0.0).contains(&cost(1.15 * right, nearness)));
        }
        // What is infinitely far away is there as soon as it is far.
        assert_eq!([cost(1e6, 0.0), cost(1.0, 0.0)], [-1.0, 0.0]);
    }

    #[test]
    fn it_fades_as_surfaces_form() {
        assert_eq!([fading(0), fading(HALF_LIFE as u64)], [1.0, 0.5]);
    }
}
