//! A mesh of outlines moved to where photos have its normals, as long as its outlines agree, and its pattern where there is one.
//!
//! Outlines say nothing of hollows, and little where they err; normals say how the surface goes on from where outlines hold
//! it. What photos cannot explain is left to both sides: it goes on as evenly as they are bent, so that hollows open that a
//! mesh of outlines alone fills.

use rayon::prelude::*;

use super::depths::fusion;
use super::depths::photo_maps::{self, PhotoMaps};
use super::draft::{COMPARED_CELLS, FEWEST_CELLS, grid_around, of_outlines, pixels_at};
use super::fairing::{self, Fairing};
use super::silhouette::Silhouette;
use super::slopes::{KnownNormals, Normals};
use super::{GoOn, SPECK, StageOneError, StageOneOptions, hull, surface, unless_cancelled};
use crate::data::Dataset;
use crate::geometry::{Camera, Mesh};
use crate::train::statistics::middle;

/// Rounds of fairing.
const N_ROUNDS: usize = 4;
/// Standard deviations of the outlines' error that a cell is wide at least: on finer ones wrong normals, of a lid that stands
/// for a mouth, lead further astray.
const CELL_ERRORS: f32 = 2.0;
/// Least error of outlines, pixels: they are sampled, and so are the normals.
const LEAST_ERROR_PX: f32 = 0.3;

/// Pixels from an outline up to which it says how far: beyond, the surface does not come in one refit.
const OUTLINE_REACH_PX: f32 = 24.0;

/// Whether a mesh that is made of this capture is made of outlines alone.
pub(in crate::train) fn is_of_outlines(dataset: &Dataset) -> bool {
    super::has_masks(dataset) && fusion::depth_views(dataset).is_empty()
}

/// A mesh that was moved.
#[derive(Debug)]
pub(in crate::train) struct Refit {
    pub(in crate::train) mesh: Mesh,
    /// Whether photos show where the surface is by its pattern.
    pub(in crate::train) has_pattern: bool,
}

/// The mesh where its normals want it, and the photos show its pattern if that is asked for, on the current thread pool. The
/// masks' outlines err by `error_px` pixels for views taken by `cameras`.
///
/// # Errors
/// When no surface is left, and when asked to stop.
pub(in crate::train) fn refit(
    dataset: &Dataset,
    cameras: &[Camera],
    known: KnownNormals<'_>,
    (error_px, asks_pattern): (f32, bool),
    go_on: GoOn<'_>,
) -> Result<Refit, StageOneError> {
    let views = dataset.train.par_iter().zip(cameras).enumerate();
    let silhouettes = views.filter_map(|(index, (view, camera))| {
        Silhouette::new(index, view, *camera, OUTLINE_REACH_PX)
    });
    let silhouettes: Vec<Silhouette> = silhouettes.collect();
    let bounds = known.mesh.bounds();
    let pixel = middle(&mut pixels_at(&silhouettes, bounds.center()));
    let least_error = error_px.max(LEAST_ERROR_PX) * pixel;
    let finest = bounds.extent().max_element() / (CELL_ERRORS * least_error);
    let n_cells = (finest as usize).clamp(FEWEST_CELLS, StageOneOptions::default().n_cells);
    let distances = |n_cells: usize| {
        let mut phi = grid_around(&bounds, n_cells);
        phi.fill_distances(known.mesh, fairing::REACH);
        phi.redistance(fairing::REACH);
        phi
    };
    let pattern = if asks_pattern {
        let coarse = distances(COMPARED_CELLS);
        photo_maps::of_surface(dataset, &silhouettes, (&bounds, &coarse), go_on)
    } else {
        None
    };
    let mut phi = distances(n_cells);
    unless_cancelled(go_on)?;
    let mut evidence = of_outlines(silhouettes, error_px, pixel, |silhouettes| {
        Ok(hull::near(silhouettes, &phi, fairing::BAND))
    })?;
    evidence.normals = Normals::around(known, &phi, least_error / phi.cell);
    if let Some(PhotoMaps { maps, .. }) = &pattern {
        let near = |node: usize| phi.values[node].abs() < fairing::REACH * phi.cell;
        evidence.seen = Some(fusion::sure(maps, &phi, &near, (&|| false, go_on))?);
    }
    for _ in 0..N_ROUNDS {
        unless_cancelled(go_on)?;
        fairing::round(&mut phi, &evidence, Fairing::UNSMOOTHED);
    }
    Ok(Refit {
        mesh: surface(dataset, &phi, SPECK)?,
        has_pattern: pattern.is_some(),
    })
}
