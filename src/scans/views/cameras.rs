//! From where a scan is photographed: places that are seen from where the object may stand, looking to it, away from it and
//! all around.

use glam::{Quat, Vec3};

use super::stand::{Stand, clearance};
use crate::geometry::Camera;
use crate::geometry::fibonacci_sphere;

/// Vertical field of view, radians.
const FOV: f32 = 1.309;
/// How far towards what it would bump into a camera goes.
const FORWARD: f32 = 0.8;
/// Least distance from anything, as a share of the radius.
const CLEAR: f32 = 0.08;
/// How close to the object's place the photos of what surrounds it are taken, as a share of the radius.
const CLOSE: f32 = 0.25;
/// The golden ratio less one, and the same in two dimensions (Roberts' R2): their multiples fill evenly, however many, and
/// independently of one another.
const R1: f32 = 0.618_034;
const R2: [f32; 2] = [0.754_877_7, 0.569_840_3];

/// `n` cameras of `side` x `side` pixels. In turns: near the object's place, looking all around; away from it, looking to it; away
/// from it, looking anywhere.
pub(super) fn cameras(
    stand: &Stand,
    points: &[Vec3],
    up: Vec3,
    (n, side): (usize, u32),
) -> Vec<Camera> {
    let n_kind = n.div_ceil(3);
    let directions = fibonacci_sphere(n_kind);
    let to_up = Quat::from_rotation_arc(Vec3::Z, up);
    let turned = |i: usize, ratio: f32, start: f32| {
        let share = (start + ratio * i as f32).fract();
        to_up * directions[(share * n_kind as f32) as usize % n_kind]
    };
    let camera = |i: usize| {
        let (turn, kind) = (i / 3, i % 3);
        let start = kind as f32 / 3.0;
        let share = (start + R2[1] * turn as f32).fract().sqrt();
        let reach = match kind {
            0 => CLOSE * share,
            _ => CLOSE + (1.0 - CLOSE) * share,
        };
        let eye = free_eye(stand, points, turned(turn, R2[0], start), reach);
        let looking = turned(turn, R1, start);
        let target = match kind {
            1 => stand.at + CLOSE * stand.radius * looking,
            _ => eye + looking,
        };
        Camera::look_at(eye, target, up, FOV, side, side)
    };
    (0..n).map(camera).collect()
}

/// A free place along a direction, at most a share of the radius away.
fn free_eye(stand: &Stand, points: &[Vec3], direction: Vec3, share: f32) -> Vec3 {
    let mut distance = (share * stand.radius).min(FORWARD * stand.sight(direction));
    for _ in 0..6 {
        let eye = stand.at + distance * direction;
        if clearance(points, eye) > CLEAR * stand.radius {
            return eye;
        }
        distance *= 0.7;
    }
    stand.at
}
