//! Training of the baselines `NeILF` and `NeILF*` (`crate::neif::neilf`), for `neif bench table1`.
//!
//! Pixels, random slots, error, optimiser and the order of sums are the fast model's, so the same seed gives the same bits
//! on any number of threads. There are no background pixels: nothing in the model could explain them.

mod chunk;
mod model;
#[cfg(test)]
mod tests;

pub use model::Neilf;

use crate::neif::neilf::{Brdf, IncidentLightConfig};
use crate::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};

/// What only the baselines have. Of the common settings they use the material's grid, the rates, warm-up and decay, the
/// smoothness and the number of kept pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeilfConfig {
    /// How the surface reflects.
    pub brdf: Brdf,
    /// Object pixels a step.
    pub pixels: usize,
    /// Directions of the hemisphere in training (`NeILF`: 128), turned at random about the normal.
    pub directions: usize,
    /// The same in pictures (`NeILF`: 256), not turned.
    pub render_directions: usize,
    /// The incident light.
    pub light: IncidentLightConfig,
}

impl NeilfConfig {
    /// The settings for a reflectance.
    pub fn new(brdf: Brdf) -> Self {
        let grid = |n_levels, finest| GridConfig {
            n_levels,
            coarsest: 4,
            finest,
            log2_table_size: 15,
            least_weight: LEAST_WEIGHT,
        };
        let (pixels, directions, render_directions) = match brdf {
            Brdf::Disney => (64, 128, 256),
            Brdf::Lobe => (256, 512, 1024),
        };
        Self {
            brdf,
            pixels,
            directions,
            render_directions,
            light: IncidentLightConfig {
                directions: grid(8, 128),
                positions: grid(4, 32),
                width: 64,
                depth: 2,
            },
        }
    }
}
