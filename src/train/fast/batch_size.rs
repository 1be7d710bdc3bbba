//! How many pixels a step draws.

use crate::train::config::TrainConfig;

/// Pixels of a step with an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::train) struct BatchSize {
    pub(in crate::train) objects: usize,
    pub(in crate::train) backgrounds: usize,
}

impl BatchSize {
    /// At `progress` of the plan, 0 to 1.
    pub(in crate::train) fn of(config: &TrainConfig, progress: f32) -> Self {
        let grown = 1.0 + config.batch_growth * progress.clamp(0.0, 1.0);
        let size = |n: usize| (n as f32 * grown).round() as usize;
        Self {
            objects: size(config.object_pixels),
            backgrounds: size(config.background_pixels),
        }
    }
}
