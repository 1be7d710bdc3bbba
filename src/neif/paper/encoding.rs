//! The integrated lobe encoding: the expected sinusoids of a Gaussian.
//!
//! `E[sin(2^l x)] = sin(2^l mu) exp(-4^l sigma²/2)`, and the cosine likewise: Eq. 8 of mip-NeRF (arXiv:2103.13415).
//! Eq. 6 of the paper prints `sin(mu) exp(-2^(l-1) Sigma)`, without the frequency and with half its exponent.

/// Values a level takes: sine and cosine of three axes.
pub const LEVEL_WIDTH: usize = 6;
/// An attenuation below this is zero in the sum it would enter; its sinusoids are not computed.
const FAINT: f32 = 1e-9;

/// Writes the encoding of a Gaussian with that mean and diagonal variance; `out`: `[n_levels][sin xyz, cos xyz]`.
pub fn encode(mean: [f32; 3], variance: [f32; 3], out: &mut [f32]) {
    let mut frequency = 1.0_f32;
    for level in out.chunks_exact_mut(LEVEL_WIDTH) {
        for axis in 0..3 {
            let attenuation = (-0.5 * frequency * frequency * variance[axis]).exp();
            let (sin, cos) = if attenuation < FAINT {
                (0.0, 0.0)
            } else {
                (frequency * mean[axis]).sin_cos()
            };
            level[axis] = sin * attenuation;
            level[3 + axis] = cos * attenuation;
        }
        frequency *= 2.0;
    }
}

/// `d loss / d variance` from the encoding and its gradient, both as [`encode`] lays them out.
pub fn encode_backward(encoded: &[f32], d_encoded: &[f32]) -> [f32; 3] {
    let mut d_variance = [0.0; 3];
    let mut frequency = 1.0_f32;
    let levels = encoded
        .chunks_exact(LEVEL_WIDTH)
        .zip(d_encoded.chunks_exact(LEVEL_WIDTH));
    for (value, d) in levels {
        for axis in 0..3 {
            let sum = value[axis] * d[axis] + value[3 + axis] * d[3 + axis];
            d_variance[axis] -= 0.5 * frequency * frequency * sum;
        }
        frequency *= 2.0;
    }
    d_variance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{assert_agrees, dot, random, slope};

    const MEAN: [f32; 3] = [0.4, -1.1, 0.05];
    const VARIANCE: [f32; 3] = [0.3, 0.02, 0.0];

    #[test]
    fn the_encoding_is_the_mean_over_gaussian_samples() {
        let mut uniform = random(5);
        let n = 100_000;
        let mut sums = [0.0_f64; 4 * LEVEL_WIDTH];
        for _ in 0..n {
            let x: [f64; 3] = std::array::from_fn(|axis| {
                // Box and Muller.
                let (u, v) = (1.0 - f64::from(uniform()), f64::from(uniform()));
                let normal = (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
                f64::from(MEAN[axis]) + f64::from(VARIANCE[axis]).sqrt() * normal
            });
            for (i, sum) in sums.iter_mut().enumerate() {
                let (level, column) = (i / LEVEL_WIDTH, i % LEVEL_WIDTH);
                let phase = x[column % 3] * f64::from(1 << level);
                *sum += if column < 3 { phase.sin() } else { phase.cos() };
            }
        }
        let mut encoded = [0.0; 4 * LEVEL_WIDTH];
        encode(MEAN, VARIANCE, &mut encoded);
        for (i, (value, sum)) in encoded.iter().zip(sums).enumerate() {
            // Four standard deviations of a mean of values within one.
            let expected = sum / f64::from(n);
            assert!(
                (f64::from(*value) - expected).abs() < 4.0 / f64::from(n).sqrt(),
                "{i}: {value} against {expected}"
            );
        }
    }

    #[test]
    fn variance_gradient_agrees_with_finite_differences() {
        let d: Vec<f32> = (0..3 * LEVEL_WIDTH)
            .map(|i| (i as f32 * 1.3).cos())
            .collect();
        let loss = |variance: &[f32; 3]| -> f64 {
            let mut encoded = [0.0; 3 * LEVEL_WIDTH];
            encode(MEAN, *variance, &mut encoded);
            dot(&encoded, &d)
        };
        let mut encoded = [0.0; 3 * LEVEL_WIDTH];
        encode(MEAN, VARIANCE, &mut encoded);
        let analytic = encode_backward(&encoded, &d);
        for axis in 0..3 {
            let numeric = slope(&mut { VARIANCE }, |v| &mut v[axis], 1e-3, loss);
            let what = format!("axis {axis}");
            assert_agrees(&what, analytic[axis], numeric, (1e-2, 1e-3));
        }
    }

    #[test]
    fn a_wide_gaussian_has_no_fine_levels() {
        let mut encoded = [1.0; 16 * LEVEL_WIDTH];
        encode([1e6, -3.0, 0.0], [1e12, 40.0, 1e30], &mut encoded);
        assert!(encoded.iter().all(|v| v.abs() < 1e-6), "{encoded:?}");
    }
}
