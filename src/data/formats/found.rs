//! What a layout is, what its reader finds, and what it lists.

use std::path::{Path, PathBuf};

use crate::data::files::capture_path::{first_file, folder_of, has_extension};
use crate::data::{DataError, Frame, PointCloud, Problem};

/// A layout without splits of its own.
pub(super) struct Layout {
    pub(super) name: &'static str,
    /// For a message that nothing was found.
    pub(super) looked_for: &'static str,
    /// The capture of this layout in a folder.
    pub(super) find: fn(&Path) -> Option<Found>,
    /// The capture that a file of this layout belongs to, recognised by the file's name.
    pub(super) of_file: fn(&Path) -> Option<Found>,
    pub(super) list: fn(&Found) -> Result<Listed, DataError>,
}

/// A capture of some layout: its folder, and the file or folder that lists the cameras.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) root: PathBuf,
    pub(super) file: PathBuf,
}

impl Found {
    pub(super) fn new(root: &Path, file: &Path) -> Self {
        Self {
            root: root.to_owned(),
            file: file.to_owned(),
        }
    }

    /// The first of the files `names` in a capture's folder that exists.
    pub(super) fn first(root: &Path, names: &[&str]) -> Option<Self> {
        Some(Self::new(root, &first_file(root, names)?))
    }

    /// A file with this extension that lists the cameras, in its folder.
    pub(super) fn with_extension(file: &Path, extension: &str) -> Option<Self> {
        has_extension(file, extension).then(|| Self::new(folder_of(file), file))
    }

    /// A path below the capture as messages show it.
    pub(super) fn shown(&self, path: &Path) -> String {
        match path.strip_prefix(&self.root) {
            Ok(below) if below.as_os_str().is_empty() => "the folder itself".to_owned(),
            Ok(below) => below.display().to_string(),
            Err(_outside) => path.display().to_string(),
        }
    }
}

/// What a layout without splits of its own lists.
#[derive(Debug, Default)]
pub(super) struct Listed {
    pub(super) frames: Vec<Frame>,
    pub(super) points: Option<PointCloud>,
    pub(super) recognised: String,
    pub(super) problems: Vec<Problem>,
}
