//! What a session is asked to do, what it shares with its owner, and why it may end early.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::latest::Latest;
use super::plan::Budget;
use super::saved::run_folder::{DatasetSource, FORMAT, RunConfig, RunFolder, RunFolderError};
use crate::data::{CaptureChoices, DataError, Dataset, MeshPlacement};
use crate::geometry::Camera;
use crate::neif::Storage;
use crate::scans::Scan;
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::masks::{FoundObject, Selection};
use crate::train::shape::stage_one::GrowthPicture;
use crate::train::{Snapshot, TrainError};

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
    /// Train the environment only.
    pub environment_only: bool,
    /// The object to look for in a capture that has neither masks nor a mesh; its environment alone is trained otherwise.
    pub object: Option<WantedObject>,
    /// Precision of the grid values in the saved files.
    pub storage: Storage,
    /// When the budget began to count.
    pub started: Instant,
    /// Make pictures of the object's surface while stage one shapes it ([`super::handle::Session::growth`]).
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
            object: None,
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

    /// Where the capture is a scan, leaves out what only photos have: an object, exposures of their own, inexact poses.
    pub(super) fn fit_to_scan(&mut self) {
        if Scan::is_scan(&self.dataset) {
            self.environment_only = true;
            self.config.photo_exposures = PhotoFit::Off;
            self.config.refine_poses = PhotoFit::Off;
        }
    }

    /// The settings as `config.toml` keeps them.
    pub(in crate::train) fn describe(&self, folder: Option<&RunFolder>) -> RunConfig {
        let run = folder.map_or(Path::new("."), RunFolder::path);
        RunConfig {
            format: FORMAT,
            program: concat!("neif ", env!("CARGO_PKG_VERSION")).to_owned(),
            environment_only: self.environment_only,
            storage: self.storage,
            budget: self.budget,
            dataset: DatasetSource {
                mesh_placement: self.mesh_placement,
                choices: self.choices.clone(),
                ..DatasetSource::new(run, &self.dataset, self.mesh.as_deref())
            },
            train: self.config.clone(),
        }
    }
}

/// The object of a capture whose photos have no masks.
#[derive(Clone, Debug)]
pub enum WantedObject {
    /// Is to be found in an environment that is learned from the photos before.
    Find(Selection),
    /// Was found: masks of the first views in the order of [`crate::data::Dataset::views`].
    Found(Arc<FoundObject>),
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
    /// The cameras of the training photos, where they are corrected.
    pub(in crate::train) cameras: Latest<Vec<Camera>>,
    /// The object's surface as it grew last.
    pub(in crate::train) growth: Latest<GrowthPicture>,
    /// The capture, once it is loaded.
    pub(in crate::train) dataset: Latest<Dataset>,
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
    /// The masks of the object that was found cannot be kept.
    #[error(transparent)]
    Masks(DataError),
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
            Self::Masks(_) | Self::NotFinite(_) | Self::Threads(_) | Self::Panicked => false,
        }
    }
}
