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
mod draft;
mod extent;
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

use self::depths::fusion;
use self::draft::{Draft, Job, MIN_RADIUS_PX, MIN_VIEWS};
use self::fairing::Fairing;
use crate::data::{Dataset, View};
use crate::geometry::{Mesh, MeshError, ScalarGrid, iso_surface};
use crate::train::session::plan::Budget;

pub(in crate::train) use self::depths::fusion::looked_at;
pub use compare::{MeshDifference, compare, silhouette_agreement};
pub use growth::GrowthPicture;
pub(in crate::train) use refit::{Refit, is_of_outlines, refit};
pub(in crate::train) use slopes::KnownNormals;

/// Share of the largest part's area below which a part is no part of the object: a thing seen in the background, or noise.
const SPECK: f64 = 0.002;
/// Share by which the rays' distances shrink in two rounds at least, or fairing is done.
const SETTLED: f32 = 0.01;
/// Most seconds that a run spends on its mesh.
const MOST_SECS: f64 = 120.0;
/// Budgets in seconds below which the grid is coarser, and its cells then.
const SHORT_SECS: f64 = 45.0;
const SHORT_CELLS: usize = 80;
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
    /// Photos agree on how deep the object's pattern lies, in this share of its pixels: it says where the surface is.
    Pattern(f32),
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
        on_news,
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

/// The surface of a grid, without parts of less than `least_share` of the largest one's area.
fn surface(dataset: &Dataset, grid: &ScalarGrid, least_share: f64) -> Result<Mesh, StageOneError> {
    let mesh = iso_surface(grid).and_then(|mesh| mesh.without_specks(least_share));
    mesh.map_err(|source| StageOneError::NoSurface {
        dataset: dataset.root.clone(),
        source,
    })
}

/// Whether the capture lacks a mesh and has masks, or depth maps of something that the cameras stand around, to make one
/// from.
pub fn is_needed(dataset: &Dataset) -> bool {
    dataset.mesh.is_none() && (has_masks(dataset) || fusion::shows_object(dataset))
}

fn has_masks(dataset: &Dataset) -> bool {
    dataset.train.iter().any(|view: &View| view.mask.is_some())
}
