//! The library's folder: what is in it, and how that changes.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use directories::ProjectDirs;

use super::entry::{Entry, light_in, picture_of, record_of};
use super::error::LibraryError;
use super::names::{file_name, free_suffix, sort_by_likeness};
use super::record::Record;
use super::thumbnail::thumbnail;
use crate::data::{bundled_assets, write_atomically};
use crate::neif::{Environment, Storage};

/// Environment variable that names the folder.
const VARIABLE: &str = "NEIF_LIBRARY";
/// Below the system's folder for this program's data, and below the bundled files.
const FOLDER: &str = "environments";

/// A folder of environments, and those that come with the program.
#[derive(Clone, Debug, Default)]
pub struct Library {
    folder: Option<PathBuf>,
    bundled: Option<PathBuf>,
}

impl Library {
    /// The environments of a folder, which need not exist, and of one that nothing is added to or removed from.
    pub fn new(folder: Option<PathBuf>, bundled: Option<PathBuf>) -> Self {
        Self { folder, bundled }
    }

    /// The person's own: the folder that `NEIF_LIBRARY` names, or one in the system's folder for data.
    pub fn of_system() -> Self {
        let named = std::env::var_os(VARIABLE).filter(|name| !name.is_empty());
        let named = named.map(|name| std::path::absolute(&name).unwrap_or_else(|_| name.into()));
        let folder = named.or_else(|| {
            let folders = ProjectDirs::from("", "", "neif")?;
            Some(folders.data_dir().join(FOLDER))
        });
        let bundled = bundled_assets().ok().map(|assets| assets.join(FOLDER));
        Self::new(folder, bundled)
    }

    /// Where a person's own are; none on a system without a home folder.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Makes the folder, where it is missing, and returns it.
    ///
    /// # Errors
    /// When there is no place for one, or the system refuses.
    pub fn made_folder(&self) -> Result<&Path, LibraryError> {
        let folder = self.folder.as_deref().ok_or(LibraryError::NoFolder)?;
        fs::create_dir_all(folder).map_err(|error| LibraryError::io(folder, error))?;
        Ok(folder)
    }

    /// All environments: the bundled ones, then a person's own, each by name. None of them is read.
    ///
    /// # Errors
    /// When a folder is there and cannot be listed.
    pub fn entries(&self) -> Result<Vec<Entry>, LibraryError> {
        let mut entries = Vec::new();
        for (folder, is_bundled) in [(&self.bundled, true), (&self.folder, false)] {
            if let Some(folder) = folder {
                entries.extend(listed(folder, is_bundled)?);
            }
        }
        let key = |entry: &Entry| (!entry.is_bundled, entry.name.to_lowercase());
        entries.sort_by_cached_key(|entry| (key(entry), entry.file.clone()));
        Ok(entries)
    }

    /// The environment of this name; a person's own before a bundled one.
    ///
    /// # Errors
    /// When none has it, with the names that there are; as [`Self::entries`].
    pub fn find(&self, name: &str) -> Result<Entry, LibraryError> {
        let entries = self.entries()?;
        if let Some(entry) = entries.iter().rfind(|entry| entry.is_called(name)) {
            return Ok(entry.clone());
        }
        let mut known: Vec<String> = entries.into_iter().map(|entry| entry.name).collect();
        sort_by_likeness(&mut known, name);
        Err(LibraryError::Unknown {
            name: name.to_owned(),
            known,
        })
    }

    /// Adds an environment that was made. It is called as `record` says, else as it calls itself, with a number where
    /// another one is called so.
    ///
    /// # Errors
    /// When there is no folder, or the system refuses; then nothing is added.
    pub fn add(
        &self,
        environment: &Arc<Environment>,
        storage: Storage,
        record: Record,
    ) -> Result<Entry, LibraryError> {
        self.put(environment, record, |light| {
            Ok(environment.save(light, storage)?)
        })
    }

    /// Adds a copy of an environment file, in which `environment` is; otherwise as [`Self::add`].
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn add_file(
        &self,
        file: &Path,
        environment: &Arc<Environment>,
        record: Record,
    ) -> Result<Entry, LibraryError> {
        self.put(environment, record, |light| {
            let mut source = File::open(file).map_err(|error| LibraryError::io(file, error))?;
            write_atomically(light, |into| std::io::copy(&mut source, into).map(|_| ()))
                .map_err(|error| LibraryError::io(light, error))
        })
    }

    /// Deletes the files of a person's own environment.
    ///
    /// # Errors
    /// When none has the name, a bundled one has it, or the system refuses.
    pub fn remove(&self, name: &str) -> Result<Entry, LibraryError> {
        let entry = self.find(name)?;
        if entry.is_bundled {
            return Err(LibraryError::Bundled(entry.name));
        }
        delete(&entry.file)?;
        Ok(entry)
    }

    /// The kept picture of an environment file of a person's own; none where there is none, or the file is newer.
    pub fn picture(&self, file: &Path) -> Option<PathBuf> {
        if file.parent() != Some(self.folder.as_deref()?) {
            return None;
        }
        let picture = picture_of(file);
        let changed = |path: &Path| fs::metadata(path).and_then(|of| of.modified()).ok();
        (changed(&picture)? >= changed(file)?).then_some(picture)
    }

    /// Adds what `write` writes, `environment`, under a name that no other has.
    fn put(
        &self,
        environment: &Arc<Environment>,
        record: Record,
        write: impl FnOnce(&Path) -> Result<(), LibraryError>,
    ) -> Result<Entry, LibraryError> {
        let folder = self.made_folder()?;
        let wanted = record.name.as_deref().unwrap_or(environment.name()).trim();
        let stem = file_name(wanted);
        let wanted = if wanted.is_empty() { &stem } else { wanted };
        let entries = self.entries()?;
        let suffix = free_suffix(|suffix| {
            let (name, stem) = (format!("{wanted}{suffix}"), format!("{stem}{suffix}"));
            let is_used =
                |entry: &Entry| entry.is_nearly_called(&name) || entry.is_nearly_called(&stem);
            entries.iter().any(is_used) || light_in(folder, &stem).exists()
        });
        let light = light_in(folder, &format!("{stem}{suffix}"));
        let record = Record {
            name: Some(format!("{wanted}{suffix}")),
            ..record
        };
        let picture = thumbnail(Arc::clone(environment));
        let written = write(&light)
            .and_then(|()| Ok(picture.write_png(&picture_of(&light))?))
            .and_then(|()| record.added_now().write(&record_of(&light)));
        if let Err(error) = written {
            // The first error says what is wrong; what was written before it is of no use.
            _ = delete(&light);
            return Err(error);
        }
        Ok(Entry::of_file(light, false).expect("a name that the library made"))
    }
}

/// The environments in a folder; none where it does not exist.
fn listed(folder: &Path, is_bundled: bool) -> Result<Vec<Entry>, LibraryError> {
    let refused = |error| LibraryError::io(folder, error);
    let files = match fs::read_dir(folder) {
        Ok(files) => files,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(refused(error)),
    };
    let mut entries = Vec::new();
    for file in files {
        let path = file.map_err(refused)?.path();
        entries.extend(Entry::of_file(path, is_bundled));
    }
    Ok(entries)
}

/// Deletes an environment's files, of which some may be missing.
fn delete(light: &Path) -> Result<(), LibraryError> {
    for file in [light, &picture_of(light), &record_of(light)] {
        match fs::remove_file(file) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(LibraryError::io(file, error));
            }
            _ => (),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
