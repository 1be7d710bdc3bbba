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
mod depths;
mod fairing;
mod growth;
mod hull;
mod outline_error;
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

use self::depths::fusion::{Depths, Seen};
use self::depths::{floor, fusion, point_maps};
use self::fairing::{Evidence, Fairing};
use self::silhouette::Silhouette;
use self::slopes::Normals;
use crate::data::{Dataset, View};
use crate::geometry::{Aabb, Mesh, MeshError, ScalarGrid, iso_surface};
use crate::train::placement::up_direction;
use crate::train::session::plan::Budget;
use crate::train::statistics::middle;

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
const LONE_PART: f64 = 0.5;
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
        let is_short = seconds < SHORT_SECS;
        Self {
            n_cells: if is_short {
                SHORT_CELLS
            } else {
                Self::default().n_cells
            },
            deadline: Some(started + share),
            ..Self::default()
        }
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
    let on_progress: &(dyn Fn(f32) + Sync) = &|fraction| on_news(Making::Progress(fraction));
    let go_on = || !cancel.load(Ordering::Relaxed);
    let maps = fusion::depth_views(dataset);
    let draft = from_depths(dataset, &maps, options, &go_on, on_progress)?;
    if draft.is_none()
        && !has_masks(dataset)
        && let Some(mesh) = from_points(dataset, options, &go_on, on_progress)?
    {
        return Ok(mesh);
    }
    let Draft { mut phi, evidence } = match draft {
        Some(draft) => draft,
        None => from_masks(dataset, options, &go_on, on_progress)?,
    };
    on_news(Making::Surface(&phi));
    on_progress(0.2);
    let mut residuals = Vec::new();
    for round in 0..options.n_rounds {
        if !go_on() {
            return Err(StageOneError::Cancelled);
        }
        if options.is_over() {
            break;
        }
        residuals.push(fairing::round(&mut phi, &evidence, &Fairing::default()));
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

/// The hull of the silhouettes.
fn from_masks(
    dataset: &Dataset,
    options: &StageOneOptions,
    go_on: &(dyn Fn() -> bool + Sync),
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<Draft, StageOneError> {
    let silhouettes = silhouettes(dataset)?;
    on_progress(0.05);
    let bounds = hull::bounds(&silhouettes, go_on);
    if !go_on() {
        return Err(StageOneError::Cancelled);
    }
    let bounds = bounds.ok_or_else(|| StageOneError::NothingInCommon {
        dataset: dataset.root.clone(),
    })?;
    on_progress(0.1);
    let hull = |silhouettes: &[Silhouette], n_cells: usize| {
        let mut hull = grid_around(&bounds, n_cells);
        if !hull::fill(silhouettes, &mut hull, go_on) {
            return Err(StageOneError::Cancelled);
        }
        hull::cut(&mut hull, &bounds);
        Ok(hull)
    };
    let pixel = middle(&mut pixels_at(&silhouettes, bounds.center()));
    let coarse_cells = options.n_cells.min(COMPARED_CELLS);
    let error_px = outline_error::find_px(&silhouettes, hull(&silhouettes, coarse_cells)?);
    let uncertain_px = error_px.max(alignment::CAMERA_ERROR_PX);
    let mut coarse = Draft::of(silhouettes, uncertain_px, pixel, |s| hull(s, coarse_cells))?;
    let is_aligned = alignment::align(&mut coarse, || go_on() && !options.is_over());
    let silhouettes = coarse.evidence.silhouettes;
    let error_px = if is_aligned {
        outline_error::find_px(&silhouettes, hull(&silhouettes, coarse_cells)?)
    } else {
        error_px
    };
    let finest = bounds.extent().max_element() / (CELL_ERRORS * error_px * pixel);
    let n_cells = options.n_cells.min((finest as usize).max(FEWEST_CELLS));
    Draft::of(silhouettes, error_px, pixel, |s| hull(s, n_cells))
}

/// Width of a pixel of each silhouette at `p`, scene units.
fn pixels_at(silhouettes: &[Silhouette], p: Vec3) -> Vec<f32> {
    silhouettes.iter().map(|s| s.pixel_at(p)).collect()
}

/// What the depth maps show, within the hull of the silhouettes where there are masks too; `None` where there are too few
/// maps, or too few that can be read.
fn from_depths(
    dataset: &Dataset,
    views: &[Depths<'_>],
    options: &StageOneOptions,
    go_on: &(dyn Fn() -> bool + Sync),
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<Option<Draft>, StageOneError> {
    let Some(Fused {
        mut grid,
        mut seen,
        bounds,
    }) = fused(dataset, views, options, go_on, &|share| {
        on_progress(0.15 * share);
    })?
    else {
        return Ok(None);
    };
    // Few masks or none: the maps alone are enough.
    let silhouettes = silhouettes(dataset).unwrap_or_default();
    let mut hull = grid.clone();
    if silhouettes.is_empty() {
        hull.values.fill(f32::NEG_INFINITY);
    } else if !hull::fill(&silhouettes, &mut hull, go_on) {
        return Err(StageOneError::Cancelled);
    }
    hull::cut(&mut hull, &bounds);
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
fn from_points(
    dataset: &Dataset,
    options: &StageOneOptions,
    go_on: &(dyn Fn() -> bool + Sync),
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<Option<Mesh>, StageOneError> {
    let maps = point_maps::maps(dataset, go_on);
    if !go_on() {
        return Err(StageOneError::Cancelled);
    }
    let views: Vec<_> = maps
        .iter()
        .map(|(map, view)| Depths::known(map, view))
        .collect();
    let coarse = StageOneOptions {
        n_cells: options.n_cells.min(POINT_CELLS),
        ..*options
    };
    let Some(Fused { mut grid, .. }) = fused(dataset, &views, &coarse, go_on, on_progress)? else {
        return Ok(None);
    };
    if let Some((points, reach)) = point_maps::around_object(dataset)
        && let Some(floor) = floor::find(&points, up_direction(dataset), reach)
    {
        let clearance = FLOOR_CELLS * grid.cell;
        floor.cut(&mut grid, clearance);
    }
    surface(dataset, &grid, LONE_PART).map(Some)
}

/// The surface of a grid, without parts of less than `least_share` of the largest one's area.
fn surface(dataset: &Dataset, grid: &ScalarGrid, least_share: f64) -> Result<Mesh, StageOneError> {
    let mesh = iso_surface(grid).and_then(|mesh| mesh.without_specks(least_share));
    mesh.map_err(|source| StageOneError::NoSurface {
        dataset: dataset.root.clone(),
        source,
    })
}

/// Distances to what depth maps show.
struct Fused {
    grid: ScalarGrid,
    seen: Seen,
    /// The box around it.
    bounds: Aabb,
}

/// Distances to what the depth maps show; `None` where there are too few, or too few that can be read.
fn fused(
    dataset: &Dataset,
    views: &[Depths<'_>],
    options: &StageOneOptions,
    go_on: &(dyn Fn() -> bool + Sync),
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<Option<Fused>, StageOneError> {
    if views.len() < fusion::MIN_MAPS {
        return Ok(None);
    }
    let Some(bounds) = fusion::bounds(dataset, views) else {
        return Ok(None);
    };
    on_progress(0.1);
    let mut grid = grid_around(&bounds, options.n_cells);
    let is_late = || options.deadline.is_some_and(|end| Instant::now() >= end);
    let on_batch = |fraction: f32| on_progress(0.1 + 0.85 * fraction);
    match fusion::fill(views, &mut grid, &is_late, go_on, &on_batch) {
        None => Err(StageOneError::Cancelled),
        Some(seen) if seen.n_maps < fusion::MIN_MAPS => Ok(None),
        Some(seen) => {
            hull::cut(&mut grid, &bounds);
            Ok(Some(Fused { grid, seen, bounds }))
        }
    }
}

/// A grid of `n_cells` along the longest side of `bounds`, with a margin on all sides.
fn grid_around(bounds: &Aabb, n_cells: usize) -> ScalarGrid {
    let margin = MARGIN_CELLS as f32 * bounds.extent().max_element() / n_cells as f32;
    let around = Aabb {
        min: bounds.min - margin,
        max: bounds.max + margin,
    };
    ScalarGrid::over(&around, n_cells + 2 * MARGIN_CELLS, 0.0)
}

/// The silhouettes of the training views; errors when they are too few or too small.
fn silhouettes(dataset: &Dataset) -> Result<Vec<Silhouette>, StageOneError> {
    let views = dataset.train.par_iter();
    let found: Vec<Silhouette> = views
        .filter_map(|view| Silhouette::new(view, view.camera))
        .collect();
    if found.len() < MIN_VIEWS {
        return Err(StageOneError::TooFewMasks {
            dataset: dataset.root.clone(),
            n_found: found.len(),
            n_views: dataset.train.len(),
        });
    }
    let mut radii: Vec<f32> = found.iter().map(|s| s.disc().1).collect();
    radii.sort_unstable_by(f32::total_cmp);
    let radius_px = radii[radii.len() / 2];
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
