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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::*;
    use crate::neif::Storage;
    use crate::render::library::{Record, sky};

    #[test]
    fn the_library_s_environments_are_listed_with_what_is_known_and_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let library = Library::new(Some(folder.path().to_owned()), None);
        assert!(environments(&library).unwrap().is_empty());
        let record = Record {
            licence: Some("CC0".to_owned()),
            ..Record::default()
        };
        let light = Arc::new(sky([1.0; 3], Vec3::Z));
        let added = library.add(&light, Storage::F32, record).unwrap();
        let listed = environments(&library).unwrap().pop().unwrap();
        assert_eq!((listed.name, listed.path), ("sky".to_owned(), added.file));
        assert_eq!(listed.about, "Licence: CC0");
        assert!(matches!(listed.content, EnvironmentContent::NotLoaded));
    }
}
