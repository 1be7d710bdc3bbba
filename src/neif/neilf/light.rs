//! The incident light field `L(x, w) -> RGB`: a grid over directions, a grid over surface points, and a network.
//!
//! `NeILF` encodes the direction by sinusoids and joins the point in the middle of an 8 x 128 network of sines
//! (Sec. 3.3 of arXiv:2203.07182). Here the direction is encoded by a multi-resolution grid around the unit sphere, which
//! holds a sharp reflection as well as any encoding, and the point by a second grid; a small network joins the two.

use std::ops::Range;

use glam::Vec3;

use crate::neif::field::radiance_field::{radiance, radiance_backward};
use crate::neif::kernels::matmul::Epilogue;
use crate::neif::networks::dense::Dense;
use crate::neif::networks::grid::Grid;
use crate::neif::networks::hash_grid::{
    FEATURES, FeatureColumns, GridConfig, Level, SamplePoints, encode_level, scatter_level,
};
use crate::neif::paper::network::{Activation, Stack, StackBuffers};

/// Width of the padded output: three colours are used.
const N_OUT: usize = 16;
/// Logarithm of the radiance that training starts with.
const INITIAL_LOG_RADIANCE: f32 = -1.0;
/// Rows that pass through the network together, about: their activations stay in the second cache.
const TILE: usize = 192;

/// Shape of an incident light field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncidentLightConfig {
    /// Encoding of the direction, over the cube around the unit sphere.
    pub directions: GridConfig,
    /// Encoding of the surface point, over the object's cube.
    pub positions: GridConfig,
    /// Hidden width, a multiple of 16.
    pub width: usize,
    /// Hidden layers.
    pub depth: usize,
}

impl IncidentLightConfig {
    fn n_features(&self) -> usize {
        self.directions.n_features() + self.positions.n_features()
    }
}

/// Parameters of an incident light field and where they lie.
#[derive(Clone, Debug)]
pub struct IncidentLight {
    config: IncidentLightConfig,
    /// The levels of the directions, then those of the positions.
    grid: Grid,
    stack: Stack,
    output: Dense,
    corner: Vec3,
    side: f32,
    /// The network, then the levels in their order.
    pub params: Vec<f32>,
}

/// Light rows of some surface points: each point has directions of its own number.
#[derive(Clone, Debug, Default)]
pub struct LightBatch {
    /// `[n_points]` in the unit cube.
    positions: Vec<[f32; 3]>,
    /// `[n_rows]` in the unit cube.
    directions: Vec<[f32; 3]>,
    /// `[n_points]`: one past each point's last row.
    ends: Vec<usize>,
    /// Footprints of all of them.
    zeros: Vec<f32>,
    encoded: Vec<f32>,
    /// `[n_rows][n_features]`, and its gradient.
    features: Vec<f32>,
    d_features: Vec<f32>,
    /// `[n_points][features of the position]`: the gradient summed over a point's rows.
    d_position_features: Vec<f32>,
    network: StackBuffers,
    output: Vec<f32>,
    d_output: Vec<f32>,
    d_hidden: Vec<f32>,
    /// `[n_rows]`, linear: the result of [`IncidentLight::forward`].
    pub radiance: Vec<Vec3>,
    /// `[n_rows]`, written before [`IncidentLight::backward`].
    pub d_radiance: Vec<Vec3>,
}

impl LightBatch {
    /// Forgets all points.
    pub fn clear(&mut self) {
        self.positions.clear();
        self.directions.clear();
        self.ends.clear();
    }

    /// Number of rows: directions of all points.
    pub fn n_rows(&self) -> usize {
        self.directions.len()
    }

    /// Rows of a point.
    pub fn rows(&self, point: usize) -> Range<usize> {
        let start = point.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[point]
    }

    /// The points in groups whose rows pass through the network together.
    pub fn tiles(&self) -> Vec<Range<usize>> {
        let mut tiles = Vec::new();
        let mut first = 0;
        for point in 0..self.ends.len() {
            let n = self.ends[point] - self.rows(first).start;
            if n >= TILE || point + 1 == self.ends.len() {
                tiles.push(first..point + 1);
                first = point + 1;
            }
        }
        tiles
    }

    fn rows_of(&self, points: &Range<usize>) -> Range<usize> {
        if points.is_empty() {
            return 0..0;
        }
        self.rows(points.start).start..self.ends[points.end - 1]
    }
}

impl IncidentLight {
    /// A grey light in the object's cube; `uniform` draws from `[0, 1)`.
    pub fn new(
        config: IncidentLightConfig,
        corner: Vec3,
        side: f32,
        mut uniform: impl FnMut() -> f32,
    ) -> Self {
        let mut levels = config.directions.levels();
        levels.extend(config.positions.levels());
        let stack = Stack::new(
            config.n_features(),
            config.width,
            config.depth,
            Activation::Relu,
        );
        let output = Dense {
            n_in: config.width,
            n_out: N_OUT,
            start: stack.end(),
        };
        let grid = Grid {
            levels,
            start: output.end(),
        };
        let mut params = vec![0.0; grid.end()];
        stack.init(&mut params, &mut uniform);
        output.init(&mut params, 1.0, &mut uniform);
        let bias = output.end() - N_OUT;
        params[bias..bias + 3].fill(INITIAL_LOG_RADIANCE);
        grid.init(&mut params, &mut uniform);
        Self {
            config,
            grid,
            stack,
            output,
            corner,
            side,
            params,
        }
    }

    /// The levels of both grids, in the order of the parameters.
    pub fn levels(&self) -> &[Level] {
        &self.grid.levels
    }

    /// Parameters of the network: the head of [`Self::params`].
    pub fn n_network_params(&self) -> usize {
        self.grid.start
    }

    /// Adds a point (world coordinates) with the directions (unit) that its light is asked for.
    pub fn push(&self, batch: &mut LightBatch, point: Vec3, directions: &[Vec3]) {
        batch
            .positions
            .push(((point - self.corner) / self.side).to_array());
        let in_cube = |d: &Vec3| (*d * 0.5 + Vec3::splat(0.5)).to_array();
        batch.directions.extend(directions.iter().map(in_cube));
        batch.ends.push(batch.directions.len());
    }

    fn is_of_directions(&self, level: usize) -> bool {
        level < self.config.directions.n_levels
    }

    fn points_of<'a>(&self, level: usize, batch: &'a LightBatch) -> SamplePoints<'a> {
        let positions = if self.is_of_directions(level) {
            &batch.directions
        } else {
            &batch.positions
        };
        SamplePoints {
            positions,
            footprints: &batch.zeros[..positions.len()],
        }
    }

    /// Encodes all rows of the batch.
    pub fn encode(&self, batch: &mut LightBatch) {
        let width = self.config.n_features();
        let n = batch.n_rows().max(batch.positions.len());
        batch.zeros.resize(n, 0.0);
        batch.features.resize(batch.n_rows() * width, 0.0);
        batch.radiance.resize(batch.n_rows(), Vec3::ZERO);
        for (index, level) in self.grid.levels.iter().enumerate() {
            let mut encoded = std::mem::take(&mut batch.encoded);
            let points = self.points_of(index, batch);
            encoded.resize(points.positions.len() * FEATURES, 0.0);
            let table = &self.params[self.grid.table(index)];
            encode_level(level, table, points, &mut encoded);
            if self.is_of_directions(index) {
                self.grid.insert(index, &encoded, &mut batch.features);
            } else {
                let columns = index * FEATURES..(index + 1) * FEATURES;
                for (point, values) in encoded.chunks_exact(FEATURES).enumerate() {
                    let rows = batch.rows(point);
                    let rows = &mut batch.features[rows.start * width..rows.end * width];
                    for row in rows.chunks_exact_mut(width) {
                        row[columns.clone()].copy_from_slice(values);
                    }
                }
            }
            batch.encoded = encoded;
        }
    }

    /// Writes the radiance of the rows of `points` of an encoded batch.
    pub fn forward(&self, batch: &mut LightBatch, points: &Range<usize>) {
        let (width, rows) = (self.config.n_features(), batch.rows_of(points));
        let input = &batch.features[rows.start * width..rows.end * width];
        self.stack.forward(&self.params, input, &mut batch.network);
        let hidden = batch.network.output();
        self.output
            .forward(&self.params, hidden, Epilogue::Linear, &mut batch.output);
        let values = batch.output.chunks_exact(N_OUT);
        for (out, row) in batch.radiance[rows].iter_mut().zip(values) {
            *out = Vec3::new(row[0], row[1], row[2]).map(radiance);
        }
    }

    /// From `batch.d_radiance` of the rows of `points`, right after [`Self::forward`] of the same points: adds to
    /// `d_network` and keeps the features' gradient.
    pub fn backward(
        &self,
        transposed: &[f32],
        batch: &mut LightBatch,
        points: &Range<usize>,
        d_network: &mut [f32],
    ) {
        let (width, rows) = (self.config.n_features(), batch.rows_of(points));
        batch.d_features.resize(batch.features.len(), 0.0);
        batch.d_output.clear();
        batch.d_output.resize(rows.len() * N_OUT, 0.0);
        let d_rows = batch.d_output.chunks_exact_mut(N_OUT);
        let values = batch.d_radiance[rows.clone()]
            .iter()
            .zip(&batch.radiance[rows.clone()]);
        for ((d_row, row), (d, value)) in d_rows.zip(batch.output.chunks_exact(N_OUT)).zip(values) {
            radiance_backward(row, (d.to_array(), value.to_array()), d_row);
        }
        let hidden = batch.network.output();
        let (d_rows, all) = ((hidden, &*batch.d_output), Epilogue::Linear);
        self.output
            .backward(transposed, d_rows, all, d_network, &mut batch.d_hidden);
        let span = rows.start * width..rows.end * width;
        self.stack.backward(
            transposed,
            &batch.features[span.clone()],
            &batch.d_hidden,
            &mut batch.network,
            d_network,
        );
        batch.d_features[span].copy_from_slice(&batch.network.d_input);
    }

    /// Sums the features' gradient over the rows of each point, after the last [`Self::backward`].
    pub fn sum_positions(&self, batch: &mut LightBatch) {
        let (width, first) = (
            self.config.n_features(),
            self.config.directions.n_features(),
        );
        let n = width - first;
        batch.d_position_features.clear();
        batch.d_position_features.resize(batch.ends.len() * n, 0.0);
        for point in 0..batch.ends.len() {
            let rows = batch.rows(point);
            let sum = &mut batch.d_position_features[point * n..(point + 1) * n];
            let rows = &batch.d_features[rows.start * width..rows.end * width];
            for row in rows.chunks_exact(width) {
                for (sum, d) in sum.iter_mut().zip(&row[first..]) {
                    *sum += d;
                }
            }
        }
    }

    /// Adds the gradient of one level's values; `d_table`: the level's part only.
    pub fn scatter_level(&self, level: usize, batch: &LightBatch, d_table: &mut [f32]) {
        let points = self.points_of(level, batch);
        if self.is_of_directions(level) {
            let n = points.positions.len() * self.grid.width();
            self.grid
                .scatter(level, points, &batch.d_features[..n], d_table);
        } else {
            let layout = FeatureColumns {
                stride: self.config.positions.n_features(),
                column: level * FEATURES - self.config.directions.n_features(),
            };
            let d_features = &batch.d_position_features[..points.positions.len() * layout.stride];
            scatter_level(
                &self.grid.levels[level],
                points,
                d_features,
                layout,
                d_table,
            );
        }
    }

    /// Transposed weights for [`Self::backward`].
    pub fn transpose(&self, transposed: &mut Vec<f32>) {
        transposed.resize(self.n_network_params(), 0.0);
        self.stack.transpose(&self.params, transposed);
        self.output.transpose(&self.params, transposed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::neilf::brdf::hemisphere;
    use crate::neif::test_gradients::{agrees, random, slope};

    fn field() -> IncidentLight {
        let grid = |finest: u32| GridConfig {
            finest,
            ..GridConfig::SMALL
        };
        let config = IncidentLightConfig {
            directions: grid(16),
            positions: grid(6),
            width: 32,
            depth: 2,
        };
        let mut uniform = random(3);
        let mut light = IncidentLight::new(config, Vec3::splat(-1.0), 2.0, &mut uniform);
        // Grids that matter, as after some training.
        let n = light.n_network_params();
        for value in &mut light.params[n..] {
            *value = uniform() - 0.5;
        }
        light
    }

    /// Three points with 1, 250 and 9 directions: two tiles.
    fn batch(light: &IncidentLight) -> LightBatch {
        let mut batch = LightBatch::default();
        for (n, x) in [(1, 0.1), (250, -0.6), (9, 0.7)] {
            let point = Vec3::new(x, 0.3 - x, 0.2);
            light.push(&mut batch, point, &hemisphere(n));
        }
        batch
    }

    fn run(light: &IncidentLight, batch: &mut LightBatch) {
        light.encode(batch);
        for tile in batch.tiles() {
            light.forward(batch, &tile);
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut light = field();
        let mut batch = batch(&light);
        let weight = |row: usize| Vec3::new(0.3, -0.2, 0.5) * (row as f32 * 0.7).sin();
        let loss = |light: &IncidentLight, batch: &mut LightBatch| -> f64 {
            run(light, batch);
            let rows = batch.radiance.iter().enumerate();
            rows.map(|(i, l)| f64::from(l.dot(weight(i)))).sum()
        };
        let n = light.n_network_params();
        let mut gradient = vec![0.0; light.params.len()];
        let mut transposed = Vec::new();
        light.transpose(&mut transposed);
        light.encode(&mut batch);
        batch.d_radiance = (0..batch.n_rows()).map(weight).collect();
        for tile in batch.tiles() {
            light.forward(&mut batch, &tile);
            light.backward(&transposed, &mut batch, &tile, &mut gradient[..n]);
        }
        light.sum_positions(&mut batch);
        for level in 0..light.levels().len() {
            let table = light.grid.table(level);
            light.scatter_level(level, &batch, &mut gradient[table]);
        }
        // The greatest gradients of network and grids: the others drown in rounding.
        for range in [0..n, n..light.params.len()] {
            let mut order: Vec<usize> = range.collect();
            order.sort_by(|&a, &b| gradient[b].abs().total_cmp(&gradient[a].abs()));
            let mut n_off = 0;
            for &i in order.iter().step_by(3).take(40) {
                let numeric = slope(
                    &mut light,
                    |light| &mut light.params[i],
                    1e-3,
                    |light| loss(light, &mut batch),
                );
                n_off += usize::from(!agrees(gradient[i], numeric, (2e-2, 1e-3)));
            }
            // A kink between the two evaluations is allowed now and then.
            assert!(n_off <= 3, "{n_off} gradients are off");
        }
    }

    #[test]
    fn tiles_do_not_change_the_light() {
        let light = field();
        let mut batch = batch(&light);
        assert_eq!(batch.tiles().len(), 2, "one tile shows nothing");
        run(&light, &mut batch);
        let tiled = batch.radiance.clone();
        light.forward(&mut batch, &(0..3));
        assert_eq!(batch.radiance, tiled);
    }
}
