//! A ray: an origin and a unit direction.

use glam::{Mat3, Vec3};

/// A half line in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: Vec3,
    /// Where it goes; unit length, so that `t` is a distance in scene units.
    pub direction: Vec3,
}

impl Ray {
    /// The point at distance `t` along the ray.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}

/// The point with the least squared distance to lines `(point, unit direction)`.
///
/// Solves `sum (I - d d^T) x = sum (I - d d^T) p`. A small pull towards the points' mean keeps it
/// defined when all lines are parallel.
pub fn nearest_point(lines: &[(Vec3, Vec3)]) -> Vec3 {
    if lines.is_empty() {
        return Vec3::ZERO;
    }
    let n = lines.len() as f32;
    let mean = lines.iter().map(|(p, _)| *p).sum::<Vec3>() / n;
    let pull = 1e-4 * n;
    let mut matrix = Mat3::from_diagonal(Vec3::splat(pull));
    let mut right_side = Vec3::ZERO;
    for (p, d) in lines {
        let across = Mat3::IDENTITY - Mat3::from_cols(d.x * *d, d.y * *d, d.z * *d);
        matrix += across;
        // Relative to the mean, so that far-off scenes do not lose digits.
        right_side += across * (*p - mean);
    }
    mean + matrix.inverse() * right_side
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_through_one_point_meet_there() {
        let target = Vec3::new(1.0, -2.0, 0.5);
        let lines: Vec<(Vec3, Vec3)> = [Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 1.0)]
            .into_iter()
            .map(|d| (target - 3.0 * d, d.normalize_or_zero()))
            .collect();
        assert!(
            nearest_point(&lines).distance(target) < 1e-3,
            "meeting point"
        );
        let parallel = [(Vec3::ZERO, Vec3::X), (Vec3::Y, Vec3::X)];
        assert!(nearest_point(&parallel).is_finite(), "parallel axes");
    }
}
