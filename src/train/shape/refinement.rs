//! Refinement of the mesh's normals while everything else is trained.
//!
//! The pixels' light paths are traced once. What is learned of the normals since then is added to those of their
//! vertices, step by step; now and then a corrected mesh is made of it for all to see, one made of outlines moved to where
//! its normals want it, and the paths are traced anew.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::normal_evidence::NormalEvidence;
use super::normal_offsets::NormalOffsets;
use super::stage_one::{self, KnownNormals, StageOneError};
use crate::data::files::tensor_file::TensorFile;
use crate::data::{Dataset, View};
use crate::geometry::{Aabb, Mesh, SurfaceTracer};
use crate::train::TrainError;
use crate::train::config::{Normals, TrainConfig};
use crate::train::preparation::retrace_pixels;
use crate::train::statistics::middle;
use crate::train::step::batch_size::BatchSize;
use crate::train::step::trainer::Trainer;

/// Steps before normals are learned: until then the surroundings have no features to go by.
pub(in crate::train) const DELAY: u64 = 100;
/// Learning rates at the beginning and at the end, radians: what is smooth is to end without noise.
const RATES: [f32; 2] = [1e-3, 1e-4];

/// Pixels that two vertices of a mesh are apart at most, about.
const DETAIL_PX: f32 = 1.6;
/// Triangles that subdividing makes at most.
const MOST_TRIANGLES: usize = 1_500_000;

/// Corrections of the normals, and the mesh that they are of.
#[derive(Debug)]
pub(in crate::train) struct Refinement {
    pub(in crate::train) offsets: NormalOffsets,
    /// The mesh that the pixels were traced on.
    pub(in crate::train) traced: Arc<Mesh>,
    /// How sure its normals are, where it moves to them.
    pub(in crate::train) evidence: Option<NormalEvidence>,
    /// [`Dataset::object_box`].
    object_box: Aabb,
    /// The step that the trainer's mesh is of.
    settled_at: u64,
}

/// Whether a run with these settings refines the normals of the capture's mesh.
pub(in crate::train) fn is_wanted(config: &TrainConfig, dataset: &Dataset) -> bool {
    let is_made = || dataset.mesh.is_some() && dataset.mesh_path.is_none();
    config.paper.is_none()
        && match config.normals {
            Normals::Given => false,
            Normals::Refined => dataset.mesh.is_some(),
            Normals::Auto => is_made(),
        }
}

/// The capture's mesh for a run with these settings: where its normals are refined, with vertices about as near to each other
/// as pixels of the photos.
pub(in crate::train) fn mesh_to_refine(
    config: &TrainConfig,
    dataset: &Dataset,
) -> Option<Arc<Mesh>> {
    let mesh = dataset.mesh.as_ref()?;
    let is_wanted = is_wanted(config, dataset);
    Some(if is_wanted {
        with_detail(Arc::clone(mesh), pixel_width(dataset))
    } else {
        Arc::clone(mesh)
    })
}

/// Width of the photos' pixels at the object, scene units, in the middle; infinite where there is none.
fn pixel_width(dataset: &Dataset) -> f32 {
    let Some(bounds) = dataset.object_box() else {
        return f32::INFINITY;
    };
    let width = |view: &View| {
        let away = Vec3::from(view.camera.world_from_camera.translation) - bounds.center();
        away.length() * view.camera.pixel_angle()
    };
    let mut widths: Vec<f32> = dataset.train.iter().map(width).collect();
    if widths.is_empty() {
        f32::INFINITY
    } else {
        middle(&mut widths)
    }
}

/// The same surface with vertices as near to each other as asks for a normal a pixel of this width.
fn with_detail(mut mesh: Arc<Mesh>, pixel: f32) -> Arc<Mesh> {
    while mesh.edge_length() > DETAIL_PX * pixel && 4 * mesh.triangles.len() <= MOST_TRIANGLES {
        mesh = Arc::new(mesh.subdivided());
    }
    mesh
}

/// Learning rate where a run is by so large a share, radians.
pub(in crate::train) fn rate(progress: f32) -> f32 {
    let [first, last] = RATES;
    first * (last / first).powf(progress.clamp(0.0, 1.0))
}

impl Refinement {
    /// Nothing is corrected yet; `None` where nothing shall be. The masks' outlines err by `outline_error_px` pixels.
    pub(in crate::train) fn of(
        config: &TrainConfig,
        dataset: &Dataset,
        tracer: Option<&SurfaceTracer>,
        outline_error_px: f32,
    ) -> Option<Self> {
        let mesh = tracer.filter(|_| is_wanted(config, dataset))?.mesh();
        // A given mesh is not made of the outlines.
        let is_made = dataset.mesh_path.is_none();
        let error_px = if is_made { outline_error_px } else { 0.0 };
        let moves = is_made && stage_one::is_of_outlines(dataset);
        let bounds = dataset.object_box()?;
        Some(Self {
            offsets: NormalOffsets::new(&bounds, error_px, pixel_width(dataset)),
            evidence: moves.then(|| NormalEvidence::new(&bounds)),
            object_box: bounds,
            traced: Arc::clone(mesh),
            settled_at: 0,
        })
    }
}

/// Names of the arrays of [`NormalEvidence::state`] and of the object's box, its two corners, in a checkpoint.
const EVIDENCE: [&str; 3] = ["normals.errors", "normals.slopes", "normals.counts"];
const OBJECT_BOX: &str = "normals.object_box";

/// The box of the mesh with which the run of a checkpoint began, where that has moved since.
pub(in crate::train) fn stored_box(file: &TensorFile) -> Option<Aabb> {
    let corners = file.f32(OBJECT_BOX, &[6]).ok()?;
    let stored = Aabb {
        min: Vec3::from_slice(&corners[..3]),
        max: Vec3::from_slice(&corners[3..]),
    };
    let is_sound = corners.iter().all(|v| v.is_finite()) && !stored.is_empty();
    is_sound.then_some(stored)
}

impl Refinement {
    /// Adds to a checkpoint what is known of the surface beyond its normals.
    pub(in crate::train) fn store_surface(&self, file: &mut TensorFile) {
        let Some(evidence) = &self.evidence else {
            return;
        };
        for (name, sums) in EVIDENCE.into_iter().zip(evidence.state()) {
            file.insert_f32(name, &[sums.len()], sums.to_vec());
        }
        let Aabb { min, max } = self.object_box;
        let corners = [min.to_array(), max.to_array()].concat();
        file.insert_f32(OBJECT_BOX, &[6], corners);
    }

    /// Goes on from there; with nothing known, where the checkpoint lacks it or it is damaged.
    pub(in crate::train) fn restore_surface(&mut self, file: &TensorFile) {
        let Some(evidence) = &mut self.evidence else {
            return;
        };
        let n = evidence.state()[0].len();
        let stored = EVIDENCE.map(|name| file.f32(name, &[n]).unwrap_or_default());
        let is_sound = |sums: &&[f32]| sums.len() == n && sums.iter().all(|v| v.is_finite());
        if stored.iter().all(is_sound) {
            evidence.set_state(stored);
        }
    }
}

impl Trainer {
    /// Whether the normals of the mesh are refined.
    pub fn refines_normals(&self) -> bool {
        self.refinement.is_some()
    }

    /// Lets snapshots have the normals as they are known by now.
    pub fn settle_normals(&mut self) {
        if let Some(refinement) = &mut self.refinement
            && refinement.settled_at < self.step
        {
            refinement.settled_at = self.step;
            let mesh = refinement.offsets.applied_to(&refinement.traced);
            self.tracer = Some(Arc::new(SurfaceTracer::new(Arc::new(mesh))));
        }
    }

    /// Moves a mesh made of outlines to where its normals want it, on the current thread pool; one for which no surface is
    /// left stays. The pixels are to be traced anew then.
    ///
    /// # Errors
    /// When cancelled; the mesh then stays.
    pub fn move_surface(
        &mut self,
        dataset: &Dataset,
        cancel: &AtomicBool,
    ) -> Result<(), TrainError> {
        self.settle_normals();
        let (Some(refinement), Some(tracer)) = (&mut self.refinement, &self.tracer) else {
            return Ok(());
        };
        let Some(evidence) = &mut refinement.evidence else {
            return Ok(());
        };
        let mesh = tracer.mesh();
        let at_vertices = |of: fn(&NormalEvidence, Vec3) -> f32| -> Vec<f32> {
            let vertices = mesh.positions.par_iter();
            vertices.map(|p| of(evidence, *p)).collect()
        };
        let known = KnownNormals {
            mesh,
            deviations: &at_vertices(NormalEvidence::deviation),
            errors: &at_vertices(NormalEvidence::error),
        };
        let cameras = self.pixels.cameras();
        let error_px = self.pixels.outline_error_px();
        let go_on = || !cancel.load(Ordering::Relaxed);
        match stage_one::refit(dataset, &cameras, known, error_px, &go_on) {
            Ok(mesh) => {
                evidence.clear();
                refinement.offsets.restart();
                refinement.traced = with_detail(Arc::new(mesh), pixel_width(dataset));
                let mesh = refinement.offsets.applied_to(&refinement.traced);
                let tracer = SurfaceTracer::new(Arc::new(mesh));
                self.tracer = Some(Arc::new(tracer));
                Ok(())
            }
            Err(StageOneError::Cancelled) => Err(TrainError::Cancelled),
            Err(_no_surface) => Ok(()),
        }
    }

    /// Whether the pixels' light paths change while training, as normals or poses are refined.
    pub fn needs_retracing(&self) -> bool {
        self.tracer.is_some() && (self.refinement.is_some() || self.poses().is_some())
    }

    /// Whether the light paths of a restored trainer, from the cameras as given or of a first choice of pixels, are to be
    /// traced anew.
    pub fn has_first_paths(&self) -> bool {
        self.tracer.is_some() && (self.poses().is_some() || !self.pixels.has_all_wanted())
    }

    /// Object pixels that the steps of the part `[from, to]` of a plan of `n_steps` draw.
    pub fn draws(&self, n_steps: f64, part: [f32; 2]) -> usize {
        BatchSize::draws(&self.config, n_steps, part)
    }

    /// Traces training pixels anew, on the mesh and from the cameras as they are known by now, on the current thread pool;
    /// nothing where neither is refined. Of the object about `most_objects`, as more will not be drawn. `on_progress` hears
    /// the share that is done, 0 to 1.
    ///
    /// # Errors
    /// When cancelled; the trainer then goes on with the old paths.
    pub fn retrace(
        &mut self,
        dataset: &Dataset,
        most_objects: usize,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        if !self.needs_retracing() {
            return Ok(());
        }
        self.settle_normals();
        let tracer = self.tracer.as_ref();
        let scene = (dataset, tracer.map(|tracer| &**tracer));
        let chosen = (most_objects, self.step);
        let (pixels, config) = (&mut self.pixels, &self.config);
        retrace_pixels(pixels, config, scene, chosen, cancel, on_progress)?;
        if let (Some(refinement), Some(tracer)) = (&mut self.refinement, tracer) {
            refinement.traced = Arc::clone(tracer.mesh());
            refinement.offsets.forget_recent();
        }
        Ok(())
    }
}
