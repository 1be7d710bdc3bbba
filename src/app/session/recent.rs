//! The list of what was opened lately, kept between sessions in a small file.

use std::path::{Path, PathBuf};

use directories::ProjectDirs;

use crate::app::work::keeper::{Keep, Keeper};

/// Paths kept.
const MAX_RECENT: usize = 8;

/// Where the list is kept; none on a system without a home folder.
fn file() -> Option<PathBuf> {
    ProjectDirs::from("", "", "neif").map(|dirs| dirs.data_local_dir().join("recent.json"))
}

/// The list, newest first; empty where there is none or it is damaged.
pub(in crate::app) fn load() -> Vec<PathBuf> {
    file().map_or_else(Vec::new, |file| load_from(&file))
}

/// Keeps the list.
pub(in crate::app) fn save(recent: &[PathBuf], keeper: &Keeper) {
    if let Some(file) = file() {
        save_to(&file, recent, keeper);
    }
}

fn load_from(file: &Path) -> Vec<PathBuf> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let mut recent: Vec<PathBuf> = serde_json::from_str(&text).unwrap_or_default();
    recent.truncate(MAX_RECENT);
    recent
}

fn save_to(file: &Path, recent: &[PathBuf], keeper: &Keeper) {
    match serde_json::to_string(recent) {
        Ok(text) => keeper.keep(file, Keep::Write(text)),
        Err(error) => tracing::warn!(
            "{}: cannot keep the list of opened files: {error}",
            file.display()
        ),
    }
}

/// Puts a path at the top of the list.
pub(in crate::app) fn add(recent: &mut Vec<PathBuf>, path: &Path) {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    recent.retain(|old| *old != path);
    recent.insert(0, path);
    recent.truncate(MAX_RECENT);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_comes_back_newest_first_without_repeats() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("deep/recent.json");
        let mut recent = Vec::new();
        for name in ["/a", "/b", "/a"] {
            add(&mut recent, Path::new(name));
        }
        let keeper = Keeper::new(|| {}).unwrap();
        save_to(&file, &recent, &keeper);
        drop(keeper);
        assert_eq!(load_from(&file), [PathBuf::from("/a"), PathBuf::from("/b")]);
    }

    #[test]
    fn a_damaged_list_is_an_empty_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("recent.json");
        std::fs::write(&file, "[1, {").unwrap();
        assert_eq!(load_from(&file), Vec::<PathBuf>::new());
    }
}
