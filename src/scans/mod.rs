//! Scans: other programs' radiance fields, read from their files and looked at from anywhere.
//!
//! `splats` holds 3D Gaussians and their file formats, `raster` draws them, `nerf` holds networks with theirs. [`Scan`] is
//! what all of them are to the rest of the program: something that makes pictures; `views` photographs it for the trainer.

mod extent;
mod file;
mod nerf;
mod picture;
mod raster;
mod splats;
mod views;

pub use file::Scan;
pub use nerf::Nerf;
pub use picture::ScanPicture;
pub use splats::{Splat, Splats};
pub use views::{Survey, load_capture};
