//! Light from where no photo looks, which the object alone constrains: as even as its reflections allow.
//!
//! A surface that mirrors a twentieth of the light says little of where it comes from, and the field fills the ceiling
//! that no photo shows with whatever explains the last noise of the pixels. Neighbouring rays into such directions are
//! asked to bring the same light. The error is that of a logarithm and grows in proportion to it: an edge costs no more
//! than the same change in steps. How much is asked falls with what the object mirrors: a mirror shows its ceiling.
//!
//! Nor is light that hardly matters brighter than white all over. Where photos show what is near, but not what lies behind
//! it, it otherwise rises tenfold while the object darkens, and glares at whoever looks there. A mirror shows its lamps, too,
//! and a lamp or the sun is a small part of what is not shown: it is as bright as the object shows it to be.

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
/// Pairs of rays that are looked at together for glare, and their rays: directions all over what is not shown.
pub(in crate::train) const GLARE_PAIRS: usize = 4;
const GLARE_GROUP: usize = 2 * GLARE_PAIRS;
/// Logarithm of a radiance above white from which on the error grows in proportion to it.
const GLARE_KNEE: f32 = 0.5;

/// First slots of the random numbers of rays in unseen directions, beyond those of the pixels, the unseen rays and the cones.
const ANYWHERE_SLOT: u64 = 1 << 35;
const AFAR_SLOT: u64 = 1 << 36;

/// From the object, where training photos show nothing.
#[derive(Clone, Debug)]
pub(in crate::train) struct Unseen {
    /// In these directions none looks: it has them in its frame at none of the [`DISTANCES`].
    pub(in crate::train) anywhere: UnseenDirections,
    /// In these none shows what is far away, at the last of them.
    pub(in crate::train) afar: UnseenDirections,
}

/// Unit directions from the object.
#[derive(Clone, Debug)]
pub(in crate::train) struct UnseenDirections {
    directions: Vec<Vec3>,
    /// Of the random numbers of the rays drawn in them.
    first_slot: u64,
}

impl Unseen {
    /// What the training photos do not show.
    pub(in crate::train) fn new(dataset: &Dataset, frame: &FieldFrame) -> Self {
        let photos = some_projectors(dataset, MOST_PHOTOS);
        let is_unseen = |direction: &Vec3, distance: f32| {
            let p_world = frame.world_from_field(*direction * distance);
            photos.iter().all(|photo| photo.pixel(p_world).is_none())
        };
        let [near @ .., far] = DISTANCES;
        let all = fibonacci_sphere(N_DIRECTIONS).into_iter();
        let afar: Vec<Vec3> = all.filter(|d| is_unseen(d, far)).collect();
        let is_unseen_near = |d: &&Vec3| near.iter().all(|distance| is_unseen(d, *distance));
        Self {
            anywhere: UnseenDirections {
                directions: afar.iter().filter(is_unseen_near).copied().collect(),
                first_slot: ANYWHERE_SLOT,
            },
            afar: UnseenDirections {
                directions: afar,
                first_slot: AFAR_SLOT,
            },
        }
    }
}

impl UnseenDirections {
    /// Share of all directions.
    pub(in crate::train) fn share(&self) -> f32 {
        self.directions.len() as f32 / N_DIRECTIONS as f32
    }

    /// Adds the rays of pairs number `slots` of a step to the batch: from beside the object, neighbouring and equally wide.
    /// Returns which these are; `slots` is empty where no direction is.
    pub(in crate::train) fn draw(
        &self,
        (seed, step): (u64, u64),
        slots: Range<usize>,
        batch: &mut FieldBatch,
    ) -> Range<usize> {
        let first = batch.rays.len();
        for slot in slots {
            let slot = self.first_slot + slot as u64;
            let mut random = SlotRandom::new(seed, step, slot);
            let middle = self.directions[random.index(self.directions.len())];
            let origin = AROUND * Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0));
            let width = WIDEST * random.uniform();
            let (tangent, bitangent) = orthonormal_basis(middle);
            let mut beside = |reach: f32| {
                let (phi, r) = (random.uniform() * TAU, reach * random.uniform());
                (middle + (tangent * phi.cos() + bitangent * phi.sin()) * r).normalize_or(middle)
            };
            let spacing = (4.0 * PI / N_DIRECTIONS as f32).sqrt();
            let one = beside(spacing);
            let other = (one + beside(APART) - middle).normalize_or(middle);
            let ray = |d: Vec3| FieldRay::of_pixel(origin.to_array(), d.to_array(), 0.0, width);
            batch.rays.extend([one, other].map(ray));
        }
        first..batch.rays.len()
    }
}

/// How much is asked where these are the object's surfaces: less the more of the light they mirror in the mean, as they show what
/// there is.
pub(in crate::train) fn trust_in_priors(surfaces: &[Surface]) -> f32 {
    let tints: Vec3 = surfaces.iter().map(|surface| surface.tint).sum();
    let reflectance = tints.element_sum() / (3 * surfaces.len().max(1)) as f32;
    (DULL / (DULL + reflectance)).powi(2)
}

/// Sum over pairs of `rays` of how much their light differs; adds `scale` times its gradient to `batch.d_radiance`.
pub(in crate::train) fn unevenness(rays: Range<usize>, scale: f32, batch: &mut FieldBatch) -> f64 {
    let mut sum = 0.0;
    for a in rays.step_by(2) {
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

/// Sum over `rays` of the logarithm of their light where that is brighter than white, weighted by how much more than half of
/// their group is: 0 at a half, 1 where all are. Adds `scale` times its gradient, with that weight held, to `batch.d_radiance`.
pub(in crate::train) fn glare(rays: Range<usize>, scale: f32, batch: &mut FieldBatch) -> f64 {
    let mut sum = 0.0;
    for first in rays.step_by(GLARE_GROUP) {
        for c in 0..3 {
            let group = first..first + GLARE_GROUP;
            let is_bright = |ray: &usize| batch.radiance[*ray][c] > 1.0;
            let bright: Vec<usize> = group.filter(is_bright).collect();
            let excess = 2.0 * bright.len() as f32 / GLARE_GROUP as f32 - 1.0;
            for ray in bright.into_iter().filter(|_| excess > 0.0) {
                let light = batch.radiance[ray][c];
                let size = light.ln().hypot(GLARE_KNEE);
                sum += f64::from(excess * (size - GLARE_KNEE));
                batch.d_radiance[ray][c] += scale * excess * light.ln() / (size * light);
            }
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
        let Unseen { anywhere, afar } = Unseen::new(&dataset, &frame);
        let directions = &anywhere.directions;
        assert!(
            directions.iter().all(|d| d.dot(ahead) < 0.9),
            "what the photo shows"
        );
        assert!(
            directions.iter().any(|d| d.dot(ahead) < -0.9),
            "what is behind it"
        );
        let share = anywhere.share();
        assert!((0.5..1.0).contains(&share), "{share}");
        assert!(directions.iter().all(|d| afar.directions.contains(d)));
    }

    /// Of these rays' radiance by its gradient of weight 0.7, against differences of the sum.
    fn assert_gradient<const N: usize>(
        radiance: [[f32; 3]; N],
        loss: impl Fn(f32, &mut FieldBatch) -> f64,
    ) -> Vec<[f32; 3]> {
        let mut batch = FieldBatch::default();
        batch.radiance = radiance.to_vec();
        batch.d_radiance = vec![[0.0; 3]; N];
        loss(0.7, &mut batch);
        let d = batch.d_radiance.clone();
        for (ray, c) in (0..3 * N).map(|i| (i / 3, i % 3)) {
            let h = 1e-3 * batch.radiance[ray][c];
            let mut at = |s: f32| {
                batch.radiance[ray][c] = radiance[ray][c] + s;
                let sum = loss(0.0, &mut batch);
                batch.radiance[ray][c] = radiance[ray][c];
                0.7 * sum
            };
            let numeric = (at(h) - at(-h)) / f64::from(2.0 * h);
            let analytic = f64::from(d[ray][c]);
            assert!(
                (analytic - numeric).abs() < 2e-2 * numeric.abs() + 1e-3,
                "{ray} {c}: {analytic} against {numeric}"
            );
        }
        d
    }

    #[test]
    fn what_differs_is_drawn_together() {
        let radiance = [[9.0; 3], [0.5, 0.1, 2.0], [0.6, 0.3, 2.01]];
        let d = assert_gradient(radiance, |scale, batch| unevenness(1..3, scale, batch));
        assert_eq!(d[0], [0.0; 3], "no ray of a pair");
        assert!(d[1][0] < 0.0 && d[2][0] > 0.0, "{d:?}");
    }

    #[test]
    fn what_is_brighter_than_white_all_over_is_darkened_and_a_lamp_left_alone() {
        // Red: three of eight; green: half of them; blue: all.
        let ray = |i: usize| match i {
            0 => [9.0; 3],
            1..5 => [0.5, 0.9, 1.2],
            5 => [0.01, 3.0, 40.0],
            _ => [900.0, 2.0, 1.5],
        };
        let radiance: [[f32; 3]; 1 + GLARE_GROUP] = std::array::from_fn(ray);
        let glare = |scale, batch: &mut FieldBatch| glare(1..1 + GLARE_GROUP, scale, batch);
        let d = assert_gradient(radiance, glare);
        assert_eq!(d[0], [0.0; 3], "another ray");
        let d = &d[1..];
        assert!(d.iter().all(|d| d[0] == 0.0 && d[1] == 0.0), "{d:?}");
        assert!(d.iter().all(|d| d[2] > 0.0), "{d:?}");
    }
}
