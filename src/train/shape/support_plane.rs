//! The plane that an object stands on, or hangs on, among points of what is around it.

use glam::{Mat3, Vec3};

use crate::train::random::SlotRandom;
use crate::train::statistics::scatter;

/// Triples of points that are tried.
const TRIALS: u64 = 6000;
/// Points that each trial is judged by, at most.
const JUDGED: usize = 4000;
/// Share of the points that must lie in the plane, less those below it.
const LEAST_SHARE: f32 = 0.05;
/// Share of the cameras that may be below it.
const CAMERAS_BELOW: f32 = 0.03;
/// How near its points are, as a share of the reach.
const THICKNESS: f32 = 0.02;
/// Rounds of least squares after the best triple.
const REFITS: usize = 5;

/// `normal.dot(p) == offset`, the normal towards the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit.
    pub normal: Vec3,
    /// Distance of the origin, scene units.
    pub offset: f32,
}

impl Plane {
    /// Distance in front of the plane, scene units; negative behind it.
    #[inline]
    pub fn height(&self, p: Vec3) -> f32 {
        self.normal.dot(p) - self.offset
    }

    fn through(normal: Vec3, p: Vec3) -> Self {
        let offset = normal.dot(p);
        Self { normal, offset }
    }

    /// The other side up, where most `cameras` are below; `None` where they are on both sides.
    fn below(self, cameras: &[Vec3]) -> Option<Self> {
        let n_above = cameras.iter().filter(|p| self.height(**p) > 0.0).count() as f32;
        let n = cameras.len() as f32;
        if n_above >= (1.0 - CAMERAS_BELOW) * n {
            Some(self)
        } else if n_above <= CAMERAS_BELOW * n {
            Some(Self {
                normal: -self.normal,
                offset: -self.offset,
            })
        } else {
            None
        }
    }

    /// The plane of least squares of points near this one, whose normals are not far apart.
    fn refitted(&self, points: impl Iterator<Item = Vec3> + Clone) -> Option<Self> {
        let n = points.clone().count();
        let middle = points.clone().sum::<Vec3>() / n.max(1) as f32;
        let (right, front) = self.normal.any_orthonormal_pair();
        // height = a x + b y + c over the plane as it stands.
        let (mut square, mut product) = (Mat3::ZERO, Vec3::ZERO);
        for p in points {
            let from = p - middle;
            let row = Vec3::new(from.dot(right), from.dot(front), 1.0);
            square += Mat3::from_cols(row * row.x, row * row.y, row);
            product += row * from.dot(self.normal);
        }
        let slopes = square.inverse() * product;
        let normal = (self.normal - slopes.x * right - slopes.y * front).try_normalize()?;
        Some(Self::through(normal, middle + slopes.z * self.normal))
    }
}

/// A plane and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::train) struct Support {
    pub(in crate::train) plane: Plane,
    /// Standard deviation of its points' heights, scene units.
    pub(in crate::train) scatter: f32,
    /// Share of the points that lie in it, less the share that lies below it.
    pub(in crate::train) share: f32,
}

/// The plane with the most of these points and the fewest below it that all cameras look down on, but for a few; points in it
/// are within a small share of `reach`. `None` where there is no such plane. Random sample consensus (Fischler and Bolles 1981).
pub(in crate::train) fn find(points: &[Vec3], cameras: &[Vec3], reach: f32) -> Option<Support> {
    let near = THICKNESS * reach;
    let stride = points.len().div_ceil(JUDGED).max(1);
    let judged: Vec<Vec3> = points.iter().copied().step_by(stride).collect();
    let share = |is: &dyn Fn(Vec3) -> bool| {
        judged.iter().filter(|p| is(**p)).count() as f32 / judged.len() as f32
    };
    let mut best = None;
    let mut most = LEAST_SHARE;
    for trial in 0..TRIALS {
        let mut random = SlotRandom::new(0, 0, trial);
        let mut pick = || judged.get(random.index(judged.len().max(1))).copied();
        let (a, b, c) = (pick()?, pick()?, pick()?);
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        let Some(plane) = Plane::through(normal, a).below(cameras) else {
            continue;
        };
        let within = share(&|p| plane.height(p).abs() < near);
        if within > most {
            let score = within - share(&|p| plane.height(p) < -2.0 * near);
            if score > most {
                (most, best) = (score, Some(plane));
            }
        }
    }
    let mut plane = best?;
    let within = |plane: Plane| {
        let points = points.iter().copied();
        points.filter(move |p| plane.height(*p).abs() < near)
    };
    for _ in 0..REFITS {
        plane = plane.refitted(within(plane)).unwrap_or(plane);
    }
    let plane = plane.below(cameras)?;
    let heights = within(plane).map(|p| plane.height(p)).collect();
    Some(Support {
        plane,
        scatter: scatter(heights),
        share: most,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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

    fn cameras() -> Vec<Vec3> {
        let turn = |i: usize| (i as f32).sin_cos();
        let camera = |(sin, cos)| Vec3::new(2.0 * cos, 2.0 * sin, 1.0);
        (0..12).map(turn).map(camera).collect()
    }

    #[test]
    fn the_floor_is_found_whichever_way_is_up() {
        let truth = Vec3::new(-0.2, 0.0, 1.0).normalize_or_zero();
        for turn in [Mat3::IDENTITY, Mat3::from_rotation_x(2.0)] {
            let turned = |points: Vec<Vec3>| points.iter().map(|p| turn * *p).collect::<Vec<_>>();
            let support = find(&turned(scene()), &turned(cameras()), 1.0).expect("a floor");
            let plane = support.plane;
            assert!(plane.normal.dot(turn * truth) > 0.9999, "{plane:?}");
            let height = |p: Vec3| plane.height(turn * p);
            assert!(height(Vec3::new(0.0, 0.0, -1.1)) < -0.05);
            assert!(height(Vec3::new(0.0, 0.0, -0.5)) > 0.4);
            assert!(support.scatter < 0.01 && support.share > 0.2, "{support:?}");
        }
    }

    #[test]
    fn a_ball_alone_stands_on_nothing() {
        assert_eq!(find(&scene()[200..], &cameras(), 1.0), None);
        assert_eq!(find(&[], &cameras(), 1.0), None);
    }
}
