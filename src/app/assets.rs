//! Files that come with the program: the demo capture and environments.

use std::path::PathBuf;

use super::state::source::{EnvironmentContent, EnvironmentEntry, environment_name};
use crate::data::bundled_assets;

/// The bundled capture.
pub fn demo() -> Option<PathBuf> {
    bundled_assets().ok().map(|assets| assets.join("demo"))
}

/// The bundled environments, by name, not read yet.
pub fn environments() -> Vec<EnvironmentEntry> {
    let assets = bundled_assets().ok();
    let files = assets.and_then(|assets| std::fs::read_dir(assets.join("environments")).ok());
    let files = files.into_iter().flatten();
    let paths = files.filter_map(|entry| Some(entry.ok()?.path()));
    let is_field = |path: &PathBuf| {
        path.extension()
            .is_some_and(|ending| ending == "safetensors")
    };
    let entry = |path: PathBuf| EnvironmentEntry {
        name: environment_name(&path),
        path,
        content: EnvironmentContent::NotLoaded,
    };
    let mut entries: Vec<_> = paths.filter(is_field).map(entry).collect();
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    entries
}
