//! Photos, masks and depth maps: from files to linear pixels in memory.
//!
//! `views` decodes the frames of a capture in parallel, as large as `photo_budget` allows, with `image` (and `exr_image`, `exif`,
//! `orientation`, `mask_color`, `shrink`) for single files; `photo` is what comes out.

mod chroma;
pub(super) mod depth;
pub(super) mod depth_view;
pub(super) mod exif;
pub(super) mod exr_image;
pub(super) mod image;
mod limits;
mod mask_color;
mod orientation;
pub(super) mod photo;
pub(super) mod photo_budget;
pub(super) mod rgba8;
mod shrink;
pub(super) mod views;
