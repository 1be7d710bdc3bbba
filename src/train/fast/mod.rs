//! Training of the fast model: grids and small networks for environment and material.
//!
//! `model` owns all parameters and takes a step in the memory of `work`; `chunk` is one share of a step, in which
//! `roughness` learns how wide lobes are and `chunk_priors` asks for what photos do not show; `gather` hands the gradients to
//! the parts and `density` refreshes the density cache. `step_context` and `batch_size` are what all shares read; `scene` is
//! what leaves training, and what happens to the mesh.

pub(super) mod batch_size;
pub(super) mod chunk;
mod chunk_priors;
mod density;
mod gather;
pub(super) mod model;
mod roughness;
mod scene;
pub mod skips;
pub(super) mod step_context;
#[cfg(test)]
mod tests;
mod work;

pub use model::Fast;
