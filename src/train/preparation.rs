//! What a trainer of either model begins with: the traced surface and the training pixels.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::TrainError;
use super::config::{PhotoFit, TrainConfig};
use super::photos::poses::Poses;
use super::pixels::outlines::OutlineFit;
use super::pixels::store::PixelStore;
use super::pixels::view_pixels::PixelOptions;
use super::placement::{field_frame, given_cameras};
use super::priors::depth_evidence::SeenDepths;
use super::shape::refinement;
use crate::data::Dataset;
use crate::geometry::SurfaceTracer;
use crate::render::path::gbuffer::PathOptions;

/// [`PathOptions::largest_turn`] in training: a mirror image that a pixel squeezes further in one direction than in the
/// other is no round cone's, and what was learned from cones would be too rough and its lamps too wide.
const TAUGHT_TURN: f32 = 0.08;
/// [`PathOptions::most`] in training.
const MOST_PATHS: usize = 8;

/// Views from which it is estimated how masks lie about a mesh that has moved a little.
const OUTLINE_VIEWS: usize = 24;

/// The mesh ready for rays, and every pixel that is trained on, from cameras as the masks show them to be.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) tracer: Option<Arc<SurfaceTracer>>,
    pub(super) poses: Option<Poses>,
    pub(super) pixels: PixelStore,
}

impl Prepared {
    /// Collects every training pixel, and traces the first of the object's, on the current thread pool; `on_progress` gets 0..1.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when no pixel can be trained on.
    pub(super) fn new(
        config: &TrainConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let mesh = refinement::mesh_to_refine(config, dataset);
        let tracer = mesh.map(|mesh| Arc::new(SurfaceTracer::new(mesh)));
        let given = given_cameras(dataset);
        let outlines = OutlineFit::new(dataset, &given, tracer.as_deref(), usize::MAX);
        let frame = field_frame(dataset, config.inner_box_scale);
        let poses = Poses::of(dataset, &frame, config.refine_poses, &outlines.shifts);
        let options = pixel_options(config, tracer.is_some(), outlines.error_px);
        let cameras = poses.as_ref().map_or(given, Poses::cameras);
        let traced = tracer.as_deref();
        let on_view = watched(3 * dataset.train.len(), cancel, on_progress);
        let depths = if config.background != PhotoFit::Off && config.depth_weight > 0.0 {
            let depths = SeenDepths::of(dataset, &cameras, traced, &frame, &on_view);
            Some(depths.ok_or(TrainError::Cancelled)?)
        } else {
            None
        };
        let mut pixels = PixelStore::collect(dataset, &cameras, tracer.as_ref(), options, &on_view)
            .ok_or(TrainError::Cancelled)?;
        pixels.depths = depths;
        if pixels.n_objects() == 0 && pixels.n_backgrounds() == 0 {
            return Err(TrainError::NoPixels {
                dataset: dataset.root.clone(),
            });
        }
        Ok(Self {
            tracer,
            poses,
            pixels,
        })
    }
}

/// Collects the pixels again, on a mesh and from cameras that have changed a little, after `n_drawn` of the object's were drawn,
/// and traces the first of the object's, others than before. `on_progress` gets 0..1.
///
/// # Errors
/// When cancelled; the pixels are then as they were.
pub(super) fn retrace_pixels(
    pixels: &mut PixelStore,
    config: &TrainConfig,
    (dataset, tracer): (&Dataset, Option<&Arc<SurfaceTracer>>),
    n_drawn: u64,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<(), TrainError> {
    let cameras = pixels.cameras();
    let surface = tracer.map(|tracer| &**tracer);
    let outlines = OutlineFit::new(dataset, &cameras, surface, OUTLINE_VIEWS);
    let options = PixelOptions {
        choice: n_drawn,
        ..pixel_options(config, tracer.is_some(), outlines.error_px)
    };
    let on_view = watched(2 * dataset.train.len(), cancel, on_progress);
    if pixels.retrace(dataset, tracer, (options, n_drawn), &on_view) {
        Ok(())
    } else {
        Err(TrainError::Cancelled)
    }
}

pub(super) fn pixel_options(
    config: &TrainConfig,
    has_object: bool,
    outline_error_px: f32,
) -> PixelOptions {
    PixelOptions {
        seed: config.seed,
        background: config.background != PhotoFit::Off,
        max_pixels: config.max_pixels,
        choice: 0,
        n_blurred: config.preconvolved_levels,
        // With an object the lamps' radiance is learned from what they shine on.
        clipped_radiance: if has_object {
            1.0
        } else {
            config.clipped_radiance
        },
        paths: PathOptions {
            max_vertices: config.bounces + 1,
            least: 1,
            most: if config.subpixels { MOST_PATHS } else { 1 },
            largest_turn: TAUGHT_TURN,
        },
        outline_error_px,
        shared_chroma: config.shared_chroma,
    }
}

/// To be called so many times: reports how many have been, and returns whether to go on.
fn watched(
    n_calls: usize,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> impl Fn() -> bool + Sync {
    let done = AtomicUsize::new(0);
    move || {
        on_progress(done.fetch_add(1, Ordering::Relaxed) as f32 / n_calls.max(1) as f32);
        !cancel.load(Ordering::Relaxed)
    }
}
