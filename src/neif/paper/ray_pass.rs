//! One pass along one ray: where it samples, what it keeps, and volume rendering forward and backward.

use super::gaussian::IntervalGaussian;
use super::network::StackBuffers;
use super::sampling::{coarse_edges, fine_edges};
use crate::neif::kernels::math::{sigmoid, softplus};
use crate::neif::kernels::matmul::LANES;

/// Shift of the density before its softplus, as in mip-NeRF: training starts thin.
const DENSITY_SHIFT: f32 = -1.0;
/// Colours are `sigmoid(x) (1 + 2 p) - p`, so that black and white can be reached (mip-NeRF).
const COLOR_PADDING: f32 = 1e-3;

/// How a ray is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperPlacement {
    /// Samples of each pass.
    pub n_samples: usize,
    /// Even part of the second pass's samples, `[0, 1]`.
    pub uniform_share: f32,
    /// Shifts of the two passes, in intervals, `[-0.5, 0.5]`; 0 when rendering.
    pub shifts: [f32; 2],
}

/// Working memory of one pass along one ray.
#[derive(Clone, Debug, Default)]
pub struct RayPass {
    /// `[n + 1]` distances between which the samples lie: set before a pass.
    pub(super) edges: Vec<f32>,
    pub(super) gaussians: Vec<IntervalGaussian>,
    /// `[n][padded position width]`.
    pub(super) input: Vec<f32>,
    pub(super) stack: StackBuffers,
    /// `[n][16 + width]`.
    pub(super) head: Vec<f32>,
    /// `[padded direction width]`: the same for all samples.
    pub(super) direction: Vec<f32>,
    pub(super) d_direction: Vec<f32>,
    /// `[n][width + padded direction width]`.
    pub(super) view_input: Vec<f32>,
    pub(super) view: Vec<f32>,
    /// `[n][16]`.
    pub(super) color: Vec<f32>,
    pub(super) weights: Vec<f32>,
    /// `[3]` linear radiance of the ray.
    pub radiance: [f32; 3],
    pub(super) d_color: Vec<f32>,
    pub(super) d_view: Vec<f32>,
    pub(super) d_view_input: Vec<f32>,
    pub(super) d_head: Vec<f32>,
    pub(super) d_stack: Vec<f32>,
}

/// Both passes along one ray: the same network, first stratified, then where the first found something.
#[derive(Clone, Debug, Default)]
pub struct RayLight {
    /// Stratified samples.
    pub coarse: RayPass,
    /// Samples by the weights of the first pass.
    pub fine: RayPass,
}

impl RayLight {
    /// The passes, coarse first.
    pub fn passes(&mut self) -> [&mut RayPass; 2] {
        [&mut self.coarse, &mut self.fine]
    }
}

impl RayPass {
    pub(super) fn place(&mut self, placement: PaperPlacement) {
        self.edges.resize(placement.n_samples + 1, 0.0);
        coarse_edges(placement.shifts[0], &mut self.edges);
    }

    pub(super) fn place_by(&mut self, coarse: &Self, placement: PaperPlacement) {
        self.edges.resize(placement.n_samples + 1, 0.0);
        fine_edges(
            &coarse.edges,
            &coarse.weights,
            placement.uniform_share,
            placement.shifts[1],
            &mut self.edges,
        );
    }

    /// Optical depths `softplus(raw - 1) delta` (Eq. 1 with the lengths it omits) and weights.
    pub(super) fn composite(&mut self, stride: usize) {
        self.weights.clear();
        let mut transmittance = 1.0;
        for (row, pair) in self.head.chunks_exact(stride).zip(self.edges.windows(2)) {
            let depth = softplus(row[0] + DENSITY_SHIFT) * (pair[1] - pair[0]);
            let weight = transmittance * -(-depth).exp_m1();
            self.weights.push(weight);
            transmittance -= weight;
        }
    }

    /// Writes `d_color` and the density column of `d_head` from `d_radiance`.
    ///
    /// `d depth_i = d w_i T_(i+1) - Σ_(k>i) d w_k w_k`, as every later weight scales with `e^-depth_i`.
    pub(super) fn composite_backward(&mut self, d_radiance: [f32; 3], stride: usize) {
        let n = self.weights.len();
        self.d_color.clear();
        self.d_color.resize(n * LANES, 0.0);
        self.d_head.clear();
        self.d_head.resize(n * stride, 0.0);
        let mut transmittance_after = 1.0 - self.weights.iter().sum::<f32>();
        let mut behind = 0.0;
        for i in (0..n).rev() {
            let weight = self.weights[i];
            let raw = &self.color[i * LANES..][..3];
            let mut d_weight = 0.0;
            for (c, d) in d_radiance.iter().enumerate() {
                d_weight += d * color(raw[c]);
                self.d_color[i * LANES + c] = d * weight * color_slope(raw[c]);
            }
            let d_depth = d_weight * transmittance_after - behind;
            behind += d_weight * weight;
            transmittance_after += weight;
            let length = self.edges[i + 1] - self.edges[i];
            let slope = sigmoid(self.head[i * stride] + DENSITY_SHIFT);
            self.d_head[i * stride] = d_depth * length * slope;
        }
    }
}

/// Colour in `[-p, 1 + p]`; NaN stays NaN for the non-finite check.
pub(super) fn color(raw: f32) -> f32 {
    sigmoid(raw) * (1.0 + 2.0 * COLOR_PADDING) - COLOR_PADDING + raw * 0.0
}

fn color_slope(raw: f32) -> f32 {
    let s = sigmoid(raw);
    s * (1.0 - s) * (1.0 + 2.0 * COLOR_PADDING)
}
