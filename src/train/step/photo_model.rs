//! What a step's pixels say of the photos themselves, taken up by the trainer: exposures and poses.

use glam::Vec3;

use super::trainer::Trainer;
use crate::train::photos::exposures::Exposures;
use crate::train::photos::poses::Poses;

impl Trainer {
    /// Takes up the step's equations and corrects the exposures when it is time.
    pub(super) fn find_exposures(&mut self) {
        if let Some(exposures) = &mut self.photos.exposures {
            let rows = self
                .work
                .chunks
                .iter()
                .map(|chunk| &chunk.photo_rows.exposures);
            exposures.take_up(self.counts.step, rows.flatten());
        }
    }

    /// Takes up the step's equations and corrects the poses when it is time.
    pub(super) fn refine_poses(&mut self) {
        if let Some(poses) = &mut self.photos.poses {
            let rows = self.work.chunks.iter().map(|chunk| &chunk.photo_rows.poses);
            if poses.take_up(self.counts.step, rows.flatten()) {
                self.pixels.set_cameras(&poses.cameras());
            }
        }
    }

    /// What each training photo's exposure multiplies radiance by, in the capture's order; `None` where all are alike.
    pub fn gains(&self) -> Option<&[Vec3]> {
        self.photos.exposures.as_ref().and_then(Exposures::gains)
    }

    /// The poses of the training photos as they are known by now; `None` where they are taken as given.
    pub fn poses(&self) -> Option<&Poses> {
        self.photos
            .poses
            .as_ref()
            .filter(|poses| poses.are_corrected())
    }
}
