//! The run folder: everything that a training run leaves behind, readable by every other command.
//!
//! `config.toml` decides the result, `checkpoint.safetensors` continues it exactly,
//! `object.safetensors`, `environment.safetensors` and `mesh.glb` show it, `metrics.csv` and
//! `log.jsonl` record how it went. Each file is written whole or not at all, so a full disk or a
//! power cut leaves the previous state.

use std::io::Write as _;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::run_log::{RunLog, Trained};
use crate::data::files::tensor_file::{TensorFile, TensorFileError};
use crate::data::{
    CaptureChoices, DataError, MeshPlacement, read_mesh, write_atomically, write_cameras, write_glb,
};
use crate::geometry::{Camera, Mesh, SurfaceTracer};
use crate::neif::{Environment, NeifError, ObjectModel, Storage, SurfaceField};
use crate::render::Scene;
use crate::train::Snapshot;
use crate::train::config::TrainConfig;
use crate::train::measure::held_out::PoseFit;
use crate::train::photos::photo_exposures::PhotoExposures;
use crate::train::session::plan::Budget;

const CONFIG: &str = "config.toml";
const CHECKPOINT: &str = "checkpoint.safetensors";
const OBJECT: &str = "object.safetensors";
/// The trained environment inside a run folder; usable alone.
pub const ENVIRONMENT: &str = "environment.safetensors";
const MESH: &str = "mesh.glb";
/// The cameras of the training photos, where their poses were refined.
const CAMERAS: &str = "cameras.json";
/// Exposure and white balance of the training photos, where each has its own.
const EXPOSURES: &str = "exposures.json";
const METRICS: &str = "metrics.csv";
const LOG: &str = "log.jsonl";

/// The layout of run folders that this version writes and reads.
pub(in crate::train::session) const FORMAT: u32 = 1;
/// Settings of training that earlier versions of this layout noted and nothing reads any more.
const GONE: [&str; 2] = ["evenness_weight", "evenness_delay"];

/// What is wrong with a run folder.
#[derive(Debug, thiserror::Error)]
pub enum RunFolderError {
    /// The folder holds a run that must not be overwritten.
    #[error("{path}: holds a run already; continue it with --resume or choose another folder", path = .0.display())]
    Occupied(PathBuf),
    /// There is nothing to resume or to show.
    #[error("{path}: not a run folder ({CONFIG} is missing)", path = .0.display())]
    NotARun(PathBuf),
    /// `config.toml` is damaged or of another version.
    #[error("{path}: {what}", path = path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the line and the field.
        what: String,
    },
    /// A tensor file is damaged or cannot be written.
    #[error(transparent)]
    Tensors(#[from] TensorFileError),
    /// A trained field is damaged or cannot be written.
    #[error(transparent)]
    Field(#[from] NeifError),
    /// The mesh or the cameras are damaged, or a file or folder cannot be read or written.
    #[error(transparent)]
    Data(#[from] DataError),
}

impl RunFolderError {
    /// True when the system refused to read or write, e.g. because the disk is full: the run
    /// folder itself is not at fault.
    pub fn is_refused_by_system(&self) -> bool {
        matches!(
            self,
            Self::Tensors(TensorFileError::Io { .. })
                | Self::Field(NeifError::File(TensorFileError::Io { .. }))
                | Self::Data(DataError::Io { .. })
        )
    }
}

/// Where the capture of a run lies. Both ways are kept, so that a run survives being moved
/// together with its capture, and on its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatasetSource {
    /// From the root of the file system.
    pub absolute: PathBuf,
    /// From the run folder, where there is such a way.
    pub relative: Option<PathBuf>,
    /// A mesh that replaced the one beside the capture, from the root of the file system.
    pub mesh: Option<PathBuf>,
    /// How the mesh was placed in the capture.
    #[serde(default)]
    pub mesh_placement: MeshPlacement,
    /// How it was to be read.
    #[serde(default)]
    pub choices: CaptureChoices,
}

/// `config.toml`: everything that decides the result.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// Layout of the folder.
    pub format: u32,
    /// Program and version that wrote it.
    pub program: String,
    /// True when only the environment is trained.
    pub environment_only: bool,
    /// Precision of the grid values in the files for showing; the checkpoint is always exact.
    #[serde(default)]
    pub storage: Storage,
    /// How much training was asked for.
    pub budget: Budget,
    /// The capture.
    pub dataset: DatasetSource,
    /// Settings of the trainer.
    pub train: TrainConfig,
}

impl DatasetSource {
    /// Where the capture at `dataset` and a mesh instead of its own lie, seen from the folder `run`.
    pub(in crate::train::session) fn new(run: &Path, dataset: &Path, mesh: Option<&Path>) -> Self {
        let absolute = absolute(dataset);
        Self {
            relative: relative_path(&self::absolute(run), &absolute),
            absolute,
            mesh: mesh.map(self::absolute),
            mesh_placement: MeshPlacement::default(),
            choices: CaptureChoices::default(),
        }
    }
}

/// What one save puts into the folder.
#[derive(Clone, Debug)]
pub struct RunState<'a> {
    /// Settings.
    pub config: &'a RunConfig,
    /// Everything that training needs to continue.
    pub checkpoint: &'a TensorFile,
    /// Everything that showing needs.
    pub snapshot: &'a Snapshot,
    /// How it went.
    pub log: &'a RunLog,
    /// Whether the mesh changed since it was saved.
    pub has_new_mesh: bool,
    /// The training photos' names and cameras, where their poses are refined.
    pub cameras: Option<Vec<(String, Camera)>>,
}

/// A folder that holds one run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Looks whether a new run may go there; makes nothing.
    ///
    /// # Errors
    /// When it holds a run already.
    pub fn check_free(path: &Path) -> Result<(), RunFolderError> {
        let files = [
            CONFIG,
            CHECKPOINT,
            OBJECT,
            ENVIRONMENT,
            MESH,
            CAMERAS,
            EXPOSURES,
            METRICS,
            LOG,
        ];
        if files.iter().any(|name| path.join(name).exists()) {
            return Err(RunFolderError::Occupied(path.to_owned()));
        }
        Ok(())
    }

    /// Makes the folder for a new run.
    ///
    /// # Errors
    /// When it holds a run already, or the system refuses.
    pub fn create(path: &Path) -> Result<Self, RunFolderError> {
        Self::check_free(path)?;
        std::fs::create_dir_all(path).map_err(|source| DataError::io(path, source))?;
        let path = path.to_owned();
        Ok(Self { path })
    }

    /// Opens the folder of an existing run.
    ///
    /// # Errors
    /// When it holds none.
    pub fn open(path: &Path) -> Result<Self, RunFolderError> {
        let path = path.to_owned();
        if Self::is_run(&path) {
            Ok(Self { path })
        } else {
            Err(RunFolderError::NotARun(path))
        }
    }

    /// True when `path` looks like the folder of a run.
    pub fn is_run(path: &Path) -> bool {
        path.join(CONFIG).is_file()
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its settings.
    ///
    /// # Errors
    /// Naming file and field, when they are damaged or of another version.
    pub fn config(&self) -> Result<RunConfig, RunFolderError> {
        let path = self.file(CONFIG);
        let text = std::fs::read_to_string(&path).map_err(|source| DataError::io(&path, source))?;
        let read = toml::from_str::<RunConfig>(&text);
        let what = match read.or_else(|error| without_gone(&text).unwrap_or(Err(error))) {
            Err(error) => error.to_string(),
            Ok(config) if config.format != FORMAT => {
                format!("format: {} is unknown, expected {FORMAT}", config.format)
            }
            Ok(config) => match config.train.validate() {
                Err(error) => error.to_string(),
                Ok(()) => return Ok(config),
            },
        };
        Err(RunFolderError::Config { path, what })
    }

    /// Where the capture lies now: its absolute place, else its place relative to the run folder.
    pub fn dataset_path(&self, config: &RunConfig) -> PathBuf {
        let DatasetSource {
            absolute, relative, ..
        } = &config.dataset;
        match relative.as_ref().map(|way| self.path.join(way)) {
            Some(relative) if !absolute.exists() && relative.exists() => relative,
            _ => absolute.clone(),
        }
    }

    /// What training needs to continue; `None` when the run ended before its first save.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn checkpoint(&self) -> Result<Option<TensorFile>, RunFolderError> {
        let path = self.file(CHECKPOINT);
        if !path.exists() {
            return Ok(None);
        }
        Ok(Some(TensorFile::read(&path)?))
    }

    /// Steps and seconds of training of the last save, where they can be read.
    pub fn trained(&self) -> Option<Trained> {
        self.log().last_row()
    }

    /// How the run went so far; empty when nothing is there.
    pub fn log(&self) -> RunLog {
        let read = |name| std::fs::read_to_string(self.file(name)).unwrap_or_default();
        RunLog::from_texts(read(METRICS), read(LOG))
    }

    /// The trained scene as it was last saved, with the photos' mean exposure.
    ///
    /// # Errors
    /// When a file is missing or damaged.
    pub fn scene(&self) -> Result<Scene, RunFolderError> {
        Ok(self.snapshot()?.scene())
    }

    /// The trained model as it was last saved; its step is 0, [`Self::trained`] knows it.
    ///
    /// # Errors
    /// When a file is missing or damaged.
    pub fn snapshot(&self) -> Result<Snapshot, RunFolderError> {
        let environment = Arc::new(Environment::load(&self.file(ENVIRONMENT))?);
        let object = if self.file(OBJECT).exists() {
            let mesh = read_mesh(&self.file(MESH))?;
            Some(Arc::new(ObjectModel {
                tracer: Arc::new(SurfaceTracer::new(Arc::new(mesh))),
                material: Arc::new(SurfaceField::load(&self.file(OBJECT))?),
            }))
        } else {
            None
        };
        Ok(Snapshot {
            step: 0,
            object,
            environment,
            exposures: PhotoExposures::read(&self.file(EXPOSURES))?.map(Arc::new),
        })
    }

    /// What is fitted to held-out photos: as was to the training photos.
    pub fn pose_fit(&self) -> PoseFit {
        if self.file(CAMERAS).exists() {
            PoseFit::Corrected
        } else {
            PoseFit::Given
        }
    }

    /// The mesh that the run was trained on; `None` where only the environment was.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn mesh(&self) -> Result<Option<Mesh>, RunFolderError> {
        let mesh = self.has_mesh().then(|| read_mesh(&self.file(MESH)));
        Ok(mesh.transpose()?)
    }

    /// Whether the run has a mesh, sound or damaged.
    pub(in crate::train::session) fn has_mesh(&self) -> bool {
        self.file(MESH).exists()
    }

    /// Saves the settings alone, before the first step.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save_config(&self, config: &RunConfig) -> Result<(), RunFolderError> {
        let text = toml::to_string(config).map_err(|error| RunFolderError::Config {
            path: self.file(CONFIG),
            what: error.to_string(),
        })?;
        self.write_text(CONFIG, &text)
    }

    /// Saves the mesh, of which training changes the normals at most.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save_mesh(&self, mesh: &Mesh) -> Result<(), RunFolderError> {
        Ok(write_glb(&self.file(MESH), mesh)?)
    }

    /// Saves everything that training changes.
    ///
    /// # Errors
    /// When the system refuses; the files that were there before are then still whole.
    pub fn save(&self, state: &RunState<'_>) -> Result<(), RunFolderError> {
        self.save_config(state.config)?;
        let storage = state.config.storage;
        let environment = &state.snapshot.environment;
        environment.save(&self.file(ENVIRONMENT), storage)?;
        if let Some(object) = &state.snapshot.object {
            object.material.save(&self.file(OBJECT), storage)?;
            if state.has_new_mesh {
                self.save_mesh(object.tracer.mesh())?;
            }
        }
        if let Some(exposures) = &state.snapshot.exposures {
            let path = self.file(EXPOSURES);
            let written = exposures.write(&path);
            written.map_err(|source| DataError::io(&path, source))?;
        }
        if let Some(cameras) = &state.cameras {
            write_cameras(&self.file(CAMERAS), cameras)?;
        }
        self.write_text(METRICS, state.log.csv())?;
        self.write_text(LOG, state.log.events())?;
        // Last, so that what is resumed is never newer than what is shown.
        state.checkpoint.write(&self.file(CHECKPOINT))?;
        Ok(())
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    fn write_text(&self, name: &str, text: &str) -> Result<(), RunFolderError> {
        let path = self.file(name);
        let written = write_atomically(&path, |file| file.write_all(text.as_bytes()));
        Ok(written.map_err(|source| DataError::io(&path, source))?)
    }
}

/// The path from the root of the file system, without following links that may move.
pub(in crate::train::session) fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// The settings of an earlier version without what is [`GONE`], or what else is wrong with them; none where nothing is gone.
fn without_gone(text: &str) -> Option<Result<RunConfig, toml::de::Error>> {
    let mut settings: toml::Table = toml::from_str(text).ok()?;
    let train = settings.get_mut("train")?.as_table_mut()?;
    let n = train.len();
    train.retain(|name, _| !GONE.contains(&name));
    (train.len() < n).then(|| settings.try_into())
}

/// The way from folder `from` to `to`, both absolute; none between different drives.
fn relative_path(from: &Path, to: &Path) -> Option<PathBuf> {
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return None;
    }
    let up = from[shared..].iter().map(|_| Component::ParentDir);
    Some(up.chain(to[shared..].iter().copied()).collect())
}

#[cfg(test)]
mod tests;
