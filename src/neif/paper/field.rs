//! The ambient network R of Eq. 3: a Mip-NeRF field over the integrated lobe encoding, volume-rendered along cones.
//!
//! Encoded interval → 8 x 256 (skip behind the fifth layer) → density and a bottleneck of 256 → with the direction
//! 128 → colour, per sample, then composited. One ray a block: its activations stay near the core.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::encoding::{LEVEL_WIDTH, encode, encode_backward};
use super::gaussian::IntervalGaussian;
use super::network::{Activation, Stack, is_sane_width, padded};
use super::ray_pass::{PaperPlacement, RayLight, RayPass, color};
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::kernels::matmul::{Epilogue, LANES};
use crate::neif::networks::dense::Dense;

/// Shape of the network. The default is the paper's, and mip-NeRF's where the paper is silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperFieldConfig {
    /// Frequencies of the position encoding: 1, 2, 4 ... radians a field unit.
    pub position_levels: usize,
    /// Frequencies of the direction encoding.
    pub direction_levels: usize,
    /// Layers before the density.
    pub depth: usize,
    /// Their width, a multiple of 16.
    pub width: usize,
    /// Width of the layer that sees the direction, a multiple of 16.
    pub view_width: usize,
}

impl Default for PaperFieldConfig {
    fn default() -> Self {
        Self {
            position_levels: 16,
            direction_levels: 4,
            depth: 8,
            width: 256,
            view_width: 128,
        }
    }
}

impl PaperFieldConfig {
    /// Whether a network of this shape can be made.
    pub fn is_sane(&self) -> bool {
        (1..=16).contains(&self.position_levels)
            && (1..=8).contains(&self.direction_levels)
            && (1..=16).contains(&self.depth)
            && is_sane_width(self.width)
            && is_sane_width(self.view_width)
    }

    fn position_width(&self) -> usize {
        self.position_levels * LEVEL_WIDTH
    }

    /// The mean direction, then its encoding.
    fn direction_width(&self) -> usize {
        3 + self.direction_levels * LEVEL_WIDTH
    }
}

/// Parameters of the network and where they lie.
#[derive(Clone, Debug)]
pub struct PaperField {
    /// The shape.
    pub config: PaperFieldConfig,
    stack: Stack,
    /// Column 0 the density, from 16 on the bottleneck.
    head: Dense,
    view: Dense,
    color: Dense,
    /// Stack, head, view layer, colour.
    pub params: Vec<f32>,
}

impl PaperField {
    /// A field with random weights; `uniform` draws from `[0, 1)`.
    pub fn new(config: PaperFieldConfig, mut uniform: impl FnMut() -> f32) -> Self {
        let mut field = Self::shaped(config);
        let mut params = vec![0.0; field.n_params()];
        field.stack.init(&mut params, &mut uniform);
        field.head.init(&mut params, 1.0, &mut uniform);
        field.view.init(&mut params, 2.0, &mut uniform);
        field.color.init(&mut params, 1.0, &mut uniform);
        field.params = params;
        field
    }

    /// A field from stored parameters; `None` when their number does not fit the configuration.
    pub fn from_params(config: PaperFieldConfig, params: Vec<f32>) -> Option<Self> {
        let field = Self {
            params,
            ..Self::shaped(config)
        };
        (field.params.len() == field.n_params()).then_some(field)
    }

    fn shaped(config: PaperFieldConfig) -> Self {
        let width = config.width;
        let position_width = padded(config.position_width());
        let stack = Stack::new(position_width, width, config.depth, Activation::Relu);
        let layer = |n_in, n_out, start| Dense { n_in, n_out, start };
        let head = layer(width, LANES + width, stack.end());
        let view_in = width + padded(config.direction_width());
        let view = layer(view_in, config.view_width, head.end());
        let color = layer(config.view_width, LANES, view.end());
        Self {
            config,
            stack,
            head,
            view,
            color,
            params: Vec::new(),
        }
    }

    /// Number of parameters.
    pub fn n_params(&self) -> usize {
        self.color.end()
    }

    /// Linear radiance of a ray, without what a backward pass would need.
    pub fn radiance(
        &self,
        ray: &FieldRay,
        placement: PaperPlacement,
        light: &mut RayLight,
    ) -> [f32; 3] {
        light.coarse.place(placement);
        self.weigh(ray, &mut light.coarse);
        light.fine.place_by(&light.coarse, placement);
        self.weigh(ray, &mut light.fine);
        self.shade(ray, &mut light.fine);
        light.fine.radiance
    }

    /// Evaluates both passes, each to its radiance.
    pub fn forward(&self, ray: &FieldRay, placement: PaperPlacement, light: &mut RayLight) {
        self.radiance(ray, placement, light);
        self.shade(ray, &mut light.coarse);
    }

    /// Colours and radiance of a pass with weights.
    fn shade(&self, ray: &FieldRay, pass: &mut RayPass) {
        self.fill_view_input(ray, pass);
        self.view.forward(
            &self.params,
            &pass.view_input,
            Epilogue::Relu,
            &mut pass.view,
        );
        self.color
            .forward(&self.params, &pass.view, Epilogue::Linear, &mut pass.color);
        pass.radiance = [0.0; 3];
        for (row, weight) in pass.color.chunks_exact(LANES).zip(&pass.weights) {
            for (sum, raw) in pass.radiance.iter_mut().zip(row) {
                *sum += weight * color(*raw);
            }
        }
    }

    /// Encodes a placed pass, and its compositing weights `T (1 - e^-depth)`.
    fn weigh(&self, ray: &FieldRay, pass: &mut RayPass) {
        let row_width = padded(self.config.position_width());
        let n = pass.edges.len() - 1;
        pass.input.clear();
        pass.input.resize(n * row_width, 0.0);
        pass.gaussians.clear();
        let rows = pass.input.chunks_exact_mut(row_width);
        for (row, pair) in rows.zip(pass.edges.windows(2)) {
            let gaussian = IntervalGaussian::new(ray, pair[0], pair[1]);
            encode(
                gaussian.mean,
                gaussian.variance,
                &mut row[..self.config.position_width()],
            );
            pass.gaussians.push(gaussian);
        }
        self.stack
            .forward(&self.params, &pass.input, &mut pass.stack);
        self.head.forward(
            &self.params,
            pass.stack.output(),
            Epilogue::Linear,
            &mut pass.head,
        );
        pass.composite(self.head.n_out);
    }

    /// Beside every sample's bottleneck, the direction as the lobe sees it: its mean, and damped sinusoids.
    fn fill_view_input(&self, ray: &FieldRay, pass: &mut RayPass) {
        let width = self.config.width;
        pass.direction.clear();
        pass.direction
            .resize(padded(self.config.direction_width()), 0.0);
        pass.direction[..3].copy_from_slice(&ray.cone.direction);
        encode(
            ray.cone.direction,
            direction_slope(ray).map(|slope| slope * ray.cone.lobe_variance),
            &mut pass.direction[self.direction_columns()],
        );
        pass.view_input.clear();
        for row in pass.head.chunks_exact(self.head.n_out) {
            pass.view_input
                .extend_from_slice(&row[LANES..LANES + width]);
            pass.view_input.extend_from_slice(&pass.direction);
        }
    }

    fn direction_columns(&self) -> Range<usize> {
        3..self.config.direction_width()
    }

    /// Back from `d_radiance` of an evaluated pass: adds to `d_params`, returns `d lobe_variance` of the ray.
    ///
    /// The samples' places take no part, as in mip-NeRF; nor does the lobe's mean length, as in the fast model.
    pub fn backward(
        &self,
        transposed: &[f32],
        ray: &FieldRay,
        d_radiance: [f32; 3],
        pass: &mut RayPass,
        d_params: &mut [f32],
    ) -> f32 {
        pass.composite_backward(d_radiance, self.head.n_out);
        let rows = (pass.view.as_slice(), pass.d_color.as_slice());
        let mask = Epilogue::MaskBy(&pass.view);
        self.color
            .backward(transposed, rows, mask, d_params, &mut pass.d_view);
        let (rows, all) = ((&*pass.view_input, &*pass.d_view), Epilogue::Linear);
        self.view
            .backward(transposed, rows, all, d_params, &mut pass.d_view_input);
        self.split_view_gradient(pass);
        let rows = (pass.stack.output(), pass.d_head.as_slice());
        self.head
            .backward(transposed, rows, all, d_params, &mut pass.d_stack);
        self.stack.backward(
            transposed,
            &pass.input,
            &pass.d_stack,
            &mut pass.stack,
            d_params,
        );
        self.lobe_gradient(ray, pass)
    }

    /// Puts the bottleneck's gradient into `d_head`, and the direction's, summed over the samples, into its place.
    fn split_view_gradient(&self, pass: &mut RayPass) {
        let width = self.config.width;
        pass.d_direction.clear();
        pass.d_direction.resize(pass.direction.len(), 0.0);
        let rows = pass.d_view_input.chunks_exact(self.view.n_in);
        for (row, d_head) in rows.zip(pass.d_head.chunks_exact_mut(self.head.n_out)) {
            d_head[LANES..].copy_from_slice(&row[..width]);
            for (sum, d) in pass.d_direction.iter_mut().zip(&row[width..]) {
                *sum += d;
            }
        }
    }

    fn lobe_gradient(&self, ray: &FieldRay, pass: &RayPass) -> f32 {
        // A pixel's ray has no roughness to learn.
        if ray.kappa.is_infinite() {
            return 0.0;
        }
        let row_width = padded(self.config.position_width());
        let columns = ..self.config.position_width();
        let rows = pass
            .input
            .chunks_exact(row_width)
            .zip(pass.stack.d_input.chunks_exact(row_width));
        let mut sum = 0.0;
        for ((row, d_row), gaussian) in rows.zip(&pass.gaussians) {
            let d_variance = encode_backward(&row[columns], &d_row[columns]);
            for (d, slope) in d_variance.iter().zip(gaussian.d_variance) {
                sum += d * slope;
            }
        }
        let columns = self.direction_columns();
        let d_variance =
            encode_backward(&pass.direction[columns.clone()], &pass.d_direction[columns]);
        for (d, slope) in d_variance.iter().zip(direction_slope(ray)) {
            sum += d * slope;
        }
        sum
    }

    /// Writes the transposed weights for [`Self::backward`] where the parameters have the weights.
    pub fn transpose(&self, transposed: &mut Vec<f32>) {
        transposed.resize(self.params.len(), 0.0);
        self.stack.transpose(&self.params, transposed);
        for layer in [self.head, self.view, self.color] {
            layer.transpose(&self.params, transposed);
        }
    }
}

/// Variance of a lobe's directions per axis, for a lobe variance of 1: `1 - l_i²`.
fn direction_slope(ray: &FieldRay) -> [f32; 3] {
    ray.direction.map(|l| (1.0 - l * l).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::field::proposal::ConeRay;
    use crate::neif::test_gradients::{agrees, dot, random, slope};

    const D: [f32; 3] = [0.7, -0.3, 1.1];
    const PLACEMENT: PaperPlacement = PaperPlacement {
        n_samples: 8,
        uniform_share: 0.5,
        shifts: [0.1, -0.2],
    };

    fn field() -> PaperField {
        let config = PaperFieldConfig {
            position_levels: 3,
            direction_levels: 2,
            depth: 4,
            width: 16,
            view_width: 16,
        };
        PaperField::new(config, random(3))
    }

    fn ray(lobe_variance: f32) -> FieldRay {
        let direction = [0.6, 0.48, 0.64];
        FieldRay {
            cone: ConeRay {
                origin: [0.1, -0.2, 0.0],
                direction: direction.map(|v| v * 0.95),
                base: 0.002,
                spread: 0.01,
                lobe_variance,
            },
            direction,
            kappa: 20.0,
        }
    }

    /// Both passes at fixed places.
    fn run(field: &PaperField, ray: &FieldRay, edges: &[f32]) -> RayPass {
        let mut pass = RayPass {
            edges: edges.to_vec(),
            ..RayPass::default()
        };
        field.weigh(ray, &mut pass);
        field.shade(ray, &mut pass);
        pass
    }

    fn loss(field: &PaperField, ray: &FieldRay, edges: &[f32]) -> f64 {
        dot(&run(field, ray, edges).radiance, &D)
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let (mut field, ray) = (field(), ray(0.05));
        let mut light = RayLight::default();
        field.forward(&ray, PLACEMENT, &mut light);
        let mut transposed = Vec::new();
        field.transpose(&mut transposed);
        for pass in light.passes() {
            let edges = pass.edges.clone();
            let mut gradient = vec![0.0; field.n_params()];
            let d_lobe = field.backward(&transposed, &ray, D, pass, &mut gradient);
            let (mut n_off, mut n) = (0, 0);
            for i in (0..gradient.len()).step_by(13) {
                let numeric = slope(
                    &mut field,
                    |field| &mut field.params[i],
                    4e-3,
                    |field| loss(field, &ray, &edges),
                );
                n_off += usize::from(!agrees(gradient[i], numeric, (3e-2, 5e-4)));
                n += 1;
            }
            // A ReLU kink between the two evaluations is allowed now and then.
            assert!(n_off * 25 <= n, "{n_off} of {n} gradients are off");
            // The best of three steps: a kink may lie within the longer ones, rounding spoils the shorter ones.
            let error = |h: f32| {
                let by_width = |ray: &FieldRay| loss(&field, ray, &edges);
                let numeric = slope(&mut { ray }, |r| &mut r.cone.lobe_variance, h, by_width);
                (f64::from(d_lobe) / numeric - 1.0).abs()
            };
            let least = error(2e-4).min(error(1e-3)).min(error(4e-3));
            assert!(least < 0.02, "lobe: {d_lobe} is off by {least}");
        }
    }

    #[test]
    fn rendering_gives_the_radiance_that_training_sees() {
        let (field, ray) = (field(), ray(0.05));
        let (mut a, mut b) = (RayLight::default(), RayLight::default());
        field.forward(&ray, PLACEMENT, &mut a);
        assert_eq!(field.radiance(&ray, PLACEMENT, &mut b), a.fine.radiance);
    }

    #[test]
    fn the_paper_s_network_has_its_size() {
        let field = PaperField::shaped(PaperFieldConfig::default());
        // 8 layers, 1 + 15 unused columns and 256 of the head, the view layer, 3 + 13 of the colour.
        let layers = 97 * 256 + 4 * 257 * 256 + 353 * 256 + 2 * 257 * 256;
        let expected = layers + 257 * 272 + 289 * 128 + 129 * 16;
        assert_eq!(field.n_params(), expected);
    }

    #[test]
    fn nan_weights_stay_visible() {
        let mut field = field();
        let last = field.params.len() - LANES;
        field.params[last] = f32::NAN;
        let radiance = field.radiance(&ray(0.0), PLACEMENT, &mut RayLight::default());
        assert!(radiance[0].is_nan(), "a NaN must reach the check");
    }
}
