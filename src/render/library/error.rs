//! Why something cannot be done with the library.

use std::io;
use std::path::{Path, PathBuf};

use crate::data::DataError;
use crate::neif::NeifError;

/// Most names in a message.
const MOST_NAMES: usize = 8;

/// Why an environment could not be listed, found, added or removed.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The system knows no folder for data, and none was given.
    #[error("there is no folder for the library; NEIF_LIBRARY can name one")]
    NoFolder,
    /// The operating system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The environment cannot be written.
    #[error(transparent)]
    Environment(#[from] NeifError),
    /// Its picture cannot be written.
    #[error(transparent)]
    Picture(#[from] DataError),
    /// None has this name.
    #[error("no environment of the library is called `{name}`; there are {known}", known = listed(known))]
    Unknown {
        /// The name.
        name: String,
        /// Those that there are, the most similar ones first.
        known: Vec<String>,
    },
    /// It is not a person's own.
    #[error("`{0}` comes with the program and cannot be removed")]
    Bundled(String),
}

impl LibraryError {
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    /// Whether what was asked for cannot be done, in contrast to a system that refuses.
    pub fn is_of_request(&self) -> bool {
        matches!(
            self,
            Self::NoFolder | Self::Unknown { .. } | Self::Bundled(_)
        )
    }
}

/// The first names, and how many more there are.
fn listed(names: &[String]) -> String {
    let first = &names[..names.len().min(MOST_NAMES)];
    match names.len() - first.len() {
        0 if names.is_empty() => "none".to_owned(),
        0 => first.join(", "),
        n => format!("{} and {n} more", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_of_names_are_cut() {
        let names = |n: usize| (0..n).map(|i| format!("e{i}")).collect::<Vec<_>>();
        assert_eq!(listed(&names(0)), "none");
        assert_eq!(listed(&names(2)), "e0, e1");
        assert!(listed(&names(10)).ends_with("e7 and 2 more"));
    }
}
