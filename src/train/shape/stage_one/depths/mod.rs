//! A draft of the surface from depth maps, or from the points of a reconstruction.
//!
//! `fusion` averages the maps' distances on a grid; `point_maps` makes coarse maps of points.

pub(super) mod fusion;
pub(super) mod outline_check;
pub(super) mod photo_maps;
pub(super) mod point_maps;
pub(super) mod smooth_guess;
#[cfg(test)]
mod tests;
