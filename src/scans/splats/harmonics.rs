//! Colours that depend on the direction: real spherical harmonics as the reference implementation of 3D Gaussian Splatting
//! orders and signs them (`utils/sh_utils.py`, `eval_sh`).

use glam::Vec3;

/// Highest degree.
pub(in crate::scans) const MAX_DEGREE: usize = 3;
/// `1 / (2 sqrt(π))`.
pub(in crate::scans) const C0: f32 = 0.282_094_8;
const C1: f32 = 0.488_602_52;
const C2: [f32; 5] = [
    1.092_548_4,
    -1.092_548_4,
    0.315_391_57,
    -1.092_548_4,
    0.546_274_2,
];
const C3: [f32; 7] = [
    -0.590_043_6,
    2.890_611_4,
    -0.457_045_8,
    0.373_176_34,
    -0.457_045_8,
    1.445_305_7,
    -0.590_043_6,
];

/// The harmonics' values in a unit direction.
fn basis(direction: Vec3) -> [f32; (MAX_DEGREE + 1) * (MAX_DEGREE + 1)] {
    let Vec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// The colour seen in a unit direction (from the eye): sRGB-encoded, at least 0. `coefficients`: 1, 4, 9 or 16.
pub(in crate::scans) fn color(coefficients: &[[f32; 3]], direction: Vec3) -> [f32; 3] {
    let mut sum = [0.5; 3];
    let basis = basis(direction);
    for (value, coefficient) in basis.iter().zip(coefficients) {
        for (sum, c) in sum.iter_mut().zip(coefficient) {
            *sum += value * c;
        }
    }
    sum.map(|c| c.max(0.0))
}
