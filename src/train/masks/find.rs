//! Finds the object in all photos.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::learn::LearnedPlace;
use super::outline::{Photo, nothing};
use super::region::{Region, agreement_of};
use super::seen::{SeenView, look};
use super::selection::Selection;
use crate::data::{DataError, Dataset, Mask, View, write_mask};
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::neif::light::environment::EnvironmentField;
use crate::train::shape::stage_one::looked_at;
use crate::train::shape::support_plane::Plane;

/// Cuts of the photos: the first near the region, the others near the shape on which the photos agree.
const ROUNDS: usize = 2;

/// The object in the photos of a capture.
#[derive(Clone, Debug)]
pub struct FoundObject {
    /// The views' names with those of their splits, in the order of [`Dataset::views`].
    pub names: Vec<String>,
    /// Where each view's mask is kept in a folder of masks.
    pub files: Vec<PathBuf>,
    /// A mask a view.
    pub masks: Vec<Mask>,
    /// Share of each mask's outline shape that it has in common with the shape on which all photos agree, 0..1: the lower, the
    /// likelier it is wrong.
    pub agreement: Vec<f32>,
    /// What it stands on.
    pub support: Option<Plane>,
}

/// Agreement below which a mask is likely wrong.
const DOUBTFUL: f32 = 0.9;

impl FoundObject {
    /// Names of the views whose masks are likely wrong, the most doubtful first.
    pub fn doubtful(&self) -> Vec<&str> {
        let views = self.agreement.iter().zip(&self.names);
        let mut doubtful: Vec<_> = views.filter(|(share, _)| **share < DOUBTFUL).collect();
        doubtful.sort_by(|a, b| a.0.total_cmp(b.0));
        doubtful
            .into_iter()
            .map(|(_, name)| name.as_str())
            .collect()
    }

    /// Writes a mask a photo into a folder, which is made where it is missing.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), DataError> {
        for (mask, file) in self.masks.iter().zip(&self.files) {
            let path = folder.join(file);
            let parent = path.parent().unwrap_or(folder);
            std::fs::create_dir_all(parent).map_err(|e| DataError::io(parent, e))?;
            write_mask(&path, mask)?;
        }
        Ok(())
    }

    /// Gives the views of the capture their masks.
    pub fn assign(&self, dataset: &mut Dataset) {
        let splits = [&mut dataset.train, &mut dataset.val, &mut dataset.test];
        for (view, mask) in splits.into_iter().flatten().zip(&self.masks) {
            view.mask = Some(mask.clone());
        }
    }
}

/// Why no object is found.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// The environment does not know where things are.
    #[error(
        "the object is found in an environment that was trained on the photos; this one is {0}"
    )]
    NoSurfaces(String),
    /// Nobody said where it is.
    #[error("{}: the cameras look at no one place: say where the object is", dataset.display())]
    NoPlace {
        /// The capture.
        dataset: PathBuf,
    },
    /// There is nothing.
    #[error("{}: nothing stands out from its surroundings where the object was looked for", dataset.display())]
    Nothing {
        /// The capture.
        dataset: PathBuf,
    },
    /// The person asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// Finds the selected object in the photos of a capture, on the current thread pool. `place` was learned from them with the
/// object as a part of it. `on_progress` gets 0..1.
///
/// The same input gives the same masks on any number of threads.
///
/// # Errors
/// When the environment is of another kind, when it shows nothing there, and when cancelled.
pub fn find_object(
    dataset: &Dataset,
    place: &LearnedPlace,
    selection: &Selection,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Result<FoundObject, MaskError> {
    let root = || dataset.root.clone();
    let environment = place.environment.as_ref();
    let no_surfaces = || MaskError::NoSurfaces(environment.name().to_owned());
    if !matches!(environment.field(), EnvironmentField::Grid { .. }) {
        return Err(no_surfaces());
    }
    let looked_at = looked_at(dataset).map(|(center, _)| center);
    let center = selection
        .at
        .or(selection.within.map(|within| within.center()));
    let center = center.or(looked_at);
    let center = center.ok_or_else(|| MaskError::NoPlace { dataset: root() })?;
    let views: Vec<&View> = dataset.views().collect();
    let cameras = place.cameras_of(dataset);
    let done = AtomicUsize::new(0);
    let n_jobs = (ROUNDS + 2) * views.len();
    let job = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        on_progress(done as f32 / n_jobs as f32);
    };
    let unless_cancelled = || {
        let is_cancelled = cancel.load(Ordering::Relaxed);
        (!is_cancelled).then_some(()).ok_or(MaskError::Cancelled)
    };

    let see = |camera: &Camera| {
        unless_cancelled()?;
        job();
        Ok(SeenView::new(environment, camera))
    };
    let seen: Vec<SeenView> = cameras.par_iter().map(see).collect::<Result<_, _>>()?;
    let region = Region::find(&seen, center, selection);
    let region = region.ok_or_else(|| MaskError::Nothing { dataset: root() })?;
    let mut priors: Vec<Mask> = seen.par_iter().map(|view| region.shown_in(view)).collect();
    let empty = environment.hollowed(region.cleared(&seen, &priors));
    let empty = empty.ok_or_else(no_surfaces)?;
    let ready = |((view, camera), prior): ((&&View, &Camera), &Mask)| {
        unless_cancelled()?;
        job();
        Ok(Photo::new((view, camera), prior, &empty))
    };
    let photos = views.par_iter().zip(&cameras).zip(&priors).map(ready);
    let photos: Vec<Option<Photo>> = photos.collect::<Result<_, MaskError>>()?;
    let (mut masks, mut small) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let cut = |((view, photo), prior): ((&&View, &Option<Photo>), &Mask)| {
            unless_cancelled()?;
            job();
            let photo = photo.as_ref();
            Ok(photo.map_or_else(|| nothing(view), |photo| photo.cut(view, prior)))
        };
        let photos = views.par_iter().zip(&photos).zip(&priors);
        masks = photos.map(cut).collect::<Result<Vec<Mask>, MaskError>>()?;
        small = masks.iter().zip(&seen).map(|(m, s)| shrunk(m, s)).collect();
        priors = region.agreed(&seen, &small);
    }
    let pairs = small.iter().zip(&priors);
    Ok(FoundObject {
        names: views.iter().map(|view| view.full_name()).collect(),
        files: mask_files(dataset),
        agreement: pairs.map(|(a, b)| agreement_of(a, b)).collect(),
        masks,
        support: region.support(),
    })
}

/// A photo's mask with the pixels of the view as it was seen.
fn shrunk(mask: &Mask, seen: &SeenView) -> Mask {
    let (width, height) = (seen.camera.width, seen.camera.height);
    let pixel = |i: u32| {
        let at = |v: u32, from: u32, to: u32| ((v as f32 + 0.5) * to as f32 / from as f32) as usize;
        let (x, y) = (
            at(i % width, width, mask.width),
            at(i / width, height, mask.height),
        );
        mask.coverage[y * mask.width as usize + x]
    };
    Mask {
        width,
        height,
        coverage: (0..width * height).map(pixel).collect(),
    }
}

/// The surface point of the environment that a camera shows at a place of its picture (pixels), world.
pub fn point_at(environment: &Environment, camera: &Camera, at_px: Vec2) -> Vec3 {
    look(environment, camera, &[at_px])[0].point
}

/// Where the mask of each view is kept in a folder of masks, in the order of [`Dataset::views`]: named as its photo, in a folder
/// named as the photo's where several have the same name.
fn mask_files(dataset: &Dataset) -> Vec<PathBuf> {
    let mut seen = HashSet::new();
    let are_unique = dataset.views().all(|view| seen.insert(&view.name));
    let file = |view: &View| {
        let folder = view.file.parent().and_then(Path::file_name);
        let folder = folder.filter(|_| !are_unique).unwrap_or_default();
        Path::new(folder).join(format!("{}.png", view.name))
    };
    dataset.views().map(file).collect()
}
