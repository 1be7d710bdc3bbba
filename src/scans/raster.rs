//! Draws Gaussians.

use std::sync::atomic::AtomicBool;

use super::picture::ScanPicture;
use super::splats::Splats;
use crate::geometry::Camera;

/// The view of a pinhole camera; `None` when cancelled.
pub(super) fn picture(
    _splats: &Splats,
    _camera: &Camera,
    _cancel: &AtomicBool,
) -> Option<ScanPicture> {
    None
}
