//! The radiance field of the surroundings, the lamp: cones in, linear radiance out, and back.
//!
//! Hash grid with footprint weights → density network (log density + 15 features) → composited along the ray →
//! one colour network a ray (deferred colour). The paper's ambient network R of Eq. 3, in the fast form.

use serde::{Deserialize, Serialize};

use super::composite::{CompositeBuffers, WIDTH, density};
use super::hash_grid::{
    FEATURES, FeatureColumns, GridConfig, Level, SamplePoints, encode_level, footprint_gradient,
    scatter_level,
};
use super::kernels::math;
use super::mlp::{Mlp, MlpBuffers, Transposed};
use super::proposal::{
    ConeRay, DensityGrid, Placement, place_samples, sample_cell, sample_in_cube,
};
use super::spherical_harmonics::{N_SH, attenuated_sh};

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
}

/// Parameters of a field and where they lie.
#[derive(Clone, Debug)]
pub struct RadianceField {
    config: FieldConfig,
    levels: Vec<Level>,
    /// Density network, colour network, then the levels from coarse to fine.
    pub params: Vec<f32>,
}

/// One ray to evaluate.
#[derive(Clone, Copy, Debug)]
pub struct FieldRay {
    /// The cone, field coordinates.
    pub cone: ConeRay,
    /// Unit direction, for the view dependence.
    pub direction: [f32; 3],
    /// Concentration of the lobe; infinite for a pixel's ray.
    pub kappa: f32,
}

/// Working memory of one batch of rays, reused from batch to batch.
#[derive(Clone, Debug, Default)]
pub struct FieldBatch {
    /// The rays; `clear` and push.
    pub rays: Vec<FieldRay>,
    n_samples: usize,
    edges: Vec<f32>,
    /// `[n_rays * n_samples]` distances of the samples.
    distances: Vec<f32>,
    deltas: Vec<f32>,
    positions: Vec<[f32; 3]>,
    footprints: Vec<f32>,
    /// `[n][n_levels * 4]`.
    features: Vec<f32>,
    density: MlpBuffers,
    composite: CompositeBuffers,
    color_input: Vec<f32>,
    color: MlpBuffers,
    /// `[n_rays]`: the result of [`RadianceField::forward`].
    pub radiance: Vec<[f32; 3]>,
    /// `[n_rays]`: written by the caller before [`RadianceField::backward`].
    pub d_radiance: Vec<[f32; 3]>,
    /// `[n_rays]`: `d loss / d lobe_variance`.
    pub d_lobe_variance: Vec<f32>,
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

    /// Weighted features of one level for all samples of a placed batch; `out`: `[n][4]`.
    pub fn encode_level(&self, level: usize, batch: &FieldBatch, out: &mut [f32]) {
        encode_level(
            &self.levels[level],
            &self.params[self.level_range(level)],
            batch.points(),
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
            batch.points(),
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
        batch.features.resize(batch.positions.len() * width, 0.0);
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
        batch
            .composite
            .forward(&batch.density.output, &batch.deltas, batch.n_samples);
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
    pub fn backward(
        &self,
        transposed: &FieldTransposed,
        batch: &mut FieldBatch,
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
            &batch.color.d_input,
            batch.n_samples,
            &mut batch.density.d_output,
        );
        self.density_net().backward(
            &transposed.density,
            &batch.features,
            &mut batch.density,
            d_density,
        );
        self.lobe_gradients(batch);
    }

    /// `d variance -> d lobe_variance` of each ray that has a lobe.
    fn lobe_gradients(&self, batch: &mut FieldBatch) {
        let width = self.config.grid.n_features();
        batch.d_lobe_variance.clear();
        for (index, ray) in batch.rays.iter().enumerate() {
            let mut sum = 0.0;
            let samples = index * batch.n_samples..(index + 1) * batch.n_samples;
            // A pixel's ray has no roughness to learn.
            for i in samples.filter(|_| ray.kappa.is_finite()) {
                let columns = i * width..(i + 1) * width;
                let (footprint, t) = (batch.footprints[i], batch.distances[i]);
                let d_footprint = footprint_gradient(
                    &self.levels,
                    footprint,
                    &batch.features[columns.clone()],
                    &batch.density.d_input[columns],
                );
                // footprint = c·sqrt(variance), so d footprint / d variance = footprint / (2 variance).
                sum += d_footprint * footprint / (2.0 * ray.cone.variance(t)).max(1e-20) * t * t;
            }
            batch.d_lobe_variance.push(sum);
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
        batch.positions.clear();
        batch.positions.extend(points.iter().map(|p| p.0));
        batch.footprints.clear();
        batch.footprints.extend(points.iter().map(|p| p.1));
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
    math::exp::<false>(log_radiance.clamp(-LOG_RADIANCE_MAX, LOG_RADIANCE_MAX)) + nan
}

impl FieldBatch {
    /// Samples of all rays.
    pub fn n(&self) -> usize {
        self.positions.len()
    }

    fn points(&self) -> SamplePoints<'_> {
        SamplePoints {
            positions: &self.positions,
            footprints: &self.footprints,
        }
    }

    /// Places `n_samples` on every ray; `jitter(ray)` gives the shift of the intervals and of the samples inside them,
    /// each in `[-0.5, 0.5]` (0 when rendering).
    pub fn place(
        &mut self,
        grid: &DensityGrid,
        n_samples: usize,
        uniform_share: f32,
        mut jitter: impl FnMut(usize) -> [f32; 2],
    ) {
        let n = self.rays.len() * n_samples;
        self.n_samples = n_samples;
        self.edges.resize(n_samples + 1, 0.0);
        self.distances.clear();
        self.deltas.clear();
        self.positions.clear();
        self.footprints.clear();
        self.positions.reserve(n);
        for (index, ray) in self.rays.iter().enumerate() {
            let [shift, inside] = jitter(index);
            place_samples(
                grid,
                &ray.cone,
                Placement {
                    uniform_share,
                    shift,
                },
                &mut self.edges,
            );
            for pair in self.edges.windows(2) {
                let delta = pair[1] - pair[0];
                // The last interval reaches far out: its sample is where its near half lies in disparity.
                let t = if delta > 1.0 {
                    pair[0] + (0.5 + inside)
                } else {
                    pair[0] + delta * (0.5 + inside)
                };
                let (position, footprint) = sample_in_cube(&ray.cone, t);
                // A lobe's ray must not find its light on the surface it starts from, nor inside the object.
                let is_empty = (ray.kappa.is_finite() && t < LOBE_START)
                    || grid.is_void(sample_cell(&ray.cone, t));
                self.distances.push(t);
                self.deltas.push(if is_empty { 0.0 } else { delta });
                self.positions.push(position);
                self.footprints.push(footprint);
            }
        }
    }

    /// Calls `observe(cell, density)` for every sample of a forward pass: keeps the density cache fresh for free.
    pub fn observe_densities(&self, mut observe: impl FnMut(u32, f32)) {
        let rows = self.density.output.chunks_exact(WIDTH);
        for ((index, &t), row) in self.distances.iter().enumerate().zip(rows) {
            let cone = &self.rays[index / self.n_samples].cone;
            observe(sample_cell(cone, t), density(row[0]));
        }
    }

    /// Sum of all feature gradients: non-finite as soon as one of them is.
    pub fn gradient_probe(&self) -> f32 {
        self.density.d_input.iter().map(|v| v * 0.0).sum()
    }

    /// `[n_rays * n_samples]` compositing weights of the last forward pass.
    pub fn weights(&self) -> &[f32] {
        &self.composite.weights
    }

    /// `[n_rays * n_samples]` distances of the samples.
    pub fn distances(&self) -> &[f32] {
        &self.distances
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field() -> RadianceField {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 4,
            finest: 32,
            log2_table_size: 10,
        };
        let mut state = 7_u32;
        RadianceField::new(
            FieldConfig {
                grid,
                n_hidden: 32,
                view_dependent: true,
            },
            move || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32
            },
        )
    }

    fn rays(lobe_variance: f32) -> Vec<FieldRay> {
        let direction = [0.6, 0.48, 0.64];
        let cone = ConeRay {
            origin: [0.1, -0.2, 0.0],
            direction,
            base: 0.002,
            spread: 0.01,
            lobe_variance,
        };
        let lobe = FieldRay {
            cone,
            direction,
            kappa: 50.0,
        };
        let pixel_cone = ConeRay {
            direction: [-0.6, 0.0, 0.8],
            lobe_variance: 0.0,
            ..cone
        };
        vec![
            lobe,
            FieldRay {
                cone: pixel_cone,
                direction: [-0.6, 0.0, 0.8],
                kappa: f32::INFINITY,
            },
        ]
    }

    /// Runs forward; sample positions depend on the rays' paths only, so they do not move between calls.
    fn run(field: &RadianceField, lobe_variance: f32) -> FieldBatch {
        let mut batch = FieldBatch {
            rays: rays(lobe_variance),
            ..FieldBatch::default()
        };
        batch.place(&DensityGrid::default(), 8, 0.5, |_| [0.1, -0.2]);
        field.encode(&mut batch, &mut Vec::new());
        field.forward(&mut batch);
        batch
    }

    const D: [[f32; 3]; 2] = [[0.7, -0.3, 1.1], [0.2, 0.9, -0.5]];

    fn loss(field: &RadianceField, lobe_variance: f32) -> f64 {
        let batch = run(field, lobe_variance);
        batch
            .radiance
            .iter()
            .flatten()
            .zip(D.iter().flatten())
            .map(|(a, b)| f64::from(*a) * f64::from(*b))
            .sum()
    }

    #[test]
    fn gradients_of_all_parameters_agree_with_finite_differences() {
        let mut field = field();
        // Grid values of order one, so that the features matter.
        let n_networks = field.n_network_params();
        for (i, value) in field.params[n_networks..].iter_mut().enumerate() {
            *value = (i as f32 * 0.77).sin() * 0.5;
        }
        let mut batch = run(&field, 0.02);
        batch.d_radiance = D.to_vec();
        let mut transposed = FieldTransposed::default();
        field.transpose(&mut transposed);
        let mut gradient = vec![0.0; field.params.len()];
        field.backward(&transposed, &mut batch, &mut gradient[..n_networks]);
        for level in 0..4 {
            let range = field.level_range(level);
            field.scatter_level(level, &batch, &mut gradient[range]);
        }
        let touched: Vec<usize> = (n_networks..gradient.len())
            .filter(|&i| gradient[i].abs() > 1e-3)
            .step_by(5)
            .collect();
        assert!(touched.len() > 20, "the rays must touch the grid");
        let mut n_off = 0;
        let checked: Vec<usize> = (0..n_networks).step_by(61).chain(touched).collect();
        for &i in &checked {
            let (kept, h) = (field.params[i], 2e-3);
            field.params[i] = kept + h;
            let up = loss(&field, 0.02);
            field.params[i] = kept - h;
            let down = loss(&field, 0.02);
            field.params[i] = kept;
            let numeric = (up - down) / f64::from(2.0 * h);
            let error = (f64::from(gradient[i]) - numeric).abs();
            n_off += usize::from(error > 3e-2 * numeric.abs() + 2e-3);
        }
        // A ReLU kink between the two evaluations is allowed now and then.
        assert!(
            n_off * 50 <= checked.len(),
            "{n_off} of {} gradients are off",
            checked.len()
        );
    }

    #[test]
    fn lobe_width_gradient_agrees_with_finite_differences() {
        let mut field = field();
        let n_networks = field.n_network_params();
        for (i, value) in field.params[n_networks..].iter_mut().enumerate() {
            *value = (i as f32 * 0.77).sin() * 0.5;
        }
        let mut batch = run(&field, 0.02);
        batch.d_radiance = D.to_vec();
        let mut transposed = FieldTransposed::default();
        field.transpose(&mut transposed);
        field.backward(&transposed, &mut batch, &mut vec![0.0; n_networks]);
        let numeric = (loss(&field, 0.021) - loss(&field, 0.019)) / 0.002;
        let analytic = f64::from(batch.d_lobe_variance[0]);
        assert!(
            (analytic - numeric).abs() < 3e-2 * numeric.abs(),
            "{analytic} against {numeric}"
        );
        assert_eq!(batch.d_lobe_variance[1], 0.0, "a pixel's ray has no lobe");
    }
}
