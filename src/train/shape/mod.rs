//! The object's surface: made before training, refined while it goes on.
//!
//! `stage_one` makes a mesh where a capture has none. Then `normal_offsets` learns the normals by `tilted_rays`, `normal_evidence`
//! knows how sure they are, `refinement` moves the surface to them, and `retracing` says when pixels are traced anew.

mod normal_evidence;
pub(super) mod normal_offsets;
pub(super) mod refinement;
#[cfg(test)]
mod refinement_tests;
pub(super) mod retracing;
pub mod stage_one;
pub mod support_plane;
pub(super) mod tilted_rays;
