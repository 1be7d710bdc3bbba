//! Files that come with the program: the demo capture and environments.

use std::path::PathBuf;

use super::state::source::{EnvironmentContent, EnvironmentEntry};
use crate::data::bundled_assets;

/// The bundled capture.
pub fn demo() -> Option<PathBuf> {
    bundled_assets().ok().map(|assets| assets.join("demo"))
}

/// The bundled environments, by name, not read yet.
pub fn environments() -> Vec<EnvironmentEntry> {
    let folder = bundled_assets()
        .ok()
        .map(|assets| assets.join("environments"));
    let files = folder.and_then(|folder| std::fs::read_dir(folder).ok());
    let paths = files
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()));
    let mut entries: Vec<_> = paths
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "safetensors")
        })
        .map(|path| EnvironmentEntry {
            name: path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            path,
            content: EnvironmentContent::NotLoaded,
        })
        .collect();
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    entries
}
