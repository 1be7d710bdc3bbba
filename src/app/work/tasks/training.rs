//! Begins training: on what is open, or anew with the object that is to be found in it.

use super::{TRAINING_REPAINT, Work};
use crate::app::state::app_state::AppState;
use crate::app::state::source::Source;
use crate::app::state::training_state::{Level, Phase, TrainingState};
use crate::train::config::TrainConfig;
use crate::train::session::handle::Session;
use crate::train::session::options::{SessionOptions, WantedObject};
use crate::train::session::plan::Budget;

impl Work {
    /// Trains on the open capture, or continues the open run.
    pub(super) fn start(&mut self, state: &mut AppState) {
        self.begin(state, None);
    }

    /// Trains on the open capture anew, with the object that was found in its photos.
    pub(super) fn train_object(&mut self, state: &mut AppState) {
        let object = std::mem::take(&mut state.object);
        if let Some(found) = object.found {
            // It takes the old one's place: two would share the processor.
            self.session = None;
            state.dataset = None;
            self.begin(state, Some(WantedObject::Found(found)));
        }
    }

    fn begin(&mut self, state: &mut AppState, object: Option<WantedObject>) {
        let budget = Budget::Seconds(state.watch.budget_secs);
        let options = match &state.source {
            Source::Demo(path) | Source::Capture(path) => {
                TrainConfig::preset(state.preferences.quality.preset())
                    .map(|config| SessionOptions {
                        choices: self.choices(path),
                        object,
                        ..SessionOptions::new(path, config, budget)
                    })
                    .map_err(|error| error.to_string())
            }
            Source::Run(path) => {
                SessionOptions::resume(path, Some(budget)).map_err(|error| error.to_string())
            }
            Source::Nothing | Source::Environment(_) => Err("Open a capture first".to_owned()),
        };
        let ctx = self.ctx.clone();
        let session = options.and_then(|options| {
            let options = SessionOptions {
                shows_growth: true,
                nice: true,
                ..options
            };
            let wake = move || ctx.request_repaint_after(TRAINING_REPAINT);
            Session::spawn(options, wake).map_err(|error| error.to_string())
        });
        match session {
            Ok(session) => {
                session.use_threads(state.pace.threads());
                self.session = Some(session);
                (self.snapshot_version, self.growth_version) = (0, 0);
                let phase = Phase::Loading {
                    what: "Reading the capture".to_owned(),
                    fraction: 0.0,
                };
                // A run that goes on goes on with its curves.
                let earlier = match &state.source {
                    Source::Run(_) => std::mem::take(&mut state.training),
                    _ => TrainingState::default(),
                };
                state.training = TrainingState { phase, ..earlier };
            }
            Err(reason) => state.messages.say(Level::Error, reason),
        }
    }
}
