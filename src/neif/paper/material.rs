//! The material network M of the paper: encoded point → 8 x 512 with a skip in the middle → one specular number.
//!
//! The paper names a softplus: it is between the layers here (beta 100, as in IDR), where it keeps the surface
//! smooth. Of the outputs only the diffuse colour has one; roughness and specular lie in `[0, 1]` by a sigmoid.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::encoding::{LEVEL_WIDTH, encode};
use super::network::{Activation, Stack, StackBuffers, is_sane_width, padded};
use crate::neif::kernels::math::{sigmoid, softplus};
use crate::neif::kernels::matmul::{Epilogue, LANES};
use crate::neif::networks::dense::Dense;
use crate::neif::surface::values::{DIFFUSE_SHIFT, ROUGHNESS_MIN, ROUGHNESS_SHIFT, Surface};

/// Output columns: three of the diffuse colour, the specular one, roughness.
const SPECULAR: usize = 3;
const ROUGHNESS: usize = 4;

/// Shape of the network. The default is the paper's, and `NeILF`'s 6 frequencies where the paper is silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperMaterialConfig {
    /// Frequencies of the position encoding: 1, 2, 4 ... radians a half side of the object's cube.
    pub position_levels: usize,
    /// Layers.
    pub depth: usize,
    /// Their width, a multiple of 16.
    pub width: usize,
}

impl Default for PaperMaterialConfig {
    fn default() -> Self {
        Self {
            position_levels: 6,
            depth: 8,
            width: 512,
        }
    }
}

impl PaperMaterialConfig {
    /// Whether a network of this shape can be made.
    pub fn is_sane(&self) -> bool {
        (1..=16).contains(&self.position_levels)
            && (1..=16).contains(&self.depth)
            && is_sane_width(self.width)
    }

    /// The point, then its encoding.
    fn input_width(&self) -> usize {
        3 + self.position_levels * LEVEL_WIDTH
    }
}

/// Parameters of the network and the cube it lives in.
#[derive(Clone, Debug)]
pub struct PaperMaterial {
    /// The shape.
    pub config: PaperMaterialConfig,
    stack: Stack,
    output: Dense,
    /// Lower corner of the cube, world coordinates.
    pub corner: Vec3,
    /// Side of the cube, world units.
    pub side: f32,
    /// Stack, then the output layer.
    pub params: Vec<f32>,
}

/// Working memory of one batch of surface points.
#[derive(Clone, Debug, Default)]
pub struct PaperMaterialBatch {
    input: Vec<f32>,
    stack: StackBuffers,
    output: Vec<f32>,
    d_output: Vec<f32>,
    d_stack: Vec<f32>,
}

impl PaperMaterial {
    /// A grey, glossy surface in the cube with the given centre and side.
    pub fn new(
        config: PaperMaterialConfig,
        center: Vec3,
        side: f32,
        mut uniform: impl FnMut() -> f32,
    ) -> Self {
        let mut material = Self::shaped(config, center - Vec3::splat(0.5 * side), side);
        let mut params = vec![0.0; material.n_params()];
        material.stack.init(&mut params, &mut uniform);
        // A tenth of the usual spread, so that the whole surface starts nearly the same.
        material.output.init(&mut params, 0.01, &mut uniform);
        material.params = params;
        material
    }

    /// A material from stored parameters; `None` when their number does not fit.
    pub fn from_params(
        config: PaperMaterialConfig,
        corner: Vec3,
        side: f32,
        params: Vec<f32>,
    ) -> Option<Self> {
        let material = Self {
            params,
            ..Self::shaped(config, corner, side)
        };
        (material.params.len() == material.n_params()).then_some(material)
    }

    fn shaped(config: PaperMaterialConfig, corner: Vec3, side: f32) -> Self {
        let stack = Stack::new(
            padded(config.input_width()),
            config.width,
            config.depth,
            Activation::Softplus,
        );
        let output = Dense {
            n_in: config.width,
            n_out: LANES,
            start: stack.end(),
        };
        Self {
            config,
            stack,
            output,
            corner,
            side,
            params: Vec::new(),
        }
    }

    /// Number of parameters.
    pub fn n_params(&self) -> usize {
        self.output.end()
    }

    /// Evaluates the surface at `points`, world coordinates, into `surfaces`.
    pub fn forward(
        &self,
        points: &[Vec3],
        batch: &mut PaperMaterialBatch,
        surfaces: &mut Vec<Surface>,
    ) {
        let width = padded(self.config.input_width());
        batch.input.clear();
        batch.input.resize(points.len() * width, 0.0);
        for (row, point) in batch.input.chunks_exact_mut(width).zip(points) {
            let x = ((*point - self.corner) / self.side * 2.0 - Vec3::ONE).to_array();
            row[..3].copy_from_slice(&x);
            encode(x, [0.0; 3], &mut row[3..self.config.input_width()]);
        }
        self.stack
            .forward(&self.params, &batch.input, &mut batch.stack);
        self.output.forward(
            &self.params,
            batch.stack.output(),
            Epilogue::Linear,
            &mut batch.output,
        );
        surfaces.clear();
        surfaces.extend(batch.output.chunks_exact(LANES).map(activate));
    }

    /// Adds to `d_params` from `d_surfaces`, of the points of the last forward pass.
    pub fn backward(
        &self,
        transposed: &[f32],
        batch: &mut PaperMaterialBatch,
        d_surfaces: &[Surface],
        d_params: &mut [f32],
    ) {
        batch.d_output.clear();
        batch.d_output.resize(batch.output.len(), 0.0);
        let rows = batch
            .d_output
            .chunks_exact_mut(LANES)
            .zip(batch.output.chunks_exact(LANES));
        for ((d_row, row), d) in rows.zip(d_surfaces) {
            for c in 0..3 {
                d_row[c] = d.diffuse[c] * sigmoid(row[c] + DIFFUSE_SHIFT);
            }
            let slope = |x: f32| sigmoid(x) * (1.0 - sigmoid(x));
            d_row[SPECULAR] = d.tint.element_sum() * slope(row[SPECULAR]);
            d_row[ROUGHNESS] =
                d.roughness * (1.0 - ROUGHNESS_MIN) * slope(row[ROUGHNESS] + ROUGHNESS_SHIFT);
        }
        let (rows, all) = ((batch.stack.output(), &*batch.d_output), Epilogue::Linear);
        self.output
            .backward(transposed, rows, all, d_params, &mut batch.d_stack);
        self.stack.backward(
            transposed,
            &batch.input,
            &batch.d_stack,
            &mut batch.stack,
            d_params,
        );
    }

    /// Writes the transposed weights for [`Self::backward`] where the parameters have the weights.
    pub fn transpose(&self, transposed: &mut Vec<f32>) {
        transposed.resize(self.params.len(), 0.0);
        self.stack.transpose(&self.params, transposed);
        self.output.transpose(&self.params, transposed);
    }
}

/// NaN stays NaN for the non-finite check: `sigmoid` alone would hide it.
fn activate(row: &[f32]) -> Surface {
    let unit = |x: f32| sigmoid(x) + x * 0.0;
    Surface {
        diffuse: Vec3::from_array(std::array::from_fn(|c| softplus(row[c] + DIFFUSE_SHIFT))),
        tint: Vec3::splat(unit(row[SPECULAR])),
        roughness: ROUGHNESS_MIN + (1.0 - ROUGHNESS_MIN) * unit(row[ROUGHNESS] + ROUGHNESS_SHIFT),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::test_gradients::{agrees, random, slope};

    fn material(params_seed: u32) -> PaperMaterial {
        let config = PaperMaterialConfig {
            position_levels: 3,
            depth: 4,
            width: 32,
        };
        PaperMaterial::new(config, Vec3::ZERO, 2.0, random(params_seed))
    }

    fn surfaces(material: &PaperMaterial, points: &[Vec3]) -> Vec<Surface> {
        let mut surfaces = Vec::new();
        material.forward(points, &mut PaperMaterialBatch::default(), &mut surfaces);
        surfaces
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut material = material(4);
        let points = [Vec3::new(0.3, -0.2, 0.7), Vec3::new(-0.9, 0.5, 0.1)];
        let d = |i: usize| Surface {
            diffuse: Vec3::new(0.3, -0.8, 0.5) * (1.0 + i as f32),
            tint: Vec3::new(-0.4, 0.9, 0.2),
            roughness: 0.7 - i as f32,
        };
        let loss = |material: &PaperMaterial| -> f64 {
            let surfaces = surfaces(material, &points);
            let surfaces = surfaces.iter().enumerate();
            surfaces.map(|(i, s)| s.dot(&d(i))).sum()
        };
        let mut batch = PaperMaterialBatch::default();
        material.forward(&points, &mut batch, &mut Vec::new());
        let mut transposed = Vec::new();
        material.transpose(&mut transposed);
        let mut gradient = vec![0.0; material.n_params()];
        material.backward(&transposed, &mut batch, &[d(0), d(1)], &mut gradient);
        let (mut n_off, mut n) = (0, 0);
        for i in (0..gradient.len()).step_by(17) {
            let numeric = slope(&mut material, |m| &mut m.params[i], 4e-3, loss);
            n_off += usize::from(!agrees(gradient[i], numeric, (3e-2, 2e-3)));
            n += 1;
        }
        // The softplus bends within a hundredth: a step across it is allowed now and then.
        assert!(n_off * 50 <= n, "{n_off} of {n} gradients are off");
    }

    #[test]
    fn training_starts_from_a_grey_glossy_surface_with_one_specular_number() {
        for surface in surfaces(&material(9), &[Vec3::ZERO, Vec3::ONE, Vec3::NEG_ONE]) {
            assert!(
                (surface.roughness - 0.3).abs() < 0.15
                    && (surface.tint - 0.5).abs().max_element() < 0.2,
                "{surface:?}"
            );
            assert_eq!(surface.tint, Vec3::splat(surface.tint.x), "one number");
        }
    }
}
