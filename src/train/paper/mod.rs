//! Training of the paper's own model: the reference that the fast one is measured against.
//!
//! The pixels, their random slots, the losses, the optimiser and the session are the fast model's; the fields, their
//! sampling and the shape of a step are here. A step runs its chunks, each ray after ray through both passes and
//! back, sums their gradients in order, and updates: the same bits on any number of threads.

mod chunk;
mod model;
#[cfg(test)]
mod tests;

pub use model::Paper;

use serde::{Deserialize, Serialize};

use crate::neif::paper::{PaperFieldConfig, PaperMaterialConfig};

/// What only the paper's model has. Of the common settings it does not use the grids, `grid_rate`, `roughness_delay`
/// and `exploration_steps`; `samples_per_ray` and `render_samples` count for each of the two passes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperConfig {
    /// Weight of the first pass's error against the second's (mip-NeRF).
    pub coarse_weight: f32,
    /// The ambient network.
    pub field: PaperFieldConfig,
    /// The material network.
    pub material: PaperMaterialConfig,
}

impl Default for PaperConfig {
    fn default() -> Self {
        Self {
            coarse_weight: 0.1,
            field: PaperFieldConfig::default(),
            material: PaperMaterialConfig::default(),
        }
    }
}

impl PaperConfig {
    /// Whether it can train.
    pub fn is_sane(&self) -> bool {
        (0.0..=1.0).contains(&self.coarse_weight) && self.field.is_sane() && self.material.is_sane()
    }
}
