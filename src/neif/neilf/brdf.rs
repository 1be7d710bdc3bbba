//! The reflectances of `NeILF` and `NeILF*`, as weights of the light from each direction; forward and backward.
//!
//! Outgoing radiance is linear in the light: `C = c + Σ_i R_i ⊙ L_i` over directions of equal solid angle.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::geometry::{fibonacci_sphere, orthonormal_basis};
use crate::neif::light::lobe::Lobe;
use crate::neif::light::shading::{SurfacePoint, fresnel, outgoing, outgoing_backward, schlick};
use crate::neif::surface::values::Surface;

/// Reflectance of a dielectric at normal incidence.
const DIELECTRIC: f32 = 0.04;
/// Share of a lobe's greatest weight below which a direction is left out.
const LEAST_WEIGHT: f32 = 1e-3;

/// How a surface reflects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brdf {
    /// The simplified Disney model of `NeILF`: base colour, metallic, roughness.
    ///
    /// The surface field's values are read as base colour = `tint`, metallic = `1 - e^(-diffuse.x)` (the diffuse output
    /// is a softplus, so this is a sigmoid of what the network says), and roughness = GGX alpha, as `NeILF` has it.
    Disney,
    /// That of the paper, for `NeILF*`: baked diffuse radiance and one tinted lobe (Eq. 4 and 7, with the normalised lobe
    /// and the Fresnel weight of the fast model).
    Lobe,
}

/// `n` unit directions of the hemisphere about +z, each standing for `2 π / n`: half a Fibonacci lattice.
pub fn hemisphere(n: usize) -> Vec<Vec3> {
    let mut directions = fibonacci_sphere(2 * n);
    directions.truncate(n);
    directions
}

/// A point and the directions that its light is summed over.
#[derive(Clone, Copy, Debug)]
pub struct Sum<'a> {
    /// The point.
    pub point: &'a SurfacePoint,
    /// Unit directions towards the light, above the surface.
    pub directions: &'a [Vec3],
    /// How many directions the hemisphere was cut into.
    pub n_lattice: usize,
}

/// What the light from one direction is multiplied with, and its slope.
struct DisneyTerms {
    /// `2 π / n · n·l`.
    measure: f32,
    /// Distribution times visibility, `D V`, and its derivative by roughness.
    glossy: (f32, f32),
    /// Schlick's weight `(1 - h·v)^5`.
    schlick: f32,
}

impl Brdf {
    /// Adds to `directions` those of the `lattice` about the point's normal that its light is needed from, `turn` radians
    /// turned about it. A lobe needs few: what weighs less than a thousandth of its greatest weight is left out.
    pub fn directions(
        self,
        surface: &Surface,
        point: &SurfacePoint,
        lattice: &[Vec3],
        turn: f32,
        directions: &mut Vec<Vec3>,
    ) {
        let (tangent, bitangent) = orthonormal_basis(point.normal);
        let (sin, cos) = turn.sin_cos();
        let (x, y) = (
            tangent * cos + bitangent * sin,
            bitangent * cos - tangent * sin,
        );
        let first = directions.len();
        let turned = |d: &Vec3| x * d.x + y * d.y + point.normal * d.z;
        directions.extend(lattice.iter().map(turned));
        if self == Self::Lobe {
            let axis = point.reflected();
            let nearest = nearest(&directions[first..], axis);
            let kappa = Lobe::from_roughness(surface.roughness).kappa;
            let least = nearest + LEAST_WEIGHT.ln() / kappa;
            let mut kept = first;
            for i in first..directions.len() {
                if directions[i].dot(axis) >= least {
                    directions[kept] = directions[i];
                    kept += 1;
                }
            }
            directions.truncate(kept);
        }
    }

    /// Writes `R_i` of each direction and returns `c`.
    pub fn forward(self, surface: &Surface, sum: Sum<'_>, responses: &mut [Vec3]) -> Vec3 {
        match self {
            Self::Disney => {
                let (base, metallic) = (surface.tint, metallic(surface));
                let f0 = f0(base, metallic);
                let diffuse = base * ((1.0 - metallic) / PI);
                for (response, direction) in responses.iter_mut().zip(sum.directions) {
                    let t = disney_terms(surface.roughness, sum, *direction);
                    let fresnel = f0 + (Vec3::ONE - f0) * t.schlick;
                    *response = (diffuse + fresnel * t.glossy.0) * t.measure;
                }
                Vec3::ZERO
            }
            Self::Lobe => {
                let cos = sum.point.n_dot_v();
                let fresnel = fresnel(surface.tint, cos);
                let kappa = Lobe::from_roughness(surface.roughness).kappa;
                lobe_weights(sum, kappa, |i, weight, _| {
                    responses[i] = fresnel * weight;
                });
                outgoing(surface, cos, Vec3::ONE, Vec3::ZERO)
            }
        }
    }

    /// Back from `d_out` to the surface, given the light `radiance` from each direction; `d L_i` is `R_i ⊙ d_out`.
    pub fn backward(
        self,
        surface: &Surface,
        sum: Sum<'_>,
        radiance: &[Vec3],
        d_out: Vec3,
        d_surface: &mut Surface,
    ) {
        match self {
            Self::Disney => {
                disney_backward(surface, sum, radiance, d_out, d_surface);
            }
            Self::Lobe => {
                let lobe = Lobe::from_roughness(surface.roughness);
                let (mut light, mut slope, mut mean_slope) = (Vec3::ZERO, Vec3::ZERO, 0.0);
                lobe_weights(sum, lobe.kappa, |i, weight, d_log| {
                    light += radiance[i] * weight;
                    slope += radiance[i] * (weight * d_log);
                    mean_slope += weight * d_log;
                });
                let cos = sum.point.n_dot_v();
                let d_light = outgoing_backward(surface, cos, light, d_out, d_surface);
                // The weights sum to one, so what all of them gain is taken off again.
                d_surface.roughness += d_light.dot(slope - light * mean_slope) * lobe.d_kappa;
            }
        }
    }
}

/// `NeILF`'s metallic, in `[0, 1)`.
pub fn metallic(surface: &Surface) -> f32 {
    1.0 - (-surface.diffuse.x).exp()
}

fn f0(base: Vec3, metallic: f32) -> Vec3 {
    Vec3::splat(DIELECTRIC * (1.0 - metallic)) + base * metallic
}

/// Cosine between the axis and the nearest direction.
fn nearest(directions: &[Vec3], axis: Vec3) -> f32 {
    directions.iter().map(|d| d.dot(axis)).fold(-1.0, f32::max)
}

/// Calls `each(i, w_i, d ln w̃_i / d kappa)` with `w_i = w̃_i / Σ w̃`, `w̃_i = e^(kappa (l_i·l_r - 1))`: the lobe's share of
/// each direction. As the shares sum to one, a lobe narrower than the lattice is the nearest direction.
fn lobe_weights(sum: Sum<'_>, kappa: f32, mut each: impl FnMut(usize, f32, f32)) {
    let (axis, directions) = (sum.point.reflected(), sum.directions);
    // Counted from the nearest direction: e^(kappa (cos - 1)) of a mirror would be 0 for all of them.
    let nearest = nearest(directions, axis);
    let exponents = || directions.iter().map(|d| d.dot(axis) - nearest);
    let total: f32 = exponents().map(|e| (kappa * e).exp()).sum();
    for (i, e) in exponents().enumerate() {
        each(i, (kappa * e).exp() / total, e);
    }
}

/// Distribution `D = e^(2 (h·n - 1) / r²) / (π r²)` and Smith–Schlick visibility `V = Π 1 / (2 (c (1 - k) + k))` over both
/// cosines, `k = (1 + r)² / 8` (Sec. 3.2 of arXiv:2203.07182).
fn disney_terms(roughness: f32, sum: Sum<'_>, direction: Vec3) -> DisneyTerms {
    let point = sum.point;
    let half = (direction + point.to_eye).normalize_or_zero();
    let cos = |v: Vec3| point.normal.dot(v).max(0.0);
    let (n_dot_h, h_dot_v) = (cos(half), half.dot(point.to_eye).max(0.0));
    let alpha2 = roughness * roughness;
    let distribution = (2.0 * (n_dot_h - 1.0) / alpha2).exp() / (PI * alpha2);
    let d_log_distribution = -2.0 / roughness - 4.0 * (n_dot_h - 1.0) / (alpha2 * roughness);
    let (k, d_k) = ((1.0 + roughness).powi(2) / 8.0, (1.0 + roughness) / 4.0);
    let visibility = |c: f32| 0.5 / (c * (1.0 - k) + k);
    let (v_light, v_eye) = (visibility(cos(direction)), visibility(cos(point.to_eye)));
    let d_log_visibility =
        -2.0 * d_k * (v_light * (1.0 - cos(direction)) + v_eye * (1.0 - cos(point.to_eye)));
    let glossy = distribution * v_light * v_eye;
    DisneyTerms {
        measure: TAU / sum.n_lattice as f32 * cos(direction),
        glossy: (glossy, glossy * (d_log_distribution + d_log_visibility)),
        schlick: schlick(h_dot_v),
    }
}

fn disney_backward(
    surface: &Surface,
    sum: Sum<'_>,
    radiance: &[Vec3],
    d_out: Vec3,
    d_surface: &mut Surface,
) {
    let (base, metallic) = (surface.tint, metallic(surface));
    let f0 = f0(base, metallic);
    let (mut d_diffuse, mut d_f0, mut d_roughness) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for (direction, radiance) in sum.directions.iter().zip(radiance) {
        let t = disney_terms(surface.roughness, sum, *direction);
        let d_response = *radiance * d_out * t.measure;
        d_diffuse += d_response;
        d_f0 += d_response * (t.glossy.0 * (1.0 - t.schlick));
        let fresnel = f0 + (Vec3::ONE - f0) * t.schlick;
        d_roughness += d_response.dot(fresnel) * t.glossy.1;
    }
    d_surface.tint += d_diffuse * ((1.0 - metallic) / PI) + d_f0 * metallic;
    d_surface.roughness += d_roughness;
    let d_metallic = d_f0.dot(base - Vec3::splat(DIELECTRIC)) - d_diffuse.dot(base) / PI;
    // d metallic / d diffuse.x = e^(-diffuse.x).
    d_surface.diffuse.x += d_metallic * (1.0 - metallic);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{assert_agrees, slope};

    /// Unit normal and eye direction, none of them along an axis.
    const POINT: SurfacePoint = SurfacePoint {
        position: Vec3::ZERO,
        normal: Vec3::new(0.104_828_5, -0.314_485_5, 0.943_456_4),
        to_eye: Vec3::new(0.566_138_5, 0.226_455_4, 0.792_593_9),
        base: 0.0,
        spread: 0.0,
    };

    const SURFACE: Surface = Surface {
        diffuse: Vec3::new(0.6, 0.3, 0.2),
        tint: Vec3::new(0.8, 0.5, 0.3),
        roughness: 0.35,
    };

    /// A smooth light from everywhere.
    fn light(d: Vec3) -> Vec3 {
        Vec3::new(1.0 + d.x, 1.2 + d.y * d.z, 1.5 - d.z) * 0.8
    }

    fn sum_over(directions: &[Vec3], n_lattice: usize) -> Sum<'_> {
        Sum {
            point: &POINT,
            directions,
            n_lattice,
        }
    }

    fn radiance_out(brdf: Brdf, surface: &Surface, directions: &[Vec3], n: usize) -> Vec3 {
        let mut responses = vec![Vec3::ZERO; directions.len()];
        let constant = brdf.forward(surface, sum_over(directions, n), &mut responses);
        let terms = responses.iter().zip(directions);
        constant + terms.map(|(r, d)| *r * light(*d)).sum::<Vec3>()
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        for brdf in [Brdf::Disney, Brdf::Lobe] {
            let lattice = hemisphere(64);
            let mut directions = Vec::new();
            brdf.directions(&SURFACE, &POINT, &lattice, 0.7, &mut directions);
            let radiance: Vec<Vec3> = directions.iter().map(|d| light(*d)).collect();
            let d_out = Vec3::new(0.7, -0.4, 1.2);
            let mut d = Surface::default();
            brdf.backward(
                &SURFACE,
                sum_over(&directions, 64),
                &radiance,
                d_out,
                &mut d,
            );
            let loss = |s: &Surface| f64::from(radiance_out(brdf, s, &directions, 64).dot(d_out));
            Surface::for_each_value(|what, value| {
                let numeric = slope(&mut { SURFACE }, value, 2e-3, loss);
                let what = format!("{brdf:?} {what}");
                assert_agrees(&what, *value(&mut { d }), numeric, (1e-2, 2e-3));
            });
        }
    }

    #[test]
    fn directions_left_out_of_a_lobe_change_little() {
        let lattice = hemisphere(256);
        let all: Vec<Vec3> = {
            let mut all = Vec::new();
            Brdf::Disney.directions(&SURFACE, &POINT, &lattice, 0.2, &mut all);
            all
        };
        let mut few = Vec::new();
        Brdf::Lobe.directions(&SURFACE, &POINT, &lattice, 0.2, &mut few);
        assert!(few.len() < all.len() / 3, "{} are kept", few.len());
        let error = radiance_out(Brdf::Lobe, &SURFACE, &few, 256)
            - radiance_out(Brdf::Lobe, &SURFACE, &all, 256);
        assert!(error.abs().max_element() < 5e-3, "{error:?}");
    }

    #[test]
    fn directions_are_unit_and_above_the_surface() {
        let mut directions = Vec::new();
        Brdf::Disney.directions(&SURFACE, &POINT, &hemisphere(100), 1.0, &mut directions);
        assert_eq!(directions.len(), 100);
        for d in directions {
            assert!(
                (d.length() - 1.0).abs() < 1e-5 && d.dot(POINT.normal) > 0.0,
                "{d:?}"
            );
        }
    }

    #[test]
    fn a_mirror_in_white_light_stays_finite_and_white() {
        let mirror = Surface {
            diffuse: Vec3::ZERO,
            tint: Vec3::ONE,
            roughness: 0.0,
        };
        let mut directions = Vec::new();
        Brdf::Lobe.directions(&mirror, &POINT, &hemisphere(32), 0.0, &mut directions);
        assert_eq!(directions.len(), 1, "the nearest direction alone");
        let mut responses = vec![Vec3::ZERO; 1];
        let constant = Brdf::Lobe.forward(&mirror, sum_over(&directions, 32), &mut responses);
        assert_eq!((constant, responses[0]), (Vec3::ZERO, Vec3::ONE));
    }

    #[test]
    fn a_rough_white_surface_reflects_at_most_what_comes_in() {
        let white = Surface {
            diffuse: Vec3::ZERO,
            tint: Vec3::ONE,
            roughness: 0.9,
        };
        let mut directions = Vec::new();
        let n = 2000;
        Brdf::Disney.directions(&white, &POINT, &hemisphere(n), 0.0, &mut directions);
        let mut responses = vec![Vec3::ZERO; n];
        Brdf::Disney.forward(&white, sum_over(&directions, n), &mut responses);
        let out: Vec3 = responses.iter().sum();
        // The Lambertian part alone gives 1; the 4 % of the dielectric's lobe come on top, as in `NeILF`.
        assert!((0.98..1.08).contains(&out.x), "{out:?}");
    }
}
