//! What the surface field says of a point.

use glam::Vec3;

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
