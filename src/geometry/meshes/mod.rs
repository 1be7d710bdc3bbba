//! Triangle meshes (`mesh`), and what is made of them: `parts`, finer triangles (`subdivision`), texture coordinates (`atlas`
//! of `charts`, with `tangents`).

pub(super) mod atlas;
mod charts;
pub(super) mod mesh;
pub(super) mod parts;
mod subdivision;
mod tangents;
#[cfg(test)]
pub(crate) mod test_mesh;
