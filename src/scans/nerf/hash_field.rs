//! Fields with a hash grid: a small network makes density and features of a point's, another one colours of those and the
//! direction (Section 5.4 of arXiv:2201.05989). What programs store differently is brought into one form here.

use glam::Vec3;

use super::field::{Densities, Field, Scratch, logistic, usable_color, usable_density};
use super::hash_grid::HashGrid;
use super::layers::{Layer, Mlp};
use super::sphere::{N_HARMONICS, harmonics};

/// How points enter the unit cube of the grid.
#[derive(Clone, Copy, Debug)]
pub(super) enum Warp {
    /// A box becomes the cube; nothing is outside of it.
    Box { min: Vec3, extent: Vec3 },
    /// All of space becomes the cube, the middle half of it the box from -1 to 1 (Eq. 10 of arXiv:2111.12077 with the
    /// largest coordinate for the norm).
    Contracted,
}

impl Warp {
    fn point(self, p: Vec3) -> Vec3 {
        match self {
            Self::Box { min, extent } => (p - min) / extent,
            Self::Contracted => {
                let norm = p.abs().max_element();
                let contracted = if norm < 1.0 {
                    p
                } else {
                    (2.0 - 1.0 / norm) * (p / norm)
                };
                (contracted + 2.0) / 4.0
            }
        }
    }
}

/// What makes a number of a network's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Output {
    None,
    Relu,
    Logistic,
    Exponential,
}

impl Output {
    fn of(self, x: f32) -> f32 {
        match self {
            Self::None => x,
            Self::Relu => x.max(0.0),
            Self::Logistic => logistic(x),
            Self::Exponential => x.exp(),
        }
    }
}

/// How directions enter the harmonics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Directions {
    /// As they are.
    Unit,
    /// As `(d + 1) / 2`: what nerfstudio's own code does.
    Halved,
}

/// A field with a hash grid.
#[derive(Clone, Debug)]
pub(super) struct HashField {
    pub(super) warp: Warp,
    pub(super) grid: HashGrid,
    /// From the grid's features to density and more.
    pub(super) density: Mlp,
    pub(super) density_output: Output,
    /// What densities are multiplied by.
    pub(super) density_scale: f32,
    pub(super) directions: Directions,
    /// From the first network's outputs, then harmonics, to a colour.
    pub(super) color: Mlp,
    pub(super) color_output: Output,
}

/// A matrix `[n_out][n_in]` as a program stores it, and a bias or none.
#[derive(Clone, Debug)]
pub(super) struct Matrix {
    pub(super) n_in: usize,
    pub(super) weights: Vec<f32>,
    pub(super) bias: Vec<f32>,
}

/// What a column of a program's first layer is multiplied with.
#[derive(Clone, Copy, Debug)]
pub(super) enum Input {
    /// An input of the network, with a sign.
    Number(usize, f32),
    /// The same for all.
    Constant(f32),
}

impl Matrix {
    pub(super) fn n_out(&self) -> usize {
        self.weights.len() / self.n_in
    }

    /// The same for inputs in another order, constants gone into the bias.
    fn rearranged(&self, n_in: usize, inputs: &[Input]) -> Self {
        let mut weights = vec![0.0; self.n_out() * n_in];
        let mut bias = self.bias.clone();
        bias.resize(self.n_out(), 0.0);
        let rows = self.weights.chunks_exact(self.n_in).zip(&mut bias);
        for ((row, bias), to) in rows.zip(weights.chunks_exact_mut(n_in)) {
            for (weight, input) in row.iter().zip(inputs) {
                match input {
                    Input::Number(i, sign) => to[*i] += sign * weight,
                    Input::Constant(value) => *bias += value * weight,
                }
            }
        }
        Self {
            n_in,
            weights,
            bias,
        }
    }

    /// The first of the outputs.
    fn truncated(mut self, n_out: usize) -> Self {
        self.weights.truncate(n_out * self.n_in);
        self.bias.truncate(n_out);
        self
    }
}

/// A network of matrices: `inputs` says what the columns of the first are for, of `n_in` numbers in all; only the first
/// `n_out` outputs are kept.
pub(super) fn network(matrices: Vec<Matrix>, n_in: usize, inputs: &[Input], n_out: usize) -> Mlp {
    let last = matrices.len().saturating_sub(1);
    let layer = |(i, matrix): (usize, Matrix)| {
        let matrix = if i == 0 {
            matrix.rearranged(n_in, inputs)
        } else {
            matrix
        };
        let matrix = if i == last {
            matrix.truncated(n_out)
        } else {
            matrix
        };
        Layer::new(matrix.n_in, &matrix.weights, &matrix.bias)
    };
    Mlp {
        layers: matrices.into_iter().enumerate().map(layer).collect(),
    }
}

/// A network of tiny-cuda-nn.
#[derive(Clone, Copy, Debug)]
pub(super) struct TcnnNetwork {
    /// Inputs and outputs with what they are padded by.
    pub(super) n_in: usize,
    pub(super) n_out: usize,
    pub(super) width: usize,
    pub(super) n_hidden: usize,
}

impl TcnnNetwork {
    fn sizes(&self) -> Vec<(usize, usize)> {
        if self.n_hidden == 0 {
            return vec![(self.n_in, self.n_out)];
        }
        let mut sizes = vec![(self.n_in, self.width)];
        sizes.extend((1..self.n_hidden).map(|_| (self.width, self.width)));
        sizes.push((self.width, self.n_out));
        sizes
    }

    pub(super) fn n_params(&self) -> usize {
        self.sizes().iter().map(|(n_in, n_out)| n_in * n_out).sum()
    }

    /// The matrices in [`Self::n_params`] numbers: one after the other, row by row (`src/fully_fused_mlp.cu`).
    pub(super) fn matrices(&self, params: &[f32]) -> Vec<Matrix> {
        assert_eq!(params.len(), self.n_params(), "the whole network");
        let mut at = 0;
        let matrix = |(n_in, n_out): (usize, usize)| {
            let weights = params[at..at + n_in * n_out].to_vec();
            at += n_in * n_out;
            Matrix {
                n_in,
                weights,
                bias: Vec::new(),
            }
        };
        self.sizes().into_iter().map(matrix).collect()
    }
}

impl HashField {
    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        format!("hash grid, {} features", self.grid.n_out())
    }
}

impl Field for HashField {
    fn n_features(&self) -> usize {
        self.density.n_out()
    }

    fn densities(&self, points: &[Vec3], scratch: &mut Scratch, answers: &mut Densities) {
        let warped: Vec<Vec3> = points.iter().map(|p| self.warp.point(*p)).collect();
        self.grid.encode(&warped, &mut scratch.inputs);
        self.density
            .apply(&scratch.inputs, &mut scratch.spare, &mut answers.features);
        answers.densities.clear();
        let rows = answers
            .features
            .chunks_exact(self.n_features())
            .zip(&warped);
        answers.densities.extend(rows.map(|(row, p)| {
            let is_inside = p.cmpgt(Vec3::ZERO).all() && p.cmplt(Vec3::ONE).all();
            if is_inside {
                usable_density(self.density_scale * self.density_output.of(row[0]))
            } else {
                0.0
            }
        }));
    }

    fn colors(
        &self,
        features: &[f32],
        directions: &[Vec3],
        scratch: &mut Scratch,
        colors: &mut Vec<[f32; 3]>,
    ) {
        scratch.inputs.clear();
        let rows = features.chunks_exact(self.n_features()).zip(directions);
        for (row, direction) in rows {
            let direction = match self.directions {
                Directions::Unit => *direction,
                Directions::Halved => (direction + 1.0) / 2.0,
            };
            scratch.inputs.extend(row);
            scratch.inputs.extend(harmonics(direction));
        }
        self.color
            .apply(&scratch.inputs, &mut scratch.spare, &mut scratch.outputs);
        colors.clear();
        let rows = scratch.outputs.as_chunks::<3>().0;
        colors.extend(
            rows.iter()
                .map(|row| usable_color(row.map(|x| self.color_output.of(x)))),
        );
    }
}

/// Numbers that a colour network takes, where the first network makes `n_features`.
pub(super) fn n_color_inputs(n_features: usize) -> usize {
    n_features + N_HARMONICS
}
