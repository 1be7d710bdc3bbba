//! One optimisation step: draw pixels, predict them, compare, and follow the gradient.
//!
//! `trainer` owns all parameters and takes the steps; `chunk` is one share of a step, in which `loss` compares what is shown with
//! the photo; `adam` and `learned` update. `step_context` and `batch_size` are what all shares read.

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
