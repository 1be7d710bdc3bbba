//! The pixel equation on an opaque surface, forward and backward: Eq. 7 of the paper with Fresnel.
//!
//! `C = D (1 - F) + g F L`, `F = s + (1 - s)(1 - n·wo)^5` per colour (Schlick), `g` an edit's specular gain, and `L`
//! the light that the lobe gathers ([`super::light_path`]).

use glam::Vec3;

use crate::neif::surface::values::Surface;

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

impl SurfacePoint {
    /// Mirror direction `l_r = 2 (n·wo) n - wo`, unit.
    pub fn reflected(&self) -> Vec3 {
        2.0 * self.normal.dot(self.to_eye) * self.normal - self.to_eye
    }

    /// Cosine between normal and eye, at least 0.
    pub fn n_dot_v(&self) -> f32 {
        self.normal.dot(self.to_eye).max(0.0)
    }
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
    use crate::neif::test_gradients::{assert_agrees, slope};

    #[test]
    fn outgoing_gradients_agree_with_finite_differences() {
        let surface = Surface {
            diffuse: Vec3::new(0.2, 0.5, 0.1),
            tint: Vec3::new(0.9, 0.04, 0.4),
            roughness: 0.3,
        };
        let (cos, light, d_out) = (0.4, Vec3::new(1.5, 0.2, 3.0), Vec3::new(0.7, -0.4, 1.2));
        let loss =
            |s: &Surface, light: Vec3| f64::from(outgoing(s, cos, Vec3::ONE, light).dot(d_out));
        let mut d = Surface::default();
        let d_light = outgoing_backward(&surface, cos, light, d_out, &mut d);
        Surface::for_each_value(|what, value| {
            let numeric = slope(&mut { surface }, value, 1e-2, |s| loss(s, light));
            assert_agrees(what, *value(&mut { d }), numeric, (0.0, 1e-3));
        });
        for c in 0..3 {
            let numeric = slope(&mut { light }, |l| &mut l[c], 1e-2, |l| loss(&surface, *l));
            assert_agrees("light", d_light[c], numeric, (0.0, 1e-3));
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
