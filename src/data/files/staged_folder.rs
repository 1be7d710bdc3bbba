//! Folders whose files appear together or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::atomic::temporary;
use crate::data::DataError;

/// Files on their way into a folder: they lie in a temporary one, which is gone when this is dropped.
#[derive(Debug)]
pub struct StagedFolder {
    target: PathBuf,
    stage: TempDir,
}

impl StagedFolder {
    /// Begins on the disk of `target`, inside it where it exists; nothing else is touched before [`Self::finish`].
    ///
    /// # Errors
    /// When `target`, or what would have to hold it, is a file or cannot be written to.
    pub fn new(target: &Path) -> Result<Self, DataError> {
        let nearest = target
            .ancestors()
            .find(|folder| folder.exists())
            .unwrap_or_else(|| Path::new("."));
        let stage = temporary(".part", 0o777).tempdir_in(nearest);
        let stage = stage.map_err(|e| DataError::io(target, e))?;
        Ok(Self {
            target: target.to_owned(),
            stage,
        })
    }

    /// Where the files are written meanwhile.
    pub fn path(&self) -> &Path {
        self.stage.path()
    }

    /// Moves the files to where they belong; those of the same names are replaced, others stay.
    ///
    /// # Errors
    /// When a file cannot be moved.
    pub fn finish(self) -> Result<(), DataError> {
        let moved = if self.target.is_dir() {
            self.move_files()
        } else {
            self.move_folder()
        };
        moved.map_err(|e| DataError::io(&self.target, e))
    }

    fn move_files(&self) -> io::Result<()> {
        for entry in fs::read_dir(self.path())? {
            let entry = entry?;
            fs::rename(entry.path(), self.target.join(entry.file_name()))?;
        }
        Ok(())
    }

    fn move_folder(&self) -> io::Result<()> {
        if let Some(parent) = self.target.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::rename(self.path(), &self.target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::test_asserts::assert_error;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn an_abandoned_folder_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        for target in [folder.path().to_owned(), folder.path().join("a/b")] {
            let staged = StagedFolder::new(&target).unwrap();
            fs::write(staged.path().join("1.png"), "half").unwrap();
            drop(staged);
            assert_eq!(names(folder.path()), [""; 0], "{}", target.display());
        }
    }

    #[test]
    fn files_arrive_together_in_new_and_existing_folders() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a/b");
        for name in ["1.png", "2.png"] {
            let staged = StagedFolder::new(&target).unwrap();
            fs::write(staged.path().join(name), name).unwrap();
            staged.finish().unwrap();
        }
        assert_eq!(names(&target), ["1.png", "2.png"]);
        assert_eq!(names(folder.path()), ["a"], "no temporary folder stays");
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("taken");
        fs::write(&file, "").unwrap();
        assert_error(StagedFolder::new(&file.join("x")), &["taken"]);
    }
}
