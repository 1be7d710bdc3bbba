//! What every field is made of: grids of features and small networks over them, forward and backward.

pub mod hash_grid;
pub mod mlp;
pub mod spherical_harmonics;
