//! Pictures and textures to keep.
//!
//! `picture` is a full image (a `raster`), `parts` the same taken apart, `panorama` what a point sees all around, `slice` a cut through the
//! field; `film` takes many along a `turntable` or `camera_path`. `bake` writes the surface as textures for glTF.

pub mod bake;
pub(super) mod camera_path;
pub mod film;
pub mod metallic_roughness;
pub mod panorama;
pub mod parts;
pub mod picture;
pub mod raster;
pub mod slice;
pub(super) mod tone_map;
pub mod turntable;
pub(super) mod unwrapped;
