//! The object that was found: a mask a photo, and what is known of them; or why there is none.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::agreed::AgreedShape;
use crate::data::{DataError, Dataset, Mask, View, write_mask};
use crate::train::shape::stage_one::GrowthPicture;
use crate::train::shape::support_plane::Plane;

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
    /// The shape on which the photos agree.
    pub(super) shape: AgreedShape,
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

    /// The shape of which the masks are, as clay over a photo, on the current thread pool.
    pub fn picture(&self, view: &View) -> GrowthPicture {
        self.shape.picture(view)
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

    /// With masks of all views of the capture, of whose first ones these are: the others', which were not looked at, are the
    /// outlines of the shape.
    pub fn of_all_views(&self, dataset: &Dataset) -> Self {
        let mut all = self.clone();
        let others: Vec<&View> = dataset.views().skip(self.masks.len()).collect();
        let outlines = others
            .par_iter()
            .map(|view| self.shape.outline(&view.camera));
        all.masks.extend(outlines.collect::<Vec<Mask>>());
        all.names.extend(others.iter().map(|view| view.full_name()));
        all.agreement.extend(others.iter().map(|_| 1.0));
        all.files = mask_files(dataset);
        all
    }

    /// Gives the views of the capture their masks.
    pub fn assign(&self, dataset: &mut Dataset) {
        let splits = [&mut dataset.train, &mut dataset.val, &mut dataset.test];
        for (view, mask) in splits.into_iter().flatten().zip(&self.masks) {
            view.mask = Some(mask.clone());
        }
    }
}

/// Where the mask of each view is kept in a folder of masks, in the order of [`Dataset::views`]: named as its photo, in a folder
/// named as the photo's where several have the same name.
pub(super) fn mask_files(dataset: &Dataset) -> Vec<PathBuf> {
    let mut seen = HashSet::new();
    let are_unique = dataset.views().all(|view| seen.insert(&view.name));
    let file = |view: &View| {
        let folder = view.file.parent().and_then(Path::file_name);
        let folder = folder.filter(|_| !are_unique).unwrap_or_default();
        Path::new(folder).join(format!("{}.png", view.name))
    };
    dataset.views().map(file).collect()
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
