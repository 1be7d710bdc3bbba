//! What the pixels of a step say of their photos' exposures and poses.

use glam::Vec3;

use super::exposures::ExposureRow;
use super::pose_step::PoseRow;
use crate::train::fast::step_context::StepContext;
use crate::train::step::loss::PixelLoss;

/// The equations of a chunk's pixels, of those that are sought.
#[derive(Debug, Default)]
pub(in crate::train) struct PhotoRows {
    pub(in crate::train) exposures: Vec<ExposureRow>,
    pub(in crate::train) poses: Vec<PoseRow>,
}

impl PhotoRows {
    pub(in crate::train) fn clear(&mut self) {
        self.exposures.clear();
        self.poses.clear();
    }

    /// Asks a pixel of the photo `view`, which shows `exposed`, gain times radiance. `place`: the direction of its ray, the
    /// photo's slope there if that is known, and the distance and opacity at which the ray ends.
    pub(in crate::train) fn ask(
        &mut self,
        context: &StepContext<'_>,
        (view, exposed, loss): (usize, Vec3, &PixelLoss),
        place: impl FnOnce() -> (Vec3, Option<Vec3>, (f32, f32)),
    ) {
        if context.finds_exposures {
            self.exposures.push(ExposureRow::new(view, exposed, loss));
        }
        if context.finds_poses
            && let (direction, Some(slope), end) = place()
        {
            let grey = loss.difference.element_sum() / 3.0;
            let row = PoseRow::new(view, direction, slope, grey, end);
            self.poses.extend(row);
        }
    }
}
