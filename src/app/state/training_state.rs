//! What the window knows of training: phase, figures and curves, fed by the session's events.

use std::path::PathBuf;

use super::training_log::TrainingLog;
use crate::train::session::events::{FinishReason, Progress, TrainEvent, Validation};

/// Points a curve keeps; older ones are then merged in pairs.
const MAX_POINTS: usize = 600;

/// Where training stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Phase {
    /// Nothing trains.
    #[default]
    Idle,
    /// The capture is read or prepared.
    Loading {
        /// What is done.
        what: String,
        /// Share that is done, 0 to 1.
        fraction: f32,
    },
    /// Steps are taken.
    Training,
    /// Steps wait.
    Paused,
    /// The end of the plan; more can be asked for.
    Finished(FinishReason),
    /// It ended with an error.
    Failed(String),
}

impl Phase {
    /// One word for the status bar.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Idle => "Idle",
            Self::Loading { .. } => "Loading",
            Self::Training => "Training",
            Self::Paused => "Paused",
            Self::Finished(FinishReason::Stopped) => "Stopped",
            Self::Finished(_) => "Finished",
            Self::Failed(_) => "Failed",
        }
    }

    /// Whether the session's thread takes commands.
    pub fn takes_commands(&self) -> bool {
        matches!(self, Self::Training | Self::Paused)
            || matches!(self, Self::Finished(reason) if *reason != FinishReason::Stopped)
    }
}

/// What is known of the opened capture.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureInfo {
    /// Training views.
    pub n_train: usize,
    /// Validation views.
    pub n_val: usize,
    /// Size of the first photo in pixels.
    pub size: (u32, u32),
    /// False when only the environment is trained.
    pub has_object: bool,
}

/// A line of a plot: `[seconds, step, value]`, merged in pairs when it grows long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    points: Vec<[f64; 3]>,
    /// Values per point, and those waiting for a full point.
    stride: usize,
    waiting: Vec<[f64; 3]>,
}

impl Curve {
    /// Adds a value; those that are not finite are left out.
    pub fn push(&mut self, secs: f64, step: u64, value: f64) {
        if !(secs.is_finite() && value.is_finite()) {
            return;
        }
        self.waiting.push([secs, step as f64, value]);
        if self.waiting.len() >= self.stride.max(1) {
            self.points.push(mean(&self.waiting));
            self.waiting.clear();
        }
        if self.points.len() >= MAX_POINTS {
            self.points = self.points.chunks(2).map(mean).collect();
            self.stride = self.stride.max(1) * 2;
        }
    }

    /// The points, oldest first.
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    let n = points.len().max(1) as f64;
    [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / n)
}

/// The state of training.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainingState {
    /// Where it stands.
    pub phase: Phase,
    /// Share of the light paths that are traced anew, 0 to 1, while no step is taken for that.
    pub retraced: Option<f32>,
    /// The last figures.
    pub progress: Progress,
    /// Facts of the capture.
    pub capture: Option<CaptureInfo>,
    /// Training loss: all of it, and its parts that object and background pixels cause.
    pub loss: [Curve; 3],
    /// PSNR on held-out pixels: on all of them, on those of the object, and of the background.
    pub psnr: [Curve; 3],
    /// All figures as a table.
    pub log: TrainingLog,
    /// The last measurement.
    pub validation: Option<Validation>,
    /// The best one: by the object, where there is one.
    pub best: Option<Validation>,
    /// The same by validation view, dB, in the capture's order.
    pub view_psnr: Vec<Option<f64>>,
    /// `[n_train]` pixels by which photos' cameras were corrected; empty where they were not, or not yet.
    pub moved_px: Vec<f32>,
    /// Where the run was last saved.
    pub saved: Option<PathBuf>,
    /// The step of the last save.
    pub saved_step: Option<u64>,
    /// Seconds of training at each save.
    pub saved_secs: Vec<f64>,
}

/// The figure that counts: PSNR of the object where there is one, in dB.
pub fn headline(validation: &Validation) -> f64 {
    validation.psnr_object.unwrap_or(validation.psnr)
}

/// How much a message matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Good to know.
    Info,
    /// Something is odd.
    Warning,
    /// Something failed.
    Error,
}

impl TrainingState {
    /// Takes in an event; returns what the person should be informed of, if anything.
    pub fn take(&mut self, event: TrainEvent) -> Vec<(Level, String)> {
        self.retraced = None;
        match event {
            TrainEvent::Retracing { fraction } => self.retraced = Some(fraction),
            TrainEvent::Loading { what, fraction } => {
                self.phase = Phase::Loading { what, fraction }
            }
            TrainEvent::Loaded {
                n_train,
                n_val,
                width,
                height,
                has_object,
                problems,
                found,
            } => {
                self.capture = Some(CaptureInfo {
                    n_train,
                    n_val,
                    size: (width, height),
                    has_object,
                });
                self.phase = Phase::Training;
                let problems = problems.into_iter().map(|p| (Level::Warning, p));
                let found = found.into_iter().map(|f| (Level::Info, f));
                return problems.chain(found).collect();
            }
            TrainEvent::Progress(progress) => {
                self.take_progress(progress);
            }
            TrainEvent::Validated(validation) => self.take_validation(validation),
            TrainEvent::ViewsValidated(psnr) => self.view_psnr = psnr,
            // Snapshots have them, from the first on.
            TrainEvent::Exposures(_) => {}
            TrainEvent::Poses(photos) => {
                self.moved_px = photos.into_iter().map(|(_, px)| px).collect();
            }
            TrainEvent::Warning(message) => return vec![(Level::Warning, message)],
            TrainEvent::Saved(path) => {
                self.saved_step = Some(self.progress.step);
                self.saved_secs.push(self.progress.elapsed_secs);
                let message = format!("Saved to {}", path.display());
                self.saved = Some(path);
                return vec![(Level::Info, message)];
            }
            TrainEvent::Paused => self.phase = Phase::Paused,
            TrainEvent::Resumed => self.phase = Phase::Training,
            TrainEvent::Finished(finish) => {
                self.phase = Phase::Finished(finish.reason);
                let how = match finish.reason {
                    FinishReason::Budget => "Training finished",
                    FinishReason::Settled => {
                        "Training finished early: the validation error has settled"
                    }
                    FinishReason::Stopped => "Training stopped",
                };
                return vec![(Level::Info, format!("{how} after {} steps", finish.step))];
            }
            TrainEvent::Failed(message) => {
                self.phase = Phase::Failed(message.clone());
                return vec![(Level::Error, message)];
            }
        }
        Vec::new()
    }

    /// Takes in the figures of a saved run; nothing of them is unsaved.
    pub fn recall(&mut self, figures: Vec<TrainEvent>) {
        for event in figures {
            self.take(event);
        }
        self.saved_step = Some(self.progress.step);
    }

    fn take_progress(&mut self, p: Progress) {
        let losses = [p.loss, p.loss_object, p.loss_background];
        for (curve, loss) in self.loss.iter_mut().zip(losses) {
            // A run without an object has no such part.
            if loss > 0.0 {
                curve.push(p.elapsed_secs, p.step, f64::from(loss));
            }
        }
        self.log.push_progress(&p);
        self.progress = p;
    }

    fn take_validation(&mut self, v: Validation) {
        let psnr = [Some(v.psnr), v.psnr_object, v.psnr_background];
        for (curve, psnr) in self.psnr.iter_mut().zip(psnr) {
            if let Some(psnr) = psnr {
                curve.push(v.elapsed_secs, v.step, psnr);
            }
        }
        if self.best.is_none_or(|best| headline(&v) > headline(&best)) {
            self.best = Some(v);
        }
        self.log.push_validation(&v);
        self.validation = Some(v);
    }

    /// Shares of the plan, 0 to 1, at which the run was saved.
    pub fn saved_fractions(&self) -> Vec<f32> {
        let end = self.progress.elapsed_secs + self.progress.eta_secs;
        let fractions = self.saved_secs.iter().map(|secs| (secs / end) as f32);
        fractions.filter(|f| (0.0..=1.0).contains(f)).collect()
    }

    /// Whether there is training that was never saved.
    pub fn is_unsaved(&self) -> bool {
        self.progress.step > self.saved_step.unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::session::events::Finish;

    #[test]
    fn a_long_curve_keeps_its_range_with_few_points() {
        let mut curve = Curve::default();
        for i in 0..10_000 {
            curve.push(f64::from(i), i as u64, f64::from(i % 7));
        }
        curve.push(f64::NAN, 1, 1.0);
        assert!(
            curve.points().len() < MAX_POINTS,
            "{} points",
            curve.points().len()
        );
        assert!(curve.points()[0][0] < 100.0 && curve.points().last().unwrap()[0] > 9_800.0);
        assert!(
            curve.points().windows(2).all(|p| p[0][0] < p[1][0]),
            "out of order"
        );
    }

    #[test]
    fn the_best_measurement_is_the_objects_and_stays() {
        let mut state = TrainingState::default();
        for (step, object) in [(1, 20.0), (2, 25.0), (3, 24.0)] {
            state.take(TrainEvent::Validated(Validation {
                step,
                psnr: 40.0 - object,
                psnr_object: Some(object),
                ..Validation::default()
            }));
        }
        assert_eq!(state.best.map(|best| best.step), Some(2));
        assert_eq!(state.validation.map(|last| last.step), Some(3));
    }

    #[test]
    fn figures_of_a_saved_run_are_shown_and_are_saved() {
        let mut state = TrainingState::default();
        let report = Progress {
            step: 7,
            loss: 0.5,
            ..Progress::default()
        };
        state.recall(vec![TrainEvent::Progress(report)]);
        assert_eq!((state.phase.clone(), state.progress.step), (Phase::Idle, 7));
        assert!(!state.is_unsaved() && state.loss[0].points().len() == 1);
    }

    #[test]
    fn events_lead_through_the_phases() {
        let mut state = TrainingState::default();
        state.take(TrainEvent::Loading {
            what: "x".to_owned(),
            fraction: 0.5,
        });
        assert_eq!(state.phase.name(), "Loading");
        let messages = state.take(TrainEvent::Loaded {
            n_train: 3,
            n_val: 1,
            width: 4,
            height: 5,
            has_object: true,
            problems: vec!["odd".to_owned()],
            found: vec!["uncertain".to_owned()],
        });
        let expected = [(Level::Warning, "odd"), (Level::Info, "uncertain")];
        assert_eq!(
            messages,
            expected.map(|(level, what)| (level, what.to_owned()))
        );
        state.take(TrainEvent::Progress(Progress {
            step: 7,
            loss: 0.5,
            ..Progress::default()
        }));
        assert!(state.is_unsaved() && state.loss[0].points().len() == 1);
        state.take(TrainEvent::Retracing { fraction: 0.5 });
        assert_eq!(state.retraced, Some(0.5));
        state.take(TrainEvent::Progress(state.progress));
        assert_eq!(state.retraced, None, "steps are taken again");
        state.take(TrainEvent::Saved("run".into()));
        assert!(!state.is_unsaved());
        state.take(TrainEvent::Paused);
        assert_eq!(state.phase, Phase::Paused);
        let finish = Finish {
            reason: FinishReason::Stopped,
            step: 7,
            train_secs: 1.0,
        };
        state.take(TrainEvent::Finished(finish));
        assert!(
            !state.phase.takes_commands(),
            "a stopped session has no thread"
        );
        state.take(TrainEvent::Failed("bad".to_owned()));
        assert_eq!(state.phase, Phase::Failed("bad".to_owned()));
    }
}
