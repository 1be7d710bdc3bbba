//! What a surface is made from, before it is faired: distances on a grid, and the evidence that they shall agree with.

use glam::Vec3;
use rayon::prelude::*;

use super::alignment::{self, outline_error_px};
use super::depths::fusion::{Depths, Seen};
use super::depths::photo_maps::{self, PhotoMaps};
use super::depths::{fusion, point_maps, smooth_guess};
use super::fairing::{self, Evidence};
use super::silhouette::{self, Silhouette};
use super::slopes::Normals;
use super::{
    GoOn, Making, StageOneError, StageOneOptions, extent, hull, surface, unless_cancelled,
};
use crate::data::{Dataset, DepthMap};
use crate::geometry::{Aabb, Mesh, ScalarGrid};
use crate::train::placement::camera_positions;
use crate::train::shape::support_plane;
use crate::train::statistics::middle;

/// Silhouettes without which there is no shape.
pub(super) const MIN_VIEWS: usize = 3;
/// Radius in pixels below which a silhouette shows no shape.
pub(super) const MIN_RADIUS_PX: f32 = 4.0;
/// Cells along the longest side of the hull that outlines are compared with.
pub(super) const COMPARED_CELLS: usize = 72;
/// Standard deviations of the outlines' error that a cell is wide at least: finer ones would show nothing but it, wider ones
/// cannot hold a handle six pixels wide whose outlines err by one.
const CELL_ERRORS: f32 = 1.5;
/// Cells that there are nevertheless.
pub(super) const FEWEST_CELLS: usize = 24;
/// Cells around the hull in which the surface can move.
pub(super) const MARGIN_CELLS: usize = 8;

/// Most cells for a mesh of points.
const POINT_CELLS: usize = 64;
/// Share of the largest part's area below which a part of a mesh of points is none of the object: bits of the background are near.
const LEAST_PART_OF_POINTS: f64 = 0.5;
/// Cells over the floor up to which a mesh of points is cut off.
const FLOOR_CELLS: f32 = 1.5;

/// A surface to be faired.
#[derive(Debug)]
pub(super) struct Draft {
    pub(super) phi: ScalarGrid,
    pub(super) evidence: Evidence,
}

impl Draft {
    /// The hull, which `make_hull` makes, of silhouettes whose outlines err by `error_px` pixels of width `pixel`, scene units.
    fn of(
        silhouettes: Vec<Silhouette>,
        error_px: f32,
        pixel: f32,
        make_hull: impl Fn(&[Silhouette]) -> Result<ScalarGrid, StageOneError>,
    ) -> Result<Self, StageOneError> {
        let evidence = of_outlines(silhouettes, error_px, pixel, make_hull)?;
        let mut phi = evidence.hull.clone();
        // It begins as the outlines are, too small: clefts are open, and narrow ones would not open again.
        for value in &mut phi.values {
            *value += silhouette::SLACK_ERRORS * error_px * pixel;
        }
        phi.redistance(fairing::REACH);
        Ok(Self { phi, evidence })
    }
}

/// What silhouettes say whose outlines err by `error_px` pixels of width `pixel`, scene units, and whose hull `make_hull` makes.
pub(super) fn of_outlines(
    mut silhouettes: Vec<Silhouette>,
    error_px: f32,
    pixel: f32,
    make_hull: impl Fn(&[Silhouette]) -> Result<ScalarGrid, StageOneError>,
) -> Result<Evidence, StageOneError> {
    for silhouette in &mut silhouettes {
        silhouette.set_error(error_px);
    }
    let hull = make_hull(&silhouettes)?;
    Ok(Evidence {
        outline_error: error_px * pixel / hull.cell,
        hull,
        silhouettes,
        seen: None,
        normals: Normals::default(),
    })
}

/// What photos show of the object's surface where it has a pattern.
struct Pattern {
    maps: Vec<DepthMap>,
    /// Distances to a surface that goes on between what they show; far inside where they show nothing.
    guess: ScalarGrid,
}

/// A mesh in the making, before its surface is faired.
pub(super) struct Job<'a> {
    pub(super) dataset: &'a Dataset,
    pub(super) options: &'a StageOneOptions,
    pub(super) go_on: GoOn<'a>,
    pub(super) on_news: &'a (dyn Fn(Making<'_>) + Sync),
}

impl Job<'_> {
    fn progress(&self, fraction: f32) {
        (self.on_news)(Making::Progress(fraction));
    }

    /// The hull of the silhouettes.
    pub(super) fn draft_from_masks(&self) -> Result<Draft, StageOneError> {
        let silhouettes = silhouettes(self.dataset)?;
        self.progress(0.05);
        let bounds = hull::bounds(&silhouettes, self.go_on)?;
        let bounds = bounds.ok_or_else(|| StageOneError::NothingInCommon {
            dataset: self.dataset.root.clone(),
        })?;
        self.progress(0.1);
        let hull_in = |bounds: &Aabb, silhouettes: &[Silhouette], n_cells: usize| {
            let mut hull = grid_around(bounds, n_cells);
            hull::fill(silhouettes, &mut hull, self.go_on)?;
            hull::cut(&mut hull, bounds);
            Ok(hull)
        };
        let pixel = middle(&mut pixels_at(&silhouettes, bounds.center()));
        let coarse_cells = self.options.n_cells.min(COMPARED_CELLS);
        let coarse_hull = |silhouettes: &[Silhouette]| hull_in(&bounds, silhouettes, coarse_cells);
        let error_px = outline_error_px(&silhouettes, coarse_hull(&silhouettes)?);
        let uncertain_px = error_px.max(alignment::CAMERA_ERROR_PX);
        let mut coarse = Draft::of(silhouettes, uncertain_px, pixel, coarse_hull)?;
        let go_on = || (self.go_on)() && !self.options.is_over();
        let is_aligned = alignment::align(&mut coarse.phi, &mut coarse.evidence, go_on);
        let error_px = if is_aligned {
            let silhouettes = &coarse.evidence.silhouettes;
            outline_error_px(silhouettes, coarse_hull(silhouettes)?)
        } else {
            error_px
        };
        let pattern = self.pattern(&mut coarse, &bounds)?;
        let extent = extent::shown(&coarse.phi, &camera_positions(self.dataset));
        // What hardly bounds an object seen from all around would only cut off what little of it is unseen.
        let closer = extent::within(&extent, bounds, &coarse.phi);
        let bounds = closer.unwrap_or(bounds);
        let finest = bounds.extent().max_element() / (CELL_ERRORS * error_px * pixel);
        let n_finest = (finest as usize).max(FEWEST_CELLS);
        let n_cells = self.options.n_cells.min(n_finest);
        let silhouettes = coarse.evidence.silhouettes;
        let mut draft = Draft::of(silhouettes, error_px, pixel, |silhouettes| {
            let mut hull = hull_in(&bounds, silhouettes, n_cells)?;
            if closer.is_some() {
                hull::raise(&mut hull, |p| extent.outside_by(p));
            }
            Ok(hull)
        })?;
        if let Some(pattern) = &pattern {
            self.carve(&mut draft, pattern)?;
        }
        Ok(draft)
    }

    /// What the photos show of the object's surface where it has a pattern, which is carved from the `coarse` surface; `None`
    /// where they contradict its outlines there.
    fn pattern(&self, coarse: &mut Draft, bounds: &Aabb) -> Result<Option<Pattern>, StageOneError> {
        let silhouettes = &coarse.evidence.silhouettes;
        let is_late = || self.options.is_over();
        let go_on = || (self.go_on)() && !is_late();
        let found =
            photo_maps::of_surface(self.dataset, silhouettes, (bounds, &coarse.phi), &go_on);
        unless_cancelled(self.go_on)?;
        let Some(PhotoMaps { maps, share }) = found else {
            return Ok(None);
        };
        (self.on_news)(Making::Pattern(share));
        let guess = smooth_guess::guess(&maps, &coarse.phi, (&is_late, self.go_on))?;
        let pattern = Pattern { maps, guess };
        self.carve(coarse, &pattern)?;
        Ok(Some(pattern))
    }

    /// Takes away what photos see through and what lies before the guess, and keeps what they show as evidence.
    fn carve(&self, draft: &mut Draft, pattern: &Pattern) -> Result<(), StageOneError> {
        let Pattern { maps, guess } = pattern;
        hull::raise(&mut draft.phi, |p| guess.sample(p));
        let hull = &draft.evidence.hull.values;
        let may_be = |node: usize| hull[node] <= draft.phi.cell;
        let is_late = || self.options.is_over();
        let seen = fusion::sure(maps, &draft.phi, &may_be, (&is_late, self.go_on))?;
        let phi = &mut draft.phi;
        let nodes = seen.distances.iter().zip(&seen.weights);
        for (value, (distance, weight)) in phi.values.iter_mut().zip(nodes) {
            if *weight > 0.0 {
                *value = value.max(*distance);
            }
        }
        phi.redistance(fairing::REACH);
        draft.evidence.seen = Some(seen);
        Ok(())
    }

    /// What the depth maps show, within the hull of the silhouettes where there are masks too; `None` where there are too few
    /// maps, or too few that can be read.
    pub(super) fn draft_from_depths(&self) -> Result<Option<Draft>, StageOneError> {
        let maps = fusion::depth_views(self.dataset);
        let Some(fused) = self.fused(&maps, self.options.n_cells, 0.15)? else {
            return Ok(None);
        };
        let (mut grid, mut seen) = (fused.grid, fused.seen);
        // Few masks or none: the maps alone are enough.
        let silhouettes = silhouettes(self.dataset).unwrap_or_default();
        let mut hull = grid.clone();
        if silhouettes.is_empty() {
            hull.values.fill(f32::NEG_INFINITY);
        } else {
            hull::fill(&silhouettes, &mut hull, self.go_on)?;
        }
        hull::cut(&mut hull, &fused.bounds);
        let nodes = grid.values.iter_mut().zip(&mut seen.weights);
        for ((value, weight), hull) in nodes.zip(&hull.values) {
            *value = value.max(*hull);
            // What the maps show there is none of the object.
            if *hull > grid.cell {
                *weight = 0.0;
            }
        }
        grid.redistance(fairing::REACH);
        Ok(Some(Draft {
            phi: grid,
            evidence: Evidence {
                hull,
                silhouettes,
                outline_error: 0.0,
                seen: Some(seen),
                normals: Normals::default(),
            },
        }))
    }

    /// The mesh of what the reconstruction's points show of the object, without the floor that it stands on, on a grid no finer
    /// than they are; `None` where there are too few.
    pub(super) fn mesh_from_points(&self) -> Result<Option<Mesh>, StageOneError> {
        let maps = point_maps::maps(self.dataset, self.go_on);
        unless_cancelled(self.go_on)?;
        let views = maps
            .iter()
            .map(|(map, view)| Depths::known(map, view.mask.as_ref()));
        let views: Vec<_> = views.collect();
        let n_cells = self.options.n_cells.min(POINT_CELLS);
        let Some(Fused { mut grid, .. }) = self.fused(&views, n_cells, 1.0)? else {
            return Ok(None);
        };
        if let Some((points, reach)) = point_maps::around_object(self.dataset)
            && let Some(support) =
                support_plane::find(&points, &camera_positions(self.dataset), reach)
        {
            let clearance = FLOOR_CELLS * grid.cell;
            hull::raise(&mut grid, |p| clearance - support.plane.height(p));
        }
        surface(self.dataset, &grid, LEAST_PART_OF_POINTS).map(Some)
    }

    /// Distances to what depth maps show, the first `part` of the job; `None` where there are too few, or too few that can be read.
    fn fused(
        &self,
        views: &[Depths<'_>],
        n_cells: usize,
        part: f32,
    ) -> Result<Option<Fused>, StageOneError> {
        if views.len() < fusion::MIN_MAPS {
            return Ok(None);
        }
        let Some(bounds) = fusion::bounds(self.dataset, views) else {
            return Ok(None);
        };
        self.progress(part * 0.1);
        let mut grid = grid_around(&bounds, n_cells);
        let is_late = || self.options.is_over();
        let on_batch = |fraction: f32| self.progress(part * (0.1 + 0.85 * fraction));
        let seen = fusion::fill(views, &mut grid, &|_| true, &is_late, self.go_on, &on_batch)?;
        hull::cut(&mut grid, &bounds);
        let has_enough = seen.n_maps >= fusion::MIN_MAPS;
        Ok(has_enough.then_some(Fused { grid, seen, bounds }))
    }
}

/// Distances to what depth maps show.
struct Fused {
    grid: ScalarGrid,
    seen: Seen,
    /// The box around it.
    bounds: Aabb,
}

/// Width of a pixel of each silhouette at `p`, scene units.
pub(super) fn pixels_at(silhouettes: &[Silhouette], p: Vec3) -> Vec<f32> {
    silhouettes.iter().map(|s| s.pixel_at(p)).collect()
}

/// A grid of `n_cells` along the longest side of `bounds`, with a margin on all sides.
pub(super) fn grid_around(bounds: &Aabb, n_cells: usize) -> ScalarGrid {
    let margin = MARGIN_CELLS as f32 * bounds.extent().max_element() / n_cells as f32;
    ScalarGrid::over(&bounds.widened(margin), n_cells + 2 * MARGIN_CELLS, 0.0)
}

/// The silhouettes of the training views; errors when they are too few or too small.
pub(super) fn silhouettes(dataset: &Dataset) -> Result<Vec<Silhouette>, StageOneError> {
    let views = dataset.train.par_iter().enumerate();
    let found: Vec<Silhouette> = views
        .filter_map(|(index, view)| Silhouette::new(index, view, view.camera, f32::INFINITY))
        .collect();
    if found.len() < MIN_VIEWS {
        return Err(StageOneError::TooFewMasks {
            dataset: dataset.root.clone(),
            n_found: found.len(),
            n_views: dataset.train.len(),
        });
    }
    let radius_px = middle(&mut found.iter().map(|s| s.disc().1).collect::<Vec<f32>>());
    if radius_px < MIN_RADIUS_PX {
        return Err(StageOneError::TooSmall {
            dataset: dataset.root.clone(),
            radius_px,
        });
    }
    Ok(found)
}
