//! When pixels are traced anew, where normals or poses are refined.

/// Shares of the plan at which they are: most is learned early, and each tracing takes time.
pub(in crate::train) const RETRACE_AT: [f32; 6] = [0.05, 0.1, 0.2, 0.3, 0.45, 0.6];
/// In a plan in seconds, how many times as long as a tracing took there is none after it: a short run is not spent on them.
const RESTS: f64 = 2.0;
/// Share of the plan after which one that was due before is left out: what has moved needs time to be learned.
const LATEST: f32 = 0.7;

/// The tracings of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Retracings {
    /// How many are behind.
    n_behind: usize,
    /// Seconds of training before which there is none.
    rested: f64,
}

impl Retracings {
    /// Of a run that goes on at a share of its plan.
    pub(in crate::train) fn starting_at(fraction: f32) -> Self {
        Self {
            n_behind: due_by(fraction),
            rested: 0.0,
        }
    }

    /// Whether one is due at a share of the plan, which is then behind, with all before it; `timed_secs`: seconds of training,
    /// in a plan in seconds.
    pub(in crate::train) fn take(&mut self, fraction: f32, timed_secs: Option<f64>) -> bool {
        let due = due_by(fraction);
        if due <= self.n_behind || timed_secs.is_some_and(|now| now < self.rested) {
            return false;
        }
        self.n_behind = due;
        fraction <= LATEST
    }

    /// Notes when one was made, seconds of training.
    pub(in crate::train) fn rest(&mut self, begun: f64, ended: f64) {
        self.rested = ended + RESTS * (ended - begun);
    }
}

/// Whether the last quarter of a run that is by so large a share of its plan has no tracing left to show what it brings.
pub(in crate::train) fn are_all_shown(fraction: f32) -> bool {
    RETRACE_AT.iter().all(|at| *at <= 0.75 * fraction)
}

fn due_by(fraction: f32) -> usize {
    RETRACE_AT.iter().filter(|at| **at <= fraction).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_in_steps_has_all_tracings_and_a_short_one_in_seconds_few() {
        let in_steps = |n_steps: u32| {
            let mut retracings = Retracings::starting_at(0.0);
            let fractions = (0..n_steps).map(|step| step as f32 / n_steps as f32);
            fractions.filter(|f| retracings.take(*f, None)).count()
        };
        assert_eq!(in_steps(1000), RETRACE_AT.len());
        // Those of one step are one.
        assert_eq!(in_steps(4), 2);
        // Each takes four seconds of forty.
        let (mut retracings, mut now, mut made) = (Retracings::starting_at(0.0), 0.0, Vec::new());
        while now < 40.0 {
            let fraction = now as f32 / 40.0;
            if retracings.take(fraction, Some(now)) {
                made.push(fraction);
                retracings.rest(now, now + 4.0);
                now += 4.0;
            }
            now += 0.1;
        }
        assert_eq!(made.len(), 3, "{made:?}");
        assert!(made.windows(2).all(|pair| pair[1] - pair[0] > 0.29));
        assert!(made.iter().all(|fraction| *fraction <= LATEST));
        // Overdue at the end: left out.
        let mut late = Retracings::starting_at(0.5);
        assert!(!late.take(0.5, None) && !late.take(0.9, None) && !late.take(0.95, None));
    }

    #[test]
    fn the_last_quarter_is_to_follow_all_tracings() {
        assert!(!are_all_shown(0.7) && are_all_shown(0.85));
    }
}
