//! A square around the foot of the object on the plane that it stands on, in field coordinates.

use glam::{Vec2, Vec3};

use crate::geometry::orthonormal_basis;

/// Share of the half side from which corrections fade out.
const FADE_FROM: f32 = 0.8;

/// A square of `side` x `side` points.
#[derive(Clone, Debug)]
pub(super) struct Square {
    pub(super) center: Vec3,
    /// Unit normal.
    pub(super) up: Vec3,
    across: Vec3,
    along: Vec3,
    pub(super) half_side: f32,
    pub(super) side: usize,
}

/// Where a ray comes down on a square.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    /// Along the ray, in lengths of its direction.
    pub(super) distance: f32,
    /// How fast the ray comes down, heights a distance.
    pub(super) fall: f32,
    /// In the square, `[-1, 1]`.
    pub(super) place: Vec2,
}

impl Meeting {
    /// 1 in the middle of the square, 0 on its rim.
    pub(super) fn fade(&self) -> f32 {
        1.0 - super::smoothstep(FADE_FROM, 1.0, self.place.length())
    }
}

impl Square {
    pub(super) fn new(center: Vec3, up: Vec3, half_side: f32, side: usize) -> Self {
        let (across, along) = orthonormal_basis(up);
        Self {
            center,
            up,
            across,
            along,
            half_side,
            side,
        }
    }

    /// Distance of neighbouring points.
    pub(super) fn point_size(&self) -> f32 {
        2.0 * self.half_side / self.side as f32
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.side * self.side
    }

    /// Point `i`, row by row.
    pub(super) fn point(&self, i: usize) -> Vec3 {
        let place = self.place(i) * self.half_side;
        self.center + self.across * place.x + self.along * place.y
    }

    fn place(&self, i: usize) -> Vec2 {
        let at = Vec2::new((i % self.side) as f32, (i / self.side) as f32) + 0.5;
        at * (2.0 / self.side as f32) - 1.0
    }

    /// Height of a point over the plane.
    pub(super) fn height(&self, point: Vec3) -> f32 {
        (point - self.center).dot(self.up)
    }

    /// Where a ray from above meets the square's inside.
    pub(super) fn meet(&self, origin: Vec3, direction: Vec3) -> Option<Meeting> {
        let height = self.height(origin);
        let fall = -direction.dot(self.up);
        // NaN meets nothing.
        if !(height > 0.0 && fall > 1e-6) {
            return None;
        }
        let distance = height / fall;
        let place = self.place_of(origin + distance * direction);
        (place.length_squared() < 1.0).then_some(Meeting {
            distance,
            fall,
            place,
        })
    }

    /// Where a point of the plane lies in the square.
    pub(super) fn place_of(&self, point: Vec3) -> Vec2 {
        let from_center = point - self.center;
        Vec2::new(from_center.dot(self.across), from_center.dot(self.along)) / self.half_side
    }
}
