//! How far a run has come: the fraction of the planned training that drives the learning rate.
//!
//! A run is planned in seconds of training or in steps. Steps give the same bits on every machine
//! speed; seconds keep a promise about time. The last part of the plan, in which the learning rate
//! decays, brings the last decibel, so a run that settles early is not cut off but *cooled down*:
//! the rest of the plan is passed through quickly.

use serde::{Deserialize, Serialize};

/// How much training is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Budget {
    /// Wall-clock seconds.
    Seconds(f64),
    /// Optimiser steps.
    Steps(u64),
}

/// The quick end of a run that has settled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CoolDown {
    /// Position at which it began.
    from: f64,
    /// Fraction that had been reached there.
    fraction: f64,
}

/// A plan in seconds of training or in steps. *Position* means that same unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Position at which the run ends; also says the unit.
    total: Budget,
    /// Set once the run has settled.
    cool_down: Option<CoolDown>,
}

impl Plan {
    /// A plan that ends after this much training.
    pub fn new(total: Budget) -> Self {
        let cool_down = None;
        Self { total, cool_down }
    }

    /// Where a run is: the one of the two that the plan counts in.
    pub fn position(&self, trained_secs: f64, steps: u64) -> f64 {
        match self.total {
            Budget::Seconds(_) => trained_secs,
            Budget::Steps(_) => steps as f64,
        }
    }

    /// Position at which the run ends.
    pub fn end(&self) -> f64 {
        match self.total {
            Budget::Seconds(seconds) => seconds,
            Budget::Steps(steps) => steps as f64,
        }
    }

    /// The number of steps at which the run ends, where it is planned in steps.
    pub fn planned_steps(&self) -> Option<u64> {
        match self.total {
            Budget::Seconds(_) => None,
            Budget::Steps(steps) => Some(steps),
        }
    }

    /// True when the plan counts seconds.
    pub fn is_timed(&self) -> bool {
        matches!(self.total, Budget::Seconds(_))
    }

    /// True once a settled run is on its quick end.
    pub fn is_cooling_down(&self) -> bool {
        self.cool_down.is_some()
    }

    /// Fraction of the plan, 0 to 1, that is behind at `position`.
    pub fn fraction(&self, position: f64) -> f32 {
        let end = self.end();
        let linear = |from: f64, at_from: f64| {
            let length = end - from;
            // An empty plan is a finished one; dividing would give NaN.
            if length <= 0.0 {
                return 1.0;
            }
            at_from + (1.0 - at_from) * (position - from) / length
        };
        let fraction = match self.cool_down {
            Some(cool) => linear(cool.from, cool.fraction),
            None => linear(0.0, 0.0),
        };
        fraction.clamp(0.0, 1.0) as f32
    }

    /// True when nothing is left to do at `position`.
    pub fn is_done(&self, position: f64) -> bool {
        position >= self.end()
    }

    /// Plans `more` training after `position`, in the unit of `more`. The fraction, and with it the
    /// learning rate, goes back accordingly: that is what makes more training worth its time.
    pub fn extend(&mut self, trained_secs: f64, steps: u64, more: Budget) {
        *self = Self::new(match more {
            Budget::Seconds(seconds) => Budget::Seconds(trained_secs + seconds),
            Budget::Steps(more) => Budget::Steps(steps.saturating_add(more)),
        });
    }

    /// Brings the end forward so that the rest of the plan takes `length` from `position` on;
    /// never makes it longer. Plans in steps stay as they are.
    pub fn cool_down(&mut self, position: f64, length: f64) {
        if let Budget::Seconds(end) = self.total {
            let from = position;
            let fraction = f64::from(self.fraction(position));
            self.cool_down = Some(CoolDown { from, fraction });
            self.total = Budget::Seconds(end.min(position + length));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_plans_give_exact_fractions() {
        let plan = Plan::new(Budget::Steps(300));
        assert_eq!(
            plan.fraction(plan.position(123.0, 100)),
            (100.0_f64 / 300.0) as f32
        );
        assert!(!plan.is_done(299.0) && plan.is_done(300.0));
        assert_eq!(plan.planned_steps(), Some(300));
    }

    #[test]
    fn an_empty_plan_is_done_and_finite() {
        let plan = Plan::new(Budget::Seconds(0.0));
        assert_eq!(plan.fraction(0.0), 1.0);
        assert!(plan.is_done(0.0));
    }

    #[test]
    fn cooling_down_runs_through_the_rest_without_a_jump() {
        let mut plan = Plan::new(Budget::Seconds(100.0));
        plan.cool_down(60.0, 10.0);
        assert!(
            (plan.fraction(60.0) - 0.6).abs() < 1e-6,
            "no jump where it begins"
        );
        assert!((plan.fraction(65.0) - 0.8).abs() < 1e-6);
        assert_eq!(plan.fraction(70.0), 1.0);
        assert!(plan.is_done(70.0));
        let mut nearly_done = Plan::new(Budget::Seconds(100.0));
        nearly_done.cool_down(95.0, 10.0);
        assert_eq!(nearly_done.end(), 100.0, "never longer than planned");
    }

    #[test]
    fn extending_a_finished_run_takes_the_fraction_back() {
        let mut plan = Plan::new(Budget::Steps(100));
        plan.extend(5.0, 100, Budget::Steps(100));
        assert_eq!((plan.fraction(100.0), plan.end()), (0.5, 200.0));
        plan.extend(5.0, 100, Budget::Seconds(15.0));
        assert_eq!(plan.fraction(5.0), 0.25);
    }
}
