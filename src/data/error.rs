//! What can be wrong with a file so that it cannot be used.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::Problem;

/// Why something could not be read or written. Every variant names the file.
#[derive(Debug, Error)]
pub enum DataError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not JSON.
    #[error("{}: not valid JSON: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// JSON with a wrong or missing field.
    #[error("{}: {}{field}: {problem}", path.display(), frame_label(*frame))]
    Field {
        /// The file.
        path: PathBuf,
        /// Index into `frames`, or `None` for the top level.
        frame: Option<usize>,
        /// The field's name.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A picture or mesh that cannot be used.
    #[error("{}: {problem}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A path that holds no capture.
    #[error("{}: not a capture: {problem}", path.display())]
    NotADataset {
        /// The path.
        path: PathBuf,
        /// What was looked for.
        problem: String,
    },
    /// A capture of which no view is usable.
    #[error("{}: no usable view{}", path.display(), list_problems(problems))]
    NoViews {
        /// The capture.
        path: PathBuf,
        /// Why, view by view.
        problems: Vec<Problem>,
    },
}

impl DataError {
    pub(crate) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    /// `field`: what of the file is wrong or missing.
    pub(super) fn field(path: &Path, field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Field {
            path: path.to_owned(),
            frame: None,
            field: field.into(),
            problem: problem.into(),
        }
    }

    /// The same, about a frame of the file where one is given.
    pub(super) fn in_frame(mut self, index: impl Into<Option<usize>>) -> Self {
        if let Self::Field { frame, .. } = &mut self {
            *frame = index.into();
        }
        self
    }

    pub(crate) fn unusable(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unusable {
            path: path.to_owned(),
            problem: problem.into(),
        }
    }

    pub(super) fn no_capture(path: &Path, problem: impl Into<String>) -> Self {
        Self::NotADataset {
            path: path.to_owned(),
            problem: problem.into(),
        }
    }
}

fn frame_label(frame: Option<usize>) -> String {
    frame.map_or_else(String::new, |i| format!("frame {i}, "))
}

fn list_problems(problems: &[Problem]) -> String {
    problems.iter().fold(String::new(), |mut list, problem| {
        list.push_str("\n  ");
        list.push_str(&problem.to_string());
        list
    })
}
