//! The light of a pixel should come from one place along its ray.
//!
//! A few photos of a room are explained as well by haze in front of each camera, all the more where their exposures
//! differ. After the distortion loss of mip-NeRF 360 (Barron et al. 2022, Eq. 15) without its term of single intervals,
//! over `s = t / (1 + t)` of distances in half sides of the inner box.

use std::ops::Range;

use super::add_weight_gradient;
use crate::neif::field::radiance_field::FieldBatch;

/// Sum over `rays` of `sum_ij w_i w_j |s_i - s_j|`; adds `scale` times its gradient by the compositing weights to
/// `batch.d_weights`.
pub(in crate::train) fn distortion(rays: Range<usize>, scale: f32, batch: &mut FieldBatch) -> f64 {
    add_weight_gradient(batch, |batch, samples_of, d_weights| {
        let of_ray = |ray: usize| {
            let samples = samples_of(ray);
            let weights = &batch.weights()[samples.clone()];
            let distances = &batch.distances()[samples.clone()];
            f64::from(ray_distortion(
                weights,
                distances,
                scale,
                &mut d_weights[samples],
            ))
        };
        rays.map(of_ray).sum()
    })
}

/// The sum over one ray, whose `distances` grow, in linear time: what lies before and behind a sample is summed along.
fn ray_distortion(weights: &[f32], distances: &[f32], scale: f32, d_weights: &mut [f32]) -> f32 {
    let place = |t: &f32| t / (1.0 + t);
    let places = weights.iter().zip(distances);
    let (all, all_moment) = places.fold((0.0, 0.0), |(all, moment), (w, t)| {
        (all + w, moment + w * place(t))
    });
    let (mut before, mut moment_before, mut sum) = (0.0, 0.0, 0.0);
    for ((w, t), d) in weights.iter().zip(distances).zip(d_weights) {
        let s = place(t);
        let (behind, moment_behind) = (all - before - w, all_moment - moment_before - w * s);
        let apart = (s * before - moment_before) + (moment_behind - s * behind);
        sum += w * apart;
        *d += scale * 2.0 * apart;
        before += w;
        moment_before += w * s;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISTANCES: [f32; 5] = [0.1, 0.3, 1.0, 2.5, 9.0];

    /// As defined, pair by pair.
    fn pairwise(weights: &[f32]) -> f32 {
        let place = |i: usize| DISTANCES[i] / (1.0 + DISTANCES[i]);
        let pairs = (0..25).map(|k| (k / 5, k % 5));
        pairs
            .map(|(i, j)| weights[i] * weights[j] * (place(i) - place(j)).abs())
            .sum()
    }

    #[test]
    fn the_sum_is_that_over_all_pairs_and_the_gradient_its_own() {
        let weights = [0.1, 0.0, 0.4, 0.2, 0.25];
        let mut gradient = [0.5; 5];
        let sum = ray_distortion(&weights, &DISTANCES, 3.0, &mut gradient);
        assert!((sum - pairwise(&weights)).abs() < 1e-6, "{sum}");
        for i in 0..5 {
            let moved = |h: f32| {
                let mut weights = weights;
                weights[i] += h;
                pairwise(&weights)
            };
            let numeric = (moved(0.01) - moved(-0.01)) / 0.02;
            let analytic = (gradient[i] - 0.5) / 3.0;
            assert!(
                (analytic - numeric).abs() < 1e-3,
                "{i}: {analytic}, {numeric}"
            );
        }
    }

    #[test]
    fn one_surface_has_none() {
        let mut gradient = [0.0; 5];
        let sum = ray_distortion(&[0.0, 0.0, 1.0, 0.0, 0.0], &DISTANCES, 1.0, &mut gradient);
        assert_eq!(sum, 0.0);
        assert_eq!(gradient[2], 0.0, "the surface stays");
        assert!(gradient[1] > 0.0 && gradient[0] > gradient[1], "haze goes");
    }
}
