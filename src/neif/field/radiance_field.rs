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
use crate::neif::networks::hash_grid::{
    FEATURES, FeatureColumns, GridConfig, Level, SamplePoints, encode_level, encode_level_bf16,
    footprint_gradient, scatter_level,
};
use crate::neif::networks::mlp::{Mlp, Transposed, is_sane_width};
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
    config: FieldConfig,
    levels: Vec<Level>,
    /// Density network, colour network, then the levels from coarse to fine.
    pub params: Vec<f32>,
}

impl RadianceField {
    /// A field with random networks and nearly zero grid values; `uniform` draws from `[0, 1)`.
    pub fn new(config: FieldConfig, mut uniform: impl FnMut() -> f32) -> Self {
        let mut field = Self {
            config,
            levels: config.grid.levels(),
            params: Vec::new(),
        };
        let n_networks = field.n_network_params();
        let n_grid: usize = field.levels.iter().map(|l| l.n_entries * FEATURES).sum();
        field.params = vec![0.0; n_networks + n_grid];
        let (density, color) = (field.density_net(), field.color_net());
        let (density_params, rest) = field.params.split_at_mut(density.n_params());
        density.init(density_params, &mut uniform);
        color.init(&mut rest[..color.n_params()], &mut uniform);
        // Start thin (0.37 per field unit) and grey, so that every sample along a ray gets a gradient.
        let last_bias = density_params.len() - WIDTH;
        density_params[last_bias] = -1.0;
        let color_end = color.n_params();
        rest[color_end - WIDTH..color_end - WIDTH + 3].fill(-1.0);
        for value in &mut field.params[n_networks..] {
            *value = (2.0 * uniform() - 1.0) * 1e-2;
        }
        field
    }

    /// A field from stored parameters; `None` when their number does not fit the configuration.
    pub fn from_params(config: FieldConfig, params: Vec<f32>) -> Option<Self> {
        let field = Self {
            config,
            levels: config.grid.levels(),
            params,
        };
        let n_grid: usize = field.levels.iter().map(|l| l.n_entries * FEATURES).sum();
        (field.params.len() == field.n_network_params() + n_grid).then_some(field)
    }

    /// The shape.
    pub fn config(&self) -> &FieldConfig {
        &self.config
    }

    /// The grid's levels, coarse to fine.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Parameters of both networks: the head of [`Self::params`].
    pub fn n_network_params(&self) -> usize {
        self.density_net().n_params() + self.color_net().n_params()
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

    fn level_range(&self, level: usize) -> std::ops::Range<usize> {
        let start: usize = self.n_network_params()
            + self.levels[..level]
                .iter()
                .map(|l| l.n_entries * FEATURES)
                .sum::<usize>();
        start..start + self.levels[level].n_entries * FEATURES
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
        encode_level(
            &self.levels[level],
            &self.params[self.level_range(level)],
            batch.samples.points(),
            out,
        );
    }

    /// [`Self::encode_level`] from `tables`, the grid's part of the parameters in bf16.
    pub fn encode_level_bf16(
        &self,
        level: usize,
        tables: &[u16],
        batch: &FieldBatch,
        out: &mut [f32],
    ) {
        let (range, head) = (self.level_range(level), self.n_network_params());
        encode_level_bf16(
            &self.levels[level],
            &tables[range.start - head..range.end - head],
            batch.samples.points(),
            out,
        );
    }

    /// Adds the gradient of one level's values after [`Self::backward`]; `d_table`: the level's part only.
    pub fn scatter_level(&self, level: usize, batch: &FieldBatch, d_table: &mut [f32]) {
        let layout = FeatureColumns {
            stride: self.config.grid.n_features(),
            column: level * FEATURES,
        };
        scatter_level(
            &self.levels[level],
            SamplePoints {
                positions: &batch.active_positions,
                footprints: &batch.active_footprints,
            },
            &batch.density.d_input,
            layout,
            d_table,
        );
    }

    /// Encodes all levels of a placed batch.
    pub fn encode(&self, batch: &mut FieldBatch, scratch: &mut Vec<f32>) {
        scratch.resize(batch.n() * FEATURES, 0.0);
        for level in 0..self.levels.len() {
            self.encode_level(level, batch, scratch);
            self.insert_level(level, scratch, batch);
        }
    }

    /// Puts one level's features (`[n][4]`) into the batch.
    pub fn insert_level(&self, level: usize, encoded: &[f32], batch: &mut FieldBatch) {
        let width = self.config.grid.n_features();
        batch.features.resize(batch.n() * width, 0.0);
        for (row, values) in batch
            .features
            .chunks_exact_mut(width)
            .zip(encoded.chunks_exact(FEATURES))
        {
            row[level * FEATURES..(level + 1) * FEATURES].copy_from_slice(values);
        }
    }

    /// Writes `batch.radiance` for an encoded batch.
    pub fn forward(&self, batch: &mut FieldBatch) {
        let (density_params, rest) = self.params.split_at(self.density_net().n_params());
        self.density_net()
            .forward(density_params, &batch.features, &mut batch.density);
        batch.composite.forward(
            &batch.density.output,
            batch.samples.deltas(),
            batch.samples.n_per_ray(),
        );
        self.fill_color_input(batch);
        let color_params = &rest[..self.color_net().n_params()];
        self.color_net()
            .forward(color_params, &batch.color_input, &mut batch.color);
        batch.radiance.clear();
        batch.radiance.extend(
            batch
                .color
                .output
                .chunks_exact(16)
                .map(|row| [row[0], row[1], row[2]].map(radiance)),
        );
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
        transposed: &FieldTransposed,
        batch: &mut FieldBatch,
        cut_off: CutOff,
        d_networks: &mut [f32],
    ) {
        let (d_density, d_color) = d_networks.split_at_mut(self.density_net().n_params());
        batch.color.d_output.clear();
        batch.color.d_output.resize(batch.rays.len() * 16, 0.0);
        let rows = batch
            .color
            .d_output
            .chunks_exact_mut(16)
            .zip(batch.color.output.chunks_exact(16));
        for ((d_row, row), (d, value)) in rows.zip(batch.d_radiance.iter().zip(&batch.radiance)) {
            for c in 0..3 {
                d_row[c] = if row[c].abs() < LOG_RADIANCE_MAX {
                    d[c] * value[c]
                } else {
                    0.0
                };
            }
        }
        self.color_net().backward(
            &transposed.color,
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
            batch.samples.n_per_ray(),
            &mut batch.density.d_output,
        );
        batch.keep_active(cut_off, &self.density_net());
        let width = self.config.grid.n_features();
        self.density_net().backward(
            &transposed.density,
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
        let n_per_ray = batch.samples.n_per_ray();
        for (row, &sample) in batch.active.iter().enumerate() {
            let index = sample as usize / n_per_ray;
            let ray = &batch.rays[index];
            // A pixel's ray has no roughness to learn.
            if !ray.kappa.is_finite() {
                continue;
            }
            let columns = row * width..(row + 1) * width;
            let footprint = batch.active_footprints[row];
            let t = batch.samples.distances()[sample as usize];
            let d_footprint = footprint_gradient(
                &self.levels,
                footprint,
                &batch.features[columns.clone()],
                &batch.density.d_input[columns],
            );
            // footprint = c·sqrt(variance), so d footprint / d variance = footprint / (2 variance).
            batch.d_lobe_variance[index] +=
                d_footprint * footprint / (2.0 * ray.cone.variance(t)).max(1e-20) * t * t;
        }
    }

    /// Transposed network weights for [`Self::backward`].
    pub fn transpose(&self, transposed: &mut FieldTransposed) {
        let (density_params, rest) = self.params.split_at(self.density_net().n_params());
        self.density_net()
            .transpose(density_params, &mut transposed.density);
        self.color_net()
            .transpose(&rest[..self.color_net().n_params()], &mut transposed.color);
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
        let params = &self.params[..self.density_net().n_params()];
        self.density_net()
            .forward(params, &batch.features, &mut batch.density);
        batch
            .density
            .output
            .chunks_exact(WIDTH)
            .map(|row| density(row[0]))
            .collect()
    }
}

/// Transposed weights of both networks.
#[derive(Clone, Debug, Default)]
pub struct FieldTransposed {
    density: Transposed,
    color: Transposed,
}

fn radiance(log_radiance: f32) -> f32 {
    let nan = log_radiance * 0.0;
    math::exp::<Baseline>(log_radiance.clamp(-LOG_RADIANCE_MAX, LOG_RADIANCE_MAX)) + nan
}

#[cfg(test)]
mod tests;
