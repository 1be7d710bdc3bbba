//! How deep is what one photo shows: a plane sweep (Collins 1996). Its neighbours' photos are warped onto it over planes
//! that face it, and where one of them lies on what it shows, the photos look alike.

use glam::{Mat3, Vec3};

use super::correlation::{Correlator, UNKNOWN};
use super::small_photo::SmallPhoto;
use crate::geometry::Camera;
use crate::neif::kernels::{Isa, dispatch, fma};

/// Least correlation with two neighbours, and by how much it must exceed that of any other depth: what repeats itself fits
/// at several.
const LEAST_SCORE: f32 = 0.75;
const LEAST_LEAD: f32 = 0.04;
/// Steps around the best that are the same peak.
const PEAK: u8 = 3;
/// Codes of a correlation of 1.
const CODES: f32 = 127.0;

/// Fewest and most depths that are tried.
const N_STEPS: (usize, usize) = (8, 128);

/// Depths that are tried: evenly in one over the depth, world units.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Steps {
    /// Number of steps.
    pub(super) n: usize,
    /// One over the furthest depth, 0 for infinity.
    pub(super) first: f32,
    /// From one step to the next.
    pub(in crate::train) width: f32,
}

impl Steps {
    /// From one over the furthest to one over the nearest depth, about a pixel of the neighbours apart.
    pub(in crate::train) fn between(
        [furthest, nearest]: [f32; 2],
        photo: &SmallPhoto,
        neighbours: &[&SmallPhoto],
    ) -> Self {
        let eye = photo.camera.position();
        let pixels = |other: &&SmallPhoto| {
            other.camera.position().distance(eye) / other.camera.pixel_angle()
        };
        let range = nearest - furthest;
        let n = (neighbours.iter().map(pixels).fold(0.0, f32::max) * range).ceil() as usize;
        let n = n.clamp(N_STEPS.0, N_STEPS.1);
        Self {
            n,
            first: furthest,
            width: range / (n - 1) as f32,
        }
    }
}

dispatch! {
    /// One over the depth, along the camera's axis, of what each pixel of `photo` shows, world units; NaN where the
    /// neighbours do not determine it.
    pub(super) fn sweep(photo: &SmallPhoto, neighbours: &[&SmallPhoto], steps: Steps) -> Vec<f32> = sweep_body
}

#[inline(always)]
fn sweep_body<I: Isa>(photo: &SmallPhoto, neighbours: &[&SmallPhoto], steps: Steps) -> Vec<f32> {
    let n_pixels = photo.grey.len();
    let warp = |neighbour: &&SmallPhoto| Warp::new(&photo.camera, &neighbour.camera);
    let warps: Vec<Warp> = neighbours.iter().map(warp).collect();
    let mut correlator = Correlator::new(photo);
    let mut codes = vec![i8::MIN; steps.n * n_pixels];
    let (mut first, mut second) = (vec![UNKNOWN; n_pixels], vec![UNKNOWN; n_pixels]);
    let mut warped = vec![f32::NAN; n_pixels];
    let mut line = Line::new(photo.camera.width as usize);
    for (k, codes) in codes.chunks_exact_mut(n_pixels).enumerate() {
        first.fill(UNKNOWN);
        second.fill(UNKNOWN);
        for (neighbour, warp) in neighbours.iter().zip(&warps) {
            let nearness = steps.first + k as f32 * steps.width;
            warp.apply::<I>(nearness, neighbour, &mut line, &mut warped);
            correlator.add(&warped, &mut first, &mut second);
        }
        for (code, (first, second)) in codes.iter_mut().zip(first.iter().zip(&second)) {
            let is_known = *second > UNKNOWN;
            let value = (0.5 * (first + second) * CODES).round_ties_even() as i8;
            *code = if is_known { value } else { i8::MIN };
        }
    }
    let peaks = peaks(&codes, n_pixels);
    (0..n_pixels)
        .map(|i| place_of(peaks[i], |k| codes[k * n_pixels + i], steps))
        .map(|step| step.map_or(f32::NAN, |step| steps.first + step * steps.width))
        .collect()
}

/// Where a pixel's correlation is largest.
#[derive(Clone, Copy, Debug)]
struct Peak {
    step: u8,
    code: i8,
    /// The largest of the steps that are not the same peak.
    other: i8,
}

/// The peaks of all pixels; `codes`: `[steps][n_pixels]`.
#[inline(always)]
fn peaks(codes: &[i8], n_pixels: usize) -> Vec<Peak> {
    let (mut best, mut at) = (vec![i8::MIN; n_pixels], vec![0_u8; n_pixels]);
    for (k, codes) in codes.chunks_exact(n_pixels).enumerate() {
        for ((best, at), code) in best.iter_mut().zip(&mut at).zip(codes) {
            let is_better = *code > *best;
            *best = if is_better { *code } else { *best };
            *at = if is_better { k as u8 } else { *at };
        }
    }
    let mut others = vec![i8::MIN; n_pixels];
    for (k, codes) in codes.chunks_exact(n_pixels).enumerate() {
        for ((other, at), code) in others.iter_mut().zip(&at).zip(codes) {
            let is_other = at.abs_diff(k as u8) > PEAK;
            let best = (*other).max(*code);
            *other = if is_other { best } else { *other };
        }
    }
    let found = at.into_iter().zip(best).zip(others);
    found
        .map(|((step, code), other)| Peak { step, code, other })
        .collect()
}

/// The step of a peak, with its fraction; `None` where it does not stand out.
fn place_of(peak: Peak, code: impl Fn(usize) -> i8, steps: Steps) -> Option<f32> {
    let value = |code: i8| f32::from(code) / CODES;
    let best = usize::from(peak.step);
    let stands_out = value(peak.code) >= LEAST_SCORE
        && value(peak.code) - value(peak.other).max(-1.0) >= LEAST_LEAD;
    // What is nearer than the last step is not known, nor what is further than the first, unless that is infinity.
    if !stands_out || best + 1 >= steps.n {
        return None;
    }
    if best == 0 {
        return (steps.first == 0.0).then_some(0.0);
    }
    // The vertex of the parabola through it and those beside it.
    let [before, middle, after] = [best - 1, best, best + 1].map(|k| value(code(k)));
    let bend = (2.0 * middle - before - after).max(f32::EPSILON);
    Some(best as f32 + (0.5 * (after - before) / bend).clamp(-0.5, 0.5))
}

/// A row of places in another photo: between which of its pixels.
struct Line {
    /// The upper left one of the four.
    corners: Vec<u32>,
    /// How far to the right and below, `[0, 1]`; NaN beside the picture.
    right: Vec<f32>,
    below: Vec<f32>,
    /// What the four show: upper left, upper right, lower left, lower right.
    values: [Vec<f32>; 4],
}

impl Line {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self {
            corners: vec![0; width],
            right: row(),
            below: row(),
            values: std::array::from_fn(|_| row()),
        }
    }
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

    /// What `to` shows where the pixels of the first camera do, were all of it so deep; NaN where it does not.
    #[inline(always)]
    fn apply<I: Isa>(&self, nearness: f32, to: &SmallPhoto, line: &mut Line, warped: &mut [f32]) {
        let width = line.corners.len();
        let n = to.camera.width as usize;
        if to.camera.width < 2 || to.camera.height < 2 {
            // Nothing lies between four pixels.
            warped.fill(f32::NAN);
            return;
        }
        for (y, row) in warped.chunks_exact_mut(width).enumerate() {
            let first = self.at_infinity * Vec3::new(0.5, y as f32 + 0.5, 1.0)
                + nearness * self.by_nearness;
            self.find::<I>(first, &to.camera, line);
            let [a, b, c, d] = &mut line.values;
            let (a, b) = (&mut a[..width], &mut b[..width]);
            let (c, d) = (&mut c[..width], &mut d[..width]);
            let (grey, corners) = (to.grey.as_slice(), &line.corners[..width]);
            for x in 0..width {
                let corner = corners[x] as usize;
                let block = &grey[corner..corner + n + 2];
                (a[x], b[x], c[x], d[x]) = (block[0], block[1], block[n], block[n + 1]);
            }
            let (right, below) = (&line.right[..width], &line.below[..width]);
            let row = &mut row[..width];
            for x in 0..width {
                let above = fma::<I>(right[x], b[x] - a[x], a[x]);
                let under = fma::<I>(right[x], d[x] - c[x], c[x]);
                row[x] = fma::<I>(below[x], under - above, above);
            }
        }
    }

    /// Places of a row of pixels, the first of which is at `first`, homogeneous.
    #[inline(always)]
    fn find<I: Isa>(&self, first: Vec3, to: &Camera, line: &mut Line) {
        let (step, width) = (self.at_infinity.x_axis, to.width as f32);
        // A little less than the last pixel.
        let [most_right, most_below] = [width, to.height as f32].map(|n| (n - 1.0).next_down());
        let n = line.corners.len();
        let (right, below) = (&mut line.right[..n], &mut line.below[..n]);
        let corners = &mut line.corners[..n];
        for x in 0..n {
            let t = x as f32;
            let depth = fma::<I>(t, step.z, first.z);
            // Behind the camera it is beside the picture.
            let nearness = if depth > 0.0 { 1.0 / depth } else { f32::NAN };
            right[x] = fma::<I>(t, step.x, first.x) * nearness - 0.5;
            below[x] = fma::<I>(t, step.y, first.y) * nearness - 0.5;
        }
        for x in 0..n {
            let (u, v) = (right[x], below[x]);
            let (column, row) = (u.clamp(0.0, most_right), v.clamp(0.0, most_below));
            let is_inside = u == column && v == row;
            let (column, row) = (column.floor(), row.floor());
            let corner = row * width + column;
            corners[x] = if is_inside { corner as i32 as u32 } else { 0 };
            right[x] = if is_inside { u - column } else { f32::NAN };
            below[x] = v - row;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_a_pixel_wide_determine_nothing() {
        let photo = |x: f32| SmallPhoto {
            camera: Camera::look_at(Vec3::new(x, 2.0, 0.0), Vec3::ZERO, Vec3::Z, 1.0, 1, 40),
            grey: (0..40).map(|i| (i % 7) as f32 / 7.0).collect(),
            colors: vec![Vec3::ONE; 40],
        };
        let (n, first, width) = (8, 0.0, 0.1);
        let steps = Steps { n, first, width };
        let found = sweep(&photo(0.0), &[&photo(0.1), &photo(-0.1)], steps);
        assert!(found.len() == 40 && found.iter().all(|nearness| nearness.is_nan()));
    }
}
