//! The environment that the object is found in: trained on whole photos, with the object as a part of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::data::Dataset;
use crate::neif::Environment;
use crate::train::config::TrainConfig;
use crate::train::session::plan::{Budget, Plan};
use crate::train::{TrainError, new_trainer};

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
) -> Result<Arc<Environment>, TrainError> {
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
            return Ok(trainer.snapshot().environment);
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
