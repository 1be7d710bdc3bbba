//! Where the field's inner box stands, and which way is up.

use glam::Vec3;

use crate::data::Dataset;
use crate::neif::contraction::FieldFrame;

/// The inner box: around the object (or between the cameras), as far as the cameras stand, times `scale`.
pub(super) fn field_frame(dataset: &Dataset, scale: f32) -> FieldFrame {
    let cameras: Vec<Vec3> = dataset.train.iter().map(|v| v.camera.position()).collect();
    let mean = cameras.iter().sum::<Vec3>() / cameras.len().max(1) as f32;
    let center = dataset
        .mesh
        .as_ref()
        .map_or(mean, |mesh| mesh.bounds().center());
    let reach = cameras
        .iter()
        .map(|c| (*c - center).abs().max_element())
        .fold(0.0, f32::max);
    let object = dataset
        .mesh
        .as_ref()
        .map_or(0.0, |mesh| 0.75 * mesh.bounds().extent().max_element());
    // One camera at the centre leaves no length to go by: one world unit is as good as any.
    let half_side = scale * reach.max(object);
    FieldFrame {
        center,
        half_side: if half_side > 0.0 { half_side } else { 1.0 },
    }
}

/// Mean up direction of the cameras, snapped to the nearest world axis when within 45° (always).
pub(super) fn up_direction(dataset: &Dataset) -> Vec3 {
    let mean: Vec3 = dataset.train.iter().map(|v| v.camera.up()).sum();
    let axis = (0..3)
        .max_by(|&a, &b| mean[a].abs().total_cmp(&mean[b].abs()))
        .unwrap_or(2);
    let mut up = Vec3::ZERO;
    up[axis] = if mean[axis] < 0.0 { -1.0 } else { 1.0 };
    up
}
