//! What every field is made of, forward and backward: a `hash_grid` of features, a small network over them (`mlp`), and
//! `spherical_harmonics` of directions.

pub mod hash_grid;
pub mod mlp;
pub mod spherical_harmonics;
