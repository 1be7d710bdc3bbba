//! Corrections of the training photos' poses, found while the surroundings are learned.
//!
//! Structure from motion leaves a photo some tenths of a pixel to a pixel off, and what is seen from many sides is
//! blurred by it. Where the field shows a pixel of a photo brighter than the photo is there, the photo is shifted, by its own
//! slope: linear least squares over its background pixels give the six numbers of its pose (Lucas and Kanade 1981; inverse
//! compositional, Baker and Matthews 2004), again and again as the field sharpens. The photo's slope is used, not the
//! field's: that of a hash grid is noise below the size of its cells. Where all that is found is as little as the field is
//! wrong, the cameras stay as they are given.

use glam::{DMat3, DVec2, DVec3, Quat, Vec3};

use super::config::PhotoFit;
use super::picture_shift::{PictureShift, known_share};
use super::preparation::given_cameras;
use super::trainer::Trainer;
use crate::data::Dataset;
use crate::data::tensor_file::TensorFile;
use crate::geometry::Camera;
use crate::neif::contraction::FieldFrame;

/// Steps before poses are corrected: until then the surroundings have no features to go by.
const DELAY: u64 = 300;
/// Steps after which cameras that are right until then are taken as right for good: looking takes a twelfth of a step.
const LOOKED_AT: u64 = 2000;
/// Steps between two corrections: a photo of fifty gives some thousand pixels in that time.
const EVERY: u64 = 100;
/// Share of a correction that is made: the field follows the poses, as they follow it.
const SHARE: f64 = 0.5;
/// Difference, in sRGB, from which a pixel counts less: it shows something else, not the same thing shifted.
const USUAL_DIFFERENCE: f32 = 0.1;
/// Least opacity along a ray: without a surface there is no distance.
const LEAST_OPACITY: f32 = 0.5;
/// How far off poses are expected to be, pixels; and the most that is corrected.
const EXPECTED_PX: f64 = 3.0;
const MOST_PX: f64 = 20.0;
/// Root mean square of the corrections in pixels up to which cameras count as right.
const RIGHT_PX: f32 = 0.13;
/// The same square in those of the corrections' noise: few small photos tell little.
const RIGHT_NOISES: f32 = 2.0;
/// Square of a running mean's noise in squares of what each new value differs from it by: values of variance 1 give a mean of
/// variance `SHARE / (2 - SHARE)`, from which the next differs by 1 more.
const NOISE_OF_CHANGE: f32 = 0.25;
/// Rounds in which the mean is taken off along one set of axes and the other.
const CENTERINGS: usize = 4;
/// Ridge, relative to the diagonal of the least squares.
const RIDGE: f64 = 0.05;

/// Array of a checkpoint.
const SUMS: &str = "poses.sums";

/// A background pixel's equation: `slopes · correction = difference`.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseRow {
    view: usize,
    /// By the rotation about the world's axes, radians, and the translation, half sides of the inner box.
    slopes: [f32; 6],
    /// Shown grey value less the photo's, sRGB.
    difference: f32,
}

impl PoseRow {
    /// Of a pixel whose ray, `direction`, ends at `distance` with `opacity`; `slope` is the photo's grey value by the unit
    /// direction ([`slope_by_direction`]). `None` where nothing can be told.
    pub(super) fn new(
        view: usize,
        direction: Vec3,
        slope: Vec3,
        difference: f32,
        (distance, opacity): (f32, f32),
    ) -> Option<Self> {
        // A camera that turns by `w` and moves by `s` sees a point in the direction `d - w x d - s / t`.
        let (turn, shift) = (slope.cross(direction), -slope / distance.max(1e-3));
        let is_told = opacity >= LEAST_OPACITY && turn.is_finite() && difference.is_finite();
        is_told.then_some(Self {
            view,
            slopes: [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z],
            difference,
        })
    }
}

/// The slope of a photo's grey value by the direction of the ray, in the plane across it, from that by the pixel.
pub(super) fn slope_by_direction(camera: &Camera, x: f32, y: f32, by_pixel: [f32; 2]) -> Vec3 {
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
struct Sums {
    turns: DMat3,
    mixed: DMat3,
    shifts: DMat3,
    by_turn: DVec3,
    by_shift: DVec3,
}

impl Sums {
    const ZERO: Self = Self {
        turns: DMat3::ZERO,
        mixed: DMat3::ZERO,
        shifts: DMat3::ZERO,
        by_turn: DVec3::ZERO,
        by_shift: DVec3::ZERO,
    };

    /// The bits of all its numbers.
    fn to_bits(self) -> [u64; 33] {
        let blocks = [self.turns, self.mixed, self.shifts].map(|block| block.to_cols_array());
        let by = [self.by_turn, self.by_shift].map(|v| v.to_array());
        let numbers = blocks.as_flattened().iter().chain(by.as_flattened());
        let mut bits = [0; 33];
        bits.iter_mut()
            .zip(numbers)
            .for_each(|(bits, v)| *bits = v.to_bits());
        bits
    }

    fn from_bits(bits: &[u64; 33]) -> Self {
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

    fn add(&mut self, row: &PoseRow) {
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

    /// The correction on top of `known`, with what is expected of poses: a pull of the whole to zero.
    fn solve(&self, known: Correction, pulls: [f64; 2]) -> Correction {
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
struct Correction {
    /// Rotation about the camera's place, world axes, radians.
    turn: DVec3,
    /// Translation, half sides of the inner box.
    shift: DVec3,
}

/// The poses of all training photos.
#[derive(Debug)]
pub struct Poses {
    /// As the capture has them.
    given: Vec<Camera>,
    /// Half side of the inner box, world units.
    half_side: f32,
    /// Mean distance of the cameras from the object, or from their middle, half sides.
    distance: f64,
    /// As they are found to be off.
    corrections: Vec<Correction>,
    sums: Vec<Sums>,
    /// Whether the corrections are used however small they are.
    is_forced: bool,
    are_corrected: bool,
    /// Mean square of the corrections' noise, pixels.
    noise: f32,
}

fn mean_square(values: &[f32]) -> f32 {
    values.iter().map(|v| v * v).sum::<f32>() / values.len().max(1) as f32
}

impl Poses {
    /// Those of the capture, corrected by as much as is known of the `shifts` that outlines show, where there are any; `None`
    /// where they are never to be.
    pub(super) fn of(
        dataset: &Dataset,
        frame: &FieldFrame,
        fit: PhotoFit,
        shifts: &[PictureShift],
    ) -> Option<Self> {
        if fit == PhotoFit::Off {
            return None;
        }
        let given = given_cameras(dataset);
        let distances = given.iter().map(|c| c.position().distance(frame.center));
        let distance = distances.sum::<f32>() / given.len().max(1) as f32 / frame.half_side;
        let mut poses = Self {
            corrections: vec![Correction::default(); given.len()],
            sums: vec![Sums::ZERO; given.len()],
            distance: f64::from(distance.max(0.1)),
            half_side: frame.half_side,
            given,
            is_forced: fit == PhotoFit::On,
            are_corrected: false,
            noise: 0.0,
        };
        poses.shift(known_share(shifts), shifts);
        poses.decide();
        Some(poses)
    }

    /// Corrects poses by a share of their pictures' shifts, half by a rotation and half by a translation: an outline does not
    /// tell one from the other.
    fn shift(&mut self, share: f32, shifts: &[PictureShift]) {
        let distance = self.distance;
        let poses = self.corrections.iter_mut().zip(&self.given).zip(shifts);
        for ((correction, camera), shift) in poses {
            let axes = camera.world_from_camera.matrix3.as_dmat3();
            let by = f64::from(0.5 * share) * shift.by.as_dvec2();
            let by = by / DVec2::new(camera.fx.into(), camera.fy.into());
            let by = axes.x_axis * by.x - axes.y_axis * by.y;
            correction.turn = by.cross(camera.forward().as_dvec3());
            correction.shift = -by * distance;
        }
        self.center();
    }

    /// Whether the cameras are used as corrected, not as given.
    pub(super) fn are_corrected(&self) -> bool {
        self.are_corrected
    }

    /// Whether the pixels of step `step` are asked for them.
    pub(super) fn are_sought(&self, step: u64) -> bool {
        step >= DELAY && (self.are_corrected || step < LOOKED_AT)
    }

    /// The cameras as they are used: corrected, where they are not right.
    pub fn cameras(&self) -> Vec<Camera> {
        if !self.are_corrected {
            return self.given.clone();
        }
        let corrected = |(camera, correction): (&Camera, &Correction)| {
            let turn = Quat::from_scaled_axis(correction.turn.as_vec3());
            let mut camera = *camera;
            let pose = &mut camera.world_from_camera;
            pose.matrix3 = glam::Mat3A::from_quat(turn) * pose.matrix3;
            pose.translation += glam::Vec3A::from(self.half_side * correction.shift.as_vec3());
            camera
        };
        self.given
            .iter()
            .zip(&self.corrections)
            .map(corrected)
            .collect()
    }

    /// How far the middle of each photo is found to be off on what it shows, pixels.
    pub fn moved_px(&self) -> Vec<f32> {
        self.px(&self.corrections)
    }

    /// By how many pixels corrections move the middle of each photo.
    fn px(&self, corrections: &[Correction]) -> Vec<f32> {
        let moved = |(camera, correction): (&Camera, &Correction)| {
            let forward = camera.forward().as_dvec3();
            let across = correction.turn.cross(forward)
                + correction.shift.reject_from(forward) / self.distance;
            across.length() as f32 / camera.pixel_angle()
        };
        self.given.iter().zip(corrections).map(moved).collect()
    }

    /// Takes up the equations of a step.
    fn add<'a>(&mut self, rows: impl Iterator<Item = &'a PoseRow>) {
        for row in rows {
            self.sums[row.view].add(row);
        }
    }

    /// Corrects all poses by what was taken up since the last time.
    fn correct(&mut self) {
        let mut changes = Vec::with_capacity(self.given.len());
        for ((sums, correction), camera) in self
            .sums
            .iter_mut()
            .zip(&mut self.corrections)
            .zip(&self.given)
        {
            let expected = EXPECTED_PX * f64::from(camera.pixel_angle());
            let pull = |expected: f64| (f64::from(USUAL_DIFFERENCE) / expected).powi(2);
            let pulls = [pull(expected), pull(expected * self.distance)];
            let before = *correction;
            let used = if self.are_corrected {
                *correction
            } else {
                Correction::default()
            };
            let found = std::mem::replace(sums, Sums::ZERO).solve(used, pulls);
            if found.turn.is_finite() && found.shift.is_finite() {
                let most = expected * MOST_PX / EXPECTED_PX;
                let turn = used.turn + found.turn - correction.turn;
                let shift = used.shift + found.shift - correction.shift;
                correction.turn = (correction.turn + turn * SHARE).clamp_length_max(most);
                correction.shift =
                    (correction.shift + shift * SHARE).clamp_length_max(most * self.distance);
            }
            changes.push(Correction {
                turn: (correction.turn - before.turn) / SHARE,
                shift: (correction.shift - before.shift) / SHARE,
            });
        }
        self.center();
        let change = mean_square(&self.px(&changes));
        // A camera that is used as corrected is not looked at as if it were not.
        if !self.are_corrected {
            self.noise = NOISE_OF_CHANGE * change;
            self.decide();
        }
    }

    /// Whether what is found is more than the field is wrong.
    fn decide(&mut self) {
        let found = mean_square(&self.moved_px());
        let right = (RIGHT_PX * RIGHT_PX).max(RIGHT_NOISES * self.noise);
        self.are_corrected = self.is_forced || found > right;
    }

    /// Holds the mean correction at zero, along the world's axes and along the cameras' own: what all photos have in common
    /// moves, turns or scales the surroundings against the object and the held-out photos, which stay where they are.
    fn center(&mut self) {
        let n = self.given.len().max(1) as f64;
        let own_axes = |camera: &Camera| camera.world_from_camera.matrix3.as_dmat3();
        let own: Vec<DMat3> = self.given.iter().map(own_axes).collect();
        let world = vec![DMat3::IDENTITY; own.len()];
        for _ in 0..CENTERINGS {
            for axes in [&world, &own] {
                let pairs = || axes.iter().zip(&self.corrections);
                let turn: DVec3 = pairs().map(|(axes, c)| axes.transpose() * c.turn).sum();
                let shift: DVec3 = pairs().map(|(axes, c)| axes.transpose() * c.shift).sum();
                for (axes, correction) in axes.iter().zip(&mut self.corrections) {
                    correction.turn -= *axes * turn / n;
                    correction.shift -= *axes * shift / n;
                }
            }
        }
    }

    /// `[n_views][6]`, as they are kept.
    pub(super) fn state(&self) -> Vec<f32> {
        let numbers = |c: &Correction| [c.turn, c.shift].map(|v| v.as_vec3().to_array());
        self.corrections
            .iter()
            .flat_map(numbers)
            .flatten()
            .collect()
    }

    /// Keeps what was taken up since the last correction, `[n_views][33]` bits, and what was decided.
    pub(super) fn store_sums(&self, file: &mut TensorFile) {
        let mut bits: Vec<u64> = self.sums.iter().flat_map(|sums| sums.to_bits()).collect();
        bits.extend([
            u64::from(self.noise.to_bits()),
            u64::from(self.are_corrected),
        ]);
        file.insert_u64(SUMS, &[bits.len()], bits);
    }

    /// Goes on from there; runs from before have none.
    pub(super) fn set_sums(&mut self, file: &TensorFile) {
        if let Ok(bits) = file.u64(SUMS, &[33 * self.sums.len() + 2])
            && let (sums, [noise, are_corrected]) = bits.as_chunks::<33>()
        {
            self.sums = sums.iter().map(Sums::from_bits).collect();
            self.noise = f32::from_bits(*noise as u32);
            self.are_corrected = *are_corrected == 1;
        }
    }

    /// Goes on from there; `state` has the length of [`Self::state`].
    pub(super) fn set_state(&mut self, state: &[f32]) {
        for (correction, numbers) in self.corrections.iter_mut().zip(state.chunks_exact(6)) {
            *correction = Correction {
                turn: Vec3::from_slice(numbers).as_dvec3(),
                shift: Vec3::from_slice(&numbers[3..]).as_dvec3(),
            };
        }
        self.decide();
    }
}

impl Trainer {
    /// Takes up the step's equations and corrects the poses when it is time.
    pub(super) fn refine_poses(&mut self) {
        let Some(poses) = &mut self.poses else {
            return;
        };
        if !poses.are_sought(self.step) {
            return;
        }
        poses.add(self.chunks.iter().flat_map(|chunk| &chunk.pose_rows));
        if self.step.is_multiple_of(EVERY) {
            poses.correct();
            self.pixels.set_cameras(&poses.cameras());
        }
    }

    /// The poses of the training photos as they are known by now; `None` where they are taken as given.
    pub fn poses(&self) -> Option<&Poses> {
        self.poses.as_ref().filter(|poses| poses.are_corrected())
    }
}
