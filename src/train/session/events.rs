//! The commands that a training session receives, and the events that it sends.

use std::path::PathBuf;

use serde::Serialize;
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
#[derive(Clone, Debug, PartialEq, Serialize, strum::IntoStaticStr)]
#[serde(untagged)]
#[strum(serialize_all = "snake_case")]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FinishReason {
    /// The planned time or steps are used up.
    Budget,
    /// The validation error had settled.
    Settled,
    /// It was asked to stop.
    Stopped,
}

/// The end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Finish {
    /// Why.
    pub reason: FinishReason,
    /// Optimiser steps done.
    pub step: u64,
    /// Seconds of training, pauses not counted.
    pub train_secs: f64,
}

impl TrainEvent {
    /// The event as one JSON object with its kind under `event`: a line of `log.jsonl` and of
    /// `neif train --json`.
    pub fn to_json(&self) -> Value {
        let mut json = match self {
            Self::ViewsValidated(psnr) => json!({ "psnr": psnr }),
            Self::Exposures(photos) => photos_json("gain", photos),
            Self::Poses(photos) => photos_json("moved_px", photos),
            Self::Warning(message) | Self::Failed(message) => json!({ "message": message }),
            Self::Saved(path) => json!({ "path": path.to_string_lossy() }),
            Self::Paused | Self::Resumed => json!({}),
            // The others have fields with names.
            named => json!(named),
        };
        json["event"] = json!(<&str>::from(self));
        json
    }
}

/// Each photo's name and what it has under `key`.
fn photos_json(key: &str, photos: &[(String, impl Serialize)]) -> Value {
    let photo = |(name, value): &(String, _)| json!({ "name": name, key: value });
    json!({ "photos": photos.iter().map(photo).collect::<Vec<_>>() })
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
        let moved = TrainEvent::Poses(vec![("a".to_owned(), 0.5)]).to_json();
        assert_eq!(
            moved.to_string(),
            r#"{"event":"poses","photos":[{"moved_px":0.5,"name":"a"}]}"#
        );
        let keys = |event: TrainEvent| {
            let json = event.to_json();
            let keys = json.as_object().map(|json| json.keys().cloned().collect());
            keys.unwrap_or_default()
        };
        let progress: Vec<String> = keys(TrainEvent::Progress(Progress::default()));
        assert_eq!(
            progress.join(" "),
            "elapsed_secs eta_secs event fraction loss loss_background loss_object planned_steps rays_per_sec \
             samples_per_ray skipped_steps skips step steps_per_sec"
        );
        let validated = keys(TrainEvent::Validated(Validation::default()));
        assert_eq!(
            validated.join(" "),
            "elapsed_secs event psnr psnr_background psnr_object step"
        );
        let retracing = TrainEvent::Retracing { fraction: 0.5 }.to_json();
        assert_eq!(
            retracing.to_string(),
            r#"{"event":"retracing","fraction":0.5}"#
        );
    }
}
