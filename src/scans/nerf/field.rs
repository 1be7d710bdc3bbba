//! What every neural radiance field answers: density and colour at points, many at a time.

use std::fmt::Debug;

use glam::Vec3;

/// Buffers of a field, kept from one batch to the next.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) inputs: Vec<f32>,
    pub(super) hidden: Vec<f32>,
    pub(super) spare: Vec<f32>,
    pub(super) outputs: Vec<f32>,
}

/// Answers of a field to a batch of points.
#[derive(Debug, Default)]
pub(super) struct Densities {
    /// Density, `[n]`: what a unit of the field's length takes from the logarithm of light; 0 or more, finite.
    pub(super) densities: Vec<f32>,
    /// What the colours are made of besides directions, `[n][n_features]`.
    pub(super) features: Vec<f32>,
}

/// A neural radiance field, in coordinates of its own.
pub(super) trait Field: Debug + Send + Sync {
    /// Numbers that a point's colour is made of besides the direction.
    fn n_features(&self) -> usize;

    /// Densities and features at points.
    fn densities(&self, points: &[Vec3], scratch: &mut Scratch, answers: &mut Densities);

    /// Colours seen along unit directions (from the eye on) by features `[n][n_features]`; at least 0.
    fn colors(
        &self,
        features: &[f32],
        directions: &[Vec3],
        scratch: &mut Scratch,
        colors: &mut Vec<[f32; 3]>,
    );
}

/// `1 / (1 + exp(-x))`.
pub(super) fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// A density that can be computed with, whatever a network's damaged weights make.
pub(super) fn usable_density(density: f32) -> f32 {
    // NaN, which a clamp would keep, becomes 0.
    if density > 0.0 {
        density.min(1e12)
    } else {
        0.0
    }
}

/// A colour that can be shown, whatever a network's damaged weights make.
pub(super) fn usable_color(color: [f32; 3]) -> [f32; 3] {
    color.map(|x| if x > 0.0 { x.min(1e6) } else { 0.0 })
}
