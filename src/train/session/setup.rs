//! Before the first step: reads the capture, completes its mesh, makes the trainer and the run folder.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use super::events::TrainEvent;
use super::object::Search;
use super::options::{SessionError, Start};
use super::run::{Run, Worker};
use super::saved::run_folder::RunFolder;
use crate::data::{Dataset, LoadOptions, Problem, Severity, Splits, background_stands_still};
use crate::geometry::ScalarGrid;
use crate::scans::load_capture;
use crate::train::TrainError;
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::new_trainer;
use crate::train::shape::refinement;
use crate::train::shape::stage_one::{self, GrowthPicture, Making, StageOneError, StageOneOptions};

/// What the person reads while photos are decoded.
const READING: &str = "Reading the capture";
/// What the person reads while a mesh is made of depth maps or masks.
const MAKING_MESH: &str = "Making the object's mesh";
/// Between two pictures of the growing surface.
const GROWTH_PAUSE: Duration = Duration::from_millis(500);
/// What the person reads while pixels are traced.
const PREPARING: &str = "Preparing the training pixels";

impl Worker {
    /// Loads everything; `None` when it was asked to stop meanwhile.
    pub(super) fn prepare(&self) -> Result<Option<Run<'_>>, SessionError> {
        let options = &self.options;
        // A run that must not be overwritten shows before the loading; the folder is made after
        // it, so that unusable input leaves nothing behind.
        if let (Some(path), Start::Fresh) = (&options.run, options.start) {
            RunFolder::check_free(path)?;
        }
        let Some(mut dataset) = self.load()? else {
            return Ok(None);
        };
        let found = match self.find_object(&mut dataset) {
            Search::Stopped => return Ok(None),
            Search::Found(found) => Some(found),
            Search::None => None,
        };
        dataset.test.clear();
        if !self.complete_mesh(&mut dataset)? {
            return Ok(None);
        }
        let config = self.settle_background(&mut dataset);
        let dataset = Arc::new(dataset);
        let folder = match (&options.run, options.start) {
            (None, _) => None,
            (Some(path), Start::Fresh) => Some(RunFolder::create(path)?),
            (Some(path), _) => Some(RunFolder::open(path)?),
        };
        self.shared.dataset.publish(Arc::clone(&dataset));
        let report = |fraction| self.loading(PREPARING, fraction);
        let trainer = self
            .pool
            .install(|| new_trainer(&config, &dataset, &self.shared.stop, &report));
        let trainer = match trainer {
            Err(TrainError::Cancelled) => return Ok(None),
            other => other?,
        };
        let mut run = Run::new(self, trainer, dataset, folder);
        run.found = found;
        if options.start != Start::Fresh {
            run.restore()?;
        }
        run.begin()?;
        Ok(Some(run))
    }

    /// Reads the capture; `None` when it was asked to stop meanwhile.
    fn load(&self) -> Result<Option<Dataset>, SessionError> {
        self.loading(READING, 0.0);
        let report = |done, all| self.loading(READING, done as f32 / all as f32);
        // An environment has no test of its own: every photo that does not validate teaches.
        let environment_only = self.options.environment_only;
        let options = LoadOptions {
            splits: if environment_only || self.wants_object().is_some() {
                Splits::ALL
            } else {
                Splits::TRAIN_VAL
            },
            mesh: self.options.mesh.clone(),
            mesh_placement: self.options.mesh_placement,
            choices: self.options.choices.clone(),
            on_progress: &report,
        };
        let load = || load_capture(&self.options.dataset, &options, &self.shared.stop);
        let Some(mut dataset) = self.pool.install(load)? else {
            return Ok(None);
        };
        if environment_only {
            dataset.mesh = None;
            dataset.train.append(&mut dataset.test);
        }
        Ok(Some(dataset))
    }

    /// Gives the capture a mesh where it has none and what one can be made from, or one with better normals: a run that
    /// goes on keeps its own, a new one makes it. False when it was asked to stop meanwhile.
    fn complete_mesh(&self, dataset: &mut Dataset) -> Result<bool, SessionError> {
        let options = &self.options;
        let is_needed = stage_one::is_needed(dataset);
        if options.environment_only
            || !(is_needed || refinement::is_wanted(&options.config, dataset))
        {
            return Ok(true);
        }
        if let (Some(path), Start::Continue | Start::Replan) = (&options.run, options.start) {
            let folder = RunFolder::open(path)?;
            dataset.mesh = folder.mesh()?.map(Arc::new);
            let checkpoint = folder.checkpoint()?;
            dataset.first_box = checkpoint.as_ref().and_then(refinement::stored_box);
            return Ok(true);
        }
        if !is_needed {
            return Ok(true);
        }
        let next_picture = Mutex::new(Instant::now());
        let pattern = OnceLock::new();
        let report = |making: Making<'_>| match making {
            Making::Progress(fraction) => self.loading(MAKING_MESH, fraction),
            Making::Pattern(share) => drop(pattern.set(share)),
            Making::Surface(distances) => self.show_growth(dataset, distances, &next_picture),
        };
        let settings = StageOneOptions::within(options.started, options.budget);
        let make = || stage_one::make_mesh(dataset, &settings, &self.shared.stop, &report);
        let made = self.pool.install(make);
        if let Some(share) = pattern.get() {
            let what = format!(
                "photos agree on how deep the object's pattern lies, in {:.0} % of its pixels: hollows that no outline shows \
                 are open there",
                100.0 * share
            );
            dataset
                .problems
                .push(Problem::new(Severity::Note, what, ""));
        }
        match made {
            Ok(mesh) => dataset.mesh = Some(Arc::new(mesh)),
            Err(StageOneError::Cancelled) => return Ok(false),
            Err(error) => {
                let message = format!("only the environment is trained: {error}");
                self.events.send(TrainEvent::Warning(message));
            }
        }
        Ok(true)
    }

    /// The settings with which to train: without the background where it is cut away or stands still in the picture, and
    /// nobody wants it all the same, which is reported with the capture's problems.
    fn settle_background(&self, dataset: &mut Dataset) -> TrainConfig {
        let mut config = self.options.config.clone();
        let decides = config.background == PhotoFit::Auto && dataset.mesh.is_some();
        let stands_still = decides
            && dataset.environment_visible
            && self.pool.install(|| background_stands_still(dataset));
        if stands_still {
            let what = "the background stands still in the picture, as on a turntable: it is left out, and light is \
                        learned from reflections alone";
            let advice = "--background=on trains on it all the same";
            dataset
                .problems
                .push(Problem::new(Severity::Warning, what, advice));
        }
        if stands_still || (decides && !dataset.environment_visible) {
            config.background = PhotoFit::Off;
        }
        if config.background == PhotoFit::Off && config.refine_poses == PhotoFit::Auto {
            // Outlines determine the initial poses, but only the background would hold them there.
            config.refine_poses = PhotoFit::Off;
        }
        config
    }

    /// Makes a picture of the surface where somebody looks and the last one is a while ago.
    fn show_growth(&self, dataset: &Dataset, distances: &ScalarGrid, next: &Mutex<Instant>) {
        let (true, Some(view)) = (self.options.shows_growth, dataset.train.first()) else {
            return;
        };
        let mut next = next.lock().unwrap_or_else(PoisonError::into_inner);
        if Instant::now() >= *next {
            let picture = GrowthPicture::new(distances, view);
            self.shared.growth.publish(Arc::new(picture));
            *next = Instant::now() + GROWTH_PAUSE;
        }
    }

    pub(super) fn loading(&self, what: &str, fraction: f32) {
        let what = what.to_owned();
        self.events.send(TrainEvent::Loading { what, fraction });
    }
}
