//! The library of environments on the command line: its names in place of paths.

use std::path::{Path, PathBuf};

use neif::render::library::{Entry, Library, LibraryError};

use super::failure::Failure;

/// The path, where something is there; else the file of the library's environment of that name.
pub(crate) fn path_or_name(path: &Path) -> Result<PathBuf, Failure> {
    if path.exists() {
        return Ok(path.to_owned());
    }
    let named = named(path).map_err(|error| {
        let what = format!("no such file or folder, and {error}");
        Failure::at(path, what)
    })?;
    Ok(named.file)
}

/// The library's environment of the name that stands in place of a path.
pub(crate) fn named(path: &Path) -> Result<Entry, LibraryError> {
    Library::of_system().find(&path.to_string_lossy())
}

/// What cannot be done is the request's fault, and what the system refuses is not.
pub(crate) fn failure(error: LibraryError) -> Failure {
    if error.is_of_request() {
        Failure::unusable(error)
    } else {
        Failure::Failed(error.into())
    }
}
