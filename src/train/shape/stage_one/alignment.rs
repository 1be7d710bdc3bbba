//! How outlines lie about the surface that all of them together give, and pictures aligned with it.
//!
//! Outlines that are all true touch the visual hull that they span; where they wander, each is cut short somewhere by another,
//! and their distances from the hull scatter as they do.
//!
//! A camera that is a little off shifts its outline as a whole, and a surface made of shifted outlines has dents where they
//! disagree. As in a bundle adjustment by turns, a coarse surface is made of the outlines, and each picture is shifted to where
//! most of its outline grazes it, as long as they err by more than chance.

use glam::Vec2;
use rayon::prelude::*;

use super::fairing::{self, Evidence, Fairing};
use super::silhouette::Silhouette;
use crate::geometry::ScalarGrid;
use crate::train::photos::picture_shift::{Off, PictureShift, known_share};
use crate::train::pixels::outlines::error_from;

/// Rounds of fairing between two looks at the pictures, and most looks.
const FAIRINGS: usize = 3;
const LOOKS: usize = 4;
/// By how much outlines are wrong at least before pictures are aligned, pixels: as much as cameras may be.
pub(super) const CAMERA_ERROR_PX: f32 = 1.0;

/// Standard deviation of the outlines' error about the `hull` that they span, pixels; 0 where they are exact.
pub(super) fn outline_error_px(silhouettes: &[Silhouette], mut hull: ScalarGrid) -> f32 {
    hull.redistance(fairing::REACH);
    let off_px = silhouettes
        .par_iter()
        .flat_map_iter(|silhouette| off(&hull, silhouette).into_iter().map(|(px, _)| px));
    error_from(off_px.collect())
}

/// Fairs the surface `phi` and shifts the pictures of its evidence to it, as long as it may `go_on`; whether any is.
pub(super) fn align(
    phi: &mut ScalarGrid,
    evidence: &mut Evidence,
    go_on: impl Fn() -> bool,
) -> bool {
    for look in 0..LOOKS {
        for _ in 0..FAIRINGS {
            if !go_on() {
                return look > 0;
            }
            fairing::round(phi, evidence, Fairing::SMOOTHED);
        }
        let silhouettes = evidence.silhouettes.par_iter();
        let shifts: Vec<_> = silhouettes
            .map(|silhouette| PictureShift::of(&off(phi, silhouette)))
            .collect();
        let share = known_share(&shifts);
        if share <= 0.0 {
            return look > 0;
        }
        for (silhouette, shift) in evidence.silhouettes.iter_mut().zip(&shifts) {
            silhouette.shift(share * shift.by);
        }
    }
    true
}

/// How far the places of an outline are from grazing the surface.
fn off(phi: &ScalarGrid, silhouette: &Silhouette) -> Vec<Off> {
    let axes = silhouette.camera.world_from_camera.matrix3;
    let places = silhouette.outline.middles.iter().filter_map(|at| {
        let near = fairing::nearest_approach(phi, &silhouette.ray(*at), f32::NEG_INFINITY)?;
        let slope = phi.gradient(near);
        let across = Vec2::new(
            slope.dot(axes.x_axis.into()),
            -slope.dot(axes.y_axis.into()),
        );
        Some((phi.sample(near) / silhouette.pixel_at(near), across))
    });
    places.collect()
}
