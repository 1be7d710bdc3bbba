//! One optimisation step: draw pixels, predict them, compare, and follow the gradient.
//!
//! `trainer` owns all parameters and takes the steps, in the memory of `work`; `chunk` is one share of a step, in which `loss`
//! compares what is shown with the photo and `chunk_priors` asks for the rest; `update` follows the gradients by `adam` and
//! `learned`. `step_context` and `batch_size` are what all shares read; `photo_model` and `surface` are what the trainer does with
//! poses and exposures, and with the mesh.

pub(super) mod adam;
pub(super) mod batch_size;
pub(super) mod chunk;
mod chunk_priors;
pub(super) mod learned;
pub(super) mod loss;
mod photo_model;
pub mod skips;
pub(super) mod step_context;
mod surface;
pub mod trainer;
#[cfg(test)]
mod trainer_tests;
mod update;
mod work;
