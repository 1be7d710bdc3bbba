//! Files that come with the program: the demo capture and environments.

use std::path::{Path, PathBuf};

use crate::app::state::{EnvironmentContent, EnvironmentEntry};

/// The folder of bundled files: `$NEIF_ASSETS`, next to the program, or where it was built.
pub fn assets_dir() -> Option<PathBuf> {
    let program = std::env::current_exe().ok();
    let beside = program
        .as_deref()
        .and_then(Path::parent)
        .map(|folder| folder.join("assets"));
    let places = [
        std::env::var_os("NEIF_ASSETS").map(PathBuf::from),
        beside,
        Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("assets")),
    ];
    places.into_iter().flatten().find(|place| place.is_dir())
}

/// The bundled capture.
pub fn demo() -> Option<PathBuf> {
    assets_dir()
        .map(|assets| assets.join("demo"))
        .filter(|demo| demo.is_dir())
}

/// The bundled environments, by name, not read yet.
pub fn environments() -> Vec<EnvironmentEntry> {
    let folder = assets_dir().map(|assets| assets.join("environments"));
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
