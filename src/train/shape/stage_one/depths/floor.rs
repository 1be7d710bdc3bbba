//! The plane that an object stands on, from a reconstruction's points.

use glam::Vec3;

use crate::geometry::ScalarGrid;
use crate::train::random::SlotRandom;
use crate::train::shape::stage_one::hull::raise;

/// Triples of points that are tried.
const TRIALS: u64 = 3000;
/// Share of the points, the lowest, from which they are drawn.
const LOWEST: f32 = 0.3;
/// Share of the points that must lie in the plane.
const LEAST_SHARE: f32 = 0.05;
/// Share of the points that may lie below it.
const BELOW: f32 = 0.03;
/// Cosine of the largest angle between its normal and up.
const UPRIGHT: f32 = 0.8;
/// How near its points are, as a share of the reach.
const THICKNESS: f32 = 0.02;

/// `normal.dot(p) == offset`, the normal upwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) struct Plane {
    normal: Vec3,
    offset: f32,
}

impl Plane {
    fn height(&self, p: Vec3) -> f32 {
        self.normal.dot(p) - self.offset
    }

    /// Leaves nothing in `grid`, distances to a surface, lower than `clearance` over the plane.
    pub(in super::super) fn cut(&self, grid: &mut ScalarGrid, clearance: f32) {
        raise(grid, |p| clearance - self.height(p));
    }
}

/// The level plane with the most of these points that has next to none below it, all within `reach` of each other; `None`
/// where there is no such plane. `up` is a unit vector. Random sample consensus (Fischler and Bolles 1981).
pub(in super::super) fn find(points: &[Vec3], up: Vec3, reach: f32) -> Option<Plane> {
    let near = THICKNESS * reach;
    let share = |is: &dyn Fn(Vec3) -> bool| {
        points.iter().filter(|p| is(**p)).count() as f32 / points.len() as f32
    };
    let mut lowest = points.to_vec();
    lowest.sort_unstable_by(|a, b| up.dot(*a).total_cmp(&up.dot(*b)));
    lowest.truncate((LOWEST * points.len() as f32).ceil() as usize);
    let mut best = None;
    let mut most = LEAST_SHARE;
    for trial in 0..TRIALS {
        let mut random = SlotRandom::new(0, 0, trial);
        let mut pick = || {
            let at = (random.uniform() * lowest.len() as f32) as usize;
            lowest.get(at.min(lowest.len().saturating_sub(1))).copied()
        };
        let (a, b, c) = (pick()?, pick()?, pick()?);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let normal = normal * normal.dot(up).signum();
        if normal.dot(up) < UPRIGHT {
            continue;
        }
        let plane = Plane {
            normal,
            offset: normal.dot(a),
        };
        let within = share(&|p| plane.height(p).abs() < near);
        if within > most && share(&|p| plane.height(p) < -near) < BELOW {
            (most, best) = (within, Some(plane));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Aabb;

    /// A floor at height -1, rising a little along x, and a ball above it.
    fn scene() -> Vec<Vec3> {
        let spread = |i: usize| {
            let i = i as f32;
            [(0.754_877_7 * i).fract(), (0.569_840_3 * i).fract()].map(|v| 2.0 * v - 1.0)
        };
        let floor = (0..200).map(|i| {
            let [x, y] = spread(i);
            Vec3::new(x, y, -1.0 + 0.2 * x)
        });
        let ball = (0..600).map(|i| {
            let [z, turn] = spread(i);
            let (sin, cos) = (turn * std::f32::consts::PI).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            0.5 * Vec3::new(radius * cos, radius * sin, z)
        });
        floor.chain(ball).collect()
    }

    #[test]
    fn the_floor_is_found_and_what_lies_below_is_cut() {
        let plane = find(&scene(), Vec3::Z, 1.0).expect("a floor");
        let truth = Vec3::new(-0.2, 0.0, 1.0).normalize_or_zero();
        assert!(plane.normal.dot(truth) > 0.999, "{plane:?}");
        let [min, max] = [-1.5, 1.5].map(Vec3::splat);
        let mut grid = ScalarGrid::over(&Aabb { min, max }, 16, -1.0);
        plane.cut(&mut grid, 0.1);
        assert!(grid.sample(Vec3::new(0.0, 0.0, -1.2)) > 0.0);
        assert!(grid.sample(Vec3::new(0.0, 0.0, -0.3)) < 0.0);
    }

    #[test]
    fn a_ball_alone_stands_on_nothing() {
        assert_eq!(find(&scene()[200..], Vec3::Z, 1.0), None);
        assert_eq!(find(&[], Vec3::Z, 1.0), None);
    }
}
