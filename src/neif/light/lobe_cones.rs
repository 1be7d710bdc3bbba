//! A lobe as several cones: for surfaces and environments other than those that were trained together.
//!
//! Photos teach the field only the cones that the object's own roughness asks for, from where it stands. A mirror made
//! rough, or another lamp, asks for wide ones that nothing has taught; narrow ones are as good as the field is sharp. The
//! cones' axes are drawn from GGX as the eye sees it, so that a lobe is also as long at grazing angles as it should be.

use std::f32::consts::TAU;

use glam::Vec3;

use super::lobe::{KAPPA_ALPHA2, Lobe};
use super::shading::SurfacePoint;
use crate::geometry::orthonormal_basis;

/// Roughness up to which one cone stands for the lobe.
const SHARP: f32 = 0.05;
/// Cones of a pixel at roughness 0.4; their number grows with the square of it.
const CONES_AT_04: f32 = 64.0;
/// Least and most cones of a pixel whose lobe is split.
const CONES: [f32; 2] = [8.0, 128.0];
/// Most cones of a pixel that has one path only: a picture in motion.
const CONES_IN_MOTION: f32 = 3.0;
/// Roughness from which cones are narrower than their share of the lobe, in proportion: photos teach the field few wide
/// cones away from the object's own, and those it was not taught gather too much. Lobes of few cones need all their width.
const NARROWED_FROM: f32 = 0.2;
const FEW: u32 = 16;
/// Widest variance of a cone per axis, radians squared: of the rare directions far from the mirror's.
const WIDEST: f32 = 0.1;

/// Which of a pixel's paths asks for cones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathOfPixel {
    /// Its number, below `of`.
    pub index: u32,
    /// Paths of the pixel, at least 1.
    pub of: u32,
    /// How many times as many cones as usual, at least 1.
    pub times: u32,
}

impl PathOfPixel {
    /// The only path of its pixel.
    pub const ALONE: Self = Self {
        index: 0,
        of: 1,
        times: 1,
    };
}

/// One of the cones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeCone {
    /// Unit direction.
    pub axis: Vec3,
    /// Its own width.
    pub lobe: Lobe,
}

/// The cones of one path for the lobe at `point`, those that leave the surface; none when one cone is enough.
///
/// Together, the paths of a pixel have one cone for each of as many equal shares of the lobe, as wide as its share.
pub fn lobe_cones(
    point: &SurfacePoint,
    roughness: f32,
    path: PathOfPixel,
) -> impl Iterator<Item = LobeCone> {
    let n_path = cones_of_path(roughness, path.of) * path.times;
    let n = n_path * path.of;
    let point = *point;
    (0..n_path).filter_map(move |k| {
        // The paths take turns, so that each sees all of the lobe.
        let i = k * path.of + path.index;
        let u = (i as f32 + 0.5) / n as f32;
        let v = (f64::from(i) * 0.618_033_988_749_895).fract() as f32;
        lobe_cone(&point, roughness, [u, v], n)
    })
}

/// The cone that two numbers in `[0, 1)` draw from the lobe, as wide as one of `n` equal shares or narrower; none if it
/// does not leave the surface.
pub fn lobe_cone(point: &SurfacePoint, roughness: f32, u: [f32; 2], n: u32) -> Option<LobeCone> {
    let alpha = roughness * roughness;
    let h = visible_ggx_normal(point.normal, point.to_eye, alpha, u);
    let axis = (2.0 * h.dot(point.to_eye) * h - point.to_eye).normalize_or_zero();
    if axis.dot(point.normal) <= 0.0 {
        return None;
    }
    // A disk of solid angle `a` has a variance of `a / 4 pi` an axis.
    let pdf = ggx_pdf(point.normal, point.to_eye, h, alpha);
    let share = if n > FEW {
        (NARROWED_FROM / roughness).min(1.0)
    } else {
        1.0
    };
    let variance = share / (n as f32 * pdf * 2.0 * TAU);
    Some(LobeCone {
        axis,
        lobe: Lobe::from_variance(variance.min(WIDEST)),
    })
}

/// Density of the lobe at `point` in the unit direction `toward`, per steradian, blurred by `spread` (a variance an axis,
/// radians squared).
pub fn lobe_density(point: &SurfacePoint, roughness: f32, spread: f32, toward: Vec3) -> f32 {
    let alpha2 = roughness.powi(4) + KAPPA_ALPHA2 * spread;
    let h = (point.to_eye + toward).normalize_or(point.normal);
    ggx_pdf(point.normal, point.to_eye, h, alpha2.sqrt())
}

fn cones_of_path(roughness: f32, n_paths: u32) -> u32 {
    if roughness <= SHARP {
        return 0;
    }
    let wanted = (CONES_AT_04 * (roughness / 0.4).powi(2)).clamp(CONES[0], CONES[1]);
    let most = if n_paths == 1 {
        CONES_IN_MOTION
    } else {
        CONES[1]
    };
    (wanted.min(most) / n_paths as f32).ceil() as u32
}

/// A microfacet normal of GGX as seen from `to_eye`, from two numbers in `[0, 1)`.
///
/// Heitz 2018, "Sampling the GGX Distribution of Visible Normals".
pub fn visible_ggx_normal(normal: Vec3, to_eye: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    let (t, b) = orthonormal_basis(normal);
    // A point seen from behind its shading normal counts as seen at grazing angle.
    let eye = Vec3::new(
        alpha * to_eye.dot(t),
        alpha * to_eye.dot(b),
        to_eye.dot(normal).max(1e-4),
    )
    .normalize_or_zero();
    let across = Vec3::new(-eye.y, eye.x, 0.0)
        .try_normalize()
        .unwrap_or(Vec3::X);
    let along = eye.cross(across);
    let (r, phi) = (u.sqrt(), TAU * v);
    let x = r * phi.cos();
    // The visible half of the disk is the whole disk squeezed towards the eye.
    let s = 0.5 * (1.0 + eye.z);
    let y = (1.0 - s) * (1.0 - x * x).max(0.0).sqrt() + s * r * phi.sin();
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let h = across * x + along * y + eye * z;
    (t * (alpha * h.x) + b * (alpha * h.y) + normal * h.z.max(1e-6)).normalize_or_zero()
}

/// Density, per steradian, of the mirror directions that [`visible_ggx_normal`] gives: `G1(v) D(h) / (4 n·v)`.
fn ggx_pdf(normal: Vec3, to_eye: Vec3, h: Vec3, alpha: f32) -> f32 {
    let a2 = (alpha * alpha).max(1e-12);
    let nv = normal.dot(to_eye).clamp(1e-4, 1.0);
    let nh = normal.dot(h).clamp(0.0, 1.0);
    let d = nh * nh * (a2 - 1.0) + 1.0;
    let distribution = a2 / (std::f32::consts::PI * d * d);
    let masking = 2.0 * nv / (nv + (a2 + (1.0 - a2) * nv * nv).sqrt());
    (masking * distribution / (4.0 * nv)).max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(cos: f32) -> SurfacePoint {
        let normal = Vec3::new(0.36, 0.48, 0.8);
        let (t, _) = orthonormal_basis(normal);
        SurfacePoint {
            normal,
            to_eye: cos * normal + (1.0 - cos * cos).sqrt() * t,
            ..SurfacePoint::default()
        }
    }

    fn all_cones(point: &SurfacePoint, roughness: f32, of: u32) -> Vec<LobeCone> {
        (0..of)
            .flat_map(|index| {
                let path = PathOfPixel {
                    index,
                    of,
                    times: 1,
                };
                lobe_cones(point, roughness, path)
            })
            .collect()
    }

    /// The mean of `light` over GGX by many directions.
    fn dense(point: &SurfacePoint, roughness: f32, light: impl Fn(Vec3) -> f32) -> f32 {
        let n = 200;
        let (mut sum, mut count) = (0.0, 0.0);
        for i in 0..n * n {
            let u = [
                ((i / n) as f32 + 0.5) / n as f32,
                ((i % n) as f32 + 0.5) / n as f32,
            ];
            let h = visible_ggx_normal(point.normal, point.to_eye, roughness * roughness, u);
            let l = 2.0 * h.dot(point.to_eye) * h - point.to_eye;
            if l.dot(point.normal) > 0.0 {
                sum += light(l);
                count += 1.0;
            }
        }
        sum / count
    }

    #[test]
    fn the_density_is_that_of_the_lobe_s_directions() {
        for (cos, roughness) in [(1.0, 0.3), (0.7, 0.5), (0.5, 0.4)] {
            let point = point(cos);
            let toward = point.reflected();
            let light = |l: Vec3| l.dot(toward).max(0.0).powi(20);
            let (mut sum, mut all) = (0.0, 0.0);
            for l in crate::geometry::fibonacci_sphere(40_000) {
                if l.dot(point.normal) > 0.0 {
                    let density = lobe_density(&point, roughness, 0.0, l);
                    sum += density * light(l);
                    all += density;
                }
            }
            let expected = dense(&point, roughness, light);
            let found = sum / all;
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{found}, not {expected}"
            );
            let total = all * 2.0 * TAU / 40_000.0;
            assert!((0.9..1.01).contains(&total), "{total} of the light");
            let blurred = lobe_density(&point, roughness, 0.05, toward);
            assert!(blurred < 0.9 * lobe_density(&point, roughness, 0.0, toward));
        }
    }

    #[test]
    fn a_sharp_lobe_is_not_split() {
        let path = PathOfPixel {
            index: 0,
            of: 4,
            times: 3,
        };
        assert_eq!(lobe_cones(&point(0.7), 0.03, path).count(), 0);
    }

    #[test]
    fn more_cones_are_as_many_times_narrower() {
        let usual = all_cones(&point(1.0), 0.3, 1);
        let path = PathOfPixel {
            times: 4,
            ..PathOfPixel::ALONE
        };
        let more: Vec<_> = lobe_cones(&point(1.0), 0.3, path).collect();
        assert_eq!(more.len(), 4 * usual.len());
        let area = |cones: &[LobeCone]| cones.iter().map(|cone| cone.lobe.variance).sum::<f32>();
        let ratio = area(&more) / area(&usual);
        assert!((0.5..2.0).contains(&ratio), "{ratio} times the lobe");
    }

    #[test]
    fn cones_leave_the_surface_and_are_finite() {
        for cos in [1e-3, 0.05, 0.5, 1.0] {
            for roughness in [0.051, 0.2, 0.6, 1.0] {
                for of in [1, 4, 16] {
                    let point = point(cos);
                    let cones = all_cones(&point, roughness, of);
                    assert!(!cones.is_empty(), "cos {cos}, roughness {roughness}");
                    for cone in cones {
                        let is_unit = (cone.axis.length() - 1.0).abs() < 1e-3;
                        assert!(is_unit && cone.axis.dot(point.normal) > 0.0, "{cone:?}");
                        let variance = cone.lobe.variance;
                        assert!(variance > 0.0 && variance <= WIDEST * 1.01, "{cone:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_smooth_light_gathers_as_by_many_directions() {
        let lamp = Vec3::new(0.2, -0.3, 0.93).normalize_or_zero();
        for cos in [0.3, 0.7, 1.0] {
            for roughness in [0.15, 0.4, 0.8] {
                let point = point(cos);
                let light = |d: Vec3| 0.2 + (0.5 + 0.5 * d.dot(lamp)).powi(3);
                let cones = all_cones(&point, roughness, 4);
                let n = cones.len() as f32;
                // The light changes little over a cone: its axis stands for it.
                let sum: f32 = cones.iter().map(|cone| light(cone.axis)).sum();
                let expected = dense(&point, roughness, light);
                assert!(
                    (sum / n - expected).abs() < 0.04 * expected,
                    "cos {cos}, roughness {roughness}: {} against {expected}",
                    sum / n
                );
            }
        }
    }

    #[test]
    fn the_cones_of_a_pixel_cover_the_lobe_once() {
        // Seen from straight above, variances of the axes and of the cones add up to the lobe's inner part.
        let point = point(1.0);
        for roughness in [0.1_f32, 0.2, 0.3] {
            let cones = all_cones(&point, roughness, 16);
            let n = cones.len() as f32;
            let alpha = roughness * roughness;
            // Half of GGX's microfacets lie within `tan = alpha`, so that half of the light lies within twice that.
            let inside =
                |cone: &&LobeCone| cone.axis.angle_between(point.normal) < 2.0 * alpha.atan();
            let inside: Vec<_> = cones.iter().filter(inside).collect();
            let share = inside.len() as f32 / n;
            assert!((share - 0.5).abs() < 0.1, "{roughness}: {share}");
            let area: f32 = inside
                .iter()
                .map(|cone| 2.0 * TAU * cone.lobe.variance)
                .sum();
            let disk = TAU * (1.0 - (2.0 * alpha.atan()).cos());
            assert!(
                (0.6..1.6).contains(&(area / disk)),
                "{roughness}: cones of {area} sr on {disk} sr"
            );
        }
    }
}
