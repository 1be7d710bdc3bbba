//! What is open, and the environments on the list.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::neif::Environment;
use crate::neif::distant::is_environment_file;
use crate::scans::Scan;

/// What is open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// Nothing yet.
    #[default]
    Nothing,
    /// The capture that comes with the program.
    Demo(PathBuf),
    /// A capture.
    Capture(PathBuf),
    /// A saved run.
    Run(PathBuf),
    /// An environment without an object.
    Environment(PathBuf),
}

impl Source {
    /// The file or folder.
    pub fn path(&self) -> Option<&PathBuf> {
        match self {
            Self::Nothing => None,
            Self::Demo(path) | Self::Capture(path) | Self::Run(path) | Self::Environment(path) => {
                Some(path)
            }
        }
    }

    /// Whether it can be trained, from the start or further.
    pub fn is_trainable(&self) -> bool {
        matches!(self, Self::Demo(_) | Self::Capture(_) | Self::Run(_))
    }

    /// The last part of the path, for people.
    pub fn name(&self) -> String {
        match (self, self.path()) {
            (Self::Demo(_), _) => "Bundled demo".to_owned(),
            (_, Some(path)) => file_name(path),
            _ => "Nothing open".to_owned(),
        }
    }
}

/// Whether a file's name is that of something that lights the scene which is open: an environment, or a scan to make one of.
pub fn is_light(path: &Path) -> bool {
    is_environment_file(path) || Scan::is_named_so(path)
}

/// The last part of a path, or all of it where there is none.
pub fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

/// The same without the extension.
pub fn file_stem(path: &Path) -> String {
    let stem = path.file_stem();
    stem.map_or_else(
        || file_name(path),
        |stem| stem.to_string_lossy().into_owned(),
    )
}

/// An environment that can be chosen.
#[derive(Clone, Debug)]
pub struct EnvironmentEntry {
    /// For people.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Where it came from and what may be done with it, for people; empty where nobody said.
    pub about: String,
    /// What is known of it.
    pub content: EnvironmentContent,
}

/// How far an environment file has been read.
#[derive(Clone, Debug)]
pub enum EnvironmentContent {
    /// Only its name is known.
    NotLoaded,
    /// A thread reads it.
    Loading,
    /// Ready.
    Ready(Arc<Environment>),
    /// It cannot be used.
    Failed(String),
}
