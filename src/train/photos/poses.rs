//! Corrections of the training photos' poses, found while the environment is learned.
//!
//! Structure from motion leaves a photo some tenths of a pixel to a pixel off, and what is seen from many sides is
//! blurred by it. Where the field shows a pixel of a photo brighter than the photo is there, the photo is shifted, by its own
//! slope ([`super::pose_step`]): its pixels, of background and object, give its pose, again and again as the field sharpens. A
//! mirror image moves almost as the surface that shows it. Where all that is found is as little as the field is wrong, the
//! cameras stay as they are given.

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::picture_shift::{PictureShift, known_share};
use super::pose_step::{Correction, PoseRow, Sums};
use crate::data::Dataset;
use crate::data::files::tensor_file::TensorFile;
use crate::geometry::Camera;
use crate::neif::field::contraction::FieldFrame;
use crate::train::TrainError;
use crate::train::config::PhotoFit;
use crate::train::placement::given_cameras;
use crate::train::step::now::Now;
use crate::train::step::part::{Part, finite, insert};
use crate::train::step::tasks::Job;

/// Steps before poses are corrected: until then the environment has no features to go by.
const DELAY: u64 = 300;
/// Steps after which cameras that are right until then are taken as right for good: looking takes a twelfth of a step.
const LOOKED_AT: u64 = 2000;
/// Steps between two corrections: a photo of fifty gives some thousand pixels in that time.
const EVERY: u64 = 100;
/// Share of a correction that is made: the field follows the poses, as they follow it.
const SHARE: f64 = 0.5;
/// Most that is corrected, pixels.
const MOST_PX: f64 = 20.0;
/// Root mean square of the corrections in pixels up to which cameras count as right.
const RIGHT_PX: f32 = 0.13;
/// The same square in those of the corrections' noise: few small photos constrain them poorly.
const RIGHT_NOISES: f32 = 2.0;
/// Square of a running mean's noise in squares of what each new value differs from it by: values of variance 1 give a mean of
/// variance `SHARE / (2 - SHARE)`, from which the next differs by 1 more.
const NOISE_OF_CHANGE: f32 = 0.25;
/// Rounds in which the mean is taken off along one set of axes and the other.
const CENTERINGS: usize = 4;

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
    /// Whether they have changed since [`Self::take_changed`].
    have_changed: bool,
    /// Mean square of the corrections' noise, pixels.
    noise: f32,
}

fn mean_square(values: &[f32]) -> f32 {
    values.iter().map(|v| v * v).sum::<f32>() / values.len().max(1) as f32
}

impl Poses {
    /// Those of the capture, corrected by as much as is known of the `shifts` that outlines show, where there are any; `None`
    /// where they are never to be.
    pub(in crate::train) fn of(
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
            have_changed: false,
            noise: 0.0,
        };
        poses.shift(known_share(shifts), shifts);
        poses.decide();
        Some(poses)
    }

    /// Corrects poses by a share of their pictures' shifts, half by a rotation and half by a translation: an outline does not
    /// distinguish the two.
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
    pub(in crate::train) fn are_corrected(&self) -> bool {
        self.are_corrected
    }

    /// Whether the pixels of step `step` are asked for them.
    pub(in crate::train) fn are_sought(&self, step: u64) -> bool {
        step >= DELAY && (self.are_corrected || step < LOOKED_AT)
    }

    /// The cameras as they are used: corrected, where they are not right.
    pub fn cameras(&self) -> Vec<Camera> {
        if !self.are_corrected {
            return self.given.clone();
        }
        let pairs = self.given.iter().zip(&self.corrections);
        pairs
            .map(|(camera, correction)| correction.corrected(camera, self.half_side))
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

    /// The cameras as they are used, once after each change.
    pub(in crate::train) fn take_changed(&mut self) -> Option<Vec<Camera>> {
        std::mem::take(&mut self.have_changed).then(|| self.cameras())
    }

    /// Takes up the equations of step `step`, while they are sought.
    pub(in crate::train) fn gather<'a>(
        &mut self,
        step: u64,
        rows: impl Iterator<Item = &'a PoseRow>,
    ) {
        if !self.are_sought(step) {
            return;
        }
        for row in rows {
            self.sums[row.view].add(row);
        }
    }

    /// Corrects all poses by what was taken up since the last time.
    fn correct(&mut self) {
        let mut changes = Vec::with_capacity(self.given.len());
        let photos = self.sums.iter_mut().zip(&mut self.corrections);
        for ((sums, correction), camera) in photos.zip(&self.given) {
            let before = *correction;
            let used = if self.are_corrected {
                before
            } else {
                Correction::default()
            };
            let found = std::mem::replace(sums, Sums::ZERO).solve(used, camera, self.distance);
            if found.turn.is_finite() && found.shift.is_finite() {
                let most = MOST_PX * f64::from(camera.pixel_angle());
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
    /// moves, turns or scales the environment against the object and the held-out photos, which stay where they are.
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

    /// Puts corrections in their place, `[n_views][6]`, and decides anew whether they are used.
    pub(super) fn set_corrections(&mut self, numbers: &[f32]) {
        for (correction, numbers) in self.corrections.iter_mut().zip(numbers.chunks_exact(6)) {
            *correction = Correction {
                turn: Vec3::from_slice(numbers).as_dvec3(),
                shift: Vec3::from_slice(&numbers[3..]).as_dvec3(),
            };
        }
        self.decide();
    }
}

/// Arrays of a checkpoint: `[n_views][6]`; and `[n_views][Sums::LEN]` bits of what was taken up since the last correction, with
/// what was decided.
const CORRECTIONS: &str = "poses.corrections";
const SUMS: &str = "poses.sums";

impl Part for Poses {
    fn update<'a>(&'a mut self, now: &Now<'_>, _jobs: &mut Vec<Job<'a>>) {
        if self.are_sought(now.step) && now.step.is_multiple_of(EVERY) {
            self.correct();
            self.have_changed = true;
        }
    }

    fn store(&self, file: &mut TensorFile) {
        let numbers = |c: &Correction| [c.turn, c.shift].map(|v| v.as_vec3().to_array());
        let corrections = self.corrections.iter().flat_map(numbers).flatten();
        insert(file, CORRECTIONS, &corrections.collect::<Vec<f32>>());
        let mut bits: Vec<u64> = self.sums.iter().flat_map(|sums| sums.to_bits()).collect();
        bits.extend([
            u64::from(self.noise.to_bits()),
            u64::from(self.are_corrected),
        ]);
        file.insert_u64(SUMS, &[bits.len()], bits);
    }

    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        self.have_changed = true;
        let numbers = finite(file, CORRECTIONS, 6 * self.corrections.len())?;
        let bits = file.u64(SUMS, &[Sums::LEN * self.sums.len() + 2])?;
        self.set_corrections(&numbers);
        if let (sums, [noise, are_corrected]) = bits.as_chunks::<{ Sums::LEN }>() {
            self.sums = sums.iter().map(Sums::from_bits).collect();
            self.noise = f32::from_bits(*noise as u32);
            self.are_corrected = *are_corrected == 1;
        }
        Ok(())
    }
}
