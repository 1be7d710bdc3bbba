//! Points that a capture's reconstruction left beside its cameras.

use glam::Vec3;

/// A sparse point cloud in the capture's world frame; the lists of points are equally long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Where the points are, scene units.
    pub positions: Vec<Vec3>,
    /// Their colours, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// How far off the photos see them on average, pixels.
    pub errors_px: Vec<f32>,
    /// Which points each photo was matched by.
    pub photos: Vec<SeenPoints>,
}

/// The points that a photo shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SeenPoints {
    /// The photo's name, as that of its view.
    pub name: String,
    /// Numbers of the points in the cloud, each below their count.
    pub points: Vec<u32>,
}
