//! Stage one: a mesh of the object where a capture has none, from its depth maps, its masks or its points.
//!
//! A draft comes first, as signed distances on a grid: depth maps fused within the visual hull of the masks, or the hull
//! alone; then the fairest surface that is where the maps saw it and whose outlines are those of the masks, to a fraction of
//! a pixel, or as near as these agree. Nothing is asked of the photos' colours, which on glossy surfaces show the
//! environment.
//!
//! Where there are neither maps nor masks, the reconstruction's points give coarse maps, which are fused and left at that.

mod alignment;
mod band;
mod compare;
pub(in crate::train) mod depths;
mod fairing;
mod growth;
mod hull;
mod refit;
mod silhouette;
mod slopes;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::Vec3;
use rayon::prelude::*;

use self::alignment::outline_error_px;
use self::depths::fusion::{Depths, Seen};
use self::depths::{fusion, point_maps};
use self::fairing::{Evidence, Fairing};
use self::silhouette::Silhouette;
use self::slopes::Normals;
use crate::data::{Dataset, View};
use crate::geometry::{Aabb, Mesh, MeshError, ScalarGrid, iso_surface};
use crate::train::placement::camera_positions;
use crate::train::session::plan::Budget;
use crate::train::shape::support_plane;
use crate::train::statistics::middle;

pub(in crate::train) use self::depths::fusion::looked_at;
pub use compare::{MeshDifference, compare, silhouette_agreement};
pub use growth::GrowthPicture;
pub(in crate::train) use refit::{is_of_outlines, refit};
pub(in crate::train) use slopes::KnownNormals;

/// Silhouettes without which there is no shape.
const MIN_VIEWS: usize = 3;
/// Radius in pixels below which a silhouette shows no shape.
const MIN_RADIUS_PX: f32 = 4.0;
/// Cells along the longest side of the hull that outlines are compared with.
const COMPARED_CELLS: usize = 72;
/// Standard deviations of the outlines' error that a cell is wide at least: finer ones would show nothing but it, wider ones
/// cannot hold a handle six pixels wide whose outlines err by one.
const CELL_ERRORS: f32 = 1.5;
/// Cells that there are nevertheless.
const FEWEST_CELLS: usize = 24;
/// Cells around the hull in which the surface can move.
const MARGIN_CELLS: usize = 8;

/// Share of the largest part's area below which a part is no part of the object: a thing seen in the background, or noise.
const SPECK: f64 = 0.002;
/// Share by which the rays' distances shrink in two rounds at least, or fairing is done.
const SETTLED: f32 = 0.01;
/// Most seconds that a run spends on its mesh.
const MOST_SECS: f64 = 120.0;
/// Budgets in seconds below which the grid is coarser, and its cells then.
const SHORT_SECS: f64 = 45.0;
const SHORT_CELLS: usize = 80;
/// Most cells for a mesh of points.
const POINT_CELLS: usize = 64;
/// The same as [`SPECK`] for a mesh of points: bits of the background are near.
const LEAST_PART_OF_POINTS: f64 = 0.5;
/// Cells over the floor up to which a mesh of points is cut off.
const FLOOR_CELLS: f32 = 1.5;

/// How a mesh is made.
#[derive(Clone, Copy, Debug)]
pub struct StageOneOptions {
    /// Cells of the grid along the object's longest side.
    pub n_cells: usize,
    /// Most rounds of fairing.
    pub n_rounds: usize,
    /// When to be done, with what there is by then.
    pub deadline: Option<Instant>,
}

impl Default for StageOneOptions {
    /// Under a minute on two cores for sixty photos.
    fn default() -> Self {
        Self {
            n_cells: 144,
            n_rounds: 24,
            deadline: None,
        }
    }
}

impl StageOneOptions {
    /// For a run that began at `started` and has `budget`: at most a third of its time.
    pub fn within(started: Instant, budget: Budget) -> Self {
        let Budget::Seconds(seconds) = budget else {
            return Self::default();
        };
        let share = Duration::from_secs_f64((seconds / 3.0).clamp(0.0, MOST_SECS));
        let mut options = Self {
            deadline: Some(started + share),
            ..Self::default()
        };
        if seconds < SHORT_SECS {
            options.n_cells = SHORT_CELLS;
        }
        options
    }

    fn is_over(&self) -> bool {
        self.deadline.is_some_and(|end| Instant::now() >= end)
    }
}

/// Why no mesh can be made.
#[derive(Debug, thiserror::Error)]
pub enum StageOneError {
    /// Too few views have a mask with the object's edge in it.
    #[error(
        "{}: a mesh needs depth maps, a reconstruction's points, or the object's outline in at least {needed} training views, \
         but only {n_found} of {n_views} have a mask that shows it", dataset.display(), needed = MIN_VIEWS
    )]
    TooFewMasks {
        /// The capture.
        dataset: PathBuf,
        /// Views with a usable mask.
        n_found: usize,
        /// Training views.
        n_views: usize,
    },
    /// The object is a few pixels large.
    #[error(
        "{}: the object is too small in the masks to determine its shape: its radius is {radius_px:.1} pixels, and \
         {needed} are needed", dataset.display(), needed = MIN_RADIUS_PX
    )]
    TooSmall {
        /// The capture.
        dataset: PathBuf,
        /// Median radius of the silhouettes.
        radius_px: f32,
    },
    /// The silhouettes do not meet.
    #[error("{}: the masks have nothing in common: check that masks and cameras belong together", dataset.display())]
    NothingInCommon {
        /// The capture.
        dataset: PathBuf,
    },
    /// No surface is left.
    #[error("{}: no surface fits the masks or depth maps: {source}", dataset.display())]
    NoSurface {
        /// The capture.
        dataset: PathBuf,
        /// What is wrong with it.
        source: MeshError,
    },
    /// The person asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// What is reported while a mesh is made.
#[derive(Clone, Copy, Debug)]
pub enum Making<'a> {
    /// Share that is done, 0..1.
    Progress(f32),
    /// Distances to the surface as it stands, scene units, negative inside: the draft, then after each round.
    Surface(&'a ScalarGrid),
}

/// Whether to go on with a job.
type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

fn unless_cancelled(go_on: GoOn<'_>) -> Result<(), StageOneError> {
    go_on().then_some(()).ok_or(StageOneError::Cancelled)
}

/// Makes the mesh of the object that the masks of the training views show, in the capture's world
/// frame, on the current thread pool.
///
/// The same capture and options without a deadline give the same mesh on any number of threads.
///
/// # Errors
/// When the masks show no shape, and when cancelled.
pub fn make_mesh(
    dataset: &Dataset,
    options: &StageOneOptions,
    cancel: &AtomicBool,
    on_news: &(dyn Fn(Making<'_>) + Sync),
) -> Result<Mesh, StageOneError> {
    let on_progress = |fraction| on_news(Making::Progress(fraction));
    let go_on = || !cancel.load(Ordering::Relaxed);
    let job = Job {
        dataset,
        options,
        go_on: &go_on,
        on_progress: &on_progress,
    };
    let draft = job.draft_from_depths()?;
    if draft.is_none()
        && !has_masks(dataset)
        && let Some(mesh) = job.mesh_from_points()?
    {
        return Ok(mesh);
    }
    let Draft { mut phi, evidence } = match draft {
        Some(draft) => draft,
        None => job.draft_from_masks()?,
    };
    on_news(Making::Surface(&phi));
    on_progress(0.2);
    let mut residuals = Vec::new();
    for round in 0..options.n_rounds {
        unless_cancelled(&go_on)?;
        if options.is_over() {
            break;
        }
        residuals.push(fairing::round(&mut phi, &evidence, Fairing::SMOOTHED));
        on_news(Making::Surface(&phi));
        // Where outlines are exact, clefts go on opening that few rays constrain.
        if evidence.outline_error > 0.0 && is_settled(&residuals) {
            break;
        }
        on_progress(0.2 + 0.8 * (round + 1) as f32 / options.n_rounds as f32);
    }
    surface(dataset, &phi, SPECK)
}

/// Whether rays have not come nearer to the surface in the last two rounds, whose mean distances from it before each these are.
fn is_settled(residuals: &[f32]) -> bool {
    match residuals {
        [.., former, _, last] => *former > 0.0 && *last > (1.0 - SETTLED) * former,
        _ => false,
    }
}

/// A surface to be faired.
struct Draft {
    phi: ScalarGrid,
    evidence: Evidence,
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
fn of_outlines(
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

/// A mesh in the making, before its surface is faired.
struct Job<'a> {
    dataset: &'a Dataset,
    options: &'a StageOneOptions,
    go_on: GoOn<'a>,
    /// Gets 0..1.
    on_progress: &'a (dyn Fn(f32) + Sync),
}

impl Job<'_> {
    /// The hull of the silhouettes.
    fn draft_from_masks(&self) -> Result<Draft, StageOneError> {
        let silhouettes = silhouettes(self.dataset)?;
        (self.on_progress)(0.05);
        let bounds = hull::bounds(&silhouettes, self.go_on)?;
        let bounds = bounds.ok_or_else(|| StageOneError::NothingInCommon {
            dataset: self.dataset.root.clone(),
        })?;
        (self.on_progress)(0.1);
        let hull = |silhouettes: &[Silhouette], n_cells: usize| {
            let mut hull = grid_around(&bounds, n_cells);
            hull::fill(silhouettes, &mut hull, self.go_on)?;
            hull::cut(&mut hull, &bounds);
            Ok(hull)
        };
        let pixel = middle(&mut pixels_at(&silhouettes, bounds.center()));
        let coarse_cells = self.options.n_cells.min(COMPARED_CELLS);
        let error_px = outline_error_px(&silhouettes, hull(&silhouettes, coarse_cells)?);
        let uncertain_px = error_px.max(alignment::CAMERA_ERROR_PX);
        let mut coarse = Draft::of(silhouettes, uncertain_px, pixel, |s| hull(s, coarse_cells))?;
        let go_on = || (self.go_on)() && !self.options.is_over();
        let is_aligned = alignment::align(&mut coarse, go_on);
        let silhouettes = coarse.evidence.silhouettes;
        let error_px = if is_aligned {
            outline_error_px(&silhouettes, hull(&silhouettes, coarse_cells)?)
        } else {
            error_px
        };
        let finest = bounds.extent().max_element() / (CELL_ERRORS * error_px * pixel);
        let n_finest = (finest as usize).max(FEWEST_CELLS);
        let n_cells = self.options.n_cells.min(n_finest);
        Draft::of(silhouettes, error_px, pixel, |s| hull(s, n_cells))
    }

    /// What the depth maps show, within the hull of the silhouettes where there are masks too; `None` where there are too few
    /// maps, or too few that can be read.
    fn draft_from_depths(&self) -> Result<Option<Draft>, StageOneError> {
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
    fn mesh_from_points(&self) -> Result<Option<Mesh>, StageOneError> {
        let maps = point_maps::maps(self.dataset, self.go_on);
        unless_cancelled(self.go_on)?;
        let views = maps.iter().map(|(map, view)| Depths::known(map, view));
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
        (self.on_progress)(part * 0.1);
        let mut grid = grid_around(&bounds, n_cells);
        let is_late = || self.options.is_over();
        let on_batch = |fraction: f32| (self.on_progress)(part * (0.1 + 0.85 * fraction));
        let seen = fusion::fill(views, &mut grid, &is_late, self.go_on, &on_batch)?;
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
fn pixels_at(silhouettes: &[Silhouette], p: Vec3) -> Vec<f32> {
    silhouettes.iter().map(|s| s.pixel_at(p)).collect()
}

/// The surface of a grid, without parts of less than `least_share` of the largest one's area.
fn surface(dataset: &Dataset, grid: &ScalarGrid, least_share: f64) -> Result<Mesh, StageOneError> {
    let mesh = iso_surface(grid).and_then(|mesh| mesh.without_specks(least_share));
    mesh.map_err(|source| StageOneError::NoSurface {
        dataset: dataset.root.clone(),
        source,
    })
}

/// A grid of `n_cells` along the longest side of `bounds`, with a margin on all sides.
fn grid_around(bounds: &Aabb, n_cells: usize) -> ScalarGrid {
    let margin = MARGIN_CELLS as f32 * bounds.extent().max_element() / n_cells as f32;
    ScalarGrid::over(&widened(bounds, margin), n_cells + 2 * MARGIN_CELLS, 0.0)
}

/// The box with a margin on all sides.
fn widened(bounds: &Aabb, margin: f32) -> Aabb {
    Aabb {
        min: bounds.min - margin,
        max: bounds.max + margin,
    }
}

/// The silhouettes of the training views; errors when they are too few or too small.
fn silhouettes(dataset: &Dataset) -> Result<Vec<Silhouette>, StageOneError> {
    let views = dataset.train.par_iter();
    let found: Vec<Silhouette> = views
        .filter_map(|view| Silhouette::new(view, view.camera, f32::INFINITY))
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

/// Whether the capture lacks a mesh and has masks, or depth maps of something that the cameras stand around, to make one
/// from.
pub fn is_needed(dataset: &Dataset) -> bool {
    dataset.mesh.is_none() && (has_masks(dataset) || fusion::shows_object(dataset))
}

fn has_masks(dataset: &Dataset) -> bool {
    dataset.train.iter().any(|view: &View| view.mask.is_some())
}
