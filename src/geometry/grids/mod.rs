//! Signed distances on a grid: from a mesh, to a mesh, and made distances again.

pub(super) mod iso_surface;
mod mesh_distances;
mod redistance;
pub(super) mod scalar_grid;
