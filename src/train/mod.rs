//! Training: pixels in, models out.

pub mod config;
pub mod fast;
pub mod masks;
pub mod measure;
pub mod neilf;
pub mod paper;
pub mod photos;
mod pixels;
mod placement;
mod preparation;
mod presets;
mod priors;
mod random;
pub mod scene_model;
pub mod session;
pub mod shape;
mod statistics;
pub mod step;
mod sweep;
#[cfg(test)]
mod test_agreement;
#[cfg(test)]
mod test_scene;

pub use self::session::saved::snapshot::Snapshot;
pub use self::step::model::{Model, Stage, StepStats};
pub use self::step::tasks::TaskClock;
pub use self::step::trainer::Trainer;
pub use config::TrainConfig;
pub use fast::Fast;
pub use neilf::Neilf;
pub use paper::Paper;
pub use scene_model::SceneModel;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use crate::data::Dataset;
use crate::data::files::tensor_file::TensorFileError;

/// The trainer of whichever model.
pub type AnyTrainer = Box<Trainer<dyn SceneModel>>;

/// The trainer of the model that the configuration names. Traces every training pixel on the current thread pool;
/// `on_progress` gets 0..1.
///
/// # Errors
/// When cancelled, when the configuration is unusable, or when no pixel can be trained on.
pub fn new_trainer(
    config: &TrainConfig,
    dataset: &Dataset,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<AnyTrainer, TrainError> {
    Ok(match config.paper {
        Some(_) => Box::new(Paper::trainer(config, dataset, cancel, on_progress)?),
        None => Box::new(Fast::trainer(config, dataset, cancel, on_progress)?),
    })
}

/// Why training cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting is unknown or out of range.
    #[error("configuration field `{field}` {what}")]
    Config {
        /// The field.
        field: &'static str,
        /// What is wrong.
        what: String,
    },
    /// Neither object nor background pixels were found.
    #[error("{}: no pixel to train on: the photos show neither object nor background", dataset.display())]
    NoPixels {
        /// The capture.
        dataset: PathBuf,
    },
    /// The person asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// A checkpoint does not fit this run.
    #[error("{}: {what}", file.display())]
    Checkpoint {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        what: &'static str,
    },
    /// A tensor file cannot be read or lacks an array.
    #[error(transparent)]
    File(#[from] TensorFileError),
}
