//! A draft of the surface from depth maps, or from the points of a reconstruction.
//!
//! `fusion` averages the maps' distances on a grid; `point_maps` makes coarse maps of points, and `floor` cuts off what the object
//! stands on.

pub(super) mod floor;
pub(super) mod fusion;
pub(super) mod point_maps;
#[cfg(test)]
mod tests;
