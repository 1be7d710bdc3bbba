//! Drives a training session from the command line: shows its events, ends it on Ctrl-C.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crossbeam::channel::RecvTimeoutError;
use neif::data::Dataset;
use neif::train::Snapshot;
use neif::train::session::events::{
    Finish, FinishReason, Progress, TrainCommand, TrainEvent, Validation,
};
use neif::train::session::handle::Session;
use neif::train::session::options::{SessionError, SessionOptions};

use super::failure::Failure;
use super::interrupt;
use super::output::{self, Display};
use super::photos_found::{describe_exposures, describe_poses};

/// How often Ctrl-C is looked for.
const POLL: Duration = Duration::from_millis(50);

/// What a session leaves in memory.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) finish: Finish,
    /// The last measurement on validation views.
    pub(crate) validation: Option<Validation>,
    /// The trained fields.
    pub(crate) snapshot: Arc<Snapshot>,
    pub(crate) dataset: Arc<Dataset>,
    /// True when Ctrl-C ended it before its time; it has then saved itself as usual.
    pub(crate) interrupted: bool,
}

impl Outcome {
    /// How the command ends: interrupted work is saved, but not done.
    pub(crate) fn verdict(&self) -> Result<(), Failure> {
        if self.interrupted {
            Err(Failure::Interrupted)
        } else {
            Ok(())
        }
    }

    /// Prints what was trained into `path` and how good it is.
    pub(crate) fn report(&self, path: &Path) -> std::io::Result<()> {
        let quality = self.validation.map(|v| {
            let object = v.psnr_object.map(|db| format!(" (object {db:.2} dB)"));
            let object = object.unwrap_or_default();
            format!(", validation PSNR {:.2} dB{object}", v.psnr)
        });
        output::line(&format!(
            "{}: {} steps in {:.1} s of training{}",
            path.display(),
            self.finish.step,
            self.finish.train_secs,
            quality.unwrap_or_default()
        ))
    }
}

/// Trains to the end of the plan or until Ctrl-C.
pub(crate) fn train(options: SessionOptions, json: bool) -> Result<Outcome, Failure> {
    interrupt::install()?;
    let session = Session::spawn(options, || {})?;
    let mut watcher = Watcher {
        display: Display::new(json),
        json,
        validation: None,
        moved_px: Vec::new(),
        finish: None,
    };
    let mut stopping = false;
    loop {
        match session.events().recv_timeout(POLL) {
            Ok(event) => watcher.show(&event)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if watcher.finish.is_some() {
            break;
        }
        if interrupt::requested() && !stopping {
            stopping = true;
            watcher.display.say("interrupted: saving what there is");
            session.send(TrainCommand::Stop);
        }
    }
    watcher.display.finish();
    let (snapshot, dataset) = (session.snapshot(), session.dataset());
    session.join().map_err(verdict)?;
    match (watcher.finish, snapshot, dataset) {
        (Some(finish), Some(snapshot), Some(dataset)) => Ok(Outcome {
            interrupted: finish.reason == FinishReason::Stopped,
            validation: watcher.validation,
            finish,
            snapshot,
            dataset,
        }),
        // It was stopped before there was anything to keep.
        _ => Err(Failure::Interrupted),
    }
}

/// Whether the input or the work is at fault.
fn verdict(error: SessionError) -> Failure {
    if error.is_unusable_input() {
        Failure::unusable(error)
    } else {
        Failure::Failed(error.into())
    }
}

/// Shows events in the way that was asked for.
struct Watcher {
    display: Display,
    json: bool,
    validation: Option<Validation>,
    /// By how many pixels the photos' cameras are corrected.
    moved_px: Vec<f32>,
    finish: Option<Finish>,
}

impl Watcher {
    fn show(&mut self, event: &TrainEvent) -> Result<(), Failure> {
        if self.json {
            output::json_line(&event.to_json())?;
        }
        match event {
            TrainEvent::Loading { what, fraction } => self.display.set(*fraction, what, ""),
            TrainEvent::Loaded {
                n_train,
                n_val,
                width,
                height,
                has_object,
                problems,
                found,
            } => {
                let kind = if *has_object {
                    "an object and its environment"
                } else {
                    "environment only"
                };
                self.display.say(&format!(
                    "{n_train} training and {n_val} validation views of {width} x {height}: {kind}"
                ));
                for problem in problems {
                    self.display.say(problem);
                }
                for finding in found {
                    self.display.say(&format!("note: {finding}"));
                }
            }
            TrainEvent::Progress(progress) => {
                let figures = self.figures(progress);
                self.display.set(progress.fraction, "Training", &figures);
            }
            TrainEvent::Retracing { fraction } => {
                self.display.set(*fraction, "Tracing light paths anew", "");
            }
            TrainEvent::Validated(validation) => self.validation = Some(*validation),
            TrainEvent::Exposures(photos) => {
                let gains = photos.iter().map(|(_, gain)| *gain);
                self.display.say(&describe_exposures(gains));
            }
            TrainEvent::Poses(photos) => {
                self.moved_px = photos.iter().map(|(_, moved_px)| *moved_px).collect();
            }
            TrainEvent::Warning(message) => self.display.say(&format!("warning: {message}")),
            TrainEvent::Finished(finish) => {
                if let Some(poses) = describe_poses(&self.moved_px) {
                    self.display.say(&poses);
                }
                self.finish = Some(*finish);
            }
            // Saving is routine; a failure comes back from the session itself.
            TrainEvent::Saved(_)
            | TrainEvent::ViewsValidated(_)
            | TrainEvent::Paused
            | TrainEvent::Resumed
            | TrainEvent::Failed(_) => {}
        }
        Ok(())
    }

    fn figures(&self, progress: &Progress) -> String {
        let planned = progress.planned_steps.map(|steps| format!("/{steps}"));
        let psnr = self.validation.map(|v| format!(", PSNR {:.2}", v.psnr));
        let skipped = match progress.skipped_steps {
            0 => String::new(),
            n => format!(", {n} steps skipped"),
        };
        format!(
            "step {}{}, {:.0}/s, loss {:.5}{}{skipped}, {:.0} s left",
            progress.step,
            planned.unwrap_or_default(),
            progress.steps_per_sec,
            progress.loss,
            psnr.unwrap_or_default(),
            progress.eta_secs,
        )
    }
}
