//! The surface field M(x): diffuse colour, specular tint and roughness at points of the object.
//!
//! A small hash grid over the object's box and one hidden layer, in place of the paper's 8 x 512 network.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::values::Surface;
use crate::neif::kernels::math::{sigmoid, softplus};
use crate::neif::networks::hash_grid::{
    FEATURES, FeatureColumns, GridConfig, Level, SamplePoints, encode_level, scatter_level,
};
use crate::neif::networks::mlp::{Mlp, MlpBuffers, Transposed, is_sane_width};
use crate::neif::paper::material::PaperMaterialBatch;

const N_OUT: usize = 16;
/// Shift of the diffuse output: training starts at `softplus(-2) = 0.13`, a dark grey.
const DIFFUSE_SHIFT: f32 = -2.0;
/// Shift of the roughness output: training starts at about 0.3.
const ROUGHNESS_SHIFT: f32 = -0.85;
/// Least learned roughness: below it the lobe is narrower than any pixel, and the gradient is lost.
const ROUGHNESS_MIN: f32 = 0.02;

/// Shape of a surface field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialConfig {
    /// Position encoding over the object's box.
    pub grid: GridConfig,
    /// Hidden width, a multiple of 16.
    pub n_hidden: usize,
    /// Whether the specular tint has a colour; without one it is grey.
    #[serde(default = "yes")]
    pub rgb_tint: bool,
}

fn yes() -> bool {
    true
}

impl MaterialConfig {
    /// Whether every number is in the supported range.
    pub fn is_sane(&self) -> bool {
        self.grid.is_sane() && is_sane_width(self.n_hidden)
    }
}

/// Parameters of a surface field and the cube it lives in.
#[derive(Clone, Debug)]
pub struct Material {
    config: MaterialConfig,
    levels: Vec<Level>,
    /// Lower corner of the cube, world coordinates.
    pub corner: Vec3,
    /// Side of the cube, world units.
    pub side: f32,
    /// The network, then the levels from coarse to fine.
    pub params: Vec<f32>,
}

/// Working memory of one batch of surface points.
#[derive(Clone, Debug, Default)]
pub struct MaterialBatch {
    positions: Vec<[f32; 3]>,
    footprints: Vec<f32>,
    features: Vec<f32>,
    net: MlpBuffers,
    /// What the paper's network keeps instead.
    pub(in crate::neif) paper: PaperMaterialBatch,
    /// The result of [`Material::forward`].
    pub surfaces: Vec<Surface>,
    /// `d loss / d surfaces`, written before [`Material::backward`].
    pub d_surfaces: Vec<Surface>,
}

impl Material {
    /// A grey, glossy surface in the cube around a box with the given centre and side.
    pub fn new(
        config: MaterialConfig,
        center: Vec3,
        side: f32,
        mut uniform: impl FnMut() -> f32,
    ) -> Self {
        let corner = center - Vec3::splat(0.5 * side);
        let mut material = Self {
            config,
            levels: config.grid.levels(),
            corner,
            side,
            params: Vec::new(),
        };
        let n_network = material.n_network_params();
        material.params = vec![0.0; n_network + material.n_grid_params()];
        material
            .net()
            .init(&mut material.params[..n_network], &mut uniform);
        for value in &mut material.params[n_network..] {
            *value = (2.0 * uniform() - 1.0) * 1e-2;
        }
        material
    }

    /// A field from stored parameters; `None` when their number does not fit.
    pub fn from_params(
        config: MaterialConfig,
        corner: Vec3,
        side: f32,
        params: Vec<f32>,
    ) -> Option<Self> {
        let material = Self {
            config,
            levels: config.grid.levels(),
            corner,
            side,
            params,
        };
        (material.params.len() == material.n_network_params() + material.n_grid_params())
            .then_some(material)
    }

    /// The shape.
    pub fn config(&self) -> &MaterialConfig {
        &self.config
    }

    /// The grid's levels, coarse to fine.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Parameters of the network: the head of [`Self::params`].
    pub fn n_network_params(&self) -> usize {
        self.net().n_params()
    }

    /// The network with its parameters.
    pub fn network(&self) -> (Mlp, &[f32]) {
        (self.net(), &self.params[..self.n_network_params()])
    }

    fn n_grid_params(&self) -> usize {
        self.levels.iter().map(|l| l.n_entries * FEATURES).sum()
    }

    fn net(&self) -> Mlp {
        Mlp {
            n_in: self.config.grid.n_features(),
            n_hidden: self.config.n_hidden,
            n_out: N_OUT,
        }
    }

    /// Evaluates the surface at `points`, world coordinates.
    pub fn forward(&self, points: &[Vec3], batch: &mut MaterialBatch, scratch: &mut Vec<f32>) {
        let width = self.config.grid.n_features();
        batch.positions.clear();
        batch.positions.extend(
            points
                .iter()
                .map(|p| ((*p - self.corner) / self.side).to_array()),
        );
        batch.footprints.clear();
        batch.footprints.resize(points.len(), 0.0);
        batch.features.resize(points.len() * width, 0.0);
        scratch.resize(points.len() * FEATURES, 0.0);
        let mut start = self.n_network_params();
        for (index, level) in self.levels.iter().enumerate() {
            let end = start + level.n_entries * FEATURES;
            let at = SamplePoints {
                positions: &batch.positions,
                footprints: &batch.footprints,
            };
            encode_level(level, &self.params[start..end], at, scratch);
            start = end;
            for (row, values) in batch
                .features
                .chunks_exact_mut(width)
                .zip(scratch.chunks_exact(FEATURES))
            {
                row[index * FEATURES..(index + 1) * FEATURES].copy_from_slice(values);
            }
        }
        self.net().forward(
            &self.params[..self.n_network_params()],
            &batch.features,
            &mut batch.net,
        );
        batch.surfaces.clear();
        batch
            .surfaces
            .extend(batch.net.output.chunks_exact(N_OUT).map(activate));
        if !self.config.rgb_tint {
            for surface in &mut batch.surfaces {
                surface.tint = Vec3::splat(surface.tint.x);
            }
        }
    }

    /// Adds the network's gradient to `d_network` and keeps the features' gradient for [`Self::scatter_level`].
    pub fn backward(
        &self,
        transposed: &Transposed,
        batch: &mut MaterialBatch,
        d_network: &mut [f32],
    ) {
        batch.net.d_output.clear();
        batch.net.d_output.resize(batch.net.output.len(), 0.0);
        let rows = batch
            .net
            .d_output
            .chunks_exact_mut(N_OUT)
            .zip(batch.net.output.chunks_exact(N_OUT));
        for ((d_row, row), (d, value)) in rows.zip(batch.d_surfaces.iter().zip(&batch.surfaces)) {
            for c in 0..3 {
                d_row[c] = d.diffuse[c] * sigmoid(row[c] + DIFFUSE_SHIFT);
                d_row[3 + c] = d.tint[c] * value.tint[c] * (1.0 - value.tint[c]);
            }
            if !self.config.rgb_tint {
                d_row[3] = d.tint.element_sum() * value.tint.x * (1.0 - value.tint.x);
                d_row[4..6].fill(0.0);
            }
            let s = (value.roughness - ROUGHNESS_MIN) / (1.0 - ROUGHNESS_MIN);
            d_row[6] = d.roughness * (1.0 - ROUGHNESS_MIN) * s * (1.0 - s);
        }
        self.net()
            .backward(transposed, &batch.features, &mut batch.net, d_network);
    }

    /// Adds the gradient of one level's values; `d_table`: the level's part only.
    pub fn scatter_level(&self, level: usize, batch: &MaterialBatch, d_table: &mut [f32]) {
        let at = SamplePoints {
            positions: &batch.positions,
            footprints: &batch.footprints,
        };
        let layout = FeatureColumns {
            stride: self.config.grid.n_features(),
            column: level * FEATURES,
        };
        scatter_level(&self.levels[level], at, &batch.net.d_input, layout, d_table);
    }

    /// Transposed network weights for [`Self::backward`].
    pub fn transpose(&self, transposed: &mut Transposed) {
        self.net()
            .transpose(&self.params[..self.n_network_params()], transposed);
    }
}

fn activate(row: &[f32]) -> Surface {
    Surface {
        diffuse: Vec3::from_array(std::array::from_fn(|c| softplus(row[c] + DIFFUSE_SHIFT))),
        tint: Vec3::from_array(std::array::from_fn(|c| sigmoid(row[3 + c]))),
        roughness: ROUGHNESS_MIN + (1.0 - ROUGHNESS_MIN) * sigmoid(row[6] + ROUGHNESS_SHIFT),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_agree_with_finite_differences() {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 2,
            finest: 8,
            log2_table_size: 9,
            least_weight: 0.05,
        };
        let config = MaterialConfig {
            grid,
            n_hidden: 16,
            rgb_tint: true,
        };
        let mut state = 3_u32;
        let mut material = Material::new(config, Vec3::ZERO, 2.0, || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        });
        let n_network = material.n_network_params();
        for (i, value) in material.params[n_network..].iter_mut().enumerate() {
            *value = (i as f32 * 0.7).sin();
        }
        let points = [Vec3::new(0.3, -0.2, 0.7), Vec3::new(-0.9, 0.5, 0.1)];
        let d = |i: usize| Surface {
            diffuse: Vec3::new(0.3, -0.8, 0.5) * (1.0 + i as f32),
            tint: Vec3::new(-0.4, 0.9, 0.2),
            roughness: 0.7 - i as f32,
        };
        let loss = |material: &Material| {
            let mut batch = MaterialBatch::default();
            material.forward(&points, &mut batch, &mut Vec::new());
            let terms = batch.surfaces.iter().enumerate();
            terms
                .map(|(i, s)| {
                    f64::from(
                        s.diffuse.dot(d(i).diffuse)
                            + s.tint.dot(d(i).tint)
                            + s.roughness * d(i).roughness,
                    )
                })
                .sum::<f64>()
        };
        let mut batch = MaterialBatch::default();
        material.forward(&points, &mut batch, &mut Vec::new());
        batch.d_surfaces = vec![d(0), d(1)];
        let mut transposed = Transposed::default();
        material.transpose(&mut transposed);
        let mut gradient = vec![0.0; material.params.len()];
        material.backward(&transposed, &mut batch, &mut gradient[..n_network]);
        let mut start = n_network;
        for level in 0..4 {
            let end = start + material.levels[level].n_entries * FEATURES;
            material.scatter_level(level, &batch, &mut gradient[start..end]);
            start = end;
        }
        let touched = (n_network..gradient.len()).filter(|&i| gradient[i].abs() > 1e-4);
        for i in (0..n_network)
            .step_by(23)
            .chain(touched)
            .collect::<Vec<_>>()
        {
            let (kept, h) = (material.params[i], 1e-2);
            material.params[i] = kept + h;
            let up = loss(&material);
            material.params[i] = kept - h;
            let down = loss(&material);
            material.params[i] = kept;
            let numeric = (up - down) / f64::from(2.0 * h);
            assert!(
                (f64::from(gradient[i]) - numeric).abs() < 2e-2 * numeric.abs() + 2e-3,
                "{i}: {} against {numeric}",
                gradient[i]
            );
        }
    }

    #[test]
    fn training_starts_from_a_grey_glossy_surface() {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 2,
            finest: 8,
            log2_table_size: 9,
            least_weight: 0.05,
        };
        let material = Material::new(
            MaterialConfig {
                grid,
                n_hidden: 16,
                rgb_tint: true,
            },
            Vec3::ZERO,
            2.0,
            || 0.4,
        );
        let mut batch = MaterialBatch::default();
        material.forward(&[Vec3::ZERO], &mut batch, &mut Vec::new());
        let s = batch.surfaces[0];
        assert!(
            (s.roughness - 0.3).abs() < 0.1 && (s.tint - 0.5).abs().max_element() < 0.1,
            "{s:?}"
        );
    }
}
