//! The surface field M(x): diffuse colour, specular tint and roughness at points of the object.
//!
//! A small hash grid over the object's box and one hidden layer, in place of the paper's 8 x 512 network.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::values::{DIFFUSE_SHIFT, ROUGHNESS_MIN, ROUGHNESS_SHIFT, Surface};
use crate::neif::kernels::math::{sigmoid, softplus};
use crate::neif::networks::grid::Grid;
use crate::neif::networks::hash_grid::{GridConfig, Level, SamplePoints};
use crate::neif::networks::mlp::{Mlp, MlpBuffers, is_sane_width};
use crate::neif::paper::material::PaperMaterialBatch;

const N_OUT: usize = 16;

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
    /// The shape.
    pub config: MaterialConfig,
    net: Mlp,
    grid: Grid,
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
        let mut material = Self::shaped(config, center - Vec3::splat(0.5 * side), side);
        let mut params = vec![0.0; material.grid.end()];
        material.net.init(&mut params, &mut uniform);
        material.grid.init(&mut params, &mut uniform);
        material.params = params;
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
            params,
            ..Self::shaped(config, corner, side)
        };
        (material.params.len() == material.grid.end()).then_some(material)
    }

    fn shaped(config: MaterialConfig, corner: Vec3, side: f32) -> Self {
        let net = Mlp {
            n_in: config.grid.n_features(),
            n_hidden: config.n_hidden,
            n_out: N_OUT,
        };
        let grid = Grid {
            levels: config.grid.levels(),
            start: net.n_params(),
        };
        Self {
            config,
            net,
            grid,
            corner,
            side,
            params: Vec::new(),
        }
    }

    /// The grid's levels, coarse to fine.
    pub fn levels(&self) -> &[Level] {
        &self.grid.levels
    }

    /// Parameters of the network: the head of [`Self::params`].
    pub fn n_network_params(&self) -> usize {
        self.grid.start
    }

    /// The network with its parameters.
    pub fn network(&self) -> (Mlp, &[f32]) {
        (self.net, &self.params[..self.grid.start])
    }

    /// Evaluates the surface at `points`, world coordinates.
    pub fn forward(&self, points: &[Vec3], batch: &mut MaterialBatch, scratch: &mut Vec<f32>) {
        batch.positions.clear();
        batch.positions.extend(
            points
                .iter()
                .map(|p| ((*p - self.corner) / self.side).to_array()),
        );
        batch.footprints.clear();
        batch.footprints.resize(points.len(), 0.0);
        let at = SamplePoints {
            positions: &batch.positions,
            footprints: &batch.footprints,
        };
        self.grid
            .encode(&self.params, at, scratch, &mut batch.features);
        self.net
            .forward(&self.params, &batch.features, &mut batch.net);
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
    pub fn backward(&self, transposed: &[f32], batch: &mut MaterialBatch, d_network: &mut [f32]) {
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
        self.net
            .backward(transposed, &batch.features, &mut batch.net, d_network);
    }

    /// Adds the gradient of one level's values; `d_table`: the level's part only.
    pub fn scatter_level(&self, level: usize, batch: &MaterialBatch, d_table: &mut [f32]) {
        let at = SamplePoints {
            positions: &batch.positions,
            footprints: &batch.footprints,
        };
        self.grid.scatter(level, at, &batch.net.d_input, d_table);
    }

    /// Writes the transposed weights for [`Self::backward`] where the network's parameters have the weights.
    pub fn transpose(&self, transposed: &mut Vec<f32>) {
        transposed.resize(self.grid.start, 0.0);
        self.net.transpose(&self.params, transposed);
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
    use crate::neif::test_gradients::{assert_agrees, random, slope};

    const CONFIG: MaterialConfig = MaterialConfig {
        grid: GridConfig {
            log2_table_size: 9,
            ..GridConfig::SMALL
        },
        n_hidden: 16,
        rgb_tint: true,
    };

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut material = Material::new(CONFIG, Vec3::ZERO, 2.0, random(3));
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
            let surfaces = batch.surfaces.iter().enumerate();
            surfaces.map(|(i, s)| s.dot(&d(i))).sum::<f64>()
        };
        let mut batch = MaterialBatch::default();
        material.forward(&points, &mut batch, &mut Vec::new());
        batch.d_surfaces = vec![d(0), d(1)];
        let mut transposed = Vec::new();
        material.transpose(&mut transposed);
        let mut gradient = vec![0.0; material.params.len()];
        material.backward(&transposed, &mut batch, &mut gradient[..n_network]);
        for level in 0..4 {
            let table = material.grid.table(level);
            material.scatter_level(level, &batch, &mut gradient[table]);
        }
        let touched = (n_network..gradient.len()).filter(|&i| gradient[i].abs() > 1e-4);
        for i in (0..n_network)
            .step_by(23)
            .chain(touched)
            .collect::<Vec<_>>()
        {
            let numeric = slope(&mut material, |m| &mut m.params[i], 1e-2, loss);
            assert_agrees(&i.to_string(), gradient[i], numeric, (2e-2, 2e-3));
        }
    }

    #[test]
    fn training_starts_from_a_grey_glossy_surface() {
        let material = Material::new(CONFIG, Vec3::ZERO, 2.0, || 0.4);
        let mut batch = MaterialBatch::default();
        material.forward(&[Vec3::ZERO], &mut batch, &mut Vec::new());
        let s = batch.surfaces[0];
        assert!(
            (s.roughness - 0.3).abs() < 0.1 && (s.tint - 0.5).abs().max_element() < 0.1,
            "{s:?}"
        );
    }
}
