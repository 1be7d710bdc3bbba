//! Points that a capture's reconstruction left beside its cameras.

use glam::Vec3;

/// A sparse point cloud in the capture's world frame; all lists are equally long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Where the points are, scene units.
    pub positions: Vec<Vec3>,
    /// Their colours, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// How far off the photos see them on average, pixels.
    pub errors_px: Vec<f32>,
}
