//! How far the outlines of masks err, estimated from how they disagree.
//!
//! Outlines that are all true touch the visual hull that they span; where they wander, each is cut short somewhere by another,
//! and their distances from the hull scatter as they do.

use rayon::prelude::*;

use super::fairing;
use super::silhouette::Silhouette;
use crate::geometry::ScalarGrid;
use crate::train::pixels::outlines::error_from;

/// Standard deviation of the outlines' error about the `hull` that they span, pixels; 0 where they are exact.
pub(super) fn find_px(silhouettes: &[Silhouette], mut hull: ScalarGrid) -> f32 {
    hull.redistance(fairing::REACH);
    let off_px = |silhouette: &Silhouette| -> Vec<f32> {
        let places = silhouette.outline.middles.iter().filter_map(|at| {
            let nearest =
                fairing::nearest_approach(&hull, &silhouette.ray(*at), f32::NEG_INFINITY)?;
            Some(hull.sample(nearest) / silhouette.pixel_at(nearest))
        });
        places.collect()
    };
    error_from(silhouettes.par_iter().flat_map_iter(off_px).collect())
}
