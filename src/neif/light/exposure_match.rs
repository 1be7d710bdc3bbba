//! Exposure and white balance that make another environment as bright as an object's own.
//!
//! The mean irradiance over all normals is the mean radiance over the sphere times pi, so the latter is compared. Only
//! on demand: how much brighter one place is than another is part of what a relighting shows.

use glam::Vec3;

use super::environment::{EnvironmentField, LightScratch};
use crate::color::luminance;
use crate::geometry::fibonacci_sphere;
use crate::neif::field::field_batch::{FieldBatch, FieldRay};
use crate::neif::{Environment, EnvironmentTransform};

/// Directions looked in.
const N_DIRECTIONS: usize = 2048;
/// The brightest of them are taken for no brighter than the next: specks of a trained field, which are no lamps, shine
/// up to 1e5 and would outweigh all else. A lamp is wider (0.2 % of all directions are a disc of five degrees).
const N_SPECKS: usize = 4;
/// Directions looked in together: their samples stay in the core's cache.
const TILE: usize = 64;
/// Gains of single colours beyond this are no white balance any more.
const LARGEST_BALANCE: f32 = 8.0;

/// Mean radiance over the sphere around a point in the environment's own coordinates.
///
/// Of a distant picture it is exact; else the mean over 2048 even directions without specks.
fn mean_radiance(environment: &Environment, at: Vec3) -> Vec3 {
    if let EnvironmentField::Distant(light) = environment.field()
        && environment.is_far()
    {
        return light.mean();
    }
    let origin = environment.frame().field_from_world(at).to_array();
    // Each cone stands for an even share of the sphere: the deviation of a square of that solid angle.
    let spread = (4.0 * std::f32::consts::PI / N_DIRECTIONS as f32 / 12.0).sqrt();
    let (mut batch, mut scratch) = (FieldBatch::default(), LightScratch::default());
    let mut seen = Vec::with_capacity(N_DIRECTIONS);
    for directions in fibonacci_sphere(N_DIRECTIONS).chunks(TILE) {
        batch.rays.clear();
        batch.rays.extend(
            directions
                .iter()
                .map(|direction| FieldRay::of_pixel(origin, direction.to_array(), 0.0, spread)),
        );
        environment.light(&mut batch, &mut scratch);
        seen.extend(batch.radiance.iter().map(|radiance| Vec3::from(*radiance)));
    }
    mean_without_specks(&mut seen, N_SPECKS)
}

/// The mean with the `n` brightest values dimmed to the next one's luminance.
fn mean_without_specks(values: &mut [Vec3], n: usize) -> Vec3 {
    values.sort_by(|a, b| luminance(*b).total_cmp(&luminance(*a)));
    let most = values.get(n).map_or(f32::INFINITY, |next| luminance(*next));
    for value in values.iter_mut().take(n) {
        let own = luminance(*value);
        if own > most {
            *value *= most / own;
        }
    }
    let sum: glam::DVec3 = values.iter().map(|value| value.as_dvec3()).sum();
    (sum / values.len().max(1) as f64).as_vec3()
}

/// `transform` with the exposure and white balance by which `other` lights an object at the world point `at` as much as
/// `own`, unmoved, does; `None` where one of them is black or not finite.
pub fn matched(
    transform: &EnvironmentTransform,
    own: &Environment,
    other: &Environment,
    at: Vec3,
) -> Option<EnvironmentTransform> {
    let wanted = mean_radiance(own, at);
    let found = mean_radiance(other, transform.environment_from_world().point(at));
    let gain = luminance(wanted) / luminance(found);
    if !(gain.is_finite() && gain > 0.0) {
        return None;
    }
    // A colour that is missing cannot be balanced.
    let balance = (wanted / found.max(Vec3::splat(f32::MIN_POSITIVE)) / gain).clamp(
        Vec3::splat(1.0 / LARGEST_BALANCE),
        Vec3::splat(LARGEST_BALANCE),
    );
    Some(EnvironmentTransform {
        exposure_ev: gain.log2(),
        white_balance: balance,
        ..*transform
    })
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::neif::distant::{DistantConfig, DistantLight};

    fn even(color: Vec3) -> Environment {
        let config = DistantConfig {
            width: 16,
            height: 8,
            world_from_picture: Quat::IDENTITY,
            has_floor: false,
        };
        let pixels: Vec<f32> = (0..128).flat_map(|_| color.to_array()).collect();
        let light = DistantLight::new(config, &pixels).unwrap();
        Environment::of_distant("even".to_owned(), Vec3::Z, light)
    }

    #[test]
    fn a_matched_environment_lights_as_much_in_the_same_colour() {
        let (own, other) = (Vec3::new(0.4, 0.5, 0.6), Vec3::new(9.0, 4.0, 2.0));
        let moved = EnvironmentTransform {
            rotate_deg: Vec3::new(0.0, 0.0, 30.0),
            exposure_ev: 3.0,
            ..EnvironmentTransform::default()
        };
        let matched = matched(&moved, &even(own), &even(other), Vec3::ZERO).unwrap();
        assert_eq!(matched.rotate_deg, moved.rotate_deg, "stays turned");
        let gain = matched.environment_from_world().gain;
        assert!((gain * other - own).length() < 1e-4, "{}", gain * other);
        let balanced = luminance(matched.white_balance * other);
        assert!(
            (balanced / luminance(other) - 1.0).abs() < 1e-4,
            "{matched:?}"
        );
    }

    #[test]
    fn a_black_environment_cannot_be_matched() {
        let (black, grey) = (even(Vec3::ZERO), even(Vec3::ONE));
        let still = EnvironmentTransform::default();
        assert!(
            matched(&still, &grey, &black, Vec3::ZERO).is_none(),
            "infinite gain"
        );
        assert!(
            matched(&still, &black, &grey, Vec3::ZERO).is_none(),
            "no light"
        );
    }

    #[test]
    fn specks_do_not_count_and_lamps_do() {
        let mut values = vec![Vec3::ONE; 2048];
        values[100] = Vec3::splat(1e5);
        values[900] = Vec3::splat(3e4);
        assert_eq!(mean_without_specks(&mut values, N_SPECKS), Vec3::ONE);
        for value in &mut values[500..520] {
            *value = Vec3::splat(41.0);
        }
        let mean = mean_without_specks(&mut values, N_SPECKS).x;
        assert!((mean - (1.0 + 20.0 * 40.0 / 2048.0)).abs() < 1e-3, "{mean}");
    }
}
