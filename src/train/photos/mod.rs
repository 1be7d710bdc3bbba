//! The photo model: each photo's exposure, white balance and pose, estimated while everything else is trained.
//!
//! `photo_rows` gathers what a step's pixels say. `exposures` (begun by `relative_exposures`, read by `photo_exposures`) and
//! `poses` (a `pose_step` for each photo, and the `picture_shift` of its outline) make corrections of it.

pub(super) mod exposures;
pub mod photo_exposures;
pub(super) mod photo_rows;
pub(super) mod picture_shift;
pub(super) mod pose_step;
pub(super) mod poses;
#[cfg(test)]
mod poses_tests;
pub(super) mod relative_exposures;
