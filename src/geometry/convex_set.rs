//! A convex set around points.

use glam::Vec3;

use super::sampling::fibonacci_sphere;

/// Directions in which it is bounded.
const DIRECTIONS: usize = 512;

/// The convex hull of points, or a little more, as half-spaces in evenly spread directions.
#[derive(Clone, Debug)]
pub struct ConvexSet {
    /// Outward unit normals, and how far along each the set reaches, scene units.
    limits: Vec<(Vec3, f32)>,
}

impl ConvexSet {
    /// What is less than `margin` (scene units) beyond these points in every direction; everything where there are none.
    pub fn around(points: &[Vec3], margin: f32) -> Self {
        let directions = fibonacci_sphere(if points.is_empty() { 0 } else { DIRECTIONS });
        let limits = directions.into_iter().map(|normal| {
            let along = points.iter().map(|point| point.dot(normal));
            (normal, along.fold(f32::NEG_INFINITY, f32::max) + margin)
        });
        Self {
            limits: limits.collect(),
        }
    }

    /// How far the most outlying of the points lies beyond such a set around the others, scene units; 0 for fewer than two.
    pub fn outlying(points: &[Vec3]) -> f32 {
        let gaps = fibonacci_sphere(DIRECTIONS).into_iter().map(|normal| {
            let along = points.iter().map(|point| point.dot(normal));
            let none = [f32::NEG_INFINITY; 2];
            let [first, second] = along.fold(none, |[first, second], along| {
                [first.max(along), second.max(first.min(along))]
            });
            first - second
        });
        let furthest = gaps.fold(0.0, f32::max);
        if furthest.is_finite() { furthest } else { 0.0 }
    }

    /// Distance outside it, scene units, or less; negative inside.
    pub fn outside_by(&self, point: Vec3) -> f32 {
        let limits = self.limits.iter();
        let beyond = limits.map(|(normal, limit)| point.dot(*normal) - limit);
        beyond.fold(f32::NEG_INFINITY, f32::max)
    }

    /// Whether a point lies in it.
    pub fn contains(&self, point: Vec3) -> bool {
        let mut limits = self.limits.iter();
        limits.all(|(normal, limit)| point.dot(*normal) <= *limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Aabb;

    #[test]
    fn it_is_a_little_more_than_the_hull_of_its_points() {
        let bounds = Aabb::from_points([Vec3::new(-1.0, -2.0, -0.5), Vec3::new(1.0, 2.0, 0.5)]);
        let set = ConvexSet::around(&bounds.corners(), 0.1);
        for corner in bounds.corners() {
            assert!((set.outside_by(corner) + 0.1).abs() < 0.01, "{corner}");
        }
        for (direction, side) in [(Vec3::X, 1.0), (Vec3::Y, 2.0), (-Vec3::Z, 0.5)] {
            assert!(set.contains((side + 0.05) * direction));
            let beyond = set.outside_by((side + 1.0) * direction);
            assert!((0.7..0.95).contains(&beyond), "{beyond}");
        }
        let mut points = bounds.corners().to_vec();
        assert!(ConvexSet::outlying(&points) < 0.9, "a corner of four");
        points.push(4.0 * Vec3::X);
        let outlying = ConvexSet::outlying(&points);
        assert!((outlying - 3.0).abs() < 0.1, "{outlying}");
        assert_eq!(ConvexSet::outlying(&points[..1]), 0.0);
        assert!(ConvexSet::around(&[], 0.1).contains(Vec3::splat(1e9)));
    }
}
