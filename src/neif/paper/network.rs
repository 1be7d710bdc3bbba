//! Deep networks over a block of rows: a stack of equal dense layers with a skip connection.

use crate::neif::kernels::math::softplus;
use crate::neif::kernels::matmul::{Epilogue, LANES};
use crate::neif::networks::dense::{Dense, MAX_WIDTH};

/// Sharpness of the softplus between layers, as in IDR: nearly a `ReLU`, and smooth.
const SOFTPLUS_BETA: f32 = 100.0;

/// `width` rounded up to what a layer may have.
pub fn padded(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// Whether a layer may be so wide, also where it reads an input beside another layer.
pub fn is_sane_width(width: usize) -> bool {
    width.is_multiple_of(LANES) && (LANES..=MAX_WIDTH / 2).contains(&width)
}

/// What happens between two layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// `max(0, x)`.
    Relu,
    /// `ln(1 + e^(100 x)) / 100`.
    Softplus,
}

/// Equal layers one after the other; the one after the middle reads the input once more.
#[derive(Clone, Debug)]
pub struct Stack {
    n_in: usize,
    activation: Activation,
    layers: Vec<Dense>,
}

/// Activations and gradients of one block of rows.
#[derive(Clone, Debug, Default)]
pub struct StackBuffers {
    outputs: Vec<Vec<f32>>,
    /// `[n][width + n_in]`: input of the layer behind the skip connection.
    joined: Vec<f32>,
    d_output: Vec<f32>,
    d_x: Vec<f32>,
    /// `[n][n_in]`: the result of [`Stack::backward`].
    pub d_input: Vec<f32>,
}

impl StackBuffers {
    /// `[n][width]` of the last layer.
    pub fn output(&self) -> &[f32] {
        self.outputs.last().map_or(&[], Vec::as_slice)
    }
}

impl Stack {
    /// `depth` layers of `width` over rows of `n_in`; parameters from 0.
    pub fn new(n_in: usize, width: usize, depth: usize, activation: Activation) -> Self {
        let mut stack = Self {
            n_in,
            activation,
            layers: Vec::with_capacity(depth),
        };
        let mut start = 0;
        for index in 0..depth {
            let n_in = match index {
                0 => n_in,
                _ if index == depth / 2 + 1 => width + n_in,
                _ => width,
            };
            let layer = Dense {
                n_in,
                n_out: width,
                start,
            };
            start = layer.end();
            stack.layers.push(layer);
        }
        stack
    }

    /// One past the last parameter.
    pub fn end(&self) -> usize {
        self.layers.last().map_or(0, Dense::end)
    }

    /// He-initialised weights, zero biases.
    pub fn init(&self, params: &mut [f32], uniform: &mut impl FnMut() -> f32) {
        for layer in &self.layers {
            layer.init(params, 2.0, uniform);
        }
    }

    /// The layer that reads the input once more.
    fn skip_layer(&self) -> usize {
        self.layers.len() / 2 + 1
    }

    /// Writes `buffers.output()` for `input`: `[n][n_in]`.
    pub fn forward(&self, params: &[f32], input: &[f32], buffers: &mut StackBuffers) {
        buffers.outputs.resize(self.layers.len(), Vec::new());
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, rest) = buffers.outputs.split_at_mut(index);
            let previous = before.last().map_or(input, Vec::as_slice);
            let x = if index == self.skip_layer() {
                let joined = &mut buffers.joined;
                joined.clear();
                let rows = previous
                    .chunks_exact(layer.n_out)
                    .zip(input.chunks_exact(self.n_in));
                for (row, input) in rows {
                    joined.extend_from_slice(row);
                    joined.extend_from_slice(input);
                }
                joined.as_slice()
            } else {
                previous
            };
            match self.activation {
                Activation::Relu => layer.forward(params, x, Epilogue::Relu, &mut rest[0]),
                Activation::Softplus => {
                    layer.forward(params, x, Epilogue::Linear, &mut rest[0]);
                    for value in &mut rest[0] {
                        *value = softplus(SOFTPLUS_BETA * *value) / SOFTPLUS_BETA;
                    }
                }
            }
        }
    }

    /// Adds to `d_params` and writes `buffers.d_input`, from `d_output` (`[n][width]`).
    pub fn backward(
        &self,
        transposed: &[f32],
        input: &[f32],
        d_output: &[f32],
        buffers: &mut StackBuffers,
        d_params: &mut [f32],
    ) {
        buffers.d_output.clear();
        buffers.d_output.extend_from_slice(d_output);
        buffers.d_input.clear();
        buffers.d_input.resize(input.len(), 0.0);
        for (index, layer) in self.layers.iter().enumerate().rev() {
            activation_backward(
                self.activation,
                &buffers.outputs[index],
                &mut buffers.d_output,
            );
            let x = match index {
                0 => input,
                _ if index == self.skip_layer() => &buffers.joined,
                _ => &buffers.outputs[index - 1],
            };
            let rows = (x, buffers.d_output.as_slice());
            let all = Epilogue::Linear;
            layer.backward(transposed, rows, all, d_params, &mut buffers.d_x);
            if index == 0 {
                for (sum, d) in buffers.d_input.iter_mut().zip(&buffers.d_x) {
                    *sum += d;
                }
            } else if index == self.skip_layer() {
                buffers.d_output.clear();
                let rows = buffers.d_x.chunks_exact(layer.n_in);
                for (row, d_input) in rows.zip(buffers.d_input.chunks_exact_mut(self.n_in)) {
                    let (d_previous, d_joined) = row.split_at(layer.n_out);
                    buffers.d_output.extend_from_slice(d_previous);
                    d_input.copy_from_slice(d_joined);
                }
            } else {
                std::mem::swap(&mut buffers.d_output, &mut buffers.d_x);
            }
        }
    }

    /// Writes all transposed weights where `params` has the weights.
    pub fn transpose(&self, params: &[f32], transposed: &mut [f32]) {
        for layer in &self.layers {
            layer.transpose(params, transposed);
        }
    }
}

/// Multiplies `d` by the slope of the activation, which follows from its output.
fn activation_backward(activation: Activation, output: &[f32], d: &mut [f32]) {
    match activation {
        Activation::Relu => {
            for (d, y) in d.iter_mut().zip(output) {
                *d = if *y > 0.0 { *d } else { 0.0 };
            }
        }
        Activation::Softplus => {
            for (d, y) in d.iter_mut().zip(output) {
                // sigmoid(beta x) = 1 - e^(-beta y).
                *d *= -(-SOFTPLUS_BETA * y).exp_m1();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{agrees, dot, random, slope};

    #[test]
    fn the_paper_s_stack_has_its_skip_behind_the_fifth_layer() {
        let stack = Stack::new(96, 256, 8, Activation::Relu);
        let widths: Vec<usize> = stack.layers.iter().map(|l| l.n_in).collect();
        assert_eq!(widths, [96, 256, 256, 256, 256, 352, 256, 256]);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        for activation in [Activation::Relu, Activation::Softplus] {
            let stack = Stack::new(16, 32, 4, activation);
            let mut uniform = random(1);
            let mut params = vec![0.0; stack.end()];
            stack.init(&mut params, &mut uniform);
            let mut input: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
            let d_output: Vec<f32> = (0..5 * 32).map(|_| uniform() - 0.5).collect();
            let loss = |params: &[f32], input: &[f32]| -> f64 {
                let mut buffers = StackBuffers::default();
                stack.forward(params, input, &mut buffers);
                dot(buffers.output(), &d_output)
            };
            let mut buffers = StackBuffers::default();
            stack.forward(&params, &input, &mut buffers);
            let mut transposed = vec![0.0; params.len()];
            stack.transpose(&params, &mut transposed);
            let mut d_params = vec![0.0; params.len()];
            stack.backward(&transposed, &input, &d_output, &mut buffers, &mut d_params);
            let mut n_off = 0;
            let mut check = |analytic: f32, numeric: f64| {
                n_off += usize::from(!agrees(analytic, numeric, (2e-2, 3e-3)));
            };
            for i in (0..params.len()).step_by(31) {
                let numeric = slope(&mut params, |p| &mut p[i], 2e-3, |p| loss(p, &input));
                check(d_params[i], numeric);
            }
            for i in (0..input.len()).step_by(3) {
                let numeric = slope(&mut input, |x| &mut x[i], 2e-3, |x| loss(&params, x));
                check(buffers.d_input[i], numeric);
            }
            // A kink between the two evaluations is allowed now and then.
            assert!(n_off <= 4, "{activation:?}: {n_off} gradients are off");
        }
    }
}
