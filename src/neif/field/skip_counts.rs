//! How much of a batch's work the shortcuts left out, counted afterwards from what the batch still holds.

use super::density_grid::DensityGrid;
use super::field_batch::FieldBatch;
use super::proposal::{N_STEPS, steps_of_ray};
use crate::neif::networks::hash_grid::Level;

/// Every so many rays one is walked for what is empty or hidden on it.
const RAY_STRIDE: usize = 4;

/// Counts over batches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkipCounts {
    /// Samples placed.
    pub samples: u64,
    /// Of these, inside the object or at a lobe's own surface, where nothing can be.
    pub void_samples: u64,
    /// Of these, left out of the backward pass for their small gradient.
    pub weak_samples: u64,
    /// Grid levels times samples.
    pub looks: u64,
    /// Of these, levels finer than the footprint, which were not looked up.
    pub fine_looks: u64,
    /// Steps along the walked rays.
    pub steps: u64,
    /// Of these, with next to no density, so that samples went elsewhere.
    pub empty_steps: u64,
    /// Of these, behind something opaque.
    pub hidden_steps: u64,
}

impl SkipCounts {
    /// Adds a batch after its backward pass.
    pub fn add(&mut self, batch: &FieldBatch, levels: &[Level], density: &DensityGrid) {
        let samples = &batch.samples;
        let n = samples.n() as u64;
        let n_void = samples.deltas.iter().filter(|d| **d == 0.0).count() as u64;
        self.samples += n;
        self.void_samples += n_void;
        self.weak_samples += n.saturating_sub(n_void + batch.active.len() as u64);
        for level in levels {
            let is_fine = |footprint: &&f32| level.weight(**footprint) == 0.0;
            self.looks += n;
            self.fine_looks += samples.points().footprints.iter().filter(is_fine).count() as u64;
        }
        for ray in batch.rays.iter().step_by(RAY_STRIDE) {
            let steps = steps_of_ray(density, &ray.cone);
            self.steps += N_STEPS as u64;
            self.empty_steps += steps.empty as u64;
            self.hidden_steps += steps.hidden as u64;
        }
    }
}
