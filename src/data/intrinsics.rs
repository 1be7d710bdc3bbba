//! A lens as a file declares it.

use crate::geometry::Distortion;

/// A lens as declared; lengths in pixels of a picture of the declared size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intrinsics {
    /// `w, h`.
    pub size: Option<(u32, u32)>,
    /// `fl_x`.
    pub fl_x: Option<f32>,
    /// `fl_y`.
    pub fl_y: Option<f32>,
    /// `camera_angle_x` in radians.
    pub camera_angle_x: Option<f32>,
    /// `camera_angle_y` in radians.
    pub camera_angle_y: Option<f32>,
    /// `cx`.
    pub cx: Option<f32>,
    /// `cy`.
    pub cy: Option<f32>,
    /// `k1..k4, p1, p2`.
    pub distortion: Distortion,
}
