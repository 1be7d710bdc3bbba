//! Training: pixels in, models out.

pub mod any_trainer;
pub mod config;
pub mod measure;
pub mod neilf;
pub mod paper;
pub mod photos;
mod pixels;
mod placement;
mod preparation;
mod priors;
mod random;
pub mod session;
pub mod shape;
mod statistics;
pub mod step;
#[cfg(test)]
mod test_scene;

pub use self::session::saved::snapshot::Snapshot;
pub use self::step::trainer::{Stage, StepStats, Trainer};
pub use any_trainer::AnyTrainer;
pub use config::TrainConfig;

use std::path::PathBuf;

use crate::data::files::tensor_file::TensorFileError;

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
