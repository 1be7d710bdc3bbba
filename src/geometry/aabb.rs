//! Axis-aligned boxes.

use glam::Vec3;

use super::Ray;

/// An axis-aligned box; empty when a component of `min` exceeds that of `max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box that holds nothing; the start of a box around points.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// The smallest box around the points.
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |aabb, p| Self {
            min: aabb.min.min(p),
            max: aabb.max.max(p),
        })
    }

    /// The middle of the box.
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// The side lengths.
    pub fn extent(&self) -> Vec3 {
        self.max - self.min
    }

    /// The length of the space diagonal.
    pub fn diagonal(&self) -> f32 {
        self.extent().length()
    }

    /// Whether the box holds no point.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// The part of the ray, as distances from its origin, that lies in the box; `None` where it misses it.
    pub fn span(&self, ray: &Ray) -> Option<(f32, f32)> {
        let inverse = ray.direction.recip();
        let (a, b) = (
            (self.min - ray.origin) * inverse,
            (self.max - ray.origin) * inverse,
        );
        let start = a.min(b).max_element().max(0.0);
        let end = a.max(b).min_element();
        (start < end).then_some((start, end))
    }

    /// Whether `p` lies in the box, its faces included.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// The box with `margin` more on all sides, scene units.
    pub fn widened(&self, margin: f32) -> Self {
        Self {
            min: self.min - margin,
            max: self.max + margin,
        }
    }

    /// The eight corners; bit 0, 1, 2 of the index chooses max over min in x, y, z.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            Vec3::new(
                if i & 1 == 0 { self.min.x } else { self.max.x },
                if i & 2 == 0 { self.min.y } else { self.max.y },
                if i & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_holds_its_corners_and_the_empty_one_nothing() {
        let aabb = Aabb::from_points([Vec3::ZERO, Vec3::new(1.0, 2.0, 2.0)]);
        assert!(Aabb::EMPTY.is_empty() && !aabb.is_empty(), "emptiness");
        assert_eq!(aabb.diagonal(), 3.0, "diagonal");
        assert_eq!(aabb.center(), Vec3::new(0.5, 1.0, 1.0), "center");
        assert!(aabb.corners().iter().all(|p| aabb.contains(*p)), "corners");
    }
}
