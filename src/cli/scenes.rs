//! Opens what the commands work on: runs, environments, captures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use neif::data::{CaptureChoices, Frame, LoadOptions, Split, Splits, View, read_frames};
use neif::geometry::Camera;
use neif::neif::{Environment, EnvironmentTransform, Storage};
use neif::render::Scene;
use neif::scans::load_capture;
use neif::train::photos::photo_exposures::PhotoExposures;
use neif::train::session::saved::run_folder::{ENVIRONMENT, RunFolder};

use super::capture::PhotoArgs;
use super::failure::{Failure, OrUnusable as _};
use super::{interrupt, library};

/// A trained run with where its capture lies.
#[derive(Debug)]
pub(crate) struct OpenRun {
    pub(crate) folder: RunFolder,
    /// The trained scene, unedited.
    pub(crate) scene: Scene,
    /// The capture, as stored or as given instead.
    pub(crate) dataset: PathBuf,
    /// The exposures of its photos, where each has its own.
    pub(crate) exposures: Option<Arc<PhotoExposures>>,
    /// How the run read it.
    pub(crate) choices: CaptureChoices,
}

/// Opens a run folder; `dataset` says where its capture lies now.
pub(crate) fn open_run(path: &Path, dataset: Option<&Path>) -> Result<OpenRun, Failure> {
    let folder = RunFolder::open(path).or_unusable()?;
    let config = folder.config().or_unusable()?;
    let snapshot = folder.snapshot().or_unusable()?;
    let dataset = dataset.map_or_else(|| folder.dataset_path(&config), Path::to_owned);
    Ok(OpenRun {
        folder,
        scene: snapshot.scene(),
        exposures: snapshot.exposures,
        dataset,
        choices: config.dataset.choices,
    })
}

impl OpenRun {
    /// Reads the photos of a split and the folder they lie in.
    pub(crate) fn load_views(
        &self,
        split: Split,
        photos: &PhotoArgs,
    ) -> Result<(Vec<View>, PathBuf), Failure> {
        let options = LoadOptions {
            splits: Splits {
                train: split == Split::Train,
                val: split == Split::Val,
                test: split == Split::Test,
            },
            choices: photos.over(self.choices.clone()),
            ..LoadOptions::default()
        };
        let cancel = interrupt::install()?;
        let dataset = load_capture(&self.dataset, &options, cancel)
            .context("the run's capture cannot be read (--dataset says where it lies now)")
            .or_unusable()?
            .ok_or(Failure::Interrupted)?;
        let views = match split {
            Split::Test => dataset.test,
            Split::Val => dataset.val,
            Split::Train => dataset.train,
        };
        if views.is_empty() {
            let what = format!("no {split} views");
            return Err(Failure::at(&self.dataset, what));
        }
        Ok((views, dataset.root))
    }
}

/// Opens an environment: an environment file, the run folder or other folder that holds one, a panorama (.hdr, .exr), or
/// where nothing is at the path the library's environment of that name.
pub(crate) fn open_environment(path: &Path) -> Result<Arc<Environment>, Failure> {
    let mut file = library::path_or_name(path)?;
    if file.is_dir() {
        file.push(ENVIRONMENT);
    }
    Ok(Arc::new(Environment::open(&file).or_unusable()?))
}

/// Opens an environment as a scene: with the object whose traces are in it, where it is a run's.
pub(crate) fn open_environment_scene(path: &Path) -> Result<Scene, Failure> {
    if path.is_dir()
        && let Ok(scene) = RunFolder::open(path).and_then(|folder| folder.scene())
    {
        return Ok(scene);
    }
    Ok(Scene::new(None, open_environment(path)?))
}

/// The scene's transform with its environment made as bright as `own`; the exposure that it has comes on top.
pub(crate) fn matched(scene: &Scene, own: &Environment) -> Result<EnvironmentTransform, Failure> {
    let matched = scene.matched_to(own).ok_or_else(|| {
        let name = scene.environment.name();
        Failure::unusable(anyhow::anyhow!(
            "--env-match: the environment `{name}` or the object's own is black"
        ))
    })?;
    Ok(EnvironmentTransform {
        exposure_ev: matched.exposure_ev + scene.transform.exposure_ev,
        ..matched
    })
}

/// The cameras of a `transforms.json`, each with its photo's name; the photos need not exist, `w, h` must then be there.
pub(crate) fn read_cameras(json: &Path) -> Result<Vec<(String, Camera)>, Failure> {
    let frames = read_frames(json).or_unusable()?;
    let camera = |frame: &Frame| {
        let missing = || Failure::at(json, "w and h are missing");
        let (width, height) = frame.intrinsics.size.ok_or_else(missing)?;
        let (camera, _) = frame.camera(width, height).or_unusable()?;
        Ok((frame.name.clone(), camera))
    };
    frames.iter().map(camera).collect()
}

/// The precision of stored grid values: of 16 bits where `half` is asked for.
pub(crate) fn storage(half: bool) -> Storage {
    if half { Storage::F16 } else { Storage::F32 }
}

/// Refuses a file whose name does not end in `.glb`.
pub(crate) fn check_is_glb(file: &Path) -> Result<(), Failure> {
    if file.extension().is_none_or(|e| e != "glb") {
        return Err(Failure::at(file, "the name must end in .glb"));
    }
    Ok(())
}

/// Makes the folder that a file goes into.
pub(crate) fn make_folder_of(file: &Path) -> Result<(), Failure> {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => make_folder(folder),
        _ => Ok(()),
    }
}

/// Makes a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path).with_context(|| path.display().to_string())?;
    Ok(())
}
