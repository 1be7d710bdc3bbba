//! Where a cloud of points is, and how large, whatever strays from it.

use glam::Vec3;

/// The points' coordinate-wise medians, and the longest side of the box that holds nine tenths of them along each axis.
pub(super) fn middle_and_size(points: &[Vec3]) -> (Vec3, f32) {
    if points.is_empty() {
        return (Vec3::ZERO, 0.0);
    }
    let mut middle = Vec3::ZERO;
    let mut size = 0.0_f32;
    for axis in 0..3 {
        let mut along: Vec<f32> = points.iter().map(|p| p[axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        let at = |share: usize| along[(along.len() - 1) * share / 20];
        middle[axis] = at(10);
        size = size.max(at(19) - at(1));
    }
    (middle, size)
}
