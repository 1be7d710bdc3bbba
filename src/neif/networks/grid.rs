//! All levels of a field's position encoding, and where their values and features lie.

use std::ops::Range;

use super::hash_grid::{
    FEATURES, FeatureColumns, Level, SamplePoints, encode_level, scatter_level,
};

/// Levels with their values in a parameter vector, one after the other.
#[derive(Clone, Debug)]
pub struct Grid {
    /// From coarse to fine.
    pub levels: Vec<Level>,
    /// First parameter.
    pub start: usize,
}

impl Grid {
    /// One past the last parameter.
    pub fn end(&self) -> usize {
        self.table(self.levels.len()).end
    }

    /// Parameters of one level; none beyond the last.
    pub fn table(&self, level: usize) -> Range<usize> {
        let before = self.levels[..level].iter().map(Level::n_values);
        let start = self.start + before.sum::<usize>();
        start..start + self.levels.get(level).map_or(0, Level::n_values)
    }

    /// Nearly zero values; `uniform` draws from `[0, 1)`.
    pub fn init(&self, params: &mut [f32], uniform: &mut impl FnMut() -> f32) {
        for value in &mut params[self.start..self.end()] {
            *value = (2.0 * uniform() - 1.0) * 1e-2;
        }
    }

    /// Width of a row of features.
    pub fn width(&self) -> usize {
        self.levels.len() * FEATURES
    }

    /// Writes the weighted features of all levels; `features`: `[n][width]`.
    pub fn encode(
        &self,
        params: &[f32],
        points: SamplePoints<'_>,
        scratch: &mut Vec<f32>,
        features: &mut Vec<f32>,
    ) {
        let n = points.positions.len();
        scratch.resize(n * FEATURES, 0.0);
        features.resize(n * self.width(), 0.0);
        for (index, level) in self.levels.iter().enumerate() {
            encode_level(level, &params[self.table(index)], points, scratch);
            self.insert(index, scratch, features);
        }
    }

    /// Puts one level's features (`[n][4]`) into the rows of all.
    pub fn insert(&self, level: usize, encoded: &[f32], features: &mut [f32]) {
        let rows = features.chunks_exact_mut(self.width());
        for (row, values) in rows.zip(encoded.chunks_exact(FEATURES)) {
            row[level * FEATURES..(level + 1) * FEATURES].copy_from_slice(values);
        }
    }

    /// Adds the gradient of one level's values; `d_features`: `[n][width]`, `d_table`: the level's part only.
    pub fn scatter(
        &self,
        level: usize,
        points: SamplePoints<'_>,
        d_features: &[f32],
        d_table: &mut [f32],
    ) {
        let layout = FeatureColumns {
            stride: self.width(),
            column: level * FEATURES,
        };
        scatter_level(&self.levels[level], points, d_features, layout, d_table);
    }
}
