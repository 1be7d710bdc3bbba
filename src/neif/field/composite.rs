//! Volume rendering of deferred features: one composited feature vector a ray (Eq. 1 and 3 of the paper, with the
//! interval lengths that Eq. 1 omits).

use crate::neif::kernels::{Baseline, Isa, dispatch, fma, math};

/// Width of a density network's output row: the density's logarithm, then the features.
pub const WIDTH: usize = 16;
/// Largest logarithm of the density, per field unit: `e^15` is opaque over a ten-thousandth of a cell.
const LOG_DENSITY_MAX: f32 = 15.0;

/// Optical depth from which a sample is opaque: `e^-20` of what is behind shows through.
const OPAQUE_DEPTH: f32 = 20.0;

/// What compositing keeps for its backward pass, and its result.
#[derive(Clone, Debug, Default)]
pub struct CompositeBuffers {
    /// `[n_rays * n_samples]` optical depths.
    depths: Vec<f32>,
    /// `[n_rays * n_samples]` weights `T (1 - e^-depth)`.
    pub weights: Vec<f32>,
    /// `[n_rays][16]`: 15 composited features, then the opacity.
    pub features: Vec<f32>,
}

impl CompositeBuffers {
    /// Composites `rows` (`[n][16]`) over intervals of lengths `deltas` (`[n]`), `n_samples` a ray.
    pub fn forward(&mut self, rows: &[f32], deltas: &[f32], n_samples: usize) {
        assert_eq!(
            rows.len(),
            deltas.len() * WIDTH,
            "composite: one row a sample"
        );
        self.depths.resize(deltas.len(), 0.0);
        self.weights.resize(deltas.len(), 0.0);
        self.features.resize(deltas.len() / n_samples * WIDTH, 0.0);
        composite_forward(self, rows, deltas, n_samples);
    }

    /// Writes `d_rows` (`[n][16]`) from `d_features` (`[n_rays][stride]`, first 16 columns used).
    /// `d_weights` (`[n_rays * n_samples]`, or nothing) is what the loss wants of the weights themselves.
    pub fn backward(
        &self,
        rows: &[f32],
        (d_features, d_weights): (&[f32], &[f32]),
        n_samples: usize,
        d_rows: &mut [f32],
    ) {
        composite_backward(self, rows, d_features, d_weights, n_samples, d_rows);
    }
}

/// Density per field unit of a row's first entry.
#[inline(always)]
pub fn density(log_density: f32) -> f32 {
    math::exp::<Baseline>(log_density.min(LOG_DENSITY_MAX))
}

dispatch! {
    fn composite_forward(kept: &mut CompositeBuffers, rows: &[f32], deltas: &[f32], n_samples: usize) = forward_body
}

#[inline(always)]
fn forward_body<I: Isa>(
    kept: &mut CompositeBuffers,
    rows: &[f32],
    deltas: &[f32],
    n_samples: usize,
) {
    optical_depths::<I>(rows, deltas, &mut kept.depths);
    weigh::<I>(&kept.depths, n_samples, &mut kept.weights);
    sum_features::<I>(rows, &kept.weights, n_samples, &mut kept.features);
}

#[inline(always)]
fn optical_depths<I: Isa>(rows: &[f32], deltas: &[f32], depths: &mut [f32]) {
    let (rows, _) = rows.as_chunks::<WIDTH>();
    for (depth, row) in depths.iter_mut().zip(rows) {
        *depth = row[0];
    }
    for (depth, delta) in depths.iter_mut().zip(deltas) {
        // `if` rather than `min`: NaN must stay NaN for the non-finite check.
        let log = if *depth > LOG_DENSITY_MAX {
            LOG_DENSITY_MAX
        } else {
            *depth
        };
        let nan = log * 0.0;
        *depth = math::exp::<I>(log) * delta + nan;
    }
}

#[inline(always)]
fn weigh<I: Isa>(depths: &[f32], n_samples: usize, weights: &mut [f32]) {
    for (weight, depth) in weights.iter_mut().zip(depths) {
        *weight = 1.0 - math::exp::<I>(-*depth) + *depth * 0.0;
    }
    for ray in weights.chunks_exact_mut(n_samples) {
        let mut transmittance = 1.0_f32;
        for weight in ray {
            let alpha = *weight;
            *weight = alpha * transmittance;
            transmittance -= *weight;
        }
    }
}

#[inline(always)]
fn sum_features<I: Isa>(rows: &[f32], weights: &[f32], n_samples: usize, features: &mut [f32]) {
    let (rows, _) = rows.as_chunks::<WIDTH>();
    let (features, _) = features.as_chunks_mut::<WIDTH>();
    let rays = rows
        .chunks_exact(n_samples)
        .zip(weights.chunks_exact(n_samples));
    for ((ray_rows, ray_weights), out) in rays.zip(features) {
        let mut sum = [0.0; WIDTH];
        for (row, &weight) in ray_rows.iter().zip(ray_weights) {
            // Column 0 holds the log density: summed along for speed, then replaced.
            for c in 0..WIDTH {
                sum[c] = fma::<I>(weight, row[c], sum[c]);
            }
        }
        let opacity: f32 = ray_weights.iter().sum();
        // Rounding may take the sum a little above 1; `min` would hide NaN.
        let opacity = if opacity > 1.0 { 1.0 } else { opacity };
        out[..WIDTH - 1].copy_from_slice(&sum[1..]);
        out[WIDTH - 1] = opacity;
    }
}

dispatch! {
    fn composite_backward(kept: &CompositeBuffers, rows: &[f32], d_features: &[f32], d_weights: &[f32], n_samples: usize, d_rows: &mut [f32]) = backward_body
}

/// `d depth_i = d w_i T_(i+1) - Σ_(k>i) d w_k w_k`, as every later weight scales with `e^-depth_i`.
#[inline(always)]
fn backward_body<I: Isa>(
    kept: &CompositeBuffers,
    rows: &[f32],
    d_features: &[f32],
    d_weights: &[f32],
    n_samples: usize,
    d_rows: &mut [f32],
) {
    let n_rays = kept.weights.len() / n_samples;
    let stride = d_features.len() / n_rays.max(1);
    let (rows, _) = rows.as_chunks::<WIDTH>();
    let (d_rows, _) = d_rows.as_chunks_mut::<WIDTH>();
    for ray in 0..n_rays {
        let d_feature = &d_features[ray * stride..ray * stride + WIDTH];
        // d[c] multiplies row column c; column 0 takes no part in the features.
        let mut d = [0.0; WIDTH];
        d[1..].copy_from_slice(&d_feature[..WIDTH - 1]);
        let d_opacity = d_feature[WIDTH - 1];
        let first = ray * n_samples;
        let mut transmittance_after =
            1.0 - kept.weights[first..first + n_samples].iter().sum::<f32>();
        let mut behind = 0.0;
        for i in (first..first + n_samples).rev() {
            let weight = kept.weights[i];
            let mut d_weight = d_opacity + d_weights.get(i).copied().unwrap_or(0.0);
            for c in 0..WIDTH {
                d_weight = fma::<I>(d[c], rows[i][c], d_weight);
            }
            let d_depth = d_weight * transmittance_after - behind;
            behind = fma::<I>(d_weight, weight, behind);
            transmittance_after += weight;
            let mut d_row = d.map(|v| v * weight);
            // The clamp is flat beyond its end, and an opaque sample's own density is no longer seen: there the rounding
            // error of the transmittance (1e-7) times a depth of up to 1e6 would be a gradient of pure noise.
            d_row[0] = if rows[i][0] < LOG_DENSITY_MAX && kept.depths[i] < OPAQUE_DEPTH {
                d_depth * kept.depths[i]
            } else {
                0.0
            };
            d_rows[i] = d_row;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{assert_agrees, dot, slope};

    const N: usize = 5;

    fn rows(seed: f32) -> Vec<f32> {
        (0..2 * N * WIDTH)
            .map(|i| (i as f32 * 0.61 + seed).sin())
            .collect()
    }

    fn deltas() -> Vec<f32> {
        (0..2 * N).map(|i| 0.1 + 0.2 * (i % 3) as f32).collect()
    }

    #[test]
    fn weights_agree_with_the_defining_product() {
        let (rows, deltas) = (rows(0.3), deltas());
        let mut buffers = CompositeBuffers::default();
        buffers.forward(&rows, &deltas, N);
        for ray in 0..2 {
            let mut transmittance = 1.0_f64;
            for i in ray * N..(ray + 1) * N {
                let depth = f64::from(rows[i * WIDTH]).exp() * f64::from(deltas[i]);
                let weight = transmittance * (1.0 - (-depth).exp());
                transmittance *= (-depth).exp();
                assert!(
                    (f64::from(buffers.weights[i]) - weight).abs() < 1e-6,
                    "sample {i}"
                );
            }
            assert!(
                (f64::from(buffers.features[ray * WIDTH + 15]) - (1.0 - transmittance)).abs()
                    < 1e-6,
                "opacity"
            );
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let (mut rows, deltas) = (rows(1.0), deltas());
        let d_features: Vec<f32> = (0..2 * WIDTH).map(|i| (i as f32 * 1.7).cos()).collect();
        let d_weights: Vec<f32> = (0..2 * N).map(|i| (i as f32 * 0.9).sin()).collect();
        let loss = |rows: &[f32]| {
            let mut buffers = CompositeBuffers::default();
            buffers.forward(rows, &deltas, N);
            dot(&buffers.features, &d_features) + dot(&buffers.weights, &d_weights)
        };
        let mut buffers = CompositeBuffers::default();
        buffers.forward(&rows, &deltas, N);
        let mut d_rows = vec![0.0; rows.len()];
        buffers.backward(&rows, (&d_features, &d_weights), N, &mut d_rows);
        for i in 0..rows.len() {
            let numeric = slope(&mut rows, |rows| &mut rows[i], 1e-2, |rows| loss(rows));
            assert_agrees(&i.to_string(), d_rows[i], numeric, (1e-2, 1e-3));
        }
    }

    #[test]
    fn an_opaque_first_sample_hides_the_rest() {
        let mut rows = rows(0.0);
        rows[0] = 1e6_f32.ln();
        let mut buffers = CompositeBuffers::default();
        buffers.forward(&rows, &[1.0; 2 * N], N);
        assert!(
            buffers.weights[0] > 0.9999 && buffers.weights[1] < 1e-4,
            "{:?}",
            &buffers.weights[..N]
        );
        let mut d_rows = vec![0.0; rows.len()];
        buffers.backward(&rows, (&[1.0; 2 * WIDTH], &[]), N, &mut d_rows);
        assert!(
            d_rows.iter().all(|v| v.is_finite()),
            "gradient must stay finite"
        );
    }

    #[test]
    fn nan_density_stays_visible() {
        let mut rows = rows(0.0);
        rows[0] = f32::NAN;
        let mut buffers = CompositeBuffers::default();
        buffers.forward(&rows, &deltas(), N);
        assert!(
            buffers.features[0].is_nan(),
            "a NaN must reach the non-finite check"
        );
    }
}
