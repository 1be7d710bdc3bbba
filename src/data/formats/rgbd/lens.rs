//! The lens of a depth camera: a matrix as text, or the JSON files of `Open3D` and of the Replica renderings. Pixel centres
//! lie at whole numbers in all of them.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::super::json_fields::Fields;
use super::{MAX_BYTES, numbers_of};
use crate::data::files::capture_path::{first_file, has_extension, read_json, read_text};
use crate::data::{DataError, Intrinsics};

/// Where the lens may stand, from the capture's folder.
const FILES: [&str; 15] = [
    "intrinsic/intrinsic_color.txt",
    "intrinsics/intrinsic_color.txt",
    "intrinsic_color.txt",
    "intrinsic.txt",
    "intrinsics.txt",
    "camera-intrinsics.txt",
    "camera_intrinsics.txt",
    "calibration.txt",
    "K.txt",
    "camera_intrinsic.json",
    "intrinsic.json",
    "camera_primesense.json",
    "cam_params.json",
    "../camera-intrinsics.txt",
    "../cam_params.json",
];
/// Where the lens of the depth maps may stand, from the capture's folder.
const DEPTH_FILES: [&str; 3] = [
    "intrinsic/intrinsic_depth.txt",
    "intrinsics/intrinsic_depth.txt",
    "intrinsic_depth.txt",
];
/// A lens as its file has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    pub(super) intrinsics: Intrinsics,
    /// Scene units of a step of the depth maps, where the file says so.
    pub(super) depth_unit: Option<f32>,
}

impl From<Intrinsics> for Lens {
    fn from(intrinsics: Intrinsics) -> Self {
        Self {
            intrinsics,
            depth_unit: None,
        }
    }
}

/// The file that holds the photos' lens, where there is one.
pub(super) fn find(root: &Path) -> Option<PathBuf> {
    first_file(root, &FILES)
}

/// The lens of the depth maps, where it is another.
pub(super) fn of_depths(root: &Path) -> Result<Option<Lens>, DataError> {
    let file = first_file(root, &DEPTH_FILES);
    file.as_deref().map(read).transpose()
}

/// The lens that `PrimeSense`'s cameras have from the factory, which captures without a lens are customarily read with.
pub(super) fn prime_sense() -> Lens {
    let lens = Intrinsics {
        size: Some((640, 480)),
        ..Intrinsics::pinhole([525.0, 525.0, 320.0, 240.0])
    };
    lens.into()
}

/// Reads a lens: JSON, or as text a matrix of 3 x 3 or 4 x 4 or the numbers fx, fy, cx, cy.
pub(super) fn read(path: &Path) -> Result<Lens, DataError> {
    if has_extension(path, "json") {
        return read_lens_json(path);
    }
    let numbers = numbers_of(path, &read_text(path, MAX_BYTES)?)?;
    let places = match numbers.len() {
        4 => [0, 1, 2, 3],
        9 => [0, 4, 2, 5],
        16 => [0, 5, 2, 6],
        n => {
            let problem =
                format!("{n} numbers are neither a matrix of 3 x 3 or 4 x 4 nor fx fy cx cy");
            return Err(DataError::field(path, "matrix", problem));
        }
    };
    let problem = "the focal lengths are not greater than 0";
    let intrinsics = pinhole(places.map(|i| numbers[i]))
        .ok_or_else(|| DataError::field(path, "matrix", problem))?;
    Ok(intrinsics.into())
}

/// `Open3D`'s `width, height, intrinsic_matrix` (column by column), or `camera` with `w, h, fx, fy, cx, cy, scale`.
fn read_lens_json(path: &Path) -> Result<Lens, DataError> {
    let value: Value = read_json(path, MAX_BYTES)?;
    let fields = Fields::new(path, None, value.get("camera").unwrap_or(&value));
    if let Some(matrix) = fields.value.get("intrinsic_matrix") {
        let numbers = matrix.as_array().map(Vec::as_slice).unwrap_or_default();
        let numbers: Vec<f64> = numbers.iter().filter_map(Value::as_f64).collect();
        let lens = match numbers.as_slice() {
            &[fx, _, _, _, fy, _, cx, cy, _] => pinhole([fx, fy, cx, cy]),
            _ => None,
        };
        let problem = "not 9 numbers, column by column, with focal lengths greater than 0";
        let lens = lens.ok_or_else(|| fields.error("intrinsic_matrix", problem))?;
        let size = fields.side("width")?.zip(fields.side("height")?);
        return Ok(Intrinsics { size, ..lens }.into());
    }
    let required = |name: &str, value: Option<f32>| {
        let missing = || fields.error(name, "missing");
        value.ok_or_else(missing)
    };
    let lens = Intrinsics::pinhole_at_whole_centers([
        required("fx", fields.positive("fx")?)?,
        required("fy", fields.positive("fy")?)?,
        required("cx", fields.number("cx")?)?,
        required("cy", fields.number("cy")?)?,
    ]);
    Ok(Lens {
        intrinsics: Intrinsics {
            size: fields.side("w")?.zip(fields.side("h")?),
            ..lens.unwrap_or_default()
        },
        depth_unit: fields.positive("scale")?.map(f32::recip),
    })
}

/// The lens of `fx, fy, cx, cy`, where they are one.
fn pinhole(numbers: [f64; 4]) -> Option<Intrinsics> {
    Intrinsics::pinhole_at_whole_centers(numbers.map(|v| v as f32))
}
