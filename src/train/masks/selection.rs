//! What a person says of the object.

use glam::{Vec2, Vec3};

use crate::geometry::Aabb;

/// Which object is meant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Selection {
    /// A point on it, world; the middle of what the cameras look at where absent.
    pub at: Option<Vec3>,
    /// A box that it is within, world.
    pub within: Option<Aabb>,
    /// Whether it is what the photos' own masks show: they are refined.
    pub is_masked: bool,
}

/// A stroke of a brush in one photo that corrects what was found: true in that photo as it is drawn, and as far as it says
/// something of space, in all.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// Index of the photo in [`crate::data::Dataset::views`].
    pub view: usize,
    /// The line that the brush took, pixels of the photo; one place is a dot.
    pub places: Vec<Vec2>,
    /// Radius of the brush, pixels of the photo.
    pub radius: f32,
    /// Whether what it covers is the object's; beside the object otherwise.
    pub adds: bool,
}

impl Stroke {
    /// Whether it covers a place in its photo, pixels.
    pub fn covers(&self, at: Vec2) -> bool {
        let square = self.radius * self.radius;
        let dot = |place: &Vec2| place.distance_squared(at) <= square;
        let line = |ends: &[Vec2]| {
            let along = ends[1] - ends[0];
            let t = (at - ends[0]).dot(along) / along.length_squared().max(f32::MIN_POSITIVE);
            (ends[0] + t.clamp(0.0, 1.0) * along).distance_squared(at) <= square
        };
        match &self.places[..] {
            [place] => dot(place),
            places => places.windows(2).any(line),
        }
    }

    /// The corners of the rectangle around it, pixels.
    pub(super) fn bounds(&self) -> [Vec2; 2] {
        let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for place in &self.places {
            min = min.min(*place - self.radius);
            max = max.max(*place + self.radius);
        }
        [min, max]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_covers_what_is_as_near_to_its_line_as_the_brush_is_wide() {
        let places = [(10.0, 10.0), (30.0, 10.0), (30.0, 40.0)];
        let mut stroke = Stroke {
            view: 0,
            places: places.map(Vec2::from).to_vec(),
            radius: 3.0,
            adds: true,
        };
        let covers = |stroke: &Stroke, x, y| stroke.covers(Vec2::new(x, y));
        assert!(covers(&stroke, 20.0, 12.9) && !covers(&stroke, 20.0, 13.1));
        assert!(covers(&stroke, 32.0, 42.0) && !covers(&stroke, 32.5, 42.5));
        assert_eq!(stroke.bounds(), [Vec2::splat(7.0), Vec2::new(33.0, 43.0)]);
        stroke.places.truncate(1);
        assert!(covers(&stroke, 10.0, 13.0) && !covers(&stroke, 20.0, 10.0));
    }
}
