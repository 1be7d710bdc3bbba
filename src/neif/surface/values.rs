//! What the surface field says of a point, and where its training starts.

use glam::Vec3;

/// Shift of the diffuse output: training starts at `softplus(-2) = 0.13`, a dark grey.
pub(in crate::neif) const DIFFUSE_SHIFT: f32 = -2.0;
/// Shift of the roughness output: training starts at about 0.3.
pub(in crate::neif) const ROUGHNESS_SHIFT: f32 = -0.85;
/// Least learned roughness: below it the lobe is narrower than any pixel, and the gradient is lost.
pub(crate) const ROUGHNESS_MIN: f32 = 0.02;

/// What the surface is made of at one point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surface {
    /// Baked diffuse radiance `C_d`, linear, at least 0.
    pub diffuse: Vec3,
    /// Specular reflectance at normal incidence, RGB in `(0, 1)`.
    pub tint: Vec3,
    /// Perceptual roughness in `(0, 1)`.
    pub roughness: f32,
}

impl Surface {
    /// Mean over the colours of what it mirrors at normal incidence, in `(0, 1)`.
    pub(crate) fn reflectance(&self) -> f32 {
        self.tint.element_sum() / 3.0
    }
}

#[cfg(test)]
impl Surface {
    /// The loss of a surface whose gradient is `d`.
    pub(crate) fn dot(&self, d: &Self) -> f64 {
        let roughness = self.roughness * d.roughness;
        f64::from(self.diffuse.dot(d.diffuse) + self.tint.dot(d.tint) + roughness)
    }

    /// Calls `visit` with the name and the place of each number of a surface.
    pub(crate) fn for_each_value(mut visit: impl FnMut(&str, &dyn Fn(&mut Self) -> &mut f32)) {
        for c in 0..3 {
            visit("diffuse", &|s| &mut s.diffuse[c]);
            visit("tint", &|s| &mut s.tint[c]);
        }
        visit("roughness", &|s| &mut s.roughness);
    }
}
