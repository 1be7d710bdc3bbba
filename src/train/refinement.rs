//! Refinement of the mesh's normals while everything else is trained.
//!
//! The pixels' light paths are traced once. What is learned of the normals since then is added to those of their
//! vertices, step by step; now and then a corrected mesh is made of it for all to see, and the paths are traced anew.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::TrainError;
use super::config::{Normals, TrainConfig};
use super::normal_offsets::NormalOffsets;
use super::preparation::retrace_pixels;
use super::trainer::Trainer;
use crate::data::Dataset;
use crate::geometry::{Mesh, SurfaceTracer};

/// Steps before normals are learned: until then the surroundings have no features to go by.
pub(super) const DELAY: u64 = 100;
/// Learning rate at the beginning, radians.
pub(super) const RATE: f32 = 1e-3;

/// Corrections of the normals, and the mesh that they are of.
#[derive(Debug)]
pub(super) struct Refinement {
    pub(super) offsets: NormalOffsets,
    /// The mesh that the pixels were traced on.
    pub(super) traced: Arc<Mesh>,
    /// The step that the trainer's mesh is of.
    settled_at: u64,
}

/// Whether a run with these settings refines the normals of the capture's mesh.
pub(super) fn is_wanted(config: &TrainConfig, dataset: &Dataset) -> bool {
    let is_made = || dataset.mesh.is_some() && dataset.mesh_path.is_none();
    config.paper.is_none()
        && match config.normals {
            Normals::Given => false,
            Normals::Refined => dataset.mesh.is_some(),
            Normals::Auto => is_made(),
        }
}

impl Refinement {
    /// Nothing is corrected yet; `None` where nothing shall be. The masks' outlines err by `outline_error_px` pixels.
    pub(super) fn of(
        config: &TrainConfig,
        dataset: &Dataset,
        tracer: Option<&SurfaceTracer>,
        outline_error_px: f32,
    ) -> Option<Self> {
        let mesh = tracer.filter(|_| is_wanted(config, dataset))?.mesh();
        // A given mesh is not made of the outlines.
        let is_made = dataset.mesh_path.is_none();
        let error_px = if is_made { outline_error_px } else { 0.0 };
        Some(Self {
            offsets: NormalOffsets::new(&mesh.bounds(), error_px),
            traced: Arc::clone(mesh),
            settled_at: 0,
        })
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

    /// Whether the pixels' light paths change while training, as normals or poses are refined.
    pub fn needs_retracing(&self) -> bool {
        self.tracer.is_some() && (self.refinement.is_some() || self.poses().is_some())
    }

    /// Traces every training pixel anew, on the mesh and from the cameras as they are known by now, on the current thread
    /// pool; nothing where neither is refined. `on_progress` hears the share that is done, 0 to 1.
    ///
    /// # Errors
    /// When cancelled; the trainer then goes on with the old paths.
    pub fn retrace(
        &mut self,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        if !self.needs_retracing() {
            return Ok(());
        }
        self.settle_normals();
        let tracer = self.tracer.as_ref();
        let scene = (dataset, tracer.map(|tracer| &**tracer));
        retrace_pixels(&mut self.pixels, &self.config, scene, cancel, on_progress)?;
        if let (Some(refinement), Some(tracer)) = (&mut self.refinement, tracer) {
            refinement.traced = Arc::clone(tracer.mesh());
            refinement.offsets.forget_recent();
        }
        Ok(())
    }
}
