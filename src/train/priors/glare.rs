//! Light from where no photo shows what is far away, which the object alone constrains: not brighter than white all over.
//!
//! Where photos show what is near, but not what lies behind it, a surface that mirrors a twentieth of the light says little of
//! it: that light rises tenfold while the object darkens, and glares at whoever looks there. A mirror shows what there is, so that
//! the less is asked the more the object mirrors. A lamp or the sun is a small part of what is not shown: it is as bright as the
//! object shows it to be.

use std::f32::consts::TAU;
use std::ops::Range;

use glam::Vec3;

use super::some_projectors;
use crate::data::Dataset;
use crate::geometry::{fibonacci_sphere, orthonormal_basis};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::surface::values::Surface;
use crate::train::random::SlotRandom;

/// Directions that are distinguished, and half the angle between neighbours, radians: `sqrt(4 pi / 2048) / 2`.
const N_DIRECTIONS: usize = 2048;
const HALF_SPACING: f32 = 0.04;
/// Distance at which a photo shows what lies in a direction, in half sides of the inner box.
const DISTANCE: f32 = 2.8;
/// Most photos that are asked.
const MOST_PHOTOS: usize = 256;
/// Standard deviation of the directions of a ray at most, radians.
const WIDEST: f32 = 0.1;
/// Where the rays start: within this distance of the middle of the inner box, in half sides of it.
const AROUND: f32 = 0.25;
/// Mean reflectance at which a quarter is asked of what is without any.
const DULL: f32 = 0.05;
/// Rays that are looked at together: directions all over what is not shown.
pub(in crate::train) const GROUP: usize = 4;
/// Logarithm of a radiance above white from which on the error grows in proportion to it.
const KNEE: f32 = 0.5;

/// First slot of the random numbers of these rays, beyond those of the pixels, the unseen rays and the cones.
const FIRST_SLOT: u64 = 1 << 36;

/// Unit directions from the object in which no training photo shows what is far away.
#[derive(Clone, Debug)]
pub(in crate::train) struct UnseenDirections(Vec<Vec3>);

impl UnseenDirections {
    /// What the training photos do not show.
    pub(in crate::train) fn new(dataset: &Dataset, frame: &FieldFrame) -> Self {
        let photos = some_projectors(dataset, MOST_PHOTOS);
        let is_unseen = |direction: &Vec3| {
            let p_world = frame.world_from_field(*direction * DISTANCE);
            photos.iter().all(|photo| photo.pixel(p_world).is_none())
        };
        let all = fibonacci_sphere(N_DIRECTIONS).into_iter();
        Self(all.filter(is_unseen).collect())
    }

    /// Share of all directions.
    pub(in crate::train) fn share(&self) -> f32 {
        self.0.len() as f32 / N_DIRECTIONS as f32
    }

    /// Adds the rays of a step's `groups` to the batch, [`GROUP`] each, from beside the object. Returns which these are; there is
    /// no group where no direction is.
    pub(in crate::train) fn draw(
        &self,
        (seed, step): (u64, u64),
        groups: Range<usize>,
        batch: &mut FieldBatch,
    ) -> Range<usize> {
        let first = batch.rays.len();
        for slot in GROUP * groups.start..GROUP * groups.end {
            let mut random = SlotRandom::new(seed, step, FIRST_SLOT + slot as u64);
            let middle = self.0[random.index(self.0.len())];
            let origin = AROUND * Vec3::from_array([(); 3].map(|()| 2.0 * random.uniform() - 1.0));
            let width = WIDEST * random.uniform();
            let (tangent, bitangent) = orthonormal_basis(middle);
            let (phi, r) = (random.uniform() * TAU, HALF_SPACING * random.uniform());
            let aside = (tangent * phi.cos() + bitangent * phi.sin()) * r;
            let direction = (middle + aside).normalize_or(middle).to_array();
            let ray = FieldRay::of_pixel(origin.to_array(), direction, 0.0, width);
            batch.rays.push(ray);
        }
        first..batch.rays.len()
    }
}

/// How much is asked where these are the object's surfaces: less the more of the light they mirror in the mean, as they show what
/// there is.
pub(in crate::train) fn trust(surfaces: &[Surface]) -> f32 {
    let sum: f32 = surfaces.iter().map(Surface::reflectance).sum();
    let reflectance = sum / surfaces.len().max(1) as f32;
    (DULL / (DULL + reflectance)).powi(2)
}

/// Sum over `rays` of the logarithm of their light where that is brighter than white, weighted by how much more than half of
/// their group is: 0 at a half, 1 where all are. Adds `scale` times its gradient, with that weight held, to `batch.d_radiance`.
pub(in crate::train) fn excess(rays: Range<usize>, scale: f32, batch: &mut FieldBatch) -> f64 {
    let mut sum = 0.0;
    for first in rays.step_by(GROUP) {
        for c in 0..3 {
            let group = first..first + GROUP;
            let is_bright = |ray: &usize| batch.radiance[*ray][c] > 1.0;
            let bright: Vec<usize> = group.filter(is_bright).collect();
            let share = 2.0 * bright.len() as f32 / GROUP as f32 - 1.0;
            for ray in bright.into_iter().filter(|_| share > 0.0) {
                let light = batch.radiance[ray][c];
                let size = light.ln().hypot(KNEE);
                sum += f64::from(share * (size - KNEE));
                batch.d_radiance[ray][c] += scale * share * light.ln() / (size * light);
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
        let unseen = UnseenDirections::new(&dataset, &frame);
        let directions = &unseen.0;
        assert!(
            directions.iter().all(|d| d.dot(ahead) < 0.9),
            "what the photo shows"
        );
        assert!(
            directions.iter().any(|d| d.dot(ahead) < -0.9),
            "what is behind it"
        );
        let share = unseen.share();
        assert!((0.5..1.0).contains(&share), "{share}");
    }

    #[test]
    fn what_is_brighter_than_white_all_over_is_darkened_and_a_lamp_left_alone() {
        // Red: one of four; green: half of them; blue: all.
        let radiance = [
            [9.0; 3],
            [0.5, 0.9, 1.2],
            [0.01, 0.9, 1.2],
            [0.5, 3.0, 40.0],
            [900.0, 2.0, 1.5],
        ];
        let mut batch = FieldBatch::default();
        batch.radiance = radiance.to_vec();
        batch.d_radiance = vec![[0.0; 3]; radiance.len()];
        excess(1..1 + GROUP, 0.7, &mut batch);
        let d = batch.d_radiance.clone();
        assert_eq!(d[0], [0.0; 3], "another ray");
        for (ray, c) in (0..3 * radiance.len()).map(|i| (i / 3, i % 3)) {
            let h = 1e-3 * radiance[ray][c];
            let mut at = |s: f32| {
                batch.radiance[ray][c] = radiance[ray][c] + s;
                let sum = excess(1..1 + GROUP, 0.0, &mut batch);
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
        let d = &d[1..];
        assert!(d.iter().all(|d| d[0] == 0.0 && d[1] == 0.0), "{d:?}");
        assert!(d.iter().all(|d| d[2] > 0.0), "{d:?}");
    }
}
