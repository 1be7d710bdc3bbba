//! From a pixel to its light: what the camera sees of the mesh, and what is reflected there.
//!
//! `trace` and `gbuffer` find the surface, `aim` chooses the cones of its lobes (`blocked_cones`, `more_cones`, `importance`),
//! `shade` brings their light by the memory of `scratch`. `reference` is the oracle: many thin rays in place of a cone.

mod aim;
pub mod blocked_cones;
pub mod gbuffer;
mod importance;
pub(super) mod more_cones;
pub mod reference;
pub mod scratch;
pub mod shade;
pub mod trace;
