//! What a run does beside stepping: begins, publishes, reports, validates, saves.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::events::TrainEvent;
use super::meter::Clock;
use super::options::{SessionError, Start};
use super::plan::{Budget, Plan};
use super::run::Run;
use super::saved::run_folder::{RunFolder, RunFolderError, RunState};
use super::saved::snapshot::Snapshot;
use crate::neif::Environment;
use crate::render::estimated_lamps;
use crate::train::TrainError;
use crate::train::shape::retracing::{Retracings, are_all_shown};

/// Seconds between two saves of the run folder.
const AUTOSAVE_SECS: f64 = 60.0;
/// Seconds between two reports and snapshots, once the first impression is made.
const REPORT_SECS: f64 = 1.0;
/// The same during the first [`EARLY_SECS`], when much changes.
const EARLY_REPORT_SECS: f64 = 0.25;
/// Length of the beginning, in seconds of training.
const EARLY_SECS: f64 = 10.0;
/// Shortest time between two validations, in seconds.
const VALIDATE_SECS: f64 = 10.0;
/// Validation takes at most one part in this many of the time.
const VALIDATE_SHARE: f64 = 50.0;
/// The last save may take this much longer than the first, which was measured.
const RESERVE_FACTOR: f64 = 1.3;
/// How many times as long as finding no lamps, as in the beginning, estimating how bright they are takes in the end.
const LAMPS_FACTOR: f64 = 9.0;
/// Seconds kept for the end of the process.
const RESERVE_SECS: f64 = 0.15;
/// Share of a time budget under which the person is informed how little is left for training.
const SMALL_SHARE: f64 = 0.2;
/// The quick end of a settled run, as a share of the time it took to settle.
const COOL_DOWN_SHARE: f64 = 0.15;

/// What becomes of a mesh made of outlines before paths are traced anew.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Surface {
    Stays,
    Moves,
}

/// Keys of the session's own entries in the checkpoint.
const PLAN_KEY: &str = "session.plan";
const TRAINED_SECS_KEY: &str = "session.trained_secs";

impl Run<'_> {
    /// Puts the trainer and the plan where the saved run ended.
    pub(in crate::train) fn restore(&mut self) -> Result<(), SessionError> {
        let Some(folder) = &self.folder else {
            return Ok(());
        };
        let Some(checkpoint) = folder.checkpoint()? else {
            self.warn("the run was never saved: it begins anew".to_owned());
            return Ok(());
        };
        self.trainer.restore(&checkpoint)?;
        self.log = folder.log();
        let damaged = |key: &str| RunFolderError::Config {
            path: checkpoint.origin().to_owned(),
            what: format!("metadata entry `{key}` is damaged"),
        };
        let entry = |key| checkpoint.text(key).map_err(RunFolderError::from);
        let secs: f64 = entry(TRAINED_SECS_KEY)?
            .parse()
            .map_err(|_not_a_number| damaged(TRAINED_SECS_KEY))?;
        let plan = serde_json::from_str(entry(PLAN_KEY)?).map_err(|_json| damaged(PLAN_KEY))?;
        self.clock = Clock::starting_at(secs);
        if self.worker.options.start == Start::Continue {
            self.plan = plan;
        }
        if self.trainer.model().poses().is_some() {
            // The light paths were traced from the cameras as given.
            self.retrace(Surface::Stays)?;
        }
        Ok(())
    }

    /// Announces the run, saves it a first time and measures what the end will cost.
    pub(in crate::train) fn begin(&mut self) -> Result<(), SessionError> {
        let first = self.dataset.train.first();
        let (width, height) = first.map_or((0, 0), |view| (view.camera.width, view.camera.height));
        let problems = self.dataset.problems.iter().map(ToString::to_string);
        self.emit(TrainEvent::Loaded {
            n_train: self.dataset.train.len(),
            n_val: self.dataset.val.len(),
            width,
            height,
            has_object: self.trainer.snapshot().object.is_some(),
            problems: problems.collect(),
            found: self.trainer.model().findings(),
        });
        let begun = Instant::now();
        self.publish();
        // A disk that is full or read-only shows now, not after the training.
        // A run that goes on keeps its mesh to the bit.
        if let (Some(folder), Some(mesh)) = (&self.folder, &self.dataset.mesh)
            && (self.worker.options.start == Start::Fresh || !folder.has_mesh())
        {
            folder.save_mesh(mesh)?;
        }
        if let Some(folder) = self.folder.clone() {
            self.keep_masks(&folder)?;
        }
        let looked = Instant::now();
        let result = self.result();
        let lamps_secs = match result.environment.estimated_lamps() {
            Some(_) => 0.0,
            None => LAMPS_FACTOR * looked.elapsed().as_secs_f64(),
        };
        if let Some(folder) = self.folder.clone() {
            self.save_into(&folder, &result)?;
        }
        self.validate();
        self.plan_time(begun.elapsed().as_secs_f64() + lamps_secs);
        self.clock.resume();
        let fraction = self.plan.fraction(self.position());
        self.due.retracings = Retracings::starting_at(fraction);
        self.due.report = self.clock.secs() + EARLY_REPORT_SECS;
        self.due.save = self.clock.secs() + AUTOSAVE_SECS;
        Ok(())
    }

    /// Takes what is spent already, and what the end will take, from a budget in seconds.
    fn plan_time(&mut self, end_secs: f64) {
        let options = &self.worker.options;
        let budget = match (options.start, options.budget) {
            (Start::Continue, _) | (_, Budget::Steps(_)) => return,
            (_, Budget::Seconds(budget)) => budget,
        };
        let spent = options.started.elapsed().as_secs_f64();
        let available = (budget - spent - end_secs * RESERVE_FACTOR - RESERVE_SECS).max(0.0);
        if available < SMALL_SHARE * budget {
            self.warn(format!(
                "loading and saving leave {available:.1} s of the budget of {budget:.0} s"
            ));
        }
        self.plan = Plan::new(Budget::Seconds(self.clock.secs() + available));
    }

    /// Does what is due by the clock or the plan.
    pub(super) fn attend(&mut self) {
        self.retrace_when_due();
        let now = self.clock.secs();
        if now >= self.due.report {
            self.publish();
            self.report();
            let interval = if now < EARLY_SECS {
                EARLY_REPORT_SECS
            } else {
                REPORT_SECS
            };
            self.due.report = now + interval;
        }
        if now >= self.due.validation {
            self.validate();
            self.cool_down_when_settled();
        }
        if now >= self.due.save {
            if let Err(error) = self.save() {
                self.warn(format!("cannot save: {error}"));
            }
            self.due.save = self.clock.secs() + AUTOSAVE_SECS;
        }
    }

    fn retrace_when_due(&mut self) {
        let fraction = self.plan.fraction(self.position());
        let begun = self.clock.secs();
        let timed_secs = self.plan.is_timed().then_some(begun);
        if self.trainer.model().needs_retracing() && self.due.retracings.take(fraction, timed_secs)
        {
            // It fails only when it is asked to stop, and the run with it.
            let _stopped = self.retrace(Surface::Moves);
            self.due.retracings.rest(begun, self.clock.secs());
        }
    }

    /// Traces training pixels anew, on the run's own threads.
    fn retrace(&mut self, surface: Surface) -> Result<(), TrainError> {
        let begun = self.clock.secs();
        let (trainer, worker) = (&mut self.trainer, self.worker);
        let on_progress = |fraction| worker.events.send(TrainEvent::Retracing { fraction });
        let (dataset, stop) = (&self.dataset, &worker.shared.stop);
        let retrace = || {
            if surface == Surface::Moves {
                trainer.move_surface(dataset, stop)?;
            }
            trainer.retrace(dataset, stop, &on_progress)
        };
        let retraced = self.worker.pool.install(retrace);
        self.meter.leave_out(self.clock.secs() - begun);
        retraced
    }

    /// Puts the newest state of the fields where everybody can take it.
    pub(in crate::train) fn publish(&self) {
        self.publish_snapshot(self.trainer.snapshot());
    }

    fn publish_snapshot(&self, snapshot: Snapshot) {
        if let Some(poses) = self.trainer.model().poses() {
            let cameras = Arc::new(poses.cameras());
            self.worker.shared.cameras.publish(cameras);
        }
        self.worker.shared.snapshot.publish(Arc::new(snapshot));
        self.worker.events.wake();
    }

    /// Reports how training goes.
    pub(in crate::train) fn report(&mut self) {
        let progress = self.meter.report(&self.plan, &self.clock, &self.trainer);
        self.emit(TrainEvent::Progress(progress));
    }

    /// Measures the fields on held-out pixels.
    pub(in crate::train) fn validate(&mut self) {
        let begun = Instant::now();
        let snapshot = self.trainer.snapshot();
        if !self.validator.is_of(snapshot.object.as_deref()) {
            self.validator = self
                .worker
                .make_validator(&self.dataset, snapshot.object.as_deref());
        }
        let measure = || self.validator.measure(&snapshot, &self.dataset);
        let measured = self.worker.pool.install(measure);
        let (step, now) = (self.trainer.steps(), self.clock.secs());
        if let Some(measured) = measured
            && let Some(validation) = measured.total.at(step, now)
        {
            self.settling.add(validation);
            self.emit(TrainEvent::Validated(validation));
            self.emit(measured.of_views());
        }
        if let Some(poses) = self.poses_found() {
            // The log has those of the end.
            self.worker.events.send(poses);
        }
        let cost = begun.elapsed().as_secs_f64();
        self.due.validation = now + VALIDATE_SECS.max(cost * VALIDATE_SHARE);
    }

    fn cool_down_when_settled(&mut self) {
        let (now, position) = (self.clock.secs(), self.position());
        let changes_paths =
            self.trainer.model().needs_retracing() && !are_all_shown(self.plan.fraction(position));
        let may = self.worker.options.config.early_stop && !self.plan.is_cooling_down();
        if may && !changes_paths && self.settling.is_settled(&self.plan, now) {
            self.plan.cool_down(position, now * COOL_DOWN_SHARE);
        }
    }

    /// Saves into the run's own folder, if it has one.
    pub(in crate::train) fn save(&mut self) -> Result<(), SessionError> {
        let folder = self.folder.clone();
        self.trainer.settle_normals();
        let snapshot = self.trainer.snapshot();
        folder.map_or(Ok(()), |folder| self.save_into(&folder, &snapshot))
    }

    /// Saves what others take for finished, and publishes that.
    pub(super) fn save_result(&mut self) -> Result<(), SessionError> {
        let result = self.result();
        if let Some(folder) = self.folder.clone() {
            self.save_into(&folder, &result)?;
        }
        self.publish_snapshot(result);
        Ok(())
    }

    /// The fields as they are now, the environment with its lamps as bright as the object's shading and reflections say: they
    /// light other objects too.
    fn result(&mut self) -> Snapshot {
        self.trainer.settle_normals();
        let snapshot = self.trainer.snapshot();
        let estimate = || estimated_lamps(&snapshot.scene(), &AtomicBool::new(false));
        let lamps = self.worker.pool.install(estimate);
        let environment = Environment::clone(&snapshot.environment).with_lamps(lamps);
        Snapshot {
            environment: Arc::new(environment),
            ..snapshot
        }
    }

    /// Saves where the person wants it, unless another run lies there.
    pub(in crate::train) fn save_to(&mut self, path: &Path) {
        let is_own = self.own_folders.iter().any(|folder| folder == path);
        let folder = if is_own && RunFolder::is_run(path) {
            RunFolder::open(path)
        } else {
            RunFolder::create(path)
        };
        let result = folder.map_err(SessionError::from).and_then(|folder| {
            if let Some(mesh) = &self.dataset.mesh {
                folder.save_mesh(mesh)?;
            }
            self.keep_masks(&folder)?;
            let result = self.result();
            self.save_into(&folder, &result)
        });
        match result {
            Ok(()) if is_own => {}
            Ok(()) => self.own_folders.push(path.to_owned()),
            Err(error) => self.warn(format!("cannot save: {error}")),
        }
    }

    fn save_into(&mut self, folder: &RunFolder, snapshot: &Snapshot) -> Result<(), SessionError> {
        let mut checkpoint = self.trainer.checkpoint();
        let plan = serde_json::to_string(&self.plan).unwrap_or_default();
        let secs = self.clock.secs().to_string();
        for (key, value) in [(PLAN_KEY, plan), (TRAINED_SECS_KEY, secs)] {
            checkpoint.metadata.insert(key.to_owned(), value);
        }
        let poses = self.trainer.model().poses();
        folder.save(&RunState {
            config: &self.config,
            checkpoint: &checkpoint,
            snapshot,
            log: &self.log,
            has_new_mesh: self.trainer.model().refines_normals(),
            cameras: poses.map(|poses| self.named(poses.cameras())),
        })?;
        self.emit(TrainEvent::Saved(folder.path().to_owned()));
        Ok(())
    }

    /// The poses as they are corrected by now.
    pub(super) fn poses_found(&self) -> Option<TrainEvent> {
        let poses = self.trainer.model().poses()?;
        Some(TrainEvent::Poses(self.named(poses.moved_px())))
    }

    /// Something of each training photo, with its name.
    pub(in crate::train) fn named<T>(&self, of_photos: Vec<T>) -> Vec<(String, T)> {
        let names = self.dataset.train.iter().map(|view| view.name.clone());
        names.zip(of_photos).collect()
    }

    /// Says what should be known but does not end the run.
    fn warn(&mut self, message: String) {
        self.emit(TrainEvent::Warning(message));
    }

    /// Notes an event in the run's log and sends it out.
    pub(in crate::train) fn emit(&mut self, event: TrainEvent) {
        self.log.note(&event);
        self.worker.events.send(event);
    }
}
