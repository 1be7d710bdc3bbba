//! Neural radiance fields of other programs, one file a format.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::picture::ScanPicture;
use crate::data::DataError;
use crate::geometry::Camera;

/// A neural radiance field.
#[derive(Clone, Debug)]
pub struct Nerf;

/// Whether the file holds a neural radiance field, by its first bytes.
pub(super) fn is_nerf(_path: &Path) -> bool {
    false
}

/// Reads a neural radiance field of any supported format.
pub(super) fn read(path: &Path) -> Result<Nerf, DataError> {
    Err(DataError::unusable(path, "not read yet"))
}

impl Nerf {
    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        "neural radiance field".to_owned()
    }

    /// The view of a pinhole camera; `None` when cancelled.
    pub(super) fn picture(&self, _camera: &Camera, _cancel: &AtomicBool) -> Option<ScanPicture> {
        None
    }

    /// Points on what is visible, at most `most`.
    pub(super) fn surface_points(&self, _most: usize) -> Vec<Vec3> {
        Vec::new()
    }
}
