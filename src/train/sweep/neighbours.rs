//! With which other photos one is compared.

use glam::Vec3;

use crate::geometry::Camera;

/// Photos that one is compared with.
const N_NEIGHBOURS: usize = 4;
/// The angle between two rays to a point at which its distance is estimated best: with less it is vague, with more the
/// pictures differ. Radians.
const BEST_ANGLE: f32 = 0.17;
/// Least mean worth of a neighbour: one that shows a twentieth of the points at a good angle.
const LEAST_WORTH: f32 = 0.05;
/// Two neighbours stand further apart than this share of their distances from the photo's camera.
const APART: f32 = 0.5;

/// The photos that constrain distances in photo `index`, best first; `points`: where what it shows may be, world.
pub(in crate::train) fn neighbours(
    cameras: &[Camera],
    index: usize,
    points: &[Vec3],
) -> Vec<usize> {
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

/// How well another photo determines how far a point is from an eye, `[0, 1]`; 0 where it does not show it.
fn worth(eye: Vec3, other: &Camera, point: Vec3) -> f32 {
    let shown_at = other.project(point).and_then(|at| other.pixel_at(at));
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
