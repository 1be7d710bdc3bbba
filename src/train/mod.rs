//! Training: pixels in, models out.

mod adam;
mod agreement;
pub mod any_trainer;
mod batch_size;
mod block_chroma;
mod checkpoint;
mod chunk;
pub mod config;
mod convolution;
mod depth_evidence;
mod distortion;
pub mod eval;
mod event_queue;
pub mod events;
mod exposures;
pub mod flip;
mod ground;
pub mod held_out;
mod image_gradient;
pub mod latest;
mod learned;
mod line_of_sight;
mod loss;
pub mod lpips;
mod mask_outline;
mod meter;
pub mod metrics;
pub mod neilf;
mod normal_evidence;
mod normal_offsets;
mod outlines;
mod packed_path;
pub mod paper;
pub mod photo_exposures;
mod photo_rows;
mod picture_shift;
mod pixel_set;
mod pixels;
mod placement;
pub mod plan;
mod pose_step;
mod poses;
#[cfg(test)]
mod poses_tests;
mod preconvolution;
mod preparation;
mod random;
mod refinement;
#[cfg(test)]
mod refinement_tests;
mod relative_exposures;
mod retracing;
mod run;
pub mod run_folder;
pub mod run_log;
pub mod session;
mod session_thread;
pub mod skips;
pub mod snapshot;
mod srgb_codes;
pub mod stage_one;
mod statistics;
mod step_context;
#[cfg(test)]
mod test_scene;
mod tilted_rays;
pub mod trainer;
#[cfg(test)]
mod trainer_tests;
mod unseen;
mod unseen_light;
mod upkeep;
mod validation;
pub mod view_error;
mod view_pixels;
mod void;

pub use any_trainer::AnyTrainer;
pub use config::TrainConfig;
pub use snapshot::Snapshot;
pub use trainer::{Stage, StepStats, Trainer};

use std::path::PathBuf;

use crate::data::tensor_file::TensorFileError;

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
