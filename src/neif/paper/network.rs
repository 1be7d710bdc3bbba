//! Deep networks over a block of rows: dense layers, and the stack of equal ones with a skip connection.

use crate::neif::kernels::math::softplus;
use crate::neif::kernels::matmul::{Epilogue, LANES, linear, linear_backward_weights, transpose};

/// Widest row of any layer; the input gradient of a layer is a product with this zero bias.
pub const MAX_WIDTH: usize = 2048;
static NO_BIAS: [f32; MAX_WIDTH] = [0.0; MAX_WIDTH];
/// Sharpness of the softplus between layers, as in IDR: nearly a `ReLU`, and smooth.
const SOFTPLUS_BETA: f32 = 100.0;

/// `width` rounded up to what a layer may have.
pub fn padded(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// A fully connected layer and where its weights (`[n_in][n_out]`) and biases lie in a parameter vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dense {
    /// Input width, a multiple of 16.
    pub n_in: usize,
    /// Output width, a multiple of 16.
    pub n_out: usize,
    /// First parameter.
    pub start: usize,
}

impl Dense {
    /// One past the last parameter.
    pub fn end(&self) -> usize {
        self.bias_start() + self.n_out
    }

    fn bias_start(&self) -> usize {
        self.start + self.n_in * self.n_out
    }

    /// Uniform weights of variance `gain / fan_in` (2 before a `ReLU`, 1 at an output), zero biases.
    pub fn init(&self, params: &mut [f32], gain: f32, uniform: &mut impl FnMut() -> f32) {
        let bound = (3.0 * gain / self.n_in as f32).sqrt();
        for w in &mut params[self.start..self.bias_start()] {
            *w = (2.0 * uniform() - 1.0) * bound;
        }
        params[self.bias_start()..self.end()].fill(0.0);
    }

    /// `y = epilogue(x·w + b)` for rows `x` (`[n][n_in]`).
    pub fn forward(&self, params: &[f32], x: &[f32], epilogue: Epilogue<'_>, y: &mut Vec<f32>) {
        y.resize(x.len() / self.n_in * self.n_out, 0.0);
        linear(
            x,
            &params[self.start..self.bias_start()],
            &params[self.bias_start()..self.end()],
            epilogue,
            y,
        );
    }

    /// Adds to `d_params` and writes `d_x`, from `d_y`; `transposed` is what [`Self::transpose`] wrote.
    pub fn backward(
        &self,
        transposed: &[f32],
        x: &[f32],
        d_y: &[f32],
        d_params: &mut [f32],
        d_x: &mut Vec<f32>,
    ) {
        let (d_w, d_b) = d_params[self.start..self.end()].split_at_mut(self.n_in * self.n_out);
        linear_backward_weights(x, d_y, d_w, d_b);
        d_x.resize(x.len(), 0.0);
        linear(
            d_y,
            &transposed[self.start..self.bias_start()],
            &NO_BIAS[..self.n_in],
            Epilogue::Linear,
            d_x,
        );
    }

    /// Writes the transposed weights where `params` has the weights.
    pub fn transpose(&self, params: &[f32], transposed: &mut [f32]) {
        let range = self.start..self.bias_start();
        transpose(&params[range.clone()], self.n_out, &mut transposed[range]);
    }
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
            layer.backward(transposed, x, &buffers.d_output, d_params, &mut buffers.d_x);
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
        Activation::Relu => relu_backward(output, d),
        Activation::Softplus => {
            for (d, y) in d.iter_mut().zip(output) {
                // sigmoid(beta x) = 1 - e^(-beta y).
                *d *= -(-SOFTPLUS_BETA * y).exp_m1();
            }
        }
    }
}

/// Zeroes `d` where the `ReLU` gave zero.
pub fn relu_backward(output: &[f32], d: &mut [f32]) {
    for (d, y) in d.iter_mut().zip(output) {
        *d = if *y > 0.0 { *d } else { 0.0 };
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Numbers in `[0, 1)` that look random and are always the same.
    pub(crate) fn random(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        }
    }

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
            let input: Vec<f32> = (0..5 * 16).map(|_| uniform() - 0.5).collect();
            let d_output: Vec<f32> = (0..5 * 32).map(|_| uniform() - 0.5).collect();
            let loss = |params: &[f32], input: &[f32]| -> f64 {
                let mut buffers = StackBuffers::default();
                stack.forward(params, input, &mut buffers);
                let terms = buffers.output().iter().zip(&d_output);
                terms.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
            };
            let mut buffers = StackBuffers::default();
            stack.forward(&params, &input, &mut buffers);
            let mut transposed = vec![0.0; params.len()];
            stack.transpose(&params, &mut transposed);
            let mut d_params = vec![0.0; params.len()];
            stack.backward(&transposed, &input, &d_output, &mut buffers, &mut d_params);
            let h = 2e-3;
            let mut n_off = 0;
            let mut check = |analytic: f32, up: f64, down: f64| {
                let numeric = (up - down) / f64::from(2.0 * h);
                let error = (f64::from(analytic) - numeric).abs();
                n_off += usize::from(error > 2e-2 * numeric.abs() + 3e-3);
            };
            for i in (0..params.len()).step_by(31) {
                let at = |h: f32| {
                    let mut moved = params.clone();
                    moved[i] += h;
                    loss(&moved, &input)
                };
                check(d_params[i], at(h), at(-h));
            }
            for i in (0..input.len()).step_by(3) {
                let at = |h: f32| {
                    let mut moved = input.clone();
                    moved[i] += h;
                    loss(&params, &moved)
                };
                check(buffers.d_input[i], at(h), at(-h));
            }
            // A kink between the two evaluations is allowed now and then.
            assert!(n_off <= 4, "{activation:?}: {n_off} gradients are off");
        }
    }
}
