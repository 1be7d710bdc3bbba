//! The real spherical harmonics of directions up to the third degree.

use glam::Vec3;

/// Harmonics up to the third degree.
pub(super) const N_HARMONICS: usize = 16;

/// The harmonics with the signs of tiny-cuda-nn's `sh_enc` (Appendix A1 of Sloan, "Stupid Spherical Harmonics Tricks"); those
/// of nerfstudio's own code are the same with a plus before all polynomials: see [`nerfstudio_sign`]. The direction need
/// not have unit length: they are polynomials.
pub(super) fn harmonics(v: Vec3) -> [f32; N_HARMONICS] {
    let (x, y, z) = (v.x, v.y, v.z);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_79,
        -0.488_602_5 * y,
        0.488_602_5 * z,
        -0.488_602_5 * x,
        1.092_548_4 * x * y,
        -1.092_548_4 * y * z,
        0.946_174_7 * zz - 0.315_391_57,
        -1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        0.590_043_6 * y * (yy - 3.0 * xx),
        2.890_611_4 * x * y * z,
        0.457_045_8 * y * (1.0 - 5.0 * zz),
        0.373_176_34 * z * (5.0 * zz - 3.0),
        0.457_045_8 * x * (1.0 - 5.0 * zz),
        1.445_305_7 * z * (xx - yy),
        0.590_043_6 * x * (3.0 * yy - xx),
    ]
}

/// What one of the harmonics is multiplied by to be that of nerfstudio's `components_from_spherical_harmonics`.
pub(super) fn nerfstudio_sign(i: usize) -> f32 {
    if i.is_multiple_of(2) { 1.0 } else { -1.0 }
}
