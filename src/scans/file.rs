//! A scan's file, recognised by its content.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::nerf::{self, Nerf};
use super::picture::ScanPicture;
use super::raster;
use super::splats::{self, Splats};
use crate::data::DataError;
use crate::geometry::Camera;

/// How the names of scans end.
const ENDINGS: [&str; 7] = ["ply", "splat", "spz", "sog", "ckpt", "msgpack", "ingp"];

/// Another program's radiance field.
#[derive(Clone, Debug)]
pub enum Scan {
    /// 3D Gaussians.
    Splats(Splats),
    /// A neural radiance field.
    Nerf(Nerf),
}

impl Scan {
    /// Whether the file holds a scan, by its first bytes; damaged or unsupported ones too, for [`Self::read`] to report.
    pub fn is_scan(path: &Path) -> bool {
        splats::is_splats(path) || nerf::is_nerf(path)
    }

    /// Whether the file's name ends as those of scans do, for where no file should be looked into.
    pub fn is_named_so(path: &Path) -> bool {
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        ENDINGS.contains(&&*ending.to_ascii_lowercase())
    }

    /// Reads a scan.
    ///
    /// # Errors
    /// When the file is no scan, of a kind that is not supported, or damaged.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        if nerf::is_nerf(path) {
            return Ok(Self::Nerf(nerf::read(path)?));
        }
        Ok(Self::Splats(splats::read(path)?))
    }

    /// What it is, for people: "3D Gaussian splats (500,000, spherical harmonics of degree 3)".
    pub fn describe(&self) -> String {
        match self {
            Self::Splats(splats) => splats.describe(),
            Self::Nerf(nerf) => nerf.describe(),
        }
    }

    /// The view of a pinhole camera; `None` when cancelled. Runs on the current rayon pool.
    pub fn picture(&self, camera: &Camera, cancel: &AtomicBool) -> Option<ScanPicture> {
        match self {
            Self::Splats(splats) => raster::picture(splats, camera, cancel),
            Self::Nerf(nerf) => nerf.picture(camera, cancel),
        }
    }

    /// Points on what is visible, at most `most` of them, spread over it evenly; scene units.
    pub fn surface_points(&self, most: usize) -> Vec<Vec3> {
        match self {
            Self::Splats(splats) => splats.surface_points(most),
            Self::Nerf(nerf) => nerf.surface_points(most),
        }
    }

    /// How many photos of it teach its light, and the pixels along their sides: as many as two cores take in some ten to twenty
    /// seconds, before which nothing is seen of it.
    pub(super) fn photos(&self) -> (usize, u32) {
        match self {
            Self::Splats(_) => (144, 320),
            // A ray of a network takes a hundred times as long as a pixel of Gaussians.
            Self::Nerf(_) => (72, 160),
        }
    }

    /// The axes that are up by convention in such files, the most usual first.
    pub(super) fn up_conventions(&self) -> &'static [Vec3] {
        match self {
            // As structure from motion leaves it, y down; or turned for a program whose z is up.
            Self::Splats(_) => &[Vec3::NEG_Y, Vec3::Z],
            Self::Nerf(_) => &[Vec3::Z, Vec3::Y],
        }
    }
}
