//! What every field is made of, forward and backward: a `grid` of features (`hash_grid`: one level of it), a small network
//! over them (`mlp`, of `dense` layers), and `spherical_harmonics` of directions.

pub mod dense;
pub mod grid;
pub mod hash_grid;
pub mod mlp;
pub mod spherical_harmonics;
