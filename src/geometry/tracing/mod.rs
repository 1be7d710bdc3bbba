//! Rays against a mesh: `bvh` is the way in, `hierarchy` builds what it walks through (`wide_bvh`); `fan` and
//! `footprint` are for the cones of lobes, `part_at` for picked points.

pub(super) mod bvh;
pub(super) mod fan;
pub(super) mod footprint;
mod hierarchy;
mod part_at;
pub(super) mod ray;
mod wide_bvh;
