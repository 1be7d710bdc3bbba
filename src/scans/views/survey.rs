//! What a scan is like: how large, which way is up, and where in it an object may stand.

use std::path::Path;

use glam::Vec3;

use super::stand::free_place;
use super::upright::up_direction;
use crate::data::{CaptureChoices, DataError, Problem, Severity};
use crate::scans::Scan;
use crate::scans::extent::middle_and_size;

/// Points that free space is measured from.
const N_POINTS: usize = 20_000;

/// A scan that was read, with what was found or said about it.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The scan.
    pub scan: Scan,
    /// Points on what is visible, scene units.
    pub points: Vec<Vec3>,
    /// The longest side of the box that holds nine tenths of them along each axis, scene units.
    pub size: f32,
    /// Unit up direction.
    pub up: Vec3,
    /// Where the object will stand: by default a free place near the middle.
    pub at: Vec3,
}

impl Survey {
    /// Reads a scan and looks at it.
    ///
    /// # Errors
    /// When the file is no scan, or one that cannot be used.
    pub fn of(path: &Path, choices: &CaptureChoices) -> Result<Self, DataError> {
        let survey = Self::of_scan(Scan::read(path)?, choices);
        survey.ok_or_else(|| DataError::unusable(path, "nothing in it is visible"))
    }

    /// Looks at a scan; `None` where nothing in it is visible.
    pub(super) fn of_scan(scan: Scan, choices: &CaptureChoices) -> Option<Self> {
        let points = scan.surface_points(N_POINTS);
        let (middle, size) = middle_and_size(&points);
        let has_size = size > 0.0 && size.is_finite();
        if points.is_empty() || !has_size {
            return None;
        }
        let up = choices.up.and_then(Vec3::try_normalize);
        let up = up.unwrap_or_else(|| up_direction(&points, size, scan.up_conventions()));
        let at = choices.at;
        let at = at.unwrap_or_else(|| free_place(&points, middle, size));
        Some(Self {
            scan,
            points,
            size,
            up,
            at,
        })
    }

    /// What was found, as a note.
    pub(super) fn finding(&self) -> Problem {
        let [up, at] = [self.up, self.at].map(|v| format!("{:.2}, {:.2}, {:.2}", v.x, v.y, v.z));
        let what = format!("in the scan, up is {up}, and light is learned around {at}");
        Problem::new(Severity::Note, what, "--up and --at say otherwise")
    }
}
