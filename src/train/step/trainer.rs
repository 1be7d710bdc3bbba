//! The trainer: the one optimisation loop, of whichever model.

use super::model::{Model, Stage, StepStats};
use super::now::Now;
use super::tasks::{TaskClock, Tasks};
use crate::data::files::tensor_file::TensorFile;
use crate::train::TrainError;
use crate::train::config::TrainConfig;

/// Name of the counters in a checkpoint.
const COUNTERS: &str = "counters";

/// A model with its settings: a plain value that takes one optimisation step at a time.
#[derive(Debug)]
pub struct Trainer<M: ?Sized> {
    pub(in crate::train) config: TrainConfig,
    pub(in crate::train) counts: Counts,
    pub(in crate::train) model: M,
}

/// How far training has come.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::train) struct Counts {
    pub(in crate::train) step: u64,
    /// Optimiser updates done: steps less the skipped ones.
    pub(in crate::train) updates: u64,
    pub(in crate::train) skipped: u64,
}

impl<M> Trainer<M> {
    /// Before the first step.
    pub(in crate::train) fn of(config: TrainConfig, model: M) -> Self {
        Self {
            config,
            counts: Counts::default(),
            model,
        }
    }
}

impl<M: Model + ?Sized> Trainer<M> {
    /// The model, to be asked or changed at this point of its run.
    pub(in crate::train) fn now(&mut self, progress: f32) -> (Now<'_>, &mut M) {
        self.now_with(progress, Tasks::default())
    }

    fn now_with<'a>(&'a mut self, progress: f32, tasks: Tasks<'a>) -> (Now<'a>, &'a mut M) {
        let now = Now {
            config: &self.config,
            step: self.counts.step,
            updates: self.counts.updates,
            progress,
            tasks,
        };
        (now, &mut self.model)
    }

    /// Takes one step on the current thread pool; `progress` in 0..1 drives the learning rates' decay.
    pub fn step(&mut self, progress: f32) -> StepStats {
        self.step_by_stage(progress, &mut |_| ())
    }

    /// [`Self::step`], reporting after each stage that it is done: for benchmarks, since the trainer has no clock.
    pub fn step_by_stage(&mut self, progress: f32, on_done: &mut dyn FnMut(Stage)) -> StepStats {
        self.step_with(progress, Tasks::default(), on_done)
    }

    /// [`Self::step`] with a clock for each of its tasks.
    pub fn step_by_task(&mut self, progress: f32, clock: &dyn TaskClock) -> StepStats {
        let tasks = Tasks { clock: Some(clock) };
        self.step_with(progress, tasks, &mut |_| ())
    }

    fn step_with(
        &mut self,
        progress: f32,
        tasks: Tasks<'_>,
        on_done: &mut dyn FnMut(Stage),
    ) -> StepStats {
        let (now, model) = self.now_with(progress, tasks);
        let stats = model.run(&now, on_done);
        self.counts.step += 1;
        if stats.skipped {
            self.counts.skipped += 1;
            return stats;
        }
        self.counts.updates += 1;
        let (now, model) = self.now_with(progress, tasks);
        model.gather(&now);
        on_done(Stage::Gather);
        let mut parts = model.parts();
        let mut jobs = Vec::new();
        for part in &mut parts {
            part.update(&now, &mut jobs);
        }
        now.tasks.all("update", jobs);
        for part in &mut parts {
            part.follow();
        }
        model.follow();
        on_done(Stage::Update);
        if model.probe(&now) {
            on_done(Stage::Probe);
        }
        stats
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.counts.step
    }

    /// Steps that learned nothing because a value was not finite.
    pub fn skipped_steps(&self) -> u64 {
        self.counts.skipped
    }

    /// All that the run needs to go on exactly where it stopped: every part's arrays and the counters. The random numbers have
    /// no state beside seed and step. Where normals or poses are refined, its pixels are traced anew with all that was
    /// learned of them: then it goes on there, but not to the bit.
    pub fn checkpoint(&mut self) -> TensorFile {
        let mut file = TensorFile::default();
        let format = self.model.format().to_owned();
        file.metadata.insert("format".to_owned(), format);
        for part in self.model.parts() {
            part.store(&mut file);
        }
        let Counts {
            step,
            updates,
            skipped,
        } = self.counts;
        file.insert_u64(COUNTERS, &[3], vec![step, updates, skipped]);
        file
    }

    /// Goes on from a checkpoint of a run with the same configuration and capture.
    ///
    /// # Errors
    /// When the file is no checkpoint of this model or of another shape; the trainer is then unchanged.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        if file.text("format")? != self.model.format() {
            return Err(TrainError::Checkpoint {
                file: file.origin().to_owned(),
                what: "is no checkpoint of this model",
            });
        }
        let counters = file.u64(COUNTERS, &[3])?;
        let before = self.checkpoint();
        if let Err(error) = self.restore_parts(file) {
            self.restore_parts(&before)
                .expect("a trainer fits its own checkpoint");
            return Err(error);
        }
        self.counts = Counts {
            step: counters[0],
            updates: counters[1],
            skipped: counters[2],
        };
        Ok(())
    }

    fn restore_parts(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        for part in self.model.parts() {
            part.restore(file)?;
        }
        self.model.follow();
        Ok(())
    }
}
