//! The commands that a training session receives, and the events that it sends.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::plan::Budget;
use crate::train::fast::skips::SkipShares;

/// A request to the training thread, carried out between two steps.
#[derive(Clone, Debug, PartialEq)]
pub enum TrainCommand {
    /// Stop stepping, keep everything.
    Pause,
    /// Go on after a pause.
    Resume,
    /// Do one step, then stay paused.
    StepOnce,
    /// Save and end.
    Stop,
    /// Save into this run folder.
    Save(PathBuf),
    /// Train this much more, also after the run has finished.
    Extend(Budget),
}

/// News from the training thread. All are delivered except [`TrainEvent::Progress`], which is
/// dropped when the reader is behind.
#[derive(Clone, Debug, PartialEq)]
pub enum TrainEvent {
    /// The capture is being read or prepared.
    Loading {
        /// What is being done, for people.
        what: String,
        /// Share of this part that is done, 0 to 1.
        fraction: f32,
    },
    /// The capture is ready.
    Loaded {
        /// Number of training views.
        n_train: usize,
        /// Number of validation views.
        n_val: usize,
        /// Width of the first training view, in pixels.
        width: u32,
        /// Height of the first training view, in pixels.
        height: u32,
        /// False when only the environment is trained.
        has_object: bool,
        /// What is odd about the capture, for people.
        problems: Vec<String>,
        /// What was found out about its photos and is done about it, for people.
        found: Vec<String>,
    },
    /// How training goes, about once a second.
    Progress(Progress),
    /// Light paths are traced anew with the refined normals and poses; no step is taken meanwhile.
    Retracing {
        /// Share that is done, 0 to 1.
        fraction: f32,
    },
    /// Quality on held-out pixels.
    Validated(Validation),
    /// The same by validation view, in the capture's order: PSNR in dB of the object, or of all pixels where nothing of it
    /// was measured.
    ViewsValidated(Vec<Option<f64>>),
    /// The learned exposures of the training photos: name and gain a colour of each.
    Exposures(Vec<(String, [f32; 3])>),
    /// The refined poses of the training photos, as often as [`Self::Validated`] and at the end: the name of each and how far
    /// its middle has moved on what it shows, pixels.
    Poses(Vec<(String, f32)>),
    /// Something that does not end the run but should be known.
    Warning(String),
    /// A run folder was saved.
    Saved(PathBuf),
    /// Stepping has stopped until further notice.
    Paused,
    /// Stepping goes on.
    Resumed,
    /// The run has come to its end; [`TrainCommand::Extend`] continues it.
    Finished(Finish),
    /// The run has ended with an error.
    Failed(String),
}

/// How training goes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Optimiser steps done.
    pub step: u64,
    /// Steps wanted, where the run is planned in steps.
    pub planned_steps: Option<u64>,
    /// Share of the plan that is done, 0 to 1.
    pub fraction: f32,
    /// Seconds of training, pauses not counted, earlier sittings of a resumed run included.
    pub elapsed_secs: f64,
    /// Seconds that are left by the plan.
    pub eta_secs: f64,
    /// Steps per second since the last report.
    pub steps_per_sec: f32,
    /// Rays per second since the last report.
    pub rays_per_sec: f32,
    /// Field samples per ray.
    pub samples_per_ray: f32,
    /// Mean loss since the last report.
    pub loss: f32,
    /// Its part that object pixels cause, unweighted.
    pub loss_object: f32,
    /// Its part that background pixels cause, unweighted.
    pub loss_background: f32,
    /// Steps skipped because of a value that was not finite.
    pub skipped_steps: u64,
    /// What the shortcuts left out of the last step.
    pub skips: Option<SkipShares>,
}

/// Quality on held-out pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Validation {
    /// Optimiser steps done.
    pub step: u64,
    /// Seconds of training.
    pub elapsed_secs: f64,
    /// PSNR over all measured pixels, dB.
    pub psnr: f64,
    /// PSNR over those of the object, dB; none where nothing of it was measured.
    pub psnr_object: Option<f64>,
    /// PSNR over the others, dB; none where there are none.
    pub psnr_background: Option<f64>,
}

/// Why a run has come to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FinishReason {
    /// The planned time or steps are used up.
    Budget,
    /// The validation error had settled.
    Settled,
    /// It was asked to stop.
    Stopped,
}

/// The end of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Why.
    pub reason: FinishReason,
    /// Optimiser steps done.
    pub step: u64,
    /// Seconds of training, pauses not counted.
    pub train_secs: f64,
}

impl FinishReason {
    /// One word for logs and scripts.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Budget => "budget",
            Self::Settled => "settled",
            Self::Stopped => "stopped",
        }
    }
}

impl TrainEvent {
    /// The event as one JSON object with its kind under `event`: a line of `log.jsonl` and of
    /// `neif train --json`.
    pub fn to_json(&self) -> Value {
        match self {
            Self::Loading { what, fraction } => {
                json!({"event": "loading", "what": what, "fraction": fraction})
            }
            Self::Loaded {
                n_train,
                n_val,
                width,
                height,
                has_object,
                problems,
                found,
            } => json!({
                "event": "loaded", "n_train": n_train, "n_val": n_val, "width": width,
                "height": height, "has_object": has_object, "problems": problems, "found": found,
            }),
            Self::Progress(p) => json!({
                "event": "progress", "step": p.step, "planned_steps": p.planned_steps,
                "fraction": p.fraction, "elapsed_secs": p.elapsed_secs, "eta_secs": p.eta_secs,
                "steps_per_sec": p.steps_per_sec, "rays_per_sec": p.rays_per_sec,
                "samples_per_ray": p.samples_per_ray, "loss": p.loss,
                "loss_object": p.loss_object, "loss_background": p.loss_background,
                "skipped_steps": p.skipped_steps, "skips": p.skips,
            }),
            Self::Retracing { fraction } => {
                json!({"event": "retracing", "fraction": fraction})
            }
            Self::Validated(v) => json!({
                "event": "validated", "step": v.step, "elapsed_secs": v.elapsed_secs,
                "psnr": v.psnr, "psnr_object": v.psnr_object, "psnr_background": v.psnr_background,
            }),
            Self::ViewsValidated(psnr) => json!({"event": "views_validated", "psnr": psnr}),
            Self::Exposures(photos) => {
                let photos = photos.iter();
                let photos: Vec<Value> = photos
                    .map(|(name, gain)| json!({"name": name, "gain": gain}))
                    .collect();
                json!({"event": "exposures", "photos": photos})
            }
            Self::Poses(photos) => {
                let photos = photos.iter();
                let photos: Vec<Value> = photos
                    .map(|(name, moved_px)| json!({"name": name, "moved_px": moved_px}))
                    .collect();
                json!({"event": "poses", "photos": photos})
            }
            Self::Warning(message) => json!({"event": "warning", "message": message}),
            Self::Saved(path) => json!({"event": "saved", "path": path.to_string_lossy()}),
            Self::Paused => json!({"event": "paused"}),
            Self::Resumed => json!({"event": "resumed"}),
            Self::Finished(finish) => json!({
                "event": "finished", "reason": finish.reason.as_str(), "step": finish.step,
                "train_secs": finish.train_secs,
            }),
            Self::Failed(message) => json!({"event": "failed", "message": message}),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_event_says_its_kind_in_json() {
        let finish = Finish {
            reason: FinishReason::Settled,
            step: 3,
            train_secs: 1.5,
        };
        let value = TrainEvent::Finished(finish).to_json();
        assert_eq!(
            value.to_string(),
            r#"{"event":"finished","reason":"settled","step":3,"train_secs":1.5}"#
        );
        let value = TrainEvent::Saved(PathBuf::from("a/b")).to_json();
        assert_eq!(value["event"], "saved");
    }
}
