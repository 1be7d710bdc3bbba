//! A network with one hidden layer of `ReLUs`: forward and hand-written backward pass over a batch.

use super::dense::Dense;
use crate::neif::kernels::matmul::Epilogue;

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
    fn layers(&self) -> [Dense; 2] {
        let hidden = Dense {
            n_in: self.n_in,
            n_out: self.n_hidden,
            start: 0,
        };
        let output = Dense {
            n_in: self.n_hidden,
            n_out: self.n_out,
            start: hidden.end(),
        };
        [hidden, output]
    }

    /// Number of parameters: both layers' weights and biases.
    pub fn n_params(&self) -> usize {
        self.layers()[1].end()
    }

    /// He-initialised weights (uniform, variance `2 / fan_in`) and zero biases; `uniform` draws from `[0, 1)`.
    pub fn init(&self, params: &mut [f32], uniform: &mut impl FnMut() -> f32) {
        for layer in self.layers() {
            layer.init(params, 2.0, uniform);
        }
    }

    /// Writes `buffers.hidden` and `buffers.output` for `input`: `[n][n_in]`.
    pub fn forward(&self, params: &[f32], input: &[f32], buffers: &mut MlpBuffers) {
        let n = input.len() / self.n_in;
        let [first, second] = self.layers();
        buffers.hidden.resize(n * self.n_hidden, 0.0);
        buffers.output.resize(n * self.n_out, 0.0);
        let tiles = input
            .chunks(TILE * self.n_in)
            .zip(buffers.hidden.chunks_mut(TILE * self.n_hidden))
            .zip(buffers.output.chunks_mut(TILE * self.n_out));
        for ((input, hidden), output) in tiles {
            first.forward_into(params, input, Epilogue::Relu, hidden);
            second.forward_into(params, hidden, Epilogue::Linear, output);
        }
    }

    /// Adds to `d_params` and writes `buffers.d_input`, from `buffers.d_output`, for the first rows of the buffers:
    /// as many as `input` has.
    pub fn backward(
        &self,
        transposed: &[f32],
        input: &[f32],
        buffers: &mut MlpBuffers,
        d_params: &mut [f32],
    ) {
        let n = input.len() / self.n_in;
        let [first, second] = self.layers();
        buffers.d_hidden.resize(TILE * self.n_hidden, 0.0);
        buffers.d_input.resize(n * self.n_in, 0.0);
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
            let mask = Epilogue::MaskBy(hidden);
            second.backward_into(transposed, (hidden, d_output), mask, d_params, d_hidden);
            let all = Epilogue::Linear;
            first.backward_into(transposed, (input, d_hidden), all, d_params, d_input);
        }
    }

    /// Writes the transposed weights for [`Self::backward`] where the parameters have the weights.
    pub fn transpose(&self, params: &[f32], transposed: &mut [f32]) {
        for layer in self.layers() {
            layer.transpose(params, transposed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{assert_agrees, dot, random, slope};

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mlp = Mlp {
            n_in: 16,
            n_hidden: 32,
            n_out: 16,
        };
        let mut uniform = random(1);
        let mut params = vec![0.0; mlp.n_params()];
        mlp.init(&mut params, &mut uniform);
        let mut input: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
        let d_output: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
        let loss = |params: &[f32], input: &[f32]| {
            let mut buffers = MlpBuffers::default();
            mlp.forward(params, input, &mut buffers);
            dot(&buffers.output, &d_output)
        };
        let mut buffers = MlpBuffers::default();
        let mut transposed = vec![0.0; params.len()];
        mlp.transpose(&params, &mut transposed);
        mlp.forward(&params, &input, &mut buffers);
        buffers.d_output.clone_from(&d_output);
        let mut d_params = vec![0.0; params.len()];
        mlp.backward(&transposed, &input, &mut buffers, &mut d_params);
        for i in (0..params.len()).step_by(37) {
            let numeric = slope(&mut params, |p| &mut p[i], 1e-3, |p| loss(p, &input));
            assert_agrees(
                &format!("parameter {i}"),
                d_params[i],
                numeric,
                (2e-2, 2e-3),
            );
        }
        for i in (0..input.len()).step_by(7) {
            let numeric = slope(&mut input, |x| &mut x[i], 1e-3, |x| loss(&params, x));
            assert_agrees(
                &format!("input {i}"),
                buffers.d_input[i],
                numeric,
                (2e-2, 2e-3),
            );
        }
    }
}
