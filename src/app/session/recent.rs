//! The list of what was opened lately, kept between sessions in a small file.

use std::path::{Path, PathBuf};

use directories::ProjectDirs;

/// Paths kept.
const MAX_RECENT: usize = 8;

/// Where the list is kept; none on a system without a home folder.
fn file() -> Option<PathBuf> {
    ProjectDirs::from("", "", "neif").map(|dirs| dirs.data_local_dir().join("recent.json"))
}

/// The list, newest first; empty where there is none or it is damaged.
pub fn load() -> Vec<PathBuf> {
    file().map_or_else(Vec::new, |file| load_from(&file))
}

/// Keeps the list.
pub fn save(recent: &[PathBuf]) {
    if let Some(file) = file()
        && let Err(error) = save_to(&file, recent)
    {
        tracing::warn!(
            "{}: cannot keep the list of opened files: {error}",
            file.display()
        );
    }
}

fn load_from(file: &Path) -> Vec<PathBuf> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let mut recent: Vec<PathBuf> = serde_json::from_str(&text).unwrap_or_default();
    recent.truncate(MAX_RECENT);
    recent
}

fn save_to(file: &Path, recent: &[PathBuf]) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut whole = tempfile::NamedTempFile::new_in(folder)?;
    serde_json::to_writer(&mut whole, recent)?;
    whole.as_file().sync_all()?;
    whole.persist(file)?;
    Ok(())
}

/// Puts a path at the top of the list.
pub fn add(recent: &mut Vec<PathBuf>, path: &Path) {
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
        save_to(&file, &recent).unwrap();
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
