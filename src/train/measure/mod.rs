//! How good a run is: rendered views against photos that were not trained on.
//!
//! `eval` measures a finished run, `validation` a running one; both fit a photo's own exposure and pose by `held_out`.
//! `metrics` has PSNR and SSIM, `flip` and `lpips` (on `convolution`) what people see; `view_error` shows where.

mod convolution;
pub mod eval;
pub mod flip;
pub mod held_out;
pub mod lpips;
pub mod metrics;
#[cfg(test)]
mod test_picture;
pub(super) mod validation;
pub mod view_error;
