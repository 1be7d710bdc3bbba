//! The pixel equation on an opaque surface, forward and backward: Eq. 7 of the paper with Fresnel and one bounce.
//!
//! `C = D (1 - F) + g F L`, `F = s + (1 - s)(1 - n·wo)^5` per colour (Schlick), `g` an edit's specular gain, and
//! `L = (1 - b) L_env + b O₂`, where `b` is the share of the lobe that meets the object again and `O₂` what the point
//! met there sends on: the same equation once more, with the environment alone.

use glam::Vec3;

use super::contraction::FieldFrame;
use super::edit::EnvironmentFromWorld;
use super::lobe::Lobe;
use super::material::Surface;
use super::proposal::ConeRay;
use super::radiance_field::FieldRay;

/// Half-angle of the part of the lobe that the mirror ray stands for, radians.
const CORE_ANGLE: f32 = 0.09;
/// Angle up to which the inner ring of lobe rays stands, radians.
const INNER_RING_END: f32 = 0.32;
/// Angles of the two rings of lobe rays, radians.
pub const RING_ANGLES: [f32; 2] = [0.19, 0.6];
/// Rays in a ring.
pub const RING_RAYS: usize = 4;

/// A surface point seen by a pixel: geometry only, world coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// Position.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit direction to the eye, or to the point that is lit by this one.
    pub to_eye: Vec3,
    /// Standard deviation of the pixel's footprint across the reflected ray, world units.
    pub base: f32,
    /// Its growth per world unit along the reflected ray: pixel cone and curvature.
    pub spread: f32,
}

/// How much of a lobe meets the object again, by distance from the mirror direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blocked {
    /// 1 when the mirror ray hits, else 0.
    pub core: f32,
    /// Share of blocked rays in the two rings, `[0, 1]`.
    pub rings: [f32; 2],
}

impl SurfacePoint {
    /// Mirror direction `l_r = 2 (n·wo) n - wo`, unit.
    pub fn reflected(&self) -> Vec3 {
        2.0 * self.normal.dot(self.to_eye) * self.normal - self.to_eye
    }

    /// Cosine between normal and eye, at least 0.
    pub fn n_dot_v(&self) -> f32 {
        self.normal.dot(self.to_eye).max(0.0)
    }

    /// The same point seen in a mirror of that lobe variance from `distance`: its footprint grows.
    pub fn seen_through(&self, lobe_variance: f32, distance: f32) -> Self {
        let blur = lobe_variance * distance * distance;
        Self {
            base: (self.base * self.base + blur).sqrt(),
            ..*self
        }
    }

    /// The cone that gathers light along the lobe, in field coordinates; `extra_variance` widens it.
    pub fn lobe_ray(
        &self,
        lobe: &Lobe,
        extra_variance: f32,
        motion: &EnvironmentFromWorld,
        frame: &FieldFrame,
    ) -> FieldRay {
        let direction = motion.direction(self.reflected());
        let to_field = motion.length(1.0) / frame.half_side;
        let cone = ConeRay {
            origin: frame
                .field_from_world(motion.point(self.position))
                .to_array(),
            direction: (direction * lobe.mean_length).to_array(),
            base: self.base * to_field,
            spread: self.spread,
            lobe_variance: lobe.variance + extra_variance,
        };
        FieldRay {
            cone,
            direction: direction.to_array(),
            kappa: lobe.kappa,
        }
    }
}

impl Blocked {
    /// Whether no tested ray is blocked.
    pub fn is_free(&self) -> bool {
        self.core <= 0.0 && self.rings[0] <= 0.0 && self.rings[1] <= 0.0
    }

    /// Blocked share of the lobe and its derivative by `kappa`: each group of rays weighted by the lobe's mass there.
    pub fn share(&self, kappa: f32) -> (f32, f32) {
        let (inside_core, d_core) = vmf_cdf(kappa, CORE_ANGLE);
        let (inside_ring, d_ring) = vmf_cdf(kappa, INNER_RING_END);
        let share = inside_core * self.core
            + (inside_ring - inside_core) * self.rings[0]
            + (1.0 - inside_ring) * self.rings[1];
        let d_share =
            d_core * self.core + (d_ring - d_core) * self.rings[0] - d_ring * self.rings[1];
        (share.clamp(0.0, 1.0), d_share)
    }
}

/// Mass of a von Mises–Fisher lobe within `angle` of its axis, and its derivative by `kappa`.
///
/// `(1 - e^(-kappa (1 - cos angle))) / (1 - e^(-2 kappa))`.
fn vmf_cdf(kappa: f32, angle: f32) -> (f32, f32) {
    let c = 1.0 - angle.cos();
    let (e, e2) = ((-kappa * c).exp(), (-2.0 * kappa).exp());
    let (numerator, denominator) = (1.0 - e, 1.0 - e2);
    let mass = numerator / denominator;
    (mass, (c * e - 2.0 * e2 * mass) / denominator)
}

/// Schlick's Fresnel weight `(1 - cos)^5`.
pub fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Outgoing radiance `D (1 - F) + gain F L`.
pub fn outgoing(surface: &Surface, cos: f32, gain: Vec3, light: Vec3) -> Vec3 {
    let fresnel = fresnel(surface.tint, cos);
    surface.diffuse * (Vec3::ONE - fresnel) + gain * fresnel * light
}

/// `F` per colour.
pub fn fresnel(tint: Vec3, cos: f32) -> Vec3 {
    tint + (Vec3::ONE - tint) * schlick(cos)
}

/// Back from `d_out`: adds to `d_surface` (diffuse and tint) and returns `d_light`. The gain is 1 in training.
pub fn outgoing_backward(
    surface: &Surface,
    cos: f32,
    light: Vec3,
    d_out: Vec3,
    d_surface: &mut Surface,
) -> Vec3 {
    let fresnel = fresnel(surface.tint, cos);
    d_surface.diffuse += d_out * (Vec3::ONE - fresnel);
    let d_fresnel = d_out * (light - surface.diffuse);
    d_surface.tint += d_fresnel * (1.0 - schlick(cos));
    d_out * fresnel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outgoing_gradients_agree_with_finite_differences() {
        let surface = Surface {
            diffuse: Vec3::new(0.2, 0.5, 0.1),
            tint: Vec3::new(0.9, 0.04, 0.4),
            roughness: 0.3,
        };
        let (cos, light, d_out) = (0.4, Vec3::new(1.5, 0.2, 3.0), Vec3::new(0.7, -0.4, 1.2));
        let loss = |s: &Surface, light: Vec3| outgoing(s, cos, Vec3::ONE, light).dot(d_out);
        let mut d = Surface::default();
        let d_light = outgoing_backward(&surface, cos, light, d_out, &mut d);
        let h = 1e-2;
        for c in 0..3 {
            let step = Vec3::AXES[c] * h;
            let shifted = |sign: f32| Surface {
                diffuse: surface.diffuse + sign * step,
                ..surface
            };
            let numeric = (loss(&shifted(1.0), light) - loss(&shifted(-1.0), light)) / (2.0 * h);
            assert!((d.diffuse[c] - numeric).abs() < 1e-3, "diffuse {c}");
            let shifted = |sign: f32| Surface {
                tint: surface.tint + sign * step,
                ..surface
            };
            let numeric = (loss(&shifted(1.0), light) - loss(&shifted(-1.0), light)) / (2.0 * h);
            assert!((d.tint[c] - numeric).abs() < 1e-3, "tint {c}");
            let numeric = (loss(&surface, light + step) - loss(&surface, light - step)) / (2.0 * h);
            assert!((d_light[c] - numeric).abs() < 1e-3, "light {c}");
        }
    }

    #[test]
    fn blocked_share_follows_the_lobe() {
        let blocked = Blocked {
            core: 1.0,
            rings: [0.5, 0.25],
        };
        assert!(
            (blocked.share(1e6).0 - 1.0).abs() < 1e-6,
            "a mirror sees the mirror ray only"
        );
        assert!(
            (blocked.share(0.35).0 - 0.25).abs() < 0.05,
            "a wide lobe sees the outer ring"
        );
        assert_eq!(Blocked::default().share(10.0).0, 0.0, "nothing blocked");
        for kappa in [0.5_f32, 5.0, 50.0, 500.0] {
            let h = 1e-2 * kappa;
            let numeric = (blocked.share(kappa + h).0 - blocked.share(kappa - h).0) / (2.0 * h);
            let analytic = blocked.share(kappa).1;
            assert!(
                (analytic - numeric).abs() < 2e-2 * numeric.abs() + 1e-5,
                "kappa {kappa}: {analytic} against {numeric}"
            );
        }
    }

    #[test]
    fn a_white_furnace_stays_white() {
        // Metal: no diffuse part; any tint between returns at most what comes in.
        for cos in [0.0, 0.1, 0.5, 1.0] {
            let metal = Surface {
                diffuse: Vec3::ZERO,
                tint: Vec3::splat(0.8),
                roughness: 0.2,
            };
            let out = outgoing(&metal, cos, Vec3::ONE, Vec3::ONE);
            assert!(
                out.max_element() <= 1.0 + 1e-6 && out.min_element() >= 0.8 - 1e-6,
                "cos {cos}: {out:?}"
            );
        }
    }
}
