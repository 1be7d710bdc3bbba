//! A training run on a thread of its own: commands in, events and snapshots out.
//!
//! The trainer itself is a plain value; this adds the thread, the clock, the run folder and the
//! validation. Window, command line and tests all drive training through a [`Session`].

use std::{
    io,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Instant,
};

use crossbeam::channel::{Receiver, Sender, bounded};

use super::event_queue::EventQueue;
use super::events::{TrainCommand, TrainEvent};
use super::latest::Latest;
use super::plan::Budget;
use super::run_folder::{RunConfig, RunFolder, RunFolderError};
use super::thread::Worker;
use crate::data::{CaptureChoices, MeshPlacement};
use crate::data::{DataError, Dataset};
use crate::neif::Storage;
use crate::train::config::TrainConfig;
use crate::train::shape::stage_one::GrowthPicture;
use crate::train::{Snapshot, TrainError};

/// Commands that may wait for the training thread, e.g. while the capture is loaded.
const COMMAND_QUEUE: usize = 64;
/// Events that may wait for their reader.
const EVENT_QUEUE: usize = 1024;

/// Where a session begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// With a new run.
    #[default]
    Fresh,
    /// With the run in the run folder, up to the end of its own plan; the budget is not used.
    Continue,
    /// With the run in the run folder, under a new budget: seconds count for this sitting, steps
    /// are the total.
    Replan,
}

/// What to train, on what, and for how long.
#[derive(Clone, Debug)]
pub struct SessionOptions {
    /// The capture.
    pub dataset: PathBuf,
    /// A mesh instead of the one beside the capture.
    pub mesh: Option<PathBuf>,
    /// How the mesh is placed in the capture.
    pub mesh_placement: MeshPlacement,
    /// What a person says about the capture.
    pub choices: CaptureChoices,
    /// Settings of the trainer.
    pub config: TrainConfig,
    /// How much training; seconds include everything since [`Self::started`] and the last save.
    pub budget: Budget,
    /// The run folder; without one nothing is saved unless asked for.
    pub run: Option<PathBuf>,
    /// New run or an old one.
    pub start: Start,
    /// Train the surroundings only.
    pub environment_only: bool,
    /// Precision of the grid values in the saved files.
    pub storage: Storage,
    /// When the budget began to count.
    pub started: Instant,
    /// Make pictures of the object's surface while stage one shapes it ([`Session::growth`]).
    pub shows_growth: bool,
    /// Give way to other threads of the machine, such as the window's.
    pub nice: bool,
}

impl SessionOptions {
    /// A new run without a run folder, its budget counting from now.
    pub fn new(dataset: &Path, config: TrainConfig, budget: Budget) -> Self {
        Self {
            dataset: dataset.to_owned(),
            mesh: None,
            mesh_placement: MeshPlacement::default(),
            choices: CaptureChoices::default(),
            config,
            budget,
            run: None,
            start: Start::Fresh,
            environment_only: false,
            storage: Storage::default(),
            started: Instant::now(),
            shows_growth: false,
            nice: false,
        }
    }

    /// Continues the run in the folder `run` with its own settings: to the end of its plan, or
    /// under a new budget.
    ///
    /// # Errors
    /// When the folder holds no run or its settings are damaged.
    pub fn resume(run: &Path, budget: Option<Budget>) -> Result<Self, RunFolderError> {
        let folder = RunFolder::open(run)?;
        let stored = folder.config()?;
        Ok(Self {
            dataset: folder.dataset_path(&stored),
            mesh: stored.dataset.mesh.clone(),
            mesh_placement: stored.dataset.mesh_placement,
            choices: stored.dataset.choices.clone(),
            run: Some(run.to_owned()),
            start: match budget {
                Some(_) => Start::Replan,
                None => Start::Continue,
            },
            environment_only: stored.environment_only,
            storage: stored.storage,
            budget: budget.unwrap_or(stored.budget),
            ..Self::new(&stored.dataset.absolute, stored.train, stored.budget)
        })
    }
}

impl SessionOptions {
    /// The settings as `config.toml` keeps them.
    pub(in crate::train) fn describe(&self, folder: Option<&RunFolder>) -> RunConfig {
        let run = folder.map_or(Path::new("."), RunFolder::path);
        let config = self.config.clone();
        let mut described = RunConfig {
            environment_only: self.environment_only,
            storage: self.storage,
            budget: self.budget,
            ..RunConfig::new(run, &self.dataset, self.mesh.as_deref(), config)
        };
        described.dataset.mesh_placement = self.mesh_placement;
        described.dataset.choices = self.choices.clone();
        described
    }
}

/// Why a session ended without finishing its run.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The capture cannot be used.
    #[error(transparent)]
    Dataset(#[from] DataError),
    /// The capture or the settings cannot be trained on, or training broke down.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The run folder cannot be used.
    #[error(transparent)]
    RunFolder(#[from] RunFolderError),
    /// Too many steps in a row gave values that are not finite.
    #[error("{0} steps in a row gave values that are not finite: the run has broken down")]
    NotFinite(u64),
    /// The system gave no thread.
    #[error("cannot start the training threads: {0}")]
    Threads(String),
    /// A bug in training.
    #[error("the training thread broke down (this is a bug)")]
    Panicked,
}

impl SessionError {
    /// True when the data or settings that were given are at fault, not the work on them.
    pub fn is_unusable_input(&self) -> bool {
        match self {
            Self::Dataset(_) | Self::Train(_) => true,
            Self::RunFolder(error) => !error.is_refused_by_system(),
            Self::NotFinite(_) | Self::Threads(_) | Self::Panicked => false,
        }
    }
}

/// How many threads take steps. The result does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// As many as the settings say.
    #[default]
    All,
    /// One fewer, but at least one.
    OneFewer,
}

/// What the two sides share.
#[derive(Debug, Default)]
pub(in crate::train) struct Shared {
    /// Set when the run is to end: loading polls it.
    pub(in crate::train) stop: AtomicBool,
    /// Set when steps are to leave a core to others.
    pub(super) spares_core: AtomicBool,
    /// The newest state of the fields.
    pub(in crate::train) snapshot: Latest<Snapshot>,
    /// The object's surface as it grew last.
    pub(in crate::train) growth: Latest<GrowthPicture>,
    /// The capture, once it is loaded.
    pub(in crate::train) dataset: Latest<Dataset>,
}

/// A running session. Dropping it stops the run, which then saves itself in the background.
#[derive(Debug)]
pub struct Session {
    commands: Sender<TrainCommand>,
    events: Receiver<TrainEvent>,
    shared: Arc<Shared>,
    thread: JoinHandle<Result<(), SessionError>>,
}

impl Session {
    /// Starts the thread. `wake` is called from it after every event and every snapshot; it must
    /// not block.
    ///
    /// # Errors
    /// When the system gives no thread. What is wrong with the data arrives as
    /// [`TrainEvent::Failed`] and from [`Self::join`].
    pub fn spawn(
        options: SessionOptions,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, SessionError> {
        let (commands, command_queue) = bounded(COMMAND_QUEUE);
        let (event_sender, events) = bounded(EVENT_QUEUE);
        let shared = Arc::new(Shared::default());
        let queue = EventQueue::new(event_sender, wake);
        let worker = Worker::new(options, Arc::clone(&shared), command_queue, queue)?;
        let thread = std::thread::Builder::new()
            .name("neif-train".to_owned())
            .spawn(move || worker.run())
            .map_err(|error: io::Error| SessionError::Threads(error.to_string()))?;
        Ok(Self {
            commands,
            events,
            shared,
            thread,
        })
    }

    /// Queues a command; it takes effect between two steps. Never waits.
    pub fn send(&self, command: TrainCommand) {
        if command == TrainCommand::Stop {
            self.shared.stop.store(true, Ordering::Relaxed);
        }
        if self.commands.try_send(command).is_err() {
            tracing::warn!("the training thread takes no more commands");
        }
    }

    /// Takes steps on so many threads from the next on.
    pub fn use_threads(&self, threads: Threads) {
        let spares_core = threads == Threads::OneFewer;
        let shared = &self.shared.spares_core;
        shared.store(spares_core, Ordering::Relaxed);
    }

    /// The events, oldest first. The queue closes when the thread has ended.
    pub fn events(&self) -> &Receiver<TrainEvent> {
        &self.events
    }

    /// The newest state of the fields.
    pub fn snapshot(&self) -> Option<Arc<Snapshot>> {
        self.shared.snapshot.get()
    }

    /// How many snapshots there have been: a change means news.
    pub fn snapshot_version(&self) -> u64 {
        self.shared.snapshot.version()
    }

    /// The object's surface over the first training photo, and how many such pictures there have been; where stage one
    /// makes the mesh from masks and [`SessionOptions::shows_growth`].
    pub fn growth(&self) -> (Option<Arc<GrowthPicture>>, u64) {
        (self.shared.growth.get(), self.shared.growth.version())
    }

    /// The capture, once it is loaded.
    pub fn dataset(&self) -> Option<Arc<Dataset>> {
        self.shared.dataset.get()
    }

    /// True once the thread has ended.
    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Stops the run if it has not finished, lets it save, and waits for the thread to end.
    /// Events that nobody has read are dropped.
    ///
    /// # Errors
    /// What ended the run, if it was an error.
    pub fn join(self) -> Result<(), SessionError> {
        // Closing both queues tells the thread that nobody listens any more.
        drop(self.commands);
        drop(self.events);
        self.thread.join().unwrap_or(Err(SessionError::Panicked))
    }
}
