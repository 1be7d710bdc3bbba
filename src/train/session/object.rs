//! The object of a capture without masks: found before training, where that is asked for.

use std::sync::Arc;

use super::events::TrainEvent;
use super::options::{SessionError, WantedObject};
use super::plan::Budget;
use super::run::{Run, Worker};
use super::saved::run_folder::{RunFolder, absolute};
use crate::data::{Dataset, Problem, Severity};
use crate::train::TrainError;
use crate::train::masks::{FoundObject, MaskError, Selection, find_object, learn_environment};

/// What the person reads meanwhile.
const LEARNING: &str = "Learning the place to find the object in it";
const FINDING: &str = "Finding the object";
/// Share of the budget in which the place is learned, and the most seconds or steps.
const SHARE: f64 = 0.2;
const MOST_SECS: f64 = 60.0;
const MOST_STEPS: u64 = 4000;
/// Steps without which nothing is found.
const LEAST_STEPS: u64 = 400;
/// The folder in a run's folder that the masks are kept in.
const FOLDER: &str = "masks";
/// So many doubtful photos are named.
const MOST_NAMED: usize = 5;

/// What came of looking for the object.
pub(super) enum Search {
    /// It was not looked for, or not found: the capture is as it was.
    None,
    /// The capture's views have masks.
    Found(Arc<FoundObject>),
    /// The person asked to stop.
    Stopped,
}

impl Worker {
    /// Whether the object is to be looked for in a capture.
    pub(super) fn wants_object(&self) -> Option<&WantedObject> {
        let wanted = self.options.object.as_ref();
        wanted.filter(|_| !self.options.environment_only)
    }

    /// Gives the views masks where there are none and the object is to be looked for.
    pub(super) fn find_object(&self, dataset: &mut Dataset) -> Search {
        let Some(wanted) = self.wants_object() else {
            return Search::None;
        };
        if dataset.mesh.is_some() || dataset.views().any(|view| view.mask.is_some()) {
            return Search::None;
        }
        let found = match wanted {
            WantedObject::Found(found) => {
                Arc::new(self.pool.install(|| found.of_all_views(dataset)))
            }
            WantedObject::Find(selection) => match self.search(dataset, selection) {
                Ok(found) => Arc::new(found),
                Err(ended) => return ended,
            },
        };
        let doubtful = found.doubtful();
        let advice = match &doubtful[..doubtful.len().min(MOST_NAMED)] {
            [] => String::new(),
            names => format!("; look at those of {}", names.join(", ")),
        };
        let advice = format!("its masks are kept in the folder `{FOLDER}` of the run{advice}");
        let what = "the object was found in the photos, which have no masks";
        dataset
            .problems
            .push(Problem::new(Severity::Note, what, &advice));
        found.assign(dataset);
        Search::Found(found)
    }

    /// Learns the place and finds the object in it; an error is how it ended otherwise.
    fn search(&self, dataset: &Dataset, selection: &Selection) -> Result<FoundObject, Search> {
        let report = |what| move |fraction| self.loading(what, fraction);
        let (config, stop) = (&self.options.config, &self.shared.stop);
        let budget = match self.options.budget {
            Budget::Seconds(seconds) => Budget::Seconds((SHARE * seconds).min(MOST_SECS)),
            Budget::Steps(steps) => {
                Budget::Steps(((SHARE * steps as f64) as u64).clamp(LEAST_STEPS, MOST_STEPS))
            }
        };
        let learn = || learn_environment(dataset, config, budget, stop, &report(LEARNING));
        let place = self.pool.install(learn).map_err(|error| match error {
            TrainError::Cancelled => Search::Stopped,
            error => self.without_object(&error.to_string()),
        })?;
        let find = || find_object(dataset, &place, (selection, &[]), stop, &report(FINDING));
        self.pool.install(find).map_err(|error| match error {
            MaskError::Cancelled => Search::Stopped,
            error => self.without_object(&error.to_string()),
        })
    }

    fn without_object(&self, why: &str) -> Search {
        let message = format!("only the environment is trained: {why}");
        self.events.send(TrainEvent::Warning(message));
        Search::None
    }
}

impl Run<'_> {
    /// Keeps the masks of the object that was found in a run's folder, and has the run read there.
    pub(super) fn keep_masks(&mut self, run: &RunFolder) -> Result<(), SessionError> {
        let Some(found) = &self.found else {
            return Ok(());
        };
        let folder = absolute(run.path()).join(FOLDER);
        found.save(&folder).map_err(SessionError::Masks)?;
        self.config.dataset.choices.masks = Some(folder);
        Ok(())
    }
}
