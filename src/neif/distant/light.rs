//! The radiance that a cone gathers from a panorama.

use glam::{Mat3, Quat, Vec3};
use serde::{Deserialize, Serialize};

use super::dome;
use super::equirect::Equirect;
use super::pyramid::{LOG_RATIO, MAX_WIDTH, Pyramid};
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::lobe::{kappa_from_variance, mean_length};

/// Variance of a uniform pixel, square pixels.
const PIXEL_VARIANCE: f32 = 1.0 / 12.0;
/// A cone this much wider than a pixel is still the pixel: the rounding of its width.
const ROUNDING: f32 = 1e-3;

/// Shape and orientation of a [`DistantLight`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistantConfig {
    /// Columns, even, 4 to 1024.
    pub width: usize,
    /// Rows, half as many.
    pub height: usize,
    /// Turns the picture's axes (z up, centre along +x) into the world's.
    pub world_from_picture: Quat,
    /// Whether the picture stands on a level floor, one field unit below its camera, which is in the field's origin; else it is
    /// infinitely far.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub has_floor: bool,
}

impl DistantConfig {
    /// Whether every number is in the supported range.
    pub fn is_sane(&self) -> bool {
        self.width == 2 * self.height
            && (4..=MAX_WIDTH).contains(&self.width)
            && self.world_from_picture.is_finite()
            && self.world_from_picture.is_normalized()
    }
}

/// A picture of all directions, made ready for cones of any width.
#[derive(Clone, Debug)]
pub struct DistantLight {
    /// Shape and orientation.
    pub config: DistantConfig,
    base: Equirect,
    pyramid: Pyramid,
    picture_from_world: Mat3,
    mean: Vec3,
}

impl DistantLight {
    /// Prepares a picture of linear radiance, `[height * width]` RGB values that are finite and not negative; `None`
    /// when their number does not fit.
    pub fn new(config: DistantConfig, radiance: &[f32]) -> Option<Self> {
        let (pixels, rest) = radiance.as_chunks::<3>();
        if !rest.is_empty() || !config.is_sane() {
            return None;
        }
        let base = Equirect::new(config.width, config.height, pixels.to_vec())?;
        Some(Self {
            config,
            pyramid: Pyramid::new(&base),
            picture_from_world: Mat3::from_quat(config.world_from_picture.inverse()),
            mean: base.mean(),
            base,
        })
    }

    /// The picture's values, `[height * width * 3]`.
    pub fn params(&self) -> &[f32] {
        self.base.pixels().as_flattened()
    }

    /// Mean radiance over the sphere.
    pub fn mean(&self) -> Vec3 {
        self.mean
    }

    /// Linear radiance along a cone. From afar the cone's origin and its width there do not matter.
    pub fn radiance(&self, ray: &FieldRay) -> [f32; 3] {
        let variance = ray.cone.spread * ray.cone.spread + ray.cone.lobe_variance;
        let direction = self.picture_from_world * Vec3::from(ray.direction);
        self.gathered(direction, variance).to_array()
    }

    /// The same of a picture on a floor, and where the light comes from: distance along the unit direction, field units.
    pub fn radiance_above_floor(&self, ray: &FieldRay) -> ([f32; 3], f32) {
        let met = dome::meet(ray, self.config.world_from_picture * Vec3::Z);
        let seen = self.gathered(self.picture_from_world * met.direction, met.variance);
        (seen.to_array(), met.distance)
    }

    /// The mean over the lobe about `d` (picture axes) with the given variance per transverse axis of its unit directions.
    fn gathered(&self, d: Vec3, variance: f32) -> Vec3 {
        let pitch = std::f32::consts::PI / self.config.height as f32;
        let pixel = pitch * pitch * PIXEL_VARIANCE;
        if variance <= pixel * (1.0 + ROUNDING) {
            return self.base.bilinear(d);
        }
        let levels = &self.pyramid.levels;
        let narrowest = self.pyramid.kappa as f32;
        let kappa = kappa_from_variance(variance);
        if kappa >= narrowest {
            // Narrower than the first level: between it and the picture, so that the variances mix to the right one.
            let first = mean_length(narrowest) / narrowest;
            let t = ((variance - pixel) / (first - pixel)).clamp(0.0, 1.0);
            return self
                .base
                .bilinear(d)
                .lerp(levels[0].bicubic(d).max(Vec3::ZERO), t);
        }
        let depth = ((narrowest / kappa).ln() / LOG_RATIO as f32).min(1e6);
        let last = levels.len() - 1;
        if depth >= last as f32 {
            // Lobes this wide differ from the mean by a cosine, in proportion to the concentration.
            let t = (kappa / narrowest * (LOG_RATIO as f32 * last as f32).exp()).min(1.0);
            return self.mean.lerp(levels[last].bicubic(d).max(Vec3::ZERO), t);
        }
        self.between_levels(d, depth)
    }

    /// Cubic through the four levels around `depth`, `[0, n_levels - 1]`.
    fn between_levels(&self, d: Vec3, depth: f32) -> Vec3 {
        let levels = &self.pyramid.levels;
        let start = (depth as usize).saturating_sub(1).min(levels.len() - 4);
        let t = depth - start as f32;
        let values: [Vec3; 4] = std::array::from_fn(|i| levels[start + i].bicubic(d));
        let mut sum = Vec3::ZERO;
        for (weight, value) in lagrange(t).into_iter().zip(values) {
            sum += weight * value;
        }
        // Beside a lamp the cubic undershoots, which would draw a dark ring around it.
        let below = (t as usize).min(2);
        sum.max(values[below].min(values[below + 1]))
            .max(Vec3::ZERO)
    }
}

/// Lagrange's weights of nodes 0, 1, 2 and 3 at `t`.
fn lagrange(t: f32) -> [f32; 4] {
    let (a, b, c) = (t - 1.0, t - 2.0, t - 3.0);
    [
        -a * b * c / 6.0,
        t * b * c / 2.0,
        -t * a * c / 2.0,
        t * a * b / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;
    use crate::neif::distant::equirect::pixel_direction;
    use crate::neif::light::lobe::Lobe;

    fn light(width: usize, paint: impl Fn(Vec3) -> [f32; 3]) -> DistantLight {
        let height = width / 2;
        let config = DistantConfig {
            width,
            height,
            world_from_picture: Quat::IDENTITY,
            has_floor: false,
        };
        let pixels: Vec<f32> = (0..width * height)
            .flat_map(|i| paint(pixel_direction(width, i)))
            .collect();
        DistantLight::new(config, &pixels).unwrap()
    }

    /// The lobe's mean over the pixels' middles, in double precision.
    fn brute_force(light: &DistantLight, d: Vec3, kappa: f64) -> [f64; 3] {
        let (mut sum, mut whole) = ([0.0; 3], 0.0);
        let (width, base) = (light.config.width, &light.base);
        for (i, pixel) in base.pixels().iter().enumerate() {
            let from = pixel_direction(width, i).as_dvec3();
            let distance2 = (from - d.as_dvec3()).length_squared();
            let weight = base.solid_angle(i / width) * (-0.5 * kappa * distance2).exp();
            whole += weight;
            for c in 0..3 {
                sum[c] += weight * f64::from(pixel[c]);
            }
        }
        sum.map(|v| v / whole)
    }

    /// Lamps of two degrees, one near the zenith, one near the seam, in a dim environment.
    fn lamps() -> (DistantLight, [Vec3; 2]) {
        let axes =
            [Vec3::new(0.05, -0.08, 1.0), Vec3::new(-1.0, 0.01, 0.2)].map(Vec3::normalize_or_zero);
        let paint = move |d: Vec3| {
            let near = axes.map(|axis| d.angle_between(axis) < 0.035);
            let sky = 0.2 + 0.1 * d.z;
            [
                if near[0] { 3e4 } else { sky },
                if near[1] { 5e3 } else { sky },
                sky,
            ]
        };
        (light(512, paint), axes)
    }

    #[test]
    fn lobes_of_any_roughness_agree_with_brute_force() {
        let (light, axes) = lamps();
        let roughnesses = [
            0.15, 0.17, 0.2, 0.23, 0.26, 0.3, 0.34, 0.4, 0.47, 0.55, 0.62, 0.7, 0.78, 0.85, 0.93,
            1.0,
        ];
        // From the lamp's middle outward, in deviations of the lobe; far out little of a lobe is left (a ninetieth of
        // its height at three), so that little of a picture hangs on it.
        for (deviations, tolerance) in [(0.0, 0.02), (1.0, 0.02), (2.0, 0.02), (3.0, 0.06)] {
            let mut worst = (0.0, String::new());
            for roughness in roughnesses {
                let lobe = Lobe::from_roughness(roughness);
                for (c, axis) in axes.into_iter().enumerate() {
                    let angle = (deviations / lobe.kappa.sqrt()).min(std::f32::consts::PI);
                    let side = axis.any_orthonormal_vector();
                    let d = axis * angle.cos() + side * angle.sin();
                    let found = f64::from(light.gathered(d, lobe.variance)[c]);
                    let expected = brute_force(&light, d, f64::from(lobe.kappa))[c];
                    let error = (found / expected - 1.0).abs();
                    if error > worst.0 {
                        worst = (error, format!("{roughness}: {found}, not {expected}"));
                    }
                }
            }
            println!("{deviations} deviations: {:.4} at {}", worst.0, worst.1);
            assert!(
                worst.0 < tolerance,
                "{deviations}: {:.4} at {}",
                worst.0,
                worst.1
            );
        }
    }

    #[test]
    fn a_mirror_shows_the_picture_itself() {
        let (light, axes) = lamps();
        for d in axes.into_iter().chain(fibonacci_sphere(50)) {
            let sharp = light.gathered(d, Lobe::from_roughness(0.02).variance);
            assert_eq!(sharp, light.base.bilinear(d), "at {d}");
        }
    }

    #[test]
    fn narrow_lobes_keep_a_lamp_s_brightness() {
        let (light, axes) = lamps();
        for roughness in [0.05, 0.07, 0.09, 0.11, 0.13] {
            let lobe = Lobe::from_roughness(roughness);
            let found = f64::from(light.gathered(axes[0], lobe.variance).x);
            let expected = brute_force(&light, axes[0], f64::from(lobe.kappa))[0];
            assert!(
                (found / expected - 1.0).abs() < 0.03,
                "{roughness}: {found}, not {expected}"
            );
        }
    }

    #[test]
    fn growing_lobes_change_steadily_and_end_at_the_mean() {
        let (light, axes) = lamps();
        let mut last = light.gathered(axes[0], 0.0).x;
        for i in 0..4000 {
            let variance = 1e-6 * (i as f32 / 4000.0 * (3e5_f32).ln()).exp();
            let value = light.gathered(axes[0], variance).x;
            assert!(
                value <= last * 1.0005 && value > last * 0.97,
                "variance {variance}: {value} after {last}"
            );
            last = value;
        }
        for variance in [1.0 / 3.0, 0.5, 1e9, f32::INFINITY] {
            assert_eq!(light.gathered(axes[0], variance), light.mean, "{variance}");
        }
    }

    #[test]
    fn even_light_is_even_at_any_width() {
        let light = light(64, |_| [0.5, 2.0, 7.0]);
        for variance in [0.0, 1e-3, 1e-2, 0.1, 0.3, 0.333, 2.0] {
            for d in fibonacci_sphere(40) {
                let error = light.gathered(d, variance) / Vec3::new(0.5, 2.0, 7.0) - Vec3::ONE;
                assert!(
                    error.abs().max_element() < 1e-4,
                    "{variance} at {d}: {error}"
                );
            }
        }
    }

    #[test]
    fn a_turned_picture_shows_its_content_where_it_went() {
        let straight = light(64, |d| if d.x > 0.9 { [9.0; 3] } else { [1.0; 3] });
        let config = DistantConfig {
            world_from_picture: Quat::from_rotation_z(std::f32::consts::FRAC_PI_2),
            ..straight.config
        };
        let turned = DistantLight::new(config, straight.params()).unwrap();
        let ray = FieldRay::of_pixel([0.0; 3], [0.0, 1.0, 0.0], 0.0, 0.0);
        assert!(
            (turned.radiance(&ray)[0] - 9.0).abs() < 1e-5,
            "+x is at +y now"
        );
    }
}
