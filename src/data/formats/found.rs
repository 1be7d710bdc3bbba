//! What a reader finds, and what it lists.

use std::path::{Path, PathBuf};

use crate::data::{Frame, PointCloud, Problem};

/// A capture of some layout: its folder, and the file or folder that lists the cameras.
#[derive(Clone, Debug)]
pub(in crate::data) struct Found {
    pub(in crate::data) root: PathBuf,
    pub(in crate::data) file: PathBuf,
}

impl Found {
    /// A file that lists the cameras, in its folder.
    pub(super) fn beside(file: &Path) -> Self {
        Self {
            root: file.parent().unwrap_or_else(|| Path::new("")).to_owned(),
            file: file.to_owned(),
        }
    }

    /// A path below the capture as messages show it.
    pub(in crate::data) fn shown(&self, path: &Path) -> String {
        match path.strip_prefix(&self.root) {
            Ok(below) if below.as_os_str().is_empty() => "the folder itself".to_owned(),
            Ok(below) => below.display().to_string(),
            Err(_outside) => path.display().to_string(),
        }
    }
}

/// What a layout without splits of its own lists.
#[derive(Debug)]
pub(in crate::data) struct Listed {
    pub(in crate::data) frames: Vec<Frame>,
    pub(in crate::data) points: Option<PointCloud>,
    pub(in crate::data) recognised: String,
    pub(in crate::data) problems: Vec<Problem>,
}
