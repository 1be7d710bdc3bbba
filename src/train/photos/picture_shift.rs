//! By how much a whole picture is off against a surface, estimated from the outline that the surface has in it: the camera's
//! error, not the mask's.

use glam::{Mat2, Vec2};

use crate::train::statistics::{cauchy_weight, scatter, share_beyond};

/// Rounds of reweighting in which a shift is found, and what keeps it at nothing, in pieces of the outline.
const ROUNDS: usize = 4;
const RIDGE: f32 = 1.0;
/// Pieces of an outline, a pixel long each, that err alike where masks wander.
const ALIKE: f32 = 20.0;
/// Scatter of exact outlines about those of an exact surface, pixels: both are sampled.
pub(in crate::train) const SAMPLING_PX: f32 = 0.35;

/// Distance of a place of the outline from where it should be, pixels, and its slope by the place.
pub(in crate::train) type Off = (f32, Vec2);

/// How far a picture is off.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct PictureShift {
    /// Of what it shows, from where it should be, pixels.
    pub(in crate::train) by: Vec2,
    /// Standard deviation of either of its coordinates, pixels.
    pub(in crate::train) error_px: f32,
}

impl PictureShift {
    /// What explains most places of an outline.
    pub(in crate::train) fn of(off: &[Off]) -> Self {
        let mut by = Vec2::ZERO;
        for _ in 0..ROUNDS {
            let (mut matrix, mut right) = (RIDGE * Mat2::IDENTITY, Vec2::ZERO);
            for (place, rest) in off.iter().zip(rests(off, by)) {
                let (off, slope) = *place;
                let weight = cauchy_weight(rest, 1.0);
                matrix += weight * Mat2::from_cols(slope * slope.x, slope * slope.y);
                right += weight * off * slope;
            }
            by = matrix.inverse() * right;
        }
        let error = scatter(rests(off, by).collect()).max(SAMPLING_PX);
        Self {
            by,
            error_px: error * (2.0 * ALIKE / off.len().max(1) as f32).sqrt(),
        }
    }
}

/// The distances that a shift leaves.
pub(in crate::train) fn rests(off: &[Off], by: Vec2) -> impl Iterator<Item = f32> {
    off.iter().map(move |(off, slope)| off - slope.dot(by))
}

/// Share of all pictures' shifts that is no error of theirs, 0 to 1.
pub(in crate::train) fn known_share(shifts: &[PictureShift]) -> f32 {
    let found: f32 = shifts.iter().map(|s| s.by.length_squared()).sum();
    let error: f32 = shifts.iter().map(|s| 2.0 * s.error_px * s.error_px).sum();
    share_beyond(found, error)
}
