//! How deep is what one photo shows: a plane sweep (Collins 1996). Its neighbours' photos are warped onto it over planes
//! that face it, and where one of them lies on what it shows, the photos look alike.

use glam::{Mat3, Vec2, Vec3};

use super::correlation::{Correlator, UNKNOWN};
use super::small_photo::SmallPhoto;
use crate::geometry::Camera;

/// Least correlation with two neighbours, and by how much it must exceed that of any other depth: what repeats itself fits
/// at several.
const LEAST_SCORE: f32 = 0.75;
const LEAST_LEAD: f32 = 0.04;
/// Steps around the best that are the same peak.
const PEAK: usize = 3;
/// Codes of a correlation of 1.
const CODES: f32 = 127.0;

/// Depths that are tried: evenly in one over the depth, from infinity on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    /// Number of steps.
    pub(super) n: usize,
    /// One over the depth from one step to the next, world units.
    pub(super) width: f32,
}

/// One over the depth, along the camera's axis, of what each pixel of `photo` shows, world units; NaN where the
/// neighbours do not tell.
pub(super) fn sweep(photo: &SmallPhoto, neighbours: &[&SmallPhoto], steps: Steps) -> Vec<f32> {
    let n_pixels = photo.grey.len();
    let warps: Vec<Warp> = neighbours
        .iter()
        .map(|neighbour| Warp::new(&photo.camera, &neighbour.camera))
        .collect();
    let mut correlator = Correlator::new(photo);
    let mut codes = vec![i8::MIN; steps.n * n_pixels];
    let (mut first, mut second) = (vec![UNKNOWN; n_pixels], vec![UNKNOWN; n_pixels]);
    let mut warped = vec![f32::NAN; n_pixels];
    for (k, codes) in codes.chunks_exact_mut(n_pixels).enumerate() {
        first.fill(UNKNOWN);
        second.fill(UNKNOWN);
        for (neighbour, warp) in neighbours.iter().zip(&warps) {
            warp.apply(k as f32 * steps.width, photo, neighbour, &mut warped);
            correlator.add(&warped, &mut first, &mut second);
        }
        for (code, (first, second)) in codes.iter_mut().zip(first.iter().zip(&second)) {
            let is_known = *second > UNKNOWN;
            if is_known {
                *code = (0.5 * (first + second) * CODES).round() as i8;
            }
        }
    }
    let peak = |i: usize| peak(|k| codes[k * n_pixels + i], steps.n);
    (0..n_pixels)
        .map(|i| peak(i).map_or(f32::NAN, |step| step * steps.width))
        .collect()
}

/// The step, with its fraction, at which the correlation is by far the largest.
fn peak(code: impl Fn(usize) -> i8, n: usize) -> Option<f32> {
    let best = (0..n).rev().max_by_key(|k| code(*k))?;
    let value = |k: usize| f32::from(code(k)) / CODES;
    if value(best) < LEAST_SCORE {
        return None;
    }
    let is_other = |k: &usize| k.abs_diff(best) > PEAK;
    let other = (0..n).filter(is_other).map(value).fold(-1.0, f32::max);
    // What is nearer than the last step is not known.
    if value(best) - other < LEAST_LEAD || best + 1 >= n {
        return None;
    }
    if best == 0 {
        return Some(0.0);
    }
    // The vertex of the parabola through it and those beside it.
    let [before, middle, after] = [best - 1, best, best + 1].map(value);
    let bend = (2.0 * middle - before - after).max(f32::EPSILON);
    Some(best as f32 + (0.5 * (after - before) / bend).clamp(-0.5, 0.5))
}

/// From the pixels of one pinhole camera to those of another, by the depth.
struct Warp {
    /// Homogeneous pixels of the other from those of the first, of what is infinitely far away.
    at_infinity: Mat3,
    /// What one over the depth adds.
    by_nearness: Vec3,
}

impl Warp {
    fn new(from: &Camera, to: &Camera) -> Self {
        // Columns: where a step to the right, one downwards, and the picture's corner are in the world.
        let axes = Mat3::from(from.world_from_camera.matrix3);
        let (right, down) = (axes.x_axis / from.fx, -axes.y_axis / from.fy);
        let corner = -axes.z_axis - from.cx * right - from.cy * down;
        let camera = to.world_from_camera.inverse();
        let pixels = |p_camera: Vec3| {
            let p = p_camera * Vec3::new(1.0, -1.0, -1.0);
            Vec3::new(to.fx * p.x + to.cx * p.z, to.fy * p.y + to.cy * p.z, p.z)
        };
        let of_direction = |v: Vec3| pixels(camera.transform_vector3(v));
        Self {
            at_infinity: Mat3::from_cols(
                of_direction(right),
                of_direction(down),
                of_direction(corner),
            ),
            by_nearness: pixels(camera.transform_point3(from.position())),
        }
    }

    /// What `to` shows where the pixels of `from` do, were all of it so deep; NaN where it does not.
    fn apply(&self, nearness: f32, from: &SmallPhoto, to: &SmallPhoto, warped: &mut [f32]) {
        let width = from.camera.width as usize;
        let mut places = vec![Vec2::ZERO; width];
        for (y, row) in warped.chunks_exact_mut(width).enumerate() {
            let first = self.at_infinity * Vec3::new(0.5, y as f32 + 0.5, 1.0)
                + nearness * self.by_nearness;
            for (x, place) in places.iter_mut().enumerate() {
                let at = first + x as f32 * self.at_infinity.x_axis;
                // Behind the camera it is beside the picture.
                let depth = if at.z > 0.0 { at.z } else { f32::NAN };
                *place = Vec2::new(at.x / depth, at.y / depth);
            }
            for (value, place) in row.iter_mut().zip(&places) {
                *value = to.at(*place);
            }
        }
    }
}
