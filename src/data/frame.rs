//! A listed photo with its pose and lens, as every reader hands it on: not yet decoded.

use std::path::{Path, PathBuf};

use glam::{Affine3A, DMat3, DVec3};

use super::intrinsics::Intrinsics;
use super::{DataError, DepthFile};
use crate::geometry::Camera;

/// One listed photo, not yet read.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the file's `frames`.
    pub index: usize,
    /// The photo's file name without extension.
    pub name: String,
    /// The photo; its extension is completed where the file exists.
    pub photo: PathBuf,
    /// The object mask, where one is named.
    pub mask: Option<PathBuf>,
    /// The depth map, where there is one.
    pub depth: Option<DepthFile>,
    /// The pose: rotation and position.
    pub world_from_camera: Affine3A,
    /// The lens.
    pub intrinsics: Intrinsics,
    /// When on a camera's path it stands there, seconds.
    pub time_secs: Option<f64>,
    /// Nearest and farthest distance along the view that the capture declares, scene units.
    pub depth_range: Option<[f32; 2]>,
    /// The file that lists it, for messages.
    pub listed_in: PathBuf,
}

/// Whether a declared number can be a side of a picture, pixels.
pub(super) fn is_side_px(side: f64) -> bool {
    (1.0..=1e6).contains(&side)
}

impl Frame {
    /// A photo, named as its file, with pose and lens and nothing else known of it.
    pub(super) fn new(
        index: usize,
        photo: PathBuf,
        world_from_camera: Affine3A,
        intrinsics: Intrinsics,
        listed_in: &Path,
    ) -> Self {
        Self {
            index,
            name: photo
                .file_stem()
                .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
            photo,
            mask: None,
            depth: None,
            time_secs: None,
            world_from_camera,
            intrinsics,
            depth_range: None,
            listed_in: listed_in.to_owned(),
        }
    }

    /// The camera for a photo of the given size, and whether the declared lens had to be scaled
    /// to it (photos shrunk after calibration).
    ///
    /// Errors when the photo's aspect is not the declared one.
    pub fn camera(&self, photo_width: u32, photo_height: u32) -> Result<(Camera, bool), DataError> {
        let lens = &self.intrinsics;
        let (width, height) = lens.size.unwrap_or((photo_width, photo_height));
        let (w, h) = (width as f32, height as f32);
        let focal_of = |angle: f32, side: f32| 0.5 * side / (0.5 * angle).tan();
        let fx = lens.fl_x.or(lens.camera_angle_x.map(|a| focal_of(a, w)));
        let fy = lens.fl_y.or(lens.camera_angle_y.map(|a| focal_of(a, h)));
        let (Some(fx), Some(fy)) = (fx.or(fy), fy.or(fx)) else {
            return Err(self.error("fl_x", "neither fl_x nor camera_angle_x is given"));
        };
        let camera = Camera {
            width,
            height,
            fx,
            // NeRF-synthetic gives the angle in x only; pixels are square there.
            fy: if lens.fl_y.is_none() && lens.fl_x.is_some() {
                fx
            } else {
                fy
            },
            cx: lens.cx.unwrap_or(0.5 * w),
            cy: lens.cy.unwrap_or(0.5 * h),
            distortion: lens.distortion,
            world_from_camera: self.world_from_camera,
        };
        if (width, height) == (photo_width, photo_height) {
            return Ok((camera, false));
        }
        let expected_width = w * photo_height as f32 / h;
        if (expected_width - photo_width as f32).abs() > 0.01 * photo_width as f32 + 1.0 {
            return Err(self.error(
                "w",
                format!(
                    "the photo {} is {photo_width} x {photo_height}, but w x h is {width} x {height}",
                    self.photo.display()
                ),
            ));
        }
        Ok((camera.resized(photo_width, photo_height), true))
    }

    pub(super) fn error(&self, field: &str, problem: impl Into<String>) -> DataError {
        DataError::field(&self.listed_in, field, problem).in_frame(self.index)
    }
}

/// The pose of a camera given as computer vision does: `p_camera = rotation p_world + translation`
/// with x right, y down, z forward. Rotation must be one.
pub(super) fn world_from_opencv(rotation: DMat3, translation: DVec3) -> Affine3A {
    let world_from_camera = rotation.transpose();
    let position = -(world_from_camera * translation);
    let axes = DMat3::from_cols(
        world_from_camera.x_axis,
        -world_from_camera.y_axis,
        -world_from_camera.z_axis,
    );
    Affine3A::from_mat3_translation(axes.as_mat3(), position.as_vec3())
}

/// Whether a matrix is a rotation up to rounding: files with four digits are within 1e-3.
pub(super) fn is_rotation(m: DMat3) -> bool {
    const TOLERANCE: f64 = 0.02;
    let off = m.transpose() * m - DMat3::IDENTITY;
    let largest = off
        .to_cols_array()
        .iter()
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    // Written so that NaN is refused as well.
    largest < TOLERANCE && m.determinant() > 0.0
}

/// The rotation and translation in the 16 numbers of a matrix, row by row.
pub(super) fn rotation_and_translation(rows: &[f64]) -> Option<(DMat3, DVec3)> {
    let column = |j: usize| {
        Some(DVec3::new(
            *rows.get(j)?,
            *rows.get(4 + j)?,
            *rows.get(8 + j)?,
        ))
    };
    let rotation = DMat3::from_cols(column(0)?, column(1)?, column(2)?);
    Some((rotation, column(3)?)).filter(|_| is_rotation(rotation))
}
