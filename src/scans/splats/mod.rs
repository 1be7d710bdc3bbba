//! 3D Gaussians (Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023) and their files.
//!
//! One file a format, each a recogniser by the first bytes and a reader; [`Collector`] keeps what of a file can be drawn.

mod collect;
mod compressed_ply;
mod dot_splat;
mod encoding;
pub(super) mod harmonics;
mod inria_ply;
mod ply_file;
mod sog;
mod sog_files;
mod spz;
#[cfg(test)]
mod test_files;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use glam::{Quat, Vec3};

use self::collect::Collector;
use self::ply_file::PlyFile;
use crate::data::DataError;
use crate::scans::extent::middle_and_size;

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
}

/// How Gaussians are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    InriaPly,
    CompressedPly,
    DotSplat,
    Spz,
    Sog,
    /// Of `GaussianSplats3D`, which is not read.
    Ksplat,
}

/// Gaussians that a scan's size is measured by.
const N_MEASURED: usize = 1000;
/// Opacity from which on a Gaussian counts as a surface.
const SOLID: f32 = 0.5;

/// Whether the file holds Gaussians, by its first bytes; damaged or unsupported ones too, for [`read`] to report.
pub(super) fn is_splats(path: &Path) -> bool {
    Format::of(path).is_some()
}

/// Reads Gaussians of any supported format.
pub(super) fn read(path: &Path) -> Result<Splats, DataError> {
    File::open(path).map_err(|e| DataError::io(path, e))?;
    match Format::of(path) {
        Some(Format::InriaPly) => inria_ply::read(path),
        Some(Format::CompressedPly) => compressed_ply::read(path),
        Some(Format::DotSplat) => dot_splat::read(path),
        Some(Format::Spz) => spz::read(path),
        Some(Format::Sog) => sog::read(path),
        Some(Format::Ksplat) => Err(DataError::unusable(
            path,
            ".ksplat is not supported: convert it to .ply, as SuperSplat can",
        )),
        None => Err(DataError::unusable(
            path,
            "no Gaussian splats of a known format (.ply, .splat, .spz, .sog)",
        )),
    }
}

impl Format {
    /// The format of a file, by its content.
    fn of(path: &Path) -> Option<Self> {
        let mut magic = Vec::new();
        File::open(path)
            .ok()?
            .take(4)
            .read_to_end(&mut magic)
            .ok()?;
        match &magic[..] {
            [b'p', b'l', b'y', _] => Self::of_ply(&PlyFile::open(path).ok()?),
            _ if spz::is_spz(path) => Some(Self::Spz),
            [b'P', b'K', 3, 4] | [b'{', ..] if sog::is_sog(path) => Some(Self::Sog),
            _ if has_extension(path, "ksplat") => Some(Self::Ksplat),
            _ => dot_splat::is_dot_splat(path).then_some(Self::DotSplat),
        }
    }

    fn of_ply(file: &PlyFile) -> Option<Self> {
        if compressed_ply::is_compressed(file) {
            return Some(Self::CompressedPly);
        }
        inria_ply::is_inria(file).then_some(Self::InriaPly)
    }
}

/// Whether a file's name ends so, in any case.
fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|other| other.eq_ignore_ascii_case(extension))
}

impl Splats {
    /// Coefficients of a colour, each RGB: 1, 4, 9 or 16.
    pub fn n_coefficients(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// The same without degrees of harmonics that are all zero: many programs write them so.
    fn trimmed(mut self) -> Self {
        let n = self.n_coefficients();
        let is_used = |k: usize| {
            let colors = self.harmonics.chunks_exact(n);
            colors
                .clone()
                .any(|color| color[k..].iter().any(|c| *c != [0.0; 3]))
        };
        let degree = (0..self.degree).find(|degree| !is_used((degree + 1) * (degree + 1)));
        if let Some(degree) = degree {
            let kept = (degree + 1) * (degree + 1);
            let colors = self.harmonics.chunks_exact(n);
            self.harmonics = colors.flat_map(|color| &color[..kept]).copied().collect();
            self.degree = degree;
        }
        self
    }

    /// About how large the scan is: the longest side of the box that holds nine tenths of the centres along each axis, scene units.
    pub(super) fn size(&self) -> f32 {
        let step = self.splats.len().div_ceil(N_MEASURED).max(1);
        let centers = self.splats.iter().step_by(step).map(|s| s.center);
        let (_, size) = middle_and_size(&centers.collect::<Vec<_>>());
        size
    }

    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        let (n, degree) = (self.splats.len(), self.degree);
        format!("3D Gaussian splats ({n}, spherical harmonics of degree {degree})")
    }

    /// Centres of Gaussians that are opaque, at most `most`, spread over the list evenly; where few are, of the most opaque tenth.
    pub(super) fn surface_points(&self, most: usize) -> Vec<Vec3> {
        let mut opacities: Vec<f32> = self.splats.iter().map(|s| s.opacity).collect();
        let tenth = opacities.len() * 9 / 10;
        if tenth >= opacities.len() {
            return Vec::new();
        }
        let (_, tenth, _) = opacities.select_nth_unstable_by(tenth, f32::total_cmp);
        let least = tenth.min(SOLID);
        let solid = self.splats.iter().filter(|s| s.opacity >= least);
        let centers: Vec<Vec3> = solid.map(|s| s.center).collect();
        let n = centers.len();
        if n <= most {
            return centers;
        }
        (0..most).map(|i| centers[i * n / most]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of Gaussians along x with these opacities.
    fn row(opacities: &[f32]) -> Splats {
        let splat = |(i, opacity): (usize, &f32)| Splat {
            center: Vec3::X * i as f32,
            scale: Vec3::ONE,
            rotation: Quat::IDENTITY,
            opacity: *opacity,
        };
        Splats {
            splats: opacities.iter().enumerate().map(splat).collect(),
            ..Splats::default()
        }
    }

    #[test]
    fn surface_points_are_of_opaque_gaussians_and_spread_over_the_list() {
        let mut opacities = vec![0.9; 1000];
        opacities[..500].fill(0.1);
        let points = row(&opacities).surface_points(10);
        let expected: Vec<Vec3> = (0..10).map(|i| Vec3::X * (500 + 50 * i) as f32).collect();
        assert_eq!(points, expected);
        assert_eq!(row(&opacities).surface_points(5000).len(), 500);
    }

    #[test]
    fn surface_points_of_a_faint_scan_are_the_most_opaque_tenth() {
        let opacities: Vec<f32> = (0..100).map(|i| i as f32 * 0.001).collect();
        let points = row(&opacities).surface_points(100);
        let expected: Vec<Vec3> = (90..100).map(|i| Vec3::X * i as f32).collect();
        assert_eq!(points, expected);
        assert!(row(&[]).surface_points(10).is_empty());
        assert_eq!(row(&[0.01]).surface_points(10), [Vec3::ZERO]);
    }

    #[test]
    fn other_files_hold_no_splats_and_the_error_names_them() {
        let folder = tempfile::tempdir().unwrap();
        for bytes in [
            &b""[..],
            b"ply",
            b"ply\n",
            b"{}",
            b"PK\x03\x04",
            b"\x1f\x8b",
        ] {
            let path = folder.path().join("other.bin");
            std::fs::write(&path, bytes).unwrap();
            assert!(!is_splats(&path), "{bytes:?}");
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains("other.bin"), "{message}");
        }
        assert!(!is_splats(folder.path()), "a folder");
        let missing = read(&folder.path().join("missing.ply")).unwrap_err();
        assert!(missing.to_string().contains("missing.ply"), "{missing}");
    }
}
