//! The trainer's surface as it moves: normals settled for snapshots, a mesh of outlines moved, pixels traced anew.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::batch_size::BatchSize;
use super::trainer::Trainer;
use crate::data::Dataset;
use crate::train::TrainError;
use crate::train::preparation::retrace_pixels;

impl Trainer {
    /// Whether the normals of the mesh are refined.
    pub fn refines_normals(&self) -> bool {
        self.surface.refinement.is_some()
    }

    /// Lets snapshots have the normals as they are known by now.
    pub fn settle_normals(&mut self) {
        let refinement = self.surface.refinement.as_mut();
        if let Some(tracer) = refinement.and_then(|refinement| refinement.settled(self.counts.step))
        {
            self.surface.tracer = Some(Arc::new(tracer));
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
        if let (Some(refinement), Some(tracer)) =
            (&mut self.surface.refinement, &self.surface.tracer)
        {
            let outlines = (&*self.pixels.cameras(), self.pixels.outline_error_px());
            if let Some(moved) = refinement.moved(tracer.mesh(), dataset, outlines, cancel)? {
                self.surface.tracer = Some(Arc::new(moved));
            }
        }
        Ok(())
    }

    /// Whether the pixels' light paths change while training, as normals or poses are refined.
    pub fn needs_retracing(&self) -> bool {
        self.surface.tracer.is_some()
            && (self.surface.refinement.is_some() || self.poses().is_some())
    }

    /// Whether the light paths of a restored trainer, from the cameras as given or of a first choice of pixels, are to be
    /// traced anew.
    pub fn has_first_paths(&self) -> bool {
        self.surface.tracer.is_some() && (self.poses().is_some() || !self.pixels.has_all_wanted())
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
        let tracer = self.surface.tracer.as_ref();
        let scene = (dataset, tracer.map(|tracer| &**tracer));
        let chosen = (most_objects, self.counts.step);
        let (pixels, config) = (&mut self.pixels, &self.config);
        retrace_pixels(pixels, config, scene, chosen, cancel, on_progress)?;
        if let (Some(refinement), Some(tracer)) = (&mut self.surface.refinement, tracer) {
            refinement.was_traced(tracer.mesh());
        }
        Ok(())
    }
}
