//! With which other photos one is compared.

use glam::Vec3;

use super::pixel_at;
use crate::geometry::Camera;

/// Photos that one is compared with.
const N_NEIGHBOURS: usize = 4;
/// Points along each side of the picture that are looked for in other photos.
const SIDE: usize = 4;
/// Their distances, in typical ones.
const DISTANCES: [f32; 3] = [0.6, 1.2, 3.0];
/// The angle between two rays to a point at which its distance is estimated best: with less it is vague, with more the
/// pictures differ. Radians.
const BEST_ANGLE: f32 = 0.17;
/// Least mean worth of a neighbour: one that shows a twentieth of the points at a good angle.
const LEAST_WORTH: f32 = 0.05;
/// Two neighbours stand further apart than this share of their distances from the photo's camera.
const APART: f32 = 0.5;

/// The photos that constrain distances in photo `index`, best first; `typical`: a distance of what is seen, world units.
pub(super) fn neighbours(cameras: &[Camera], index: usize, typical: f32) -> Vec<usize> {
    let points = points_before(&cameras[index], typical);
    let eye = cameras[index].position();
    let worth = |other: &Camera| {
        let sum: f32 = points.iter().map(|p| worth(eye, other, *p)).sum();
        sum / points.len() as f32
    };
    let others = cameras.iter().enumerate().filter(|(i, _)| *i != index);
    let mut others: Vec<(f32, usize)> = others.map(|(i, other)| (worth(other), i)).collect();
    others.retain(|(worth, _)| *worth >= LEAST_WORTH);
    others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<usize> = Vec::new();
    for (_, other) in others {
        let place = cameras[other].position();
        let is_apart = |former: &usize| {
            let former = cameras[*former].position();
            place.distance(former) > APART * place.distance(eye).min(former.distance(eye))
        };
        if chosen.iter().all(is_apart) {
            chosen.push(other);
        }
        if chosen.len() == N_NEIGHBOURS {
            break;
        }
    }
    chosen
}

fn points_before(camera: &Camera, typical: f32) -> Vec<Vec3> {
    let at = |i: usize, n: u32| (i as f32 + 0.5) / SIDE as f32 * n as f32;
    let ray = |i: usize| camera.ray(at(i % SIDE, camera.width), at(i / SIDE, camera.height));
    let points = |i: usize| DISTANCES.map(|distance| ray(i).at(distance * typical));
    (0..SIDE * SIDE).flat_map(points).collect()
}

/// How well another photo determines how far a point is from an eye, `[0, 1]`; 0 where it does not show it.
fn worth(eye: Vec3, other: &Camera, point: Vec3) -> f32 {
    let shown_at = other.project(point).and_then(|at| pixel_at(other, at));
    if shown_at.is_none() {
        return 0.0;
    }
    let angle = (point - eye).angle_between(point - other.position()) / BEST_ANGLE;
    // 1 at the best angle, linear below, steeply less above.
    if angle < 1.0 {
        angle
    } else {
        (1.0 - angle).exp()
    }
}
