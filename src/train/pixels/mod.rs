//! What a step draws from: the training pixels of all photos, each traced once and kept in few bytes.
//!
//! `mask_outline` and `outlines` say which pixels of a photo are the object's; `view_pixels` and `preconvolution` take what is
//! wanted of them; `traced_pixels` traces the object's, portion by portion (`portions`); `store` keeps it all, with the help of
//! `packed_path`, `srgb_codes`, `block_chroma` and `pixel_set`, and draws.

mod block_chroma;
mod findings;
mod image_gradient;
pub(super) mod mask_outline;
pub(super) mod outlines;
mod packed_path;
mod pixel_set;
mod portions;
mod preconvolution;
mod srgb_codes;
pub(super) mod store;
#[cfg(test)]
mod store_tests;
mod traced_pixels;
pub(super) mod view_pixels;
