//! 3D Gaussians (Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023) and their files.
//!
//! One file a format, each an `is_…` by the first bytes and a reader.

pub(super) mod harmonics;

use std::path::Path;
use std::sync::OnceLock;

use glam::{Quat, Vec3};

use crate::data::DataError;

/// A Gaussian in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Its centre, scene units.
    pub center: Vec3,
    /// Standard deviation along its own axes, scene units, positive.
    pub scale: Vec3,
    /// From its own axes to the scene's, unit.
    pub rotation: Quat,
    /// At its centre, 0 to 1.
    pub opacity: f32,
}

/// A scan of Gaussians.
#[derive(Clone, Debug, Default)]
pub struct Splats {
    /// The Gaussians.
    pub splats: Vec<Splat>,
    /// Degree of the spherical harmonics of the colours, 0 to 3.
    pub degree: usize,
    /// Coefficients of the colours, `[splat][(degree + 1)²]` RGB, in the order and signs of the reference implementation
    /// (`eval_sh`): a colour is `0.5 + Σ` of them, sRGB-encoded, at least 0.
    pub harmonics: Vec<[f32; 3]>,
    /// Whether it was trained with the screen filter of Mip-Splatting (`rasterize_mode: antialiased`): then a Gaussian that is
    /// widened to a pixel's size loses opacity instead of growing.
    pub is_antialiased: bool,
    /// See [`Self::size`].
    pub(super) size: OnceLock<f32>,
}

/// Whether the file holds Gaussians, by its first bytes.
pub(super) fn is_splats(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "ply")
}

/// Reads Gaussians of any supported format.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    Err(DataError::unusable(
        path,
        "Gaussian splats are not read yet",
    ))
}

impl Splats {
    /// Coefficients of a colour, each RGB: 1, 4, 9 or 16.
    pub fn n_coefficients(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// The longest side of the box that holds nine tenths of the Gaussians along each axis, scene units.
    pub(super) fn size(&self) -> f32 {
        *self.size.get_or_init(|| {
            let side = |axis: usize| {
                let mut along: Vec<f32> = self.splats.iter().map(|s| s.center[axis]).collect();
                let n = along.len();
                let mut at = |share: usize| {
                    let (_, value, _) =
                        along.select_nth_unstable_by(n * share / 20, f32::total_cmp);
                    *value
                };
                at(19) - at(1)
            };
            if self.splats.is_empty() {
                return 0.0;
            }
            (0..3).map(side).fold(0.0, f32::max)
        })
    }

    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        let (n, degree) = (self.splats.len(), self.degree);
        format!("3D Gaussian splats ({n}, spherical harmonics of degree {degree})")
    }

    /// Centres of Gaussians that are visible, at most `most`.
    pub(super) fn surface_points(&self, most: usize) -> Vec<Vec3> {
        let visible = self.splats.iter().filter(|s| s.opacity > 0.5);
        visible.map(|s| s.center).take(most).collect()
    }
}
