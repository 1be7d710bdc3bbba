//! The model's surface as glTF's metallic-roughness material.
//!
//! Ours has a diffuse albedo `a` and a reflectance at normal incidence `f`, both RGB and free. glTF has a base colour `b`
//! and a metalness `m` with `a = b (1 - m)` and `f = 0.04 (1 - m) + b m` (glTF 2.0, appendix B.3.5), and with
//! `KHR_materials_specular` another colour in place of 0.04. Roughness and Fresnel's term are the same.

use glam::Vec3;

/// Reflectance of glTF's dielectrics.
pub const DIELECTRIC: f32 = 0.04;
/// Steps over the metalness in search of the best, and then of halving around it.
const N_STEPS: usize = 16;
const N_HALVINGS: usize = 8;
/// From this metalness on the dielectric part no longer shows.
const METAL: f32 = 0.98;

/// What one texel of the textures holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MetallicRoughness {
    /// Base colour, linear, `[0, 1]`.
    pub base: Vec3,
    /// Metalness, `[0, 1]`.
    pub metallic: f32,
    /// Reflectance of the part that is no metal, in place of 0.04, for viewers that know `KHR_materials_specular`.
    pub dielectric: Vec3,
}

impl MetallicRoughness {
    /// The material whose albedo and reflectance are nearest to the given ones (least squares over both); beyond that,
    /// `dielectric` makes up for the reflectance's rest where there is a part that is no metal.
    pub fn nearest(albedo: Vec3, reflectance: Vec3) -> Self {
        let (albedo, reflectance) = (
            albedo.clamp(Vec3::ZERO, Vec3::ONE),
            reflectance.clamp(Vec3::ZERO, Vec3::ONE),
        );
        let error = |metallic: f32| {
            let base = best_base(albedo, reflectance, metallic);
            let metal = Self {
                base,
                metallic,
                dielectric: Vec3::splat(DIELECTRIC),
            };
            (metal.albedo() - albedo).length_squared()
                + (metal.reflectance() - reflectance).length_squared()
        };
        // The error has up to two valleys (a metal of that colour, a plastic of that colour), so no descent.
        let step = 1.0 / N_STEPS as f32;
        let (mut best, mut least) = (0.0, error(0.0));
        let mut consider = |metallic: f32, best: &mut f32| {
            let found = error(metallic);
            // A little better is not worth more metal: the colour of a black plastic is noise.
            if found < least - 1e-9 {
                (*best, least) = (metallic, found);
            }
        };
        for i in 1..=N_STEPS {
            consider(i as f32 * step, &mut best);
        }
        let mut width = step;
        for _ in 0..N_HALVINGS {
            width *= 0.5;
            let middle = best;
            for metallic in [middle - width, middle + width] {
                consider(metallic.clamp(0.0, 1.0), &mut best);
            }
        }
        let base = best_base(albedo, reflectance, best);
        let dielectric = if best < METAL {
            ((reflectance - best * base) / (1.0 - best)).clamp(Vec3::ZERO, Vec3::ONE)
        } else {
            Vec3::splat(DIELECTRIC)
        };
        Self {
            base,
            metallic: best,
            dielectric,
        }
    }

    /// Diffuse albedo of the material.
    pub fn albedo(&self) -> Vec3 {
        self.base * (1.0 - self.metallic)
    }

    /// Its reflectance at normal incidence.
    pub fn reflectance(&self) -> Vec3 {
        self.dielectric * (1.0 - self.metallic) + self.base * self.metallic
    }

    /// The same for viewers that do not know `KHR_materials_specular`.
    pub fn plain_reflectance(&self) -> Vec3 {
        Vec3::splat(DIELECTRIC * (1.0 - self.metallic)) + self.base * self.metallic
    }
}

/// The base colour of least error at a given metalness: a weighted mean, clamped, as the error is a parabola.
fn best_base(albedo: Vec3, reflectance: Vec3, metallic: f32) -> Vec3 {
    let rest = 1.0 - metallic;
    let wanted = rest * albedo + metallic * (reflectance - Vec3::splat(DIELECTRIC * rest));
    // At least a half: no division by zero.
    let weight = rest * rest + metallic * metallic;
    (wanted / weight).clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gltf_can_say_comes_back_exactly() {
        for base in [Vec3::new(0.9, 0.6, 0.2), Vec3::new(0.1, 0.3, 0.8)] {
            for metallic in [0.0, 0.25, 0.6, 1.0] {
                let truth = MetallicRoughness {
                    base,
                    metallic,
                    dielectric: Vec3::splat(DIELECTRIC),
                };
                let found = MetallicRoughness::nearest(truth.albedo(), truth.reflectance());
                assert!(
                    (found.albedo() - truth.albedo()).length() < 0.01,
                    "{found:?}"
                );
                let reflectance = found.plain_reflectance() - truth.reflectance();
                assert!(reflectance.length() < 0.01, "{found:?}");
                assert!((found.metallic - metallic).abs() < 0.02, "{found:?}");
            }
        }
    }

    #[test]
    fn plastics_stay_plastics_and_metals_metals() {
        let plastic = MetallicRoughness::nearest(Vec3::new(0.6, 0.05, 0.03), Vec3::splat(0.05));
        assert!(plastic.metallic < 0.03, "{plastic:?}");
        assert!(
            (plastic.reflectance() - Vec3::splat(0.05)).length() < 1e-3,
            "{plastic:?}"
        );
        let gold = MetallicRoughness::nearest(Vec3::splat(0.01), Vec3::new(1.0, 0.77, 0.34));
        assert!(gold.metallic > 0.97, "{gold:?}");
        let black = MetallicRoughness::nearest(Vec3::ZERO, Vec3::splat(0.04));
        assert_eq!(
            (black.metallic, black.base),
            (0.0, Vec3::ZERO),
            "black plastic"
        );
    }

    #[test]
    fn reflectance_that_gltf_cannot_say_is_made_up_for() {
        // A red body under a strong white gloss.
        let (albedo, reflectance) = (Vec3::new(0.5, 0.1, 0.1), Vec3::splat(0.3));
        let found = MetallicRoughness::nearest(albedo, reflectance);
        let rest = (found.reflectance() - reflectance).length();
        let plain = (found.plain_reflectance() - reflectance).length();
        assert!(rest < 0.1 && plain > 2.0 * rest, "{found:?}");
    }

    #[test]
    fn absurd_values_stay_in_range() {
        for value in [-1.0, 0.0, 7.0, 1e30] {
            let found = MetallicRoughness::nearest(Vec3::splat(value), Vec3::splat(value));
            assert!((0.0..=1.0).contains(&found.metallic), "{found:?}");
            assert!(found.base.min_element() >= 0.0 && found.base.max_element() <= 1.0);
        }
    }
}
