//! The environment that the object is found in: trained on whole photos, with the object as a part of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::data::Dataset;
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::train::config::TrainConfig;
use crate::train::photos::poses::Poses;
use crate::train::session::plan::{Budget, Plan};
use crate::train::{TrainError, new_trainer};

/// An environment that was trained on photos with the object as a part of it.
#[derive(Clone, Debug)]
pub struct LearnedPlace {
    /// The environment.
    pub environment: Arc<Environment>,
    /// The cameras of the training photos as they were corrected, where they were.
    pub cameras: Option<Vec<Camera>>,
}

impl LearnedPlace {
    /// With the cameras as the capture has them.
    pub fn as_given(environment: Arc<Environment>) -> Self {
        let cameras = None;
        Self {
            environment,
            cameras,
        }
    }

    /// The cameras of all views of a capture, in the order of [`Dataset::views`].
    pub(super) fn cameras_of(&self, dataset: &Dataset) -> Vec<Camera> {
        let mut cameras: Vec<Camera> = dataset.views().map(|view| view.camera).collect();
        let corrected = self.cameras.iter().flatten();
        for (camera, corrected) in cameras.iter_mut().zip(corrected) {
            *camera = *corrected;
        }
        cameras
    }
}

/// Trains an environment on the capture as it is without masks and mesh, on the current thread pool. `on_progress` gets 0..1.
///
/// # Errors
/// When cancelled, and as for [`new_trainer`].
pub fn learn_environment(
    dataset: &Dataset,
    config: &TrainConfig,
    budget: Budget,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<LearnedPlace, TrainError> {
    let started = Instant::now();
    let has_object = dataset.mesh.is_some() || dataset.views().any(|view| view.mask.is_some());
    let stripped = has_object.then(|| without_object(dataset));
    let dataset = stripped.as_ref().unwrap_or(dataset);
    let mut trainer = new_trainer(config, dataset, cancel, &|_| ())?;
    let plan = Plan::new(budget);
    loop {
        if cancel.load(Ordering::Relaxed) {
            return Err(TrainError::Cancelled);
        }
        let position = plan.position(started.elapsed().as_secs_f64(), trainer.steps());
        if plan.is_done(position) {
            return Ok(LearnedPlace {
                environment: trainer.snapshot().environment,
                cameras: trainer.model().poses().map(Poses::cameras),
            });
        }
        let fraction = plan.fraction(position);
        trainer.step(fraction);
        on_progress(fraction);
    }
}

/// The capture with nothing that says where the object is.
fn without_object(dataset: &Dataset) -> Dataset {
    let mut dataset = dataset.clone();
    dataset.mesh = None;
    let splits = [&mut dataset.train, &mut dataset.val, &mut dataset.test];
    for view in splits.into_iter().flatten() {
        view.mask = None;
    }
    dataset
}
