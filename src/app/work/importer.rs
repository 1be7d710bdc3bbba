//! Makes environments of scans: a training session each, whose environment lights the object while it takes shape.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use egui::Context;

use crate::app::lighting::Import;
use crate::app::lighting::standing::set_down_in_the_middle;
use crate::app::state::app_state::AppState;
use crate::app::state::source::{EnvironmentContent, EnvironmentEntry};
use crate::app::state::training_state::Level;
use crate::neif::{Environment, EnvironmentTransform};
use crate::train::config::TrainConfig;
use crate::train::session::events::{TrainCommand, TrainEvent};
use crate::train::session::handle::{Session, Threads};
use crate::train::session::options::SessionOptions;
use crate::train::session::plan::Budget;

/// Training time of a scan, seconds.
const BUDGET_SECS: f64 = 180.0;
/// Before so many steps there is only fog.
const FIRST_STEP: u64 = 50;
/// An import wakes the window at most so often.
const REPAINT: Duration = Duration::from_millis(250);
/// The object is lit by what was learned meanwhile when the import has gone on for this share longer, since each time costs a
/// picture and changes slow down ...
const PATIENCE: f64 = 0.15;
/// ... and never sooner than after so many seconds.
const MIN_INTERVAL_SECS: f64 = 1.0;

/// The imports that go on.
#[derive(Debug, Default)]
pub(super) struct Importer {
    running: Vec<Running>,
}

#[derive(Debug)]
struct Running {
    session: Session,
    /// Its environment, by its index on the list.
    index: usize,
    version: u64,
    /// Training time so far, seconds.
    trained_secs: f64,
    /// When the object was last lit anew, by the window's clock, seconds.
    lit_secs: f64,
    is_over: bool,
    /// How the environment stood before, and how the object was set down in it last.
    set_down: Option<[EnvironmentTransform; 2]>,
}

/// An environment that was made here.
pub(super) struct Made {
    /// The file that it was made of, by which it is known on the list.
    pub(super) source: PathBuf,
    pub(super) environment: Arc<Environment>,
}

impl Made {
    /// What is on the list, where it is known.
    pub(super) fn of_entry(entry: &EnvironmentEntry) -> Option<Self> {
        let EnvironmentContent::Ready(environment) = &entry.content else {
            return None;
        };
        Some(Self {
            source: entry.path.clone(),
            environment: Arc::clone(environment),
        })
    }
}

impl Importer {
    /// Begins to make an environment of a scan, unless that goes on already.
    pub(super) fn start(&mut self, state: &mut AppState, path: &Path, ctx: &Context) {
        let index = state.environment_of_file(path);
        if self.running.iter().any(|running| running.index == index) {
            return;
        }
        let ctx = ctx.clone();
        let wake = move || ctx.request_repaint_after(REPAINT);
        let session = TrainConfig::preset("fast").map_err(|error| error.to_string());
        let session = session.and_then(|config| {
            let options = SessionOptions {
                nice: true,
                environment_only: true,
                ..SessionOptions::new(path, config, Budget::Seconds(BUDGET_SECS))
            };
            Session::spawn(options, wake).map_err(|error| error.to_string())
        });
        match session {
            Ok(session) => {
                session.use_threads(state.pace.threads());
                state.environments[index].content = EnvironmentContent::Loading;
                state.lighting.removed.remove(&index);
                state.lighting.imports.push(Import {
                    environment: index,
                    what: "Reading the scan".to_owned(),
                    fraction: 0.0,
                });
                self.running.push(Running {
                    session,
                    index,
                    version: 0,
                    trained_secs: 0.0,
                    lit_secs: f64::NEG_INFINITY,
                    is_over: false,
                    set_down: None,
                });
            }
            Err(reason) => fail(state, index, reason),
        }
    }

    /// Trains on so many threads.
    pub(super) fn use_threads(&self, threads: Threads) {
        let sessions = self.running.iter().map(|running| &running.session);
        sessions.for_each(|session| session.use_threads(threads));
    }

    /// Ends an import; what was learned so far stays.
    pub(super) fn stop(&self, index: usize) {
        let found = self.running.iter().find(|running| running.index == index);
        if let Some(running) = found {
            running.session.send(TrainCommand::Stop);
        }
    }

    /// Takes in what was learned since the last frame; returns what is complete.
    pub(super) fn poll(&mut self, state: &mut AppState) -> Vec<Made> {
        let mut made = Vec::new();
        for running in &mut self.running {
            running.poll(state);
            if running.is_over {
                let index = running.index;
                state
                    .lighting
                    .imports
                    .retain(|import| import.environment != index);
                let entry = &mut state.environments[index];
                if matches!(entry.content, EnvironmentContent::Loading) {
                    // Stopped before anything was learned.
                    entry.content = EnvironmentContent::NotLoaded;
                }
                if let EnvironmentContent::Ready(environment) = &entry.content {
                    let environment = Environment::clone(environment).renamed(&entry.name);
                    made.push(Made {
                        source: entry.path.clone(),
                        environment: Arc::new(environment),
                    });
                }
            }
        }
        self.running.retain(|running| !running.is_over);
        made
    }
}

impl Running {
    fn poll(&mut self, state: &mut AppState) {
        while let Ok(event) = self.session.events().try_recv() {
            tracing::trace!(?event, "import");
            let import = state.lighting.imports.iter_mut();
            let import = import
                .into_iter()
                .find(|import| import.environment == self.index);
            match (event, import) {
                (TrainEvent::Loading { what, fraction }, Some(import)) => {
                    (import.what, import.fraction) = (what, fraction);
                }
                (TrainEvent::Progress(progress), Some(import)) => {
                    "Learning its light".clone_into(&mut import.what);
                    import.fraction = progress.fraction;
                    self.trained_secs = progress.elapsed_secs;
                }
                (TrainEvent::Warning(text), _) => state.messages.say(Level::Warning, text),
                (TrainEvent::Failed(reason), _) => {
                    self.is_over = true;
                    fail(state, self.index, reason);
                }
                (TrainEvent::Finished(_), _) => self.is_over = true,
                _ => {}
            }
        }
        let version = self.session.snapshot_version();
        let now = state.messages.now_secs;
        let interval = MIN_INTERVAL_SECS.max(PATIENCE * self.trained_secs);
        if version != self.version
            && (self.is_over || now - self.lit_secs >= interval)
            && let Some(snapshot) = self.session.snapshot()
        {
            self.version = version;
            if snapshot.step >= FIRST_STEP {
                self.lit_secs = now;
                self.take(state, &snapshot.environment);
            }
        }
    }

    /// The environment as it is now. The first time the object is lit by it; and it is set down in it, anew while its surfaces
    /// take shape, until somebody moves it.
    fn take(&mut self, state: &mut AppState, environment: &Arc<Environment>) {
        let entry = &mut state.environments[self.index];
        let is_first = !matches!(entry.content, EnvironmentContent::Ready(_));
        entry.content = EnvironmentContent::Ready(Arc::clone(environment));
        if is_first && !state.lighting.removed.contains(&self.index) {
            state.look.environment = Some(self.index);
            self.set_down = Some([state.look.transform; 2]);
        }
        let is_chosen = state.look.environment == Some(self.index);
        if let Some([before, placed]) = &mut self.set_down
            && is_chosen
            && state.look.transform == *placed
        {
            state.look.transform = *before;
            set_down_in_the_middle(state);
            *placed = state.look.transform;
        } else {
            self.set_down = None;
        }
    }
}

fn fail(state: &mut AppState, index: usize, reason: String) {
    state.environments[index].content = EnvironmentContent::Failed(reason.clone());
    state.messages.say(Level::Error, reason);
}
