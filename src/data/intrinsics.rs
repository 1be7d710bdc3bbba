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

impl Intrinsics {
    /// A lens of focal lengths and principal point `fx, fy, cx, cy`, without distortion.
    pub(super) fn pinhole([fx, fy, cx, cy]: [f32; 4]) -> Self {
        Self {
            fl_x: Some(fx),
            fl_y: Some(fy),
            cx: Some(cx),
            cy: Some(cy),
            ..Self::default()
        }
    }

    /// The same of numbers from a file whose pixel centres lie at whole numbers; `None` where they are no lens.
    pub(super) fn pinhole_at_whole_centers([fx, fy, cx, cy]: [f32; 4]) -> Option<Self> {
        let is_lens = [fx, fy, cx, cy].iter().all(|v| v.is_finite()) && fx > 0.0 && fy > 0.0;
        is_lens.then(|| Self::pinhole([fx, fy, cx + 0.5, cy + 0.5]))
    }
}
