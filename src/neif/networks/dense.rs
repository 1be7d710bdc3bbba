//! A fully connected layer over rows, forward and backward.

use std::ops::Range;

use crate::neif::kernels::matmul::{Epilogue, linear, linear_backward_weights, transpose};

/// Widest input of any layer; the input gradient of a layer is a product with this zero bias.
pub const MAX_WIDTH: usize = 2048;
static NO_BIAS: [f32; MAX_WIDTH] = [0.0; MAX_WIDTH];

/// A layer and where its weights (`[n_in][n_out]`) and biases lie in a parameter vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dense {
    /// Input width, a multiple of 4.
    pub n_in: usize,
    /// Output width, a multiple of 16.
    pub n_out: usize,
    /// First parameter.
    pub start: usize,
}

impl Dense {
    /// One past the last parameter.
    pub fn end(&self) -> usize {
        self.biases().end
    }

    fn weights(&self) -> Range<usize> {
        self.start..self.start + self.n_in * self.n_out
    }

    fn biases(&self) -> Range<usize> {
        let start = self.weights().end;
        start..start + self.n_out
    }

    /// Uniform weights of variance `gain / fan_in` (2 before a `ReLU`, 1 at an output), zero biases.
    pub fn init(&self, params: &mut [f32], gain: f32, uniform: &mut impl FnMut() -> f32) {
        let bound = (3.0 * gain / self.n_in as f32).sqrt();
        for w in &mut params[self.weights()] {
            *w = (2.0 * uniform() - 1.0) * bound;
        }
        params[self.biases()].fill(0.0);
    }

    /// `y = epilogue(x·w + b)` for rows `x` (`[n][n_in]`).
    pub fn forward(&self, params: &[f32], x: &[f32], epilogue: Epilogue<'_>, y: &mut Vec<f32>) {
        y.resize(x.len() / self.n_in * self.n_out, 0.0);
        self.forward_into(params, x, epilogue, y);
    }

    /// [`Self::forward`] into `y` of the right length.
    pub fn forward_into(&self, params: &[f32], x: &[f32], epilogue: Epilogue<'_>, y: &mut [f32]) {
        let (w, b) = (&params[self.weights()], &params[self.biases()]);
        linear(x, w, b, epilogue, y);
    }

    /// Adds to `d_params` and writes `d_x = epilogue(d_y·wᵀ)`; `transposed` is what [`Self::transpose`] wrote.
    pub fn backward(
        &self,
        transposed: &[f32],
        (x, d_y): (&[f32], &[f32]),
        epilogue: Epilogue<'_>,
        d_params: &mut [f32],
        d_x: &mut Vec<f32>,
    ) {
        d_x.resize(x.len(), 0.0);
        self.backward_into(transposed, (x, d_y), epilogue, d_params, d_x);
    }

    /// [`Self::backward`] into `d_x` of the right length.
    pub fn backward_into(
        &self,
        transposed: &[f32],
        (x, d_y): (&[f32], &[f32]),
        epilogue: Epilogue<'_>,
        d_params: &mut [f32],
        d_x: &mut [f32],
    ) {
        let (d_w, d_b) = d_params[self.start..self.end()].split_at_mut(self.n_in * self.n_out);
        linear_backward_weights(x, d_y, d_w, d_b);
        let w = &transposed[self.weights()];
        linear(d_y, w, &NO_BIAS[..self.n_in], epilogue, d_x);
    }

    /// Writes the transposed weights where `params` has the weights.
    pub fn transpose(&self, params: &[f32], transposed: &mut [f32]) {
        let range = self.weights();
        transpose(&params[range.clone()], self.n_out, &mut transposed[range]);
    }
}
