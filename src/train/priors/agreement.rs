//! What a wide cone gathers is the mean of what the narrower ones within it do.
//!
//! Photos without an object teach the field the widths that pixels and their blurred levels ask for; wider cones, which
//! a rough object put there will ask for, mean anything. Drawn cones at every roughness are made to follow the narrow
//! ones within them, which stay.

use std::ops::Range;

use glam::Vec3;

use super::unseen::look;
use crate::geometry::sample_vmf;
use crate::neif::EnvironmentTransform;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::light::light_path::first_lobe_ray;
use crate::neif::light::lobe::{Lobe, mean_length};
use crate::neif::light::shading::SurfacePoint;
use crate::train::fast::step_context::StepContext;
use crate::train::random::SlotRandom;

/// Narrower cones of a group, in two sets of half as many.
const NARROW: usize = 8;
/// Cones of a group, the wide one first.
const GROUP: usize = NARROW + 1;
/// Their roughness as a share of the wide one's: an eighth of its variance.
const NARROWING: f32 = 0.594_604;
/// Range of the wide cone's roughness.
const ROUGHNESS: Range<f32> = 0.1..1.0;
/// Radiance below which a difference counts by itself and not as a share.
const DARK: f32 = 0.05;
/// Slots of the random numbers: beyond those of the pixels and the unseen rays.
const FIRST_SLOT: u64 = 1 << 34;

/// Adds the rays of groups number `slots`: a wide cone each, then its narrow ones, from wherever a camera could be. Returns
/// which these are.
pub(in crate::train) fn draw(
    context: &StepContext<'_>,
    slots: Range<usize>,
    batch: &mut FieldBatch,
) -> Range<usize> {
    let first = batch.rays.len();
    let still = EnvironmentTransform::default().environment_from_world();
    for slot in slots {
        let slot = FIRST_SLOT + slot as u64;
        let mut random = SlotRandom::new(context.config.seed, context.step, slot);
        let (position, pixel) = look(context, &mut random);
        let axis = pixel.direction;
        let point = SurfacePoint {
            position,
            ..SurfacePoint::default()
        };
        let span = ROUGHNESS.end - ROUGHNESS.start;
        let roughness = ROUGHNESS.start + span * random.uniform();
        let [wide, narrow] = [roughness, roughness * NARROWING].map(Lobe::from_roughness);
        let mut push = |axis: Vec3, lobe: &Lobe| {
            let ray = first_lobe_ray(&point, axis, lobe, &still, context.frame);
            batch.rays.push(ray);
        };
        push(axis, &wide);
        // Mean lengths multiply where one distribution spreads the axes of another.
        let between = kappa_from_mean_length(wide.mean_length / narrow.mean_length);
        for _ in 0..2 {
            let (u, v) = (random.uniform(), random.uniform());
            let n = NARROW / 2;
            for k in 0..n {
                let share = (k as f32 + u) / n as f32;
                let turn = (v + k as f32 * 0.618_034).fract();
                push(sample_vmf(between, axis, [share, turn]), &narrow);
            }
        }
    }
    first..batch.rays.len()
}

/// The concentration of a von Mises-Fisher distribution whose mean direction has this length, in `[0, 1)`
/// (Banerjee et al. 2005, Eq. 4.4, and two of Newton's steps).
fn kappa_from_mean_length(length: f32) -> f32 {
    let length = length.clamp(0.0, 0.999_999);
    let mut kappa = length * (3.0 - length * length) / (1.0 - length * length);
    for _ in 0..2 {
        let a = mean_length(kappa);
        let slope = 1.0 - a * a - 2.0 * a / kappa.max(1e-3);
        if slope > 1e-4 {
            kappa = (kappa - (a - length) / slope).max(0.0);
        }
    }
    kappa
}

/// Sum over the groups of `rays` of how far the wide cone is from the narrow ones' mean, as a share, squared; adds `scale`
/// times its gradient by the wide ones' radiance to `batch.d_radiance`.
///
/// The square is the product of the differences from two independent means: its expectation has no part of the means'
/// own spread.
pub(in crate::train) fn disagreement(
    rays: Range<usize>,
    scale: f32,
    batch: &mut FieldBatch,
) -> f64 {
    let mut sum = 0.0;
    for start in rays.step_by(GROUP) {
        let light = |ray: usize| Vec3::from(batch.radiance[ray]);
        let half = NARROW / 2;
        let mean = |set: usize| {
            let rays = start + 1 + set * half..start + 1 + (set + 1) * half;
            rays.map(light).sum::<Vec3>() / half as f32
        };
        let (wide, means) = (light(start), [mean(0), mean(1)]);
        let size = 0.5 * wide + 0.25 * (means[0] + means[1]) + DARK;
        let share = (size * size).recip();
        let differences = means.map(|mean| mean - wide);
        sum += f64::from((share * differences[0] * differences[1]).element_sum());
        let d = -scale * share * (differences[0] + differences[1]);
        let d_radiance = &mut batch.d_radiance[start];
        *d_radiance = (Vec3::from(*d_radiance) + d).to_array();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concentration_is_the_inverse_of_the_mean_length() {
        for kappa in [0.4_f32, 1.0, 3.0, 20.0, 500.0] {
            let found = kappa_from_mean_length(mean_length(kappa));
            assert!((found / kappa - 1.0).abs() < 0.02, "{kappa}: {found}");
        }
        for length in [-1.0, 0.0, 1.0, 2.0] {
            let kappa = kappa_from_mean_length(length);
            assert!(kappa.is_finite() && kappa >= 0.0, "{length}: {kappa}");
        }
    }

    /// A batch of one group in which the wide cone has one radiance and each of the narrow ones its own.
    fn group(wide: f32, narrow: [f32; NARROW]) -> FieldBatch {
        let light = [wide].into_iter().chain(narrow);
        let mut batch = FieldBatch::default();
        batch.radiance.extend(light.map(|v| [v, 0.5 * v, 0.0]));
        batch.d_radiance.resize(GROUP, [0.0; 3]);
        batch
    }

    #[test]
    fn a_group_that_agrees_feels_nothing() {
        let mut batch = group(2.0, [1.0, 3.0, 1.0, 3.0, 2.0, 2.0, 0.0, 4.0]);
        assert_eq!(disagreement(0..GROUP, 1.0, &mut batch), 0.0);
        assert!(batch.d_radiance.iter().all(|d| *d == [0.0; 3]));
    }

    #[test]
    fn a_wide_cone_that_is_too_bright_is_darkened_and_its_narrow_ones_stay() {
        let mut batch = group(2.0, [1.0, 0.5, 1.5, 1.0, 0.0, 2.0, 1.0, 1.0]);
        assert!(disagreement(0..GROUP, 1.0, &mut batch) > 0.0);
        // The optimiser goes down the gradient.
        assert!(batch.d_radiance[0][0] > 0.0 && batch.d_radiance[0][2] == 0.0);
        assert_eq!(batch.d_radiance[1..], [[0.0; 3]; NARROW]);
    }

    #[test]
    fn the_gradient_is_that_of_the_differences_with_their_size_held() {
        let narrow = [1.0, 0.5, 1.5, 0.7, 0.2, 1.1, 0.9, 0.3];
        let product = |wide: f32| {
            let half = |set: usize| narrow[set * 4..set * 4 + 4].iter().sum::<f32>() / 4.0;
            (half(0) - wide) * (half(1) - wide)
        };
        let mut batch = group(1.2, narrow);
        disagreement(0..GROUP, 1.0, &mut batch);
        let mean = narrow.iter().sum::<f32>() / NARROW as f32;
        let size = 0.5 * (1.2 + mean) + DARK;
        let h = 1e-2;
        let numeric = (product(1.2 + h) - product(1.2 - h)) / (2.0 * h);
        let analytic = batch.d_radiance[0][0] * size * size;
        assert!((analytic - numeric).abs() < 1e-3, "{analytic}, {numeric}");
    }
}
