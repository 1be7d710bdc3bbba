//! The pose of one photo, from what it and a picture of the scene differ by: linear least squares over pixels give its six numbers
//! (Lucas and Kanade 1981; inverse compositional, Baker and Matthews 2004).
//!
//! The photo's slope is used, not the field's: that of a hash grid is noise below the size of its cells.

use glam::{DMat3, DVec3, Mat3A, Quat, Vec3, Vec3A};

use crate::geometry::Camera;

/// Difference, in sRGB, from which a pixel counts less: it shows something else, not the same thing shifted.
const USUAL_DIFFERENCE: f32 = 0.1;
/// Least opacity along a ray: without a surface there is no distance.
const LEAST_OPACITY: f32 = 0.5;
/// Ridge, relative to the diagonal of the least squares.
const RIDGE: f64 = 0.05;
/// How far off poses are expected to be, pixels.
const EXPECTED_PX: f64 = 3.0;

/// A pixel's equation: `slopes · correction = difference`.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct PoseRow {
    pub(in crate::train) view: usize,
    /// By the rotation about the world's axes, radians, and the translation, in the unit of the distances.
    slopes: [f32; 6],
    /// Shown grey value less the photo's, sRGB.
    difference: f32,
}

impl PoseRow {
    /// Of a pixel whose ray, `direction`, ends at `distance` with `opacity`; `slope` is the photo's grey value by the unit
    /// direction ([`slope_by_direction`]). `None` where nothing can be determined.
    pub(in crate::train) fn new(
        view: usize,
        direction: Vec3,
        slope: Vec3,
        difference: f32,
        (distance, opacity): (f32, f32),
    ) -> Option<Self> {
        // A camera that turns by `w` and moves by `s` sees a point in the direction `d - w x d - s / t`.
        let (turn, shift) = (slope.cross(direction), -slope / distance.max(1e-3));
        let is_known = opacity >= LEAST_OPACITY && turn.is_finite() && difference.is_finite();
        is_known.then_some(Self {
            view,
            slopes: [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z],
            difference,
        })
    }
}

/// The slope of a photo's grey value by the direction of the ray, in the plane across it, from that by the pixel.
pub(in crate::train) fn slope_by_direction(
    camera: &Camera,
    x: f32,
    y: f32,
    by_pixel: [f32; 2],
) -> Vec3 {
    let direction = camera.ray(x, y).direction;
    let right = camera.ray(x + 1.0, y).direction - direction;
    let down = camera.ray(x, y + 1.0).direction - direction;
    let (rr, rd, dd) = (right.dot(right), right.dot(down), down.dot(down));
    let [a, b] = by_pixel;
    let determinant = (rr * dd - rd * rd).max(f32::MIN_POSITIVE);
    (right * (a * dd - b * rd) + down * (b * rr - a * rd)) / determinant
}

/// Sums of the least squares of one photo, in blocks of rotation and translation.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Sums {
    turns: DMat3,
    mixed: DMat3,
    shifts: DMat3,
    by_turn: DVec3,
    by_shift: DVec3,
}

impl Sums {
    /// Numbers that it consists of.
    pub(super) const LEN: usize = 33;

    pub(in crate::train) const ZERO: Self = Self {
        turns: DMat3::ZERO,
        mixed: DMat3::ZERO,
        shifts: DMat3::ZERO,
        by_turn: DVec3::ZERO,
        by_shift: DVec3::ZERO,
    };

    /// The bits of all its numbers.
    pub(in crate::train) fn to_bits(self) -> [u64; Self::LEN] {
        let blocks = [self.turns, self.mixed, self.shifts].map(|block| block.to_cols_array());
        let by = [self.by_turn, self.by_shift].map(|v| v.to_array());
        let numbers = blocks.as_flattened().iter().chain(by.as_flattened());
        let mut bits = [0; Self::LEN];
        for (bits, v) in bits.iter_mut().zip(numbers) {
            *bits = v.to_bits();
        }
        bits
    }

    pub(in crate::train) fn from_bits(bits: &[u64; Self::LEN]) -> Self {
        let numbers = bits.map(f64::from_bits);
        let block = |at: usize| DMat3::from_cols_slice(&numbers[at..]);
        let vector = |at: usize| DVec3::from_slice(&numbers[at..]);
        Self {
            turns: block(0),
            mixed: block(9),
            shifts: block(18),
            by_turn: vector(27),
            by_shift: vector(30),
        }
    }

    pub(in crate::train) fn add(&mut self, row: &PoseRow) {
        let [a, b, c, d, e, f] = row.slopes.map(f64::from);
        let (turn, shift) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
        let outer = |u: DVec3, v: DVec3| DMat3::from_cols(u * v.x, u * v.y, u * v.z);
        let ratio = f64::from(row.difference / USUAL_DIFFERENCE);
        let weight = 1.0 / (1.0 + ratio * ratio);
        self.turns += outer(turn, turn) * weight;
        self.mixed += outer(turn, shift) * weight;
        self.shifts += outer(shift, shift) * weight;
        let difference = weight * f64::from(row.difference);
        self.by_turn += turn * difference;
        self.by_shift += shift * difference;
    }

    /// The correction on top of `known`, with what is expected of the pose of `camera`, `distance` away from what it sees: a
    /// pull of the whole to zero.
    pub(in crate::train) fn solve(
        &self,
        known: Correction,
        camera: &Camera,
        distance: f64,
    ) -> Correction {
        let expected = EXPECTED_PX * f64::from(camera.pixel_angle());
        let pulls = [expected, expected * distance]
            .map(|expected| (f64::from(USUAL_DIFFERENCE) / expected).powi(2));
        let ridge = |block: DMat3, pull: f64| {
            let diagonal = DVec3::new(block.x_axis.x, block.y_axis.y, block.z_axis.z);
            block + DMat3::from_diagonal(diagonal * RIDGE + DVec3::splat(pull))
        };
        let turns = ridge(self.turns, pulls[0]).inverse();
        let shifts = ridge(self.shifts, pulls[1]);
        let by_turn = self.by_turn - known.turn * pulls[0];
        let by_shift = self.by_shift - known.shift * pulls[1];
        // By blocks: the rotation is put into the equations of the translation (Schur).
        let mixed = self.mixed.transpose() * turns;
        let shift = (shifts - mixed * self.mixed).inverse() * (by_shift - mixed * by_turn);
        Correction {
            turn: turns * (by_turn - self.mixed * shift),
            shift,
        }
    }
}

/// How a photo's camera differs from the capture's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::train) struct Correction {
    /// Rotation about the camera's place, world axes, radians.
    pub(in crate::train) turn: DVec3,
    /// Translation, in the unit of the distances.
    pub(in crate::train) shift: DVec3,
}

impl Correction {
    /// The camera with it; `unit`: what it is a translation in, world units.
    pub(in crate::train) fn corrected(self, camera: &Camera, unit: f32) -> Camera {
        let turn = Quat::from_scaled_axis(self.turn.as_vec3());
        let mut camera = *camera;
        let pose = &mut camera.world_from_camera;
        pose.matrix3 = Mat3A::from_quat(turn) * pose.matrix3;
        pose.translation += Vec3A::from(unit * self.shift.as_vec3());
        camera
    }
}
