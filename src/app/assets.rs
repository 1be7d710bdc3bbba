//! What is there before anything is opened: the demo capture, and the environments of the library.

use std::path::PathBuf;

use super::state::source::{EnvironmentContent, EnvironmentEntry};
use crate::data::bundled_assets;
use crate::render::library::{Entry, Library, LibraryError};

/// The bundled capture.
pub fn demo() -> Option<PathBuf> {
    bundled_assets().ok().map(|assets| assets.join("demo"))
}

/// The library's environments, the bundled ones first, not read yet.
///
/// # Errors
/// When the library cannot be listed.
pub fn environments(library: &Library) -> Result<Vec<EnvironmentEntry>, LibraryError> {
    let listed = |entry: Entry| EnvironmentEntry {
        about: entry.about(),
        name: entry.name,
        path: entry.file,
        content: EnvironmentContent::NotLoaded,
    };
    Ok(library.entries()?.into_iter().map(listed).collect())
}
