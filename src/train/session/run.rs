//! A run in progress: steps to the end of its plan and obeys commands between two steps.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use crossbeam::channel::{Receiver, TryRecvError};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::event_queue::EventQueue;
use super::events::{Finish, FinishReason, TrainCommand, TrainEvent};
use super::meter::{Clock, Meter};
use super::options::{SessionError, SessionOptions, Shared};
use super::plan::{Budget, Plan};
use super::saved::run_folder::{RunConfig, RunFolder};
use super::saved::run_log::RunLog;
use crate::data::Dataset;
use crate::neif::ObjectModel;
use crate::render::preview::priority::lower_thread_priority;
use crate::train::AnyTrainer;
use crate::train::masks::FoundObject;
use crate::train::measure::validation::{Settling, Validator};
use crate::train::shape::retracing::Retracings;

/// Training then takes only time that nothing else wants, and the window stays smooth (measured:
/// 25 frames per second instead of 13).
const LOWEST_PRIORITY: i32 = 19;
/// Steps in a row that may be skipped before the run is given up.
const MAX_SKIPS_IN_A_ROW: u64 = 500;

/// What the thread owns before there is a run, and keeps during it.
pub(in crate::train) struct Worker {
    pub(in crate::train) options: SessionOptions,
    pub(in crate::train) shared: Arc<Shared>,
    pub(in crate::train) commands: Receiver<TrainCommand>,
    pub(in crate::train) events: EventQueue,
    pub(in crate::train) pool: ThreadPool,
    /// One thread fewer, for steps that leave a core to others.
    small_pool: ThreadPool,
}

impl Worker {
    /// Makes the thread pool; the rest happens on the thread.
    pub(in crate::train) fn new(
        options: SessionOptions,
        shared: Arc<Shared>,
        commands: Receiver<TrainCommand>,
        events: EventQueue,
    ) -> Result<Self, SessionError> {
        let nice = options.nice;
        let pool = |n_threads| {
            ThreadPoolBuilder::new()
                .num_threads(n_threads)
                .thread_name(|i| format!("neif-train-{i}"))
                .start_handler(move |_| {
                    if nice {
                        lower_thread_priority(LOWEST_PRIORITY);
                    }
                })
                .build()
                .map_err(|error| SessionError::Threads(error.to_string()))
        };
        let all = pool(options.config.threads)?;
        let fewer = all.current_num_threads().saturating_sub(1).max(1);
        Ok(Self {
            small_pool: pool(fewer)?,
            options,
            shared,
            commands,
            events,
            pool: all,
        })
    }

    /// Prepares and trains; reports how it ended.
    pub(in crate::train) fn run(mut self) -> Result<(), SessionError> {
        self.options.fit_to_scan();
        if self.options.nice {
            lower_thread_priority(LOWEST_PRIORITY);
        }
        let result = self.prepare_and_train();
        if let Err(error) = &result {
            self.events.send(TrainEvent::Failed(error.to_string()));
        }
        self.events.close();
        result
    }

    fn prepare_and_train(&self) -> Result<(), SessionError> {
        if let Some(mut run) = self.prepare()? {
            return run.train();
        }
        self.events.send(TrainEvent::Finished(Finish {
            reason: FinishReason::Stopped,
            step: 0,
            train_secs: 0.0,
        }));
        Ok(())
    }

    /// The threads for the next step.
    fn step_pool(&self) -> &ThreadPool {
        if self.shared.spares_core.load(Ordering::Relaxed) {
            &self.small_pool
        } else {
            &self.pool
        }
    }

    /// What measures the capture's validation views, traced on the object's mesh.
    pub(super) fn make_validator(
        &self,
        dataset: &Dataset,
        object: Option<&ObjectModel>,
    ) -> Validator {
        let config = &self.options.config;
        let make = || Validator::new(dataset, object, config.seed, config.validation_pixels());
        self.pool.install(make)
    }
}

/// A run in progress. What it does beside stepping is in `upkeep.rs`.
pub(in crate::train) struct Run<'a> {
    pub(in crate::train) worker: &'a Worker,
    pub(in crate::train) trainer: AnyTrainer,
    pub(in crate::train) dataset: Arc<Dataset>,
    /// Where it is saved by itself.
    pub(in crate::train) folder: Option<RunFolder>,
    /// Folders that belong to this run and so may be written again.
    pub(super) own_folders: Vec<PathBuf>,
    /// The object that was found in photos without masks.
    pub(super) found: Option<Arc<FoundObject>>,
    pub(in crate::train) config: RunConfig,
    pub(in crate::train) plan: Plan,
    pub(super) clock: Clock,
    pub(in crate::train) meter: Meter,
    pub(in crate::train) log: RunLog,
    pub(super) validator: Validator,
    pub(in crate::train) settling: Settling,
    skips_in_a_row: u64,
    pub(in crate::train) due: Due,
}

/// Seconds of training at which something is due.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Due {
    pub(in crate::train) report: f64,
    pub(in crate::train) validation: f64,
    pub(in crate::train) save: f64,
    pub(in crate::train) retracings: Retracings,
}

/// What to do after looking at the commands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Flow {
    Go,
    Stop,
}

impl<'a> Run<'a> {
    /// A run that has not begun.
    pub(in crate::train) fn new(
        worker: &'a Worker,
        trainer: AnyTrainer,
        dataset: Arc<Dataset>,
        folder: Option<RunFolder>,
    ) -> Self {
        let options = &worker.options;
        let validator = worker.make_validator(&dataset, trainer.snapshot().object.as_deref());
        Self {
            config: options.describe(folder.as_ref()),
            found: None,
            own_folders: options.run.iter().cloned().collect(),
            log: RunLog::default(),
            plan: Plan::new(options.budget),
            clock: Clock::default(),
            meter: Meter::default(),
            settling: Settling::default(),
            skips_in_a_row: 0,
            due: Due::default(),
            worker,
            trainer,
            dataset,
            folder,
            validator,
        }
    }

    /// Trains until the end, and further each time more training is asked for.
    pub(in crate::train) fn train(&mut self) -> Result<(), SessionError> {
        loop {
            let reason = self.train_to_the_end()?;
            self.finish(reason)?;
            if reason == FinishReason::Stopped || self.wait_for_more() == Flow::Stop {
                return Ok(());
            }
        }
    }

    fn train_to_the_end(&mut self) -> Result<FinishReason, SessionError> {
        loop {
            if self.obey()? == Flow::Stop {
                return Ok(FinishReason::Stopped);
            }
            if self.plan.is_done(self.position()) {
                return Ok(if self.plan.is_cooling_down() {
                    FinishReason::Settled
                } else {
                    FinishReason::Budget
                });
            }
            self.step()?;
            self.attend();
        }
    }

    /// Where the run is on its plan.
    pub(in crate::train) fn position(&self) -> f64 {
        self.plan.position(self.clock.secs(), self.trainer.steps())
    }

    fn step(&mut self) -> Result<(), SessionError> {
        let fraction = self.plan.fraction(self.position());
        let pool = self.worker.step_pool();
        let stats = pool.install(|| self.trainer.step(fraction));
        self.meter.add(&stats);
        let skips = self.skips_in_a_row + 1;
        self.skips_in_a_row = if stats.skipped { skips } else { 0 };
        if self.skips_in_a_row > MAX_SKIPS_IN_A_ROW {
            return Err(SessionError::NotFinite(self.skips_in_a_row));
        }
        Ok(())
    }

    /// Carries out the commands that have arrived; waits for more while paused.
    fn obey(&mut self) -> Result<Flow, SessionError> {
        let mut paused = false;
        loop {
            if self.worker.shared.stop.load(Ordering::Relaxed) {
                return Ok(Flow::Stop);
            }
            let command = match self.next_command(paused) {
                Ok(command) => command,
                Err(TryRecvError::Empty) => return Ok(Flow::Go),
                // Nobody can send commands any more: nobody wants the run.
                Err(TryRecvError::Disconnected) => return Ok(Flow::Stop),
            };
            match command {
                TrainCommand::Pause if !paused => {
                    paused = true;
                    self.pause();
                }
                TrainCommand::StepOnce => {
                    paused = true;
                    self.step()?;
                    self.pause();
                }
                TrainCommand::Resume if paused => {
                    paused = false;
                    self.go_on();
                }
                TrainCommand::Stop => return Ok(Flow::Stop),
                TrainCommand::Save(path) => self.save_to(&path),
                TrainCommand::Extend(more) => self.extend(more),
                TrainCommand::Pause | TrainCommand::Resume => {}
            }
        }
    }

    fn next_command(&self, wait: bool) -> Result<TrainCommand, TryRecvError> {
        let commands = &self.worker.commands;
        if wait {
            commands.recv().map_err(TryRecvError::from)
        } else {
            commands.try_recv()
        }
    }

    fn pause(&mut self) {
        self.stand();
        self.emit(TrainEvent::Paused);
    }

    /// Stops the clock and shows where the run stands.
    fn stand(&mut self) {
        self.clock.pause();
        self.trainer.settle_normals();
        self.publish();
        self.report();
    }

    fn go_on(&mut self) {
        self.clock.resume();
        self.emit(TrainEvent::Resumed);
    }

    fn extend(&mut self, more: Budget) {
        self.plan
            .extend(self.clock.secs(), self.trainer.steps(), more);
        // What was traced for the rest of the former plan is too little for a much longer one.
        let fraction = self.plan.fraction(self.position());
        self.due.retracings = Retracings::starting_at(fraction);
        self.settling = Settling::default();
    }

    /// Publishes, validates and saves the result.
    fn finish(&mut self, reason: FinishReason) -> Result<(), SessionError> {
        self.stand();
        self.validate();
        if let Some(gains) = self.trainer.model().gains() {
            let gains = gains.iter().map(glam::Vec3::to_array).collect();
            self.emit(TrainEvent::Exposures(self.named(gains)));
        }
        if let Some(poses) = self.poses_found() {
            self.emit(poses);
        }
        let finish = Finish {
            reason,
            step: self.trainer.steps(),
            train_secs: self.clock.secs(),
        };
        // Noted before the save, so that the saved log is complete; sent after it, so that who
        // hears of the end finds the files.
        self.log.note(&TrainEvent::Finished(finish));
        self.save_result()?;
        self.worker.events.send(TrainEvent::Finished(finish));
        Ok(())
    }

    /// Waits after the end of the run until it is extended or nobody is left to extend it.
    fn wait_for_more(&mut self) -> Flow {
        while let Ok(command) = self.worker.commands.recv() {
            match command {
                TrainCommand::Extend(more) => {
                    self.extend(more);
                    self.go_on();
                    return Flow::Go;
                }
                TrainCommand::Save(path) => self.save_to(&path),
                TrainCommand::Stop => return Flow::Stop,
                TrainCommand::Pause | TrainCommand::Resume | TrainCommand::StepOnce => {}
            }
        }
        Flow::Stop
    }
}
