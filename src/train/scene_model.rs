//! What a session needs of a model under training beside its steps: the scene as it is known by now, and how the capture's
//! mesh and cameras change while it is learned.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::TrainError;
use super::config::TrainConfig;
use super::fast::skips::SkipShares;
use super::photos::poses::Poses;
use super::session::saved::snapshot::Snapshot;
use super::step::model::Model;
use super::step::now::Now;
use super::step::trainer::Trainer;
use crate::data::Dataset;

/// A model that is a scene. One that takes mesh, cameras and exposures as they are given leaves out most of this.
pub trait SceneModel: Model {
    /// The scene as it stands after `step` steps: a copy of the parameters.
    fn snapshot(&self, step: u64) -> Snapshot;

    /// Field samples a ray.
    fn samples_per_ray(&self, config: &TrainConfig) -> f32;

    /// What its pixels have shown before the first step, and what is done about it, as sentences.
    fn findings(&self) -> Vec<String>;

    /// What the shortcuts left out of the last step, counted now: costs about a hundredth of a step.
    fn skips(&self) -> Option<SkipShares> {
        None
    }

    /// What each training photo's exposure multiplies radiance by, in the capture's order; `None` where all are alike.
    fn gains(&self) -> Option<&[Vec3]> {
        None
    }

    /// The poses of the training photos as they are known by now; `None` where they are taken as given.
    fn poses(&self) -> Option<&Poses> {
        None
    }

    /// Whether the normals of the mesh are refined.
    fn refines_normals(&self) -> bool {
        false
    }

    /// Lets snapshots have the normals as they are known after `step` steps.
    fn settle_normals(&mut self, _step: u64) {}

    /// Moves a mesh made of outlines to where its normals want it, on the current thread pool; one for which no surface is
    /// left stays. The pixels are to be traced anew then.
    ///
    /// # Errors
    /// When cancelled; the mesh then stays.
    fn move_surface(&mut self, _dataset: &Dataset, _cancel: &AtomicBool) -> Result<(), TrainError> {
        Ok(())
    }

    /// Whether the pixels' light paths change while training, as normals or poses are refined.
    fn needs_retracing(&self) -> bool {
        false
    }

    /// Traces now, on the current thread pool, what steps would trace while they draw: for timing steps alone.
    fn trace_rest(&mut self) {}

    /// Traces training pixels anew, on the mesh and from the cameras as they are known by now, on the current thread pool.
    /// `on_progress` gets the share that is done, 0 to 1.
    ///
    /// # Errors
    /// When cancelled; training then goes on with the old paths.
    fn retrace(
        &mut self,
        _now: &Now<'_>,
        _dataset: &Dataset,
        _cancel: &AtomicBool,
        _on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        Ok(())
    }
}

impl<M: SceneModel + ?Sized> Trainer<M> {
    /// The model, to be asked.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// The scene as it stands: a copy of the parameters.
    pub fn snapshot(&self) -> Snapshot {
        self.model.snapshot(self.steps())
    }

    /// Field samples a ray.
    pub fn samples_per_ray(&self) -> f32 {
        self.model.samples_per_ray(&self.config)
    }

    /// [`SceneModel::settle_normals`].
    pub fn settle_normals(&mut self) {
        let step = self.steps();
        self.model.settle_normals(step);
    }

    /// [`SceneModel::move_surface`], with the normals as they are known by now.
    ///
    /// # Errors
    /// When cancelled; the mesh then stays.
    pub fn move_surface(
        &mut self,
        dataset: &Dataset,
        cancel: &AtomicBool,
    ) -> Result<(), TrainError> {
        self.settle_normals();
        self.model.move_surface(dataset, cancel)
    }

    /// [`SceneModel::trace_rest`].
    pub fn trace_rest(&mut self) {
        self.model.trace_rest();
    }

    /// [`SceneModel::retrace`], where paths change.
    ///
    /// # Errors
    /// When cancelled; training then goes on with the old paths.
    pub fn retrace(
        &mut self,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        if !self.model.needs_retracing() {
            return Ok(());
        }
        self.settle_normals();
        let (now, model) = self.now(0.0);
        model.retrace(&now, dataset, cancel, on_progress)
    }
}
