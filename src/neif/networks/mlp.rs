//! A network with one hidden layer of `ReLUs`: forward and hand-written backward pass over a batch.

use crate::neif::kernels::matmul::{Epilogue, linear, linear_backward_weights, transpose};

/// Samples that pass through all layers together, so that their activations stay in the first cache: a multiple of the
/// kernels' six rows.
const TILE: usize = 96;

/// Widths of a network; every width but the input is a multiple of 16, the input of 4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mlp {
    /// Input width.
    pub n_in: usize,
    /// Hidden width.
    pub n_hidden: usize,
    /// Output width.
    pub n_out: usize,
}

/// Activations and gradients of one batch; reused from step to step.
#[derive(Clone, Debug, Default)]
pub struct MlpBuffers {
    /// `[n][n_hidden]`, after the `ReLU`.
    pub hidden: Vec<f32>,
    /// `[n][n_out]`.
    pub output: Vec<f32>,
    /// `[n][n_out]`, `d loss / d output`: written by the caller.
    pub d_output: Vec<f32>,
    /// `[n][n_in]`.
    pub d_input: Vec<f32>,
    /// One tile.
    d_hidden: Vec<f32>,
    /// The backward products have no bias.
    no_bias: Vec<f32>,
}

/// The weights transposed, for input gradients; refreshed after each optimiser step.
#[derive(Clone, Debug, Default)]
pub struct Transposed {
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Transposed {
    /// No weights.
    pub const EMPTY: Self = Self {
        first: Vec::new(),
        second: Vec::new(),
    };
}

impl MlpBuffers {
    /// Moves the given rows (increasing) of the kept activations and of `d_output` to the front.
    pub fn keep_rows(&mut self, rows: &[u32], net: &Mlp) {
        keep_rows(rows, net.n_hidden, &mut self.hidden);
        keep_rows(rows, net.n_out, &mut self.d_output);
    }
}

/// Moves the given rows (increasing) of a matrix with rows of length `width` to the front.
pub fn keep_rows(rows: &[u32], width: usize, values: &mut [f32]) {
    for (to, &from) in rows.iter().enumerate() {
        let from = from as usize * width;
        values.copy_within(from..from + width, to * width);
    }
}

/// Whether a hidden width suits the kernels and is no accident: a multiple of 16 up to 256.
pub fn is_sane_width(n_hidden: usize) -> bool {
    n_hidden.is_multiple_of(16) && (16..=256).contains(&n_hidden)
}

impl Mlp {
    /// Number of parameters: both layers' weights and biases.
    pub fn n_params(&self) -> usize {
        (self.n_in + 1) * self.n_hidden + (self.n_hidden + 1) * self.n_out
    }

    /// He-initialised weights (uniform, variance `2 / fan_in`) and zero biases; `uniform` draws from `[0, 1)`.
    pub fn init(&self, params: &mut [f32], mut uniform: impl FnMut() -> f32) {
        let shapes = self.split();
        params.fill(0.0);
        for (range, fan_in) in [
            (shapes[0].clone(), self.n_in),
            (shapes[2].clone(), self.n_hidden),
        ] {
            let bound = (6.0 / fan_in as f32).sqrt();
            for w in &mut params[range] {
                *w = (2.0 * uniform() - 1.0) * bound;
            }
        }
    }

    /// Writes `buffers.hidden` and `buffers.output` for `input`: `[n][n_in]`.
    pub fn forward(&self, params: &[f32], input: &[f32], buffers: &mut MlpBuffers) {
        let n = input.len() / self.n_in;
        let [w1, b1, w2, b2] = self.split();
        buffers.hidden.resize(n * self.n_hidden, 0.0);
        buffers.output.resize(n * self.n_out, 0.0);
        let tiles = input
            .chunks(TILE * self.n_in)
            .zip(buffers.hidden.chunks_mut(TILE * self.n_hidden))
            .zip(buffers.output.chunks_mut(TILE * self.n_out));
        for ((input, hidden), output) in tiles {
            let (w1, b1) = (&params[w1.clone()], &params[b1.clone()]);
            linear(input, w1, b1, Epilogue::Relu, hidden);
            let (w2, b2) = (&params[w2.clone()], &params[b2.clone()]);
            linear(hidden, w2, b2, Epilogue::Linear, output);
        }
    }

    /// Adds to `d_params` and writes `buffers.d_input`, from `buffers.d_output`, for the first rows of the buffers:
    /// as many as `input` has.
    pub fn backward(
        &self,
        transposed: &Transposed,
        input: &[f32],
        buffers: &mut MlpBuffers,
        d_params: &mut [f32],
    ) {
        let n = input.len() / self.n_in;
        buffers.d_hidden.resize(TILE * self.n_hidden, 0.0);
        buffers.d_input.resize(n * self.n_in, 0.0);
        buffers.no_bias.resize(self.n_hidden.max(self.n_in), 0.0);
        let (d_w1, rest) = d_params.split_at_mut(self.n_in * self.n_hidden);
        let (d_b1, rest) = rest.split_at_mut(self.n_hidden);
        let (d_w2, d_b2) = rest.split_at_mut(self.n_hidden * self.n_out);
        let tiles = input
            .chunks(TILE * self.n_in)
            .zip(buffers.hidden.chunks(TILE * self.n_hidden))
            .zip(buffers.d_output.chunks(TILE * self.n_out))
            .zip(buffers.d_input.chunks_mut(TILE * self.n_in));
        for (((input, hidden), d_output), d_input) in tiles {
            // The last tile of `input` may be shorter than those of the buffers.
            let n = input.len() / self.n_in;
            let (hidden, d_output) = (&hidden[..n * self.n_hidden], &d_output[..n * self.n_out]);
            let d_hidden = &mut buffers.d_hidden[..n * self.n_hidden];
            linear_backward_weights(hidden, d_output, d_w2, d_b2);
            let no_bias = &buffers.no_bias[..self.n_hidden];
            let mask = Epilogue::MaskBy(hidden);
            linear(d_output, &transposed.second, no_bias, mask, d_hidden);
            linear_backward_weights(input, d_hidden, d_w1, d_b1);
            let no_bias = &buffers.no_bias[..self.n_in];
            linear(
                d_hidden,
                &transposed.first,
                no_bias,
                Epilogue::Linear,
                d_input,
            );
        }
    }

    /// Refreshes the transposed weights.
    pub fn transpose(&self, params: &[f32], transposed: &mut Transposed) {
        let [w1, _, w2, _] = self.split();
        transposed.first.resize(w1.len(), 0.0);
        transposed.second.resize(w2.len(), 0.0);
        transpose(&params[w1], self.n_hidden, &mut transposed.first);
        transpose(&params[w2], self.n_out, &mut transposed.second);
    }

    /// Ranges of first weights, first biases, second weights, second biases.
    fn split(&self) -> [std::ops::Range<usize>; 4] {
        let a = self.n_in * self.n_hidden;
        let b = a + self.n_hidden;
        let c = b + self.n_hidden * self.n_out;
        [0..a, a..b, b..c, c..c + self.n_out]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mlp = Mlp {
            n_in: 16,
            n_hidden: 32,
            n_out: 16,
        };
        let mut state = 1_u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut params = vec![0.0; mlp.n_params()];
        mlp.init(&mut params, &mut uniform);
        let input: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
        let d_output: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
        let loss = |params: &[f32], input: &[f32]| {
            let mut buffers = MlpBuffers::default();
            mlp.forward(params, input, &mut buffers);
            buffers
                .output
                .iter()
                .zip(&d_output)
                .map(|(a, b)| f64::from(a * b))
                .sum::<f64>()
        };
        let mut buffers = MlpBuffers::default();
        let mut transposed = Transposed::default();
        mlp.transpose(&params, &mut transposed);
        mlp.forward(&params, &input, &mut buffers);
        buffers.d_output.clone_from(&d_output);
        let mut d_params = vec![0.0; params.len()];
        mlp.backward(&transposed, &input, &mut buffers, &mut d_params);
        let check = |analytic: f32, numeric: f64, what: &str| {
            assert!(
                (f64::from(analytic) - numeric).abs() < 2e-2 * numeric.abs() + 2e-3,
                "{what}: {analytic} against {numeric}"
            );
        };
        let h = 1e-3;
        for i in (0..params.len()).step_by(37) {
            let (mut up, mut down) = (params.clone(), params.clone());
            up[i] += h;
            down[i] -= h;
            check(
                d_params[i],
                (loss(&up, &input) - loss(&down, &input)) / f64::from(2.0 * h),
                &format!("parameter {i}"),
            );
        }
        for i in (0..input.len()).step_by(7) {
            let (mut up, mut down) = (input.clone(), input.clone());
            up[i] += h;
            down[i] -= h;
            check(
                buffers.d_input[i],
                (loss(&params, &up) - loss(&params, &down)) / f64::from(2.0 * h),
                &format!("input {i}"),
            );
        }
    }
}
