//! A training run on a thread of its own: commands in, events and snapshots out.
//!
//! The trainer itself is a plain value; this adds the thread, the clock, the run folder and the
//! validation. Window, command line and tests all drive training through a [`Session`].

use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, bounded};

use super::event_queue::EventQueue;
use super::events::{TrainCommand, TrainEvent};
use super::options::{SessionError, SessionOptions, Shared};
use super::run::Worker;
use crate::data::Dataset;
use crate::geometry::Camera;
use crate::train::Snapshot;
use crate::train::shape::stage_one::GrowthPicture;

/// Commands that may wait for the training thread, e.g. while the capture is loaded.
const COMMAND_QUEUE: usize = 64;
/// Events that may wait for their reader.
const EVENT_QUEUE: usize = 1024;

/// How many threads take steps. The result does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// As many as the settings say.
    #[default]
    All,
    /// One fewer, but at least one.
    OneFewer,
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

    /// The cameras of the training photos as they are corrected by now, where they are.
    pub fn cameras(&self) -> Option<Arc<Vec<Camera>>> {
        self.shared.cameras.get()
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
        // Closing both queues signals to the thread that nobody listens any more.
        drop(self.commands);
        drop(self.events);
        self.thread.join().unwrap_or(Err(SessionError::Panicked))
    }
}
