//! Where in its run a step is, and how fast it learns there.

use super::adam::Rates;
use super::tasks::Tasks;
use crate::train::config::TrainConfig;

/// Where in its run a step is.
#[derive(Clone, Copy, Debug)]
pub struct Now<'a> {
    pub(in crate::train) config: &'a TrainConfig,
    /// Steps that were run.
    pub(in crate::train) step: u64,
    /// Optimiser updates, from the first on with the one at hand: steps less the skipped ones.
    pub(in crate::train) updates: u64,
    /// Share of the plan, 0 to 1.
    pub(in crate::train) progress: f32,
    /// How its loops are run.
    pub(in crate::train) tasks: Tasks<'a>,
}

impl Now<'_> {
    /// Object pixels that were drawn in all steps, but for the growth of the batch.
    pub(in crate::train) fn n_objects(&self) -> u64 {
        self.step * self.config.object_pixels as u64
    }

    /// What the decay leaves of a learning rate.
    fn decay(&self) -> f32 {
        self.config.final_rate.powf(self.progress.clamp(0.0, 1.0))
    }

    /// What warm-up and decay leave of a learning rate.
    fn share(&self) -> f32 {
        let warmup = (self.updates as f32 / self.config.warmup_steps.max(1) as f32).min(1.0);
        warmup * self.decay()
    }

    /// The rates of a field whose first `n_head` parameters are networks and the others a grid.
    pub(super) fn rates(&self, n_head: usize) -> Rates {
        let share = self.share();
        Rates {
            n_head,
            head: share * self.config.network_rate,
            tail: share * self.config.grid_rate,
            tail_decay: self.decay().powi(2) * self.config.grid_decay,
        }
    }

    /// The rate of the display transform's exponent.
    pub(super) fn gamma_rate(&self) -> Rates {
        Rates {
            n_head: 1,
            head: self.share() * self.config.gamma_rate,
            tail: 0.0,
            tail_decay: 0.0,
        }
    }
}
