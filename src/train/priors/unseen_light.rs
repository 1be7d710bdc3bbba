//! Light from where no photo looks, which the object alone constrains: as even as its reflections allow.
//!
//! A surface that mirrors a twentieth of the light says little of where it comes from, and the field fills the ceiling
//! that no photo shows with whatever explains the last noise of the pixels. Neighbouring rays into such directions are
//! asked to bring the same light. The error is that of a logarithm and grows in proportion to it: an edge costs no more
//! than the same change in steps. How much is asked falls with what the object mirrors: a mirror shows its ceiling.

use std::f32::consts::{PI, TAU};
use std::ops::Range;

use glam::Vec3;

use super::some_projectors;
use crate::data::Dataset;
use crate::geometry::{fibonacci_sphere, orthonormal_basis};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::surface::values::Surface;
use crate::train::random::SlotRandom;

/// Directions that are distinguished.
const N_DIRECTIONS: usize = 2048;
/// Distances at which a photo may show what lies in a direction, in half sides of the inner box.
const DISTANCES: [f32; 3] = [0.7, 1.4, 2.8];
/// Most photos that are asked.
const MOST_PHOTOS: usize = 256;
/// Angle between the two rays of a pair at most, radians.
const APART: f32 = 0.15;
/// Standard deviation of the directions of a ray at most, radians.
const WIDEST: f32 = 0.1;
/// Where the rays start: within this distance of the middle of the inner box, in half sides of it.
const AROUND: f32 = 0.25;
/// Radiance below which a difference counts by itself and not as a share.
const DARK: f32 = 0.02;
/// Share below which the error is a square.
const KNEE: f32 = 0.05;
/// Mean reflectance at which a quarter is asked of what is without any.
const DULL: f32 = 0.05;
/// Slots of the random numbers: beyond those of the pixels, the unseen rays and the cones.
const FIRST_SLOT: u64 = 1 << 35;

/// Unit directions from the object in which no photo looks.
#[derive(Clone, Debug, Default)]
pub(in crate::train) struct UnseenDirections(Vec<Vec3>);

impl UnseenDirections {
    /// Those that no training photo has in its frame at any of the [`DISTANCES`].
    pub(in crate::train) fn of(dataset: &Dataset, frame: &FieldFrame) -> Self {
        let photos = some_projectors(dataset, MOST_PHOTOS);
        let is_unseen = |direction: &Vec3| {
            DISTANCES.iter().all(|distance| {
                let p_world = frame.world_from_field(*direction * *distance);
                photos.iter().all(|photo| photo.pixel(p_world).is_none())
            })
        };
        let all = fibonacci_sphere(N_DIRECTIONS).into_iter();
        Self(all.filter(is_unseen).collect())
    }

    /// Share of all directions.
    pub(in crate::train) fn share(&self) -> f32 {
        self.0.len() as f32 / N_DIRECTIONS as f32
    }

    /// Adds the rays of pairs number `slots` of a step to the batch: from beside the object, neighbouring and equally wide.
    pub(in crate::train) fn draw(
        &self,
        (seed, step): (u64, u64),
        slots: Range<usize>,
        batch: &mut FieldBatch,
    ) {
        for slot in slots {
            let slot = FIRST_SLOT + slot as u64;
            let mut random = SlotRandom::new(seed, step, slot);
            let middle = self.0[random.index(self.0.len())];
            let origin = AROUND * Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0));
            let width = WIDEST * random.uniform();
            let (tangent, bitangent) = orthonormal_basis(middle);
            let mut beside = |reach: f32| {
                let (phi, r) = (random.uniform() * TAU, reach * random.uniform());
                (middle + (tangent * phi.cos() + bitangent * phi.sin()) * r).normalize_or(middle)
            };
            let spacing = (4.0 * PI / N_DIRECTIONS as f32).sqrt();
            let first = beside(spacing);
            let second = (first + beside(APART) - middle).normalize_or(middle);
            let ray = |d: Vec3| FieldRay::of_pixel(origin.to_array(), d.to_array(), 0.0, width);
            batch.rays.extend([first, second].map(ray));
        }
    }
}

/// How much is asked where these are the object's surfaces: less the more of the light they mirror in the mean.
pub(in crate::train) fn trust_in_evenness(surfaces: &[Surface]) -> f32 {
    let tints: Vec3 = surfaces.iter().map(|surface| surface.tint).sum();
    let reflectance = tints.element_sum() / (3 * surfaces.len().max(1)) as f32;
    (DULL / (DULL + reflectance)).powi(2)
}

/// Sum over `n_pairs` pairs from ray `first` on of how much their light differs; adds `scale` times its gradient to
/// `batch.d_radiance`.
pub(in crate::train) fn unevenness(
    (first, n_pairs): (usize, usize),
    scale: f32,
    batch: &mut FieldBatch,
) -> f64 {
    let mut sum = 0.0;
    for a in (0..n_pairs).map(|i| first + 2 * i) {
        for c in 0..3 {
            let light = [a, a + 1].map(|ray| batch.radiance[ray][c] + DARK);
            let log = (light[0] / light[1]).ln();
            let size = log.hypot(KNEE);
            sum += f64::from(size - KNEE);
            let d_log = scale * log / size;
            batch.d_radiance[a][c] += d_log / light[0];
            batch.d_radiance[a + 1][c] -= d_log / light[1];
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::placement::field_frame;
    use crate::train::test_scene::sphere_in_a_box;

    #[test]
    fn a_direction_is_unseen_where_no_photo_looks() {
        let mut dataset = sphere_in_a_box(6, 32);
        let frame = field_frame(&dataset, 1.1);
        dataset.train.truncate(1);
        let camera = &dataset.train[0].camera;
        let ahead = (frame.center - camera.position()).normalize_or(Vec3::Z);
        let unseen = UnseenDirections::of(&dataset, &frame);
        assert!(
            unseen.0.iter().all(|d| d.dot(ahead) < 0.9),
            "what the photo shows"
        );
        assert!(
            unseen.0.iter().any(|d| d.dot(ahead) < -0.9),
            "what is behind it"
        );
        assert!((0.5..1.0).contains(&unseen.share()), "{}", unseen.share());
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut batch = FieldBatch::default();
        batch.radiance = vec![[9.0; 3], [0.5, 0.1, 2.0], [0.6, 0.3, 2.01]];
        batch.d_radiance = vec![[0.0; 3]; 3];
        unevenness((1, 1), 0.7, &mut batch);
        let d = batch.d_radiance.clone();
        assert_eq!(d[0], [0.0; 3], "no ray of a pair");
        for (ray, c) in [(1, 0), (1, 1), (2, 0), (2, 1), (2, 2)] {
            let h = 1e-3 * batch.radiance[ray][c];
            let mut at = |s: f32| {
                let kept = batch.radiance[ray][c];
                batch.radiance[ray][c] += s;
                let sum = unevenness((1, 1), 0.0, &mut batch);
                batch.radiance[ray][c] = kept;
                0.7 * sum
            };
            let numeric = (at(h) - at(-h)) / f64::from(2.0 * h);
            let analytic = f64::from(d[ray][c]);
            assert!(
                (analytic - numeric).abs() < 2e-2 * numeric.abs() + 1e-3,
                "{ray} {c}: {analytic} against {numeric}"
            );
        }
    }
}
