//! The clock of a run and the figures between two reports.

use std::time::Instant;

use super::events::Progress;
use super::plan::Plan;
use crate::train::scene_model::SceneModel;
use crate::train::step::model::StepStats;
use crate::train::step::trainer::Trainer;

/// Counts seconds of training: stands while paused.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Clock {
    counted_secs: f64,
    running_since: Option<Instant>,
}

impl Clock {
    /// A standing clock of a run that has been trained before.
    pub(in crate::train) fn starting_at(counted_secs: f64) -> Self {
        Self {
            counted_secs,
            running_since: None,
        }
    }

    /// Seconds counted so far.
    pub(in crate::train) fn secs(&self) -> f64 {
        let running = self
            .running_since
            .map_or(0.0, |since| since.elapsed().as_secs_f64());
        self.counted_secs + running
    }

    /// Lets it run.
    pub(in crate::train) fn resume(&mut self) {
        self.running_since.get_or_insert_with(Instant::now);
    }

    /// Lets it stand.
    pub(in crate::train) fn pause(&mut self) {
        self.counted_secs = self.secs();
        self.running_since = None;
    }
}

/// Adds up what happens between two reports.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Meter {
    steps: u64,
    rays: u64,
    /// Whole, of object pixels, of background pixels.
    losses: [f64; 3],
    n_losses: u64,
    /// When the last report was made, in seconds of training.
    since_secs: f64,
    /// The last report, for rates when nothing has happened since.
    last: Progress,
}

impl Meter {
    /// Adds one step.
    pub(in crate::train) fn add(&mut self, stats: &StepStats) {
        self.steps += 1;
        self.rays += u64::from(stats.rays);
        if !stats.skipped {
            let losses = [stats.loss, stats.loss_object, stats.loss_background];
            for (sum, loss) in self.losses.iter_mut().zip(losses) {
                *sum += f64::from(loss);
            }
            self.n_losses += 1;
        }
    }

    /// Leaves seconds in which no step could be taken out of the rates.
    pub(super) fn leave_out(&mut self, secs: f64) {
        self.since_secs += secs;
    }

    /// The figures since the last report; begins anew.
    pub(in crate::train) fn report(
        &mut self,
        plan: &Plan,
        clock: &Clock,
        trainer: &Trainer<dyn SceneModel>,
    ) -> Progress {
        let now = clock.secs();
        let interval = now - self.since_secs;
        let position = plan.position(now, trainer.steps());
        let mut progress = Progress {
            step: trainer.steps(),
            planned_steps: plan.planned_steps(),
            fraction: plan.fraction(position),
            elapsed_secs: now,
            samples_per_ray: trainer.samples_per_ray(),
            skipped_steps: trainer.skipped_steps(),
            skips: trainer.model().skips(),
            ..self.last
        };
        if self.steps > 0 && interval > 0.0 {
            progress.steps_per_sec = (self.steps as f64 / interval) as f32;
            progress.rays_per_sec = (self.rays as f64 / interval) as f32;
        }
        if self.n_losses > 0 {
            let [loss, object, background] =
                self.losses.map(|sum| (sum / self.n_losses as f64) as f32);
            progress.loss = loss;
            (progress.loss_object, progress.loss_background) = (object, background);
        }
        progress.eta_secs = eta_secs(plan, position, progress.steps_per_sec);
        *self = Self {
            since_secs: now,
            last: progress,
            ..Self::default()
        };
        progress
    }
}

/// Seconds that are left by the plan; 0 while the speed is not known.
fn eta_secs(plan: &Plan, position: f64, steps_per_sec: f32) -> f64 {
    let left = (plan.end() - position).max(0.0);
    match (plan.is_timed(), steps_per_sec > 0.0) {
        (true, _) => left,
        (false, true) => left / f64::from(steps_per_sec),
        (false, false) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::session::plan::Budget;

    #[test]
    fn a_standing_clock_does_not_count() {
        let mut clock = Clock::starting_at(5.0);
        assert_eq!(clock.secs(), 5.0);
        clock.resume();
        clock.pause();
        let stood = clock.secs();
        assert_eq!(clock.secs(), stood);
        assert!(stood >= 5.0);
    }

    #[test]
    fn the_time_left_is_finite_before_the_speed_is_known() {
        let plan = Plan::new(Budget::Steps(100));
        assert_eq!(eta_secs(&plan, 0.0, 0.0), 0.0);
        assert_eq!(eta_secs(&plan, 50.0, 10.0), 5.0);
    }
}
