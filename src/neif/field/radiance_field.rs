//! The radiance field of the environment, the lamp: cones in, linear radiance out, and back.
//!
//! Hash grid with footprint weights → density network (log density + 15 features) → composited along the ray →
//! one colour network a ray (deferred colour). The paper's ambient network R of Eq. 3, in the fast form.

use serde::{Deserialize, Serialize};

use super::composite::{WIDTH, density};
use super::density_grid::DensityGrid;

pub use super::field_batch::{CutOff, FieldBatch, FieldRay};
use super::proposal::ConeRay;
use super::samples::SampledRay;
use crate::neif::kernels::{Baseline, math};
use crate::neif::networks::grid::Grid;
use crate::neif::networks::hash_grid::{
    GridConfig, Level, SamplePoints, encode_level, encode_level_bf16, footprint_gradient,
};
use crate::neif::networks::mlp::{Mlp, is_sane_width};
use crate::neif::networks::spherical_harmonics::{N_SH, attenuated_sh};

/// Input width of the colour network: 15 features, opacity, 9 harmonics, padding.
const COLOR_INPUT: usize = 32;
/// Distance, in half sides of the inner box, before which a lobe's ray meets nothing.
const LOBE_START: f32 = 0.006;
/// Radiance is `e^x` with `|x|` up to this: 1.6e5, enough for unclipped lamps.
const LOG_RADIANCE_MAX: f32 = 12.0;

/// Shape of a radiance field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldConfig {
    /// The position encoding over the contracted cube.
    pub grid: GridConfig,
    /// Hidden width of both networks, a multiple of 16.
    pub n_hidden: usize,
    /// Whether the colour network sees the direction.
    pub view_dependent: bool,
    /// Whether lobes are encoded with their width (ILE, Eq. 6); without it they are lines.
    #[serde(default = "yes")]
    pub integrated: bool,
    /// Whether the environment is infinitely far: every ray starts at the centre.
    #[serde(default)]
    pub is_far: bool,
}

fn yes() -> bool {
    true
}

impl FieldConfig {
    /// Whether every number is in the supported range.
    pub fn is_sane(&self) -> bool {
        self.grid.is_sane() && is_sane_width(self.n_hidden)
    }
}

/// Parameters of a field and where they lie.
#[derive(Clone, Debug)]
pub struct RadianceField {
    /// The shape.
    pub config: FieldConfig,
    grid: Grid,
    /// Density network, colour network, then the levels from coarse to fine.
    pub params: Vec<f32>,
}

impl RadianceField {
    /// A field with random networks and nearly zero grid values; `uniform` draws from `[0, 1)`.
    pub fn new(config: FieldConfig, mut uniform: impl FnMut() -> f32) -> Self {
        let mut field = Self::shaped(config);
        let mut params = vec![0.0; field.grid.end()];
        let (density, color) = (field.density_net(), field.color_net());
        let (density_params, rest) = params.split_at_mut(density.n_params());
        density.init(density_params, &mut uniform);
        color.init(rest, &mut uniform);
        // Start thin (0.37 per field unit) and grey, so that every sample along a ray gets a gradient.
        let last_bias = density_params.len() - WIDTH;
        density_params[last_bias] = -1.0;
        let color_end = color.n_params();
        rest[color_end - WIDTH..color_end - WIDTH + 3].fill(-1.0);
        field.grid.init(&mut params, &mut uniform);
        field.params = params;
        field
    }

    /// A field from stored parameters; `None` when their number does not fit the configuration.
    pub fn from_params(config: FieldConfig, params: Vec<f32>) -> Option<Self> {
        let field = Self {
            params,
            ..Self::shaped(config)
        };
        (field.params.len() == field.grid.end()).then_some(field)
    }

    fn shaped(config: FieldConfig) -> Self {
        let grid = Grid {
            levels: config.grid.levels(),
            start: 0,
        };
        let mut field = Self {
            config,
            grid,
            params: Vec::new(),
        };
        field.grid.start = field.density_net().n_params() + field.color_net().n_params();
        field
    }

    /// The grid's levels, coarse to fine.
    pub fn levels(&self) -> &[Level] {
        &self.grid.levels
    }

    /// Parameters of both networks: the head of [`Self::params`].
    pub fn n_network_params(&self) -> usize {
        self.grid.start
    }

    /// The density network and the colour network, each with its parameters.
    pub fn networks(&self) -> [(Mlp, &[f32]); 2] {
        let (density, color) = (self.density_net(), self.color_net());
        let (density_params, rest) = self.params.split_at(density.n_params());
        [
            (density, density_params),
            (color, &rest[..color.n_params()]),
        ]
    }

    fn density_net(&self) -> Mlp {
        Mlp {
            n_in: self.config.grid.n_features(),
            n_hidden: self.config.n_hidden,
            n_out: WIDTH,
        }
    }

    fn color_net(&self) -> Mlp {
        Mlp {
            n_in: COLOR_INPUT,
            n_hidden: self.config.n_hidden,
            n_out: 16,
        }
    }

    /// Places `n_per_ray` samples on every ray of the batch; `jitter(ray)` gives the shift of the intervals and of the
    /// samples inside them, each in `[-0.5, 0.5]` (0 when rendering).
    pub fn place(
        &self,
        batch: &mut FieldBatch,
        grid: &DensityGrid,
        n_per_ray: usize,
        uniform_share: f32,
        mut jitter: impl FnMut(usize) -> [f32; 2],
    ) {
        for ray in &mut batch.rays {
            if self.config.is_far {
                ray.cone.origin = [0.0; 3];
                ray.cone.base = 0.0;
            }
            if !self.config.integrated && ray.kappa.is_finite() {
                ray.cone = ConeRay {
                    base: 0.0,
                    spread: 0.0,
                    lobe_variance: 0.0,
                    ..ray.cone
                };
            }
        }
        let rays = batch
            .rays
            .iter()
            .enumerate()
            .map(|(index, ray)| SampledRay {
                cone: ray.cone,
                jitter: jitter(index),
                start: if ray.kappa.is_finite() && !self.config.is_far {
                    LOBE_START
                } else {
                    0.0
                },
            });
        batch.samples.place(grid, n_per_ray, uniform_share, rays);
    }

    /// Weighted features of one level for all samples of a placed batch; `out`: `[n][4]`.
    pub fn encode_level(&self, level: usize, batch: &FieldBatch, out: &mut [f32]) {
        let table = &self.params[self.grid.table(level)];
        encode_level(&self.grid.levels[level], table, batch.samples.points(), out);
    }

    /// [`Self::encode_level`] from `tables`, the grid's part of the parameters in bf16.
    pub fn encode_level_bf16(
        &self,
        level: usize,
        tables: &[u16],
        batch: &FieldBatch,
        out: &mut [f32],
    ) {
        let (range, head) = (self.grid.table(level), self.grid.start);
        let table = &tables[range.start - head..range.end - head];
        encode_level_bf16(&self.grid.levels[level], table, batch.samples.points(), out);
    }

    /// Adds the gradient of one level's values after [`Self::backward`]; `d_table`: the level's part only.
    pub fn scatter_level(&self, level: usize, batch: &FieldBatch, d_table: &mut [f32]) {
        let points = SamplePoints {
            positions: &batch.active_positions,
            footprints: &batch.active_footprints,
        };
        self.grid
            .scatter(level, points, &batch.density.d_input, d_table);
    }

    /// Encodes all levels of a placed batch.
    pub fn encode(&self, batch: &mut FieldBatch, scratch: &mut Vec<f32>) {
        let points = batch.samples.points();
        self.grid
            .encode(&self.params, points, scratch, &mut batch.features);
    }

    /// Puts one level's features (`[n][4]`) into the batch.
    pub fn insert_level(&self, level: usize, encoded: &[f32], batch: &mut FieldBatch) {
        let n = batch.n() * self.grid.width();
        batch.features.resize(n, 0.0);
        self.grid.insert(level, encoded, &mut batch.features);
    }

    /// Writes `batch.radiance` for an encoded batch.
    pub fn forward(&self, batch: &mut FieldBatch) {
        let [(density_net, density_params), (color_net, color_params)] = self.networks();
        density_net.forward(density_params, &batch.features, &mut batch.density);
        batch.composite.forward(
            &batch.density.output,
            &batch.samples.deltas,
            batch.samples.n_per_ray,
        );
        self.fill_color_input(batch);
        color_net.forward(color_params, &batch.color_input, &mut batch.color);
        let rows = batch.color.output.chunks_exact(16);
        batch.radiance.clear();
        batch
            .radiance
            .extend(rows.map(|row| [row[0], row[1], row[2]].map(radiance)));
    }

    fn fill_color_input(&self, batch: &mut FieldBatch) {
        batch.color_input.clear();
        batch
            .color_input
            .resize(batch.rays.len() * COLOR_INPUT, 0.0);
        let rows = batch
            .color_input
            .chunks_exact_mut(COLOR_INPUT)
            .zip(batch.composite.features.chunks_exact(WIDTH));
        for ((row, features), ray) in rows.zip(&batch.rays) {
            row[..WIDTH].copy_from_slice(features);
            if self.config.view_dependent {
                row[WIDTH..WIDTH + N_SH].copy_from_slice(&attenuated_sh(ray.direction, ray.kappa));
            }
        }
    }

    /// Back from `batch.d_radiance` to the networks' gradients (added to `d_networks`), the features' and the lobes'.
    ///
    /// Samples whose gradient is below the cut-off of the greatest on their ray are left out.
    pub fn backward(
        &self,
        transposed: &[f32],
        batch: &mut FieldBatch,
        cut_off: CutOff,
        d_networks: &mut [f32],
    ) {
        let n_density = self.density_net().n_params();
        let (d_density, d_color) = d_networks.split_at_mut(n_density);
        let (density_transposed, color_transposed) = transposed.split_at(n_density);
        batch.color.d_output.clear();
        batch.color.d_output.resize(batch.rays.len() * 16, 0.0);
        let rows = batch
            .color
            .d_output
            .chunks_exact_mut(16)
            .zip(batch.color.output.chunks_exact(16));
        for ((d_row, row), (d, value)) in rows.zip(batch.d_radiance.iter().zip(&batch.radiance)) {
            radiance_backward(row, (*d, *value), d_row);
        }
        self.color_net().backward(
            color_transposed,
            &batch.color_input,
            &mut batch.color,
            d_color,
        );
        batch
            .density
            .d_output
            .resize(batch.density.output.len(), 0.0);
        batch.composite.backward(
            &batch.density.output,
            (&batch.color.d_input, &batch.d_weights),
            batch.samples.n_per_ray,
            &mut batch.density.d_output,
        );
        batch.keep_active(cut_off, &self.density_net());
        let width = self.config.grid.n_features();
        self.density_net().backward(
            density_transposed,
            &batch.features[..batch.active.len() * width],
            &mut batch.density,
            d_density,
        );
        self.lobe_gradients(batch);
    }

    /// `d variance -> d lobe_variance` of each ray that has a lobe.
    fn lobe_gradients(&self, batch: &mut FieldBatch) {
        let width = self.config.grid.n_features();
        batch.d_lobe_variance.clear();
        batch.d_lobe_variance.resize(batch.rays.len(), 0.0);
        let n_per_ray = batch.samples.n_per_ray;
        for (row, &sample) in batch.active.iter().enumerate() {
            let index = sample as usize / n_per_ray;
            let ray = &batch.rays[index];
            // A pixel's ray has no roughness to learn.
            if !ray.kappa.is_finite() {
                continue;
            }
            let columns = row * width..(row + 1) * width;
            let footprint = batch.active_footprints[row];
            let t = batch.samples.distances[sample as usize];
            let d_footprint = footprint_gradient(
                &self.grid.levels,
                footprint,
                &batch.features[columns.clone()],
                &batch.density.d_input[columns],
            );
            // footprint = c·sqrt(variance), so d footprint / d variance = footprint / (2 variance).
            batch.d_lobe_variance[index] +=
                d_footprint * footprint / (2.0 * ray.cone.variance(t)).max(1e-20) * t * t;
        }
    }

    /// Writes the transposed weights for [`Self::backward`] where the networks' parameters have the weights.
    pub fn transpose(&self, transposed: &mut Vec<f32>) {
        transposed.resize(self.grid.start, 0.0);
        let [(density_net, density_params), (color_net, color_params)] = self.networks();
        let (density, color) = transposed.split_at_mut(density_net.n_params());
        density_net.transpose(density_params, density);
        color_net.transpose(color_params, color);
    }

    /// Densities (per field unit) at points of the unit cube with the given footprints.
    pub fn densities(
        &self,
        batch: &mut FieldBatch,
        points: &[([f32; 3], f32)],
        scratch: &mut Vec<f32>,
    ) -> Vec<f32> {
        batch.samples.set_points(points);
        self.encode(batch, scratch);
        let [(density_net, params), _] = self.networks();
        density_net.forward(params, &batch.features, &mut batch.density);
        batch
            .density
            .output
            .chunks_exact(WIDTH)
            .map(|row| density(row[0]))
            .collect()
    }
}

/// `e^x`, which keeps NaN: clamping would hide it from the non-finite check.
pub(in crate::neif) fn radiance(log_radiance: f32) -> f32 {
    let nan = log_radiance * 0.0;
    math::exp::<Baseline>(log_radiance.clamp(-LOG_RADIANCE_MAX, LOG_RADIANCE_MAX)) + nan
}

/// Writes the gradient of the logarithms `row` from that of the radiance `value`; both in the first three columns.
pub(in crate::neif) fn radiance_backward(
    row: &[f32],
    (d, value): ([f32; 3], [f32; 3]),
    d_row: &mut [f32],
) {
    for c in 0..3 {
        d_row[c] = if row[c].abs() < LOG_RADIANCE_MAX {
            d[c] * value[c]
        } else {
            0.0
        };
    }
}

#[cfg(test)]
mod tests;
