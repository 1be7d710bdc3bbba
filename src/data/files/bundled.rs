//! Files that come with the program.

use std::path::{Path, PathBuf};

/// The folder of bundled files: `$NEIF_ASSETS`, next to the program, or where it was built.
///
/// # Errors
/// The places that were looked at, when none holds the demo capture.
pub fn bundled_assets() -> Result<PathBuf, Vec<PathBuf>> {
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
    let places: Vec<PathBuf> = places.into_iter().flatten().collect();
    let found = places.iter().find(|place| place.join("demo").is_dir());
    found.cloned().ok_or(places)
}
