//! Real spherical harmonics to degree 2, attenuated by the width of a lobe.

/// Number of basis functions of degree 0 to 2.
pub const N_SH: usize = 9;

/// The nine values at unit direction `d`, degree `l` scaled by `exp(-l (l+1) / (2 kappa))`, the expectation under a
/// von Mises–Fisher lobe (Eq. 8 of Ref-NeRF, arXiv:2112.03907). Infinite `kappa` is a plain direction.
pub fn attenuated_sh(d: [f32; 3], kappa: f32) -> [f32; N_SH] {
    let [x, y, z] = d;
    let first = (-1.0 / kappa).exp();
    let second = first * first * first;
    [
        0.282_094_8,
        0.488_602_5 * y * first,
        0.488_602_5 * z * first,
        0.488_602_5 * x * first,
        1.092_548_4 * x * y * second,
        1.092_548_4 * y * z * second,
        0.315_391_57 * (3.0 * z * z - 1.0) * second,
        1.092_548_4 * x * z * second,
        0.546_274_2 * (x * x - y * y) * second,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    #[test]
    fn basis_is_orthonormal() {
        let n = 20_000;
        let mut gram = [[0.0_f64; N_SH]; N_SH];
        for d in fibonacci_sphere(n) {
            let sh = attenuated_sh(d.to_array(), f32::INFINITY);
            for (row, a) in gram.iter_mut().zip(sh) {
                for (sum, b) in row.iter_mut().zip(sh) {
                    *sum += f64::from(a * b) * 4.0 * std::f64::consts::PI / n as f64;
                }
            }
        }
        for (a, row) in gram.iter().enumerate() {
            for (b, product) in row.iter().enumerate() {
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < 1e-3, "<{a}, {b}> = {product}");
            }
        }
    }

    #[test]
    fn a_wide_lobe_keeps_only_the_mean() {
        let sh = attenuated_sh([0.0, 0.0, 1.0], 0.1);
        assert!(sh[1..].iter().all(|v| v.abs() < 1e-3), "{sh:?}");
    }
}
