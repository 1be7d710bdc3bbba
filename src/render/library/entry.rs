//! One environment of the library: its files.

use std::path::{Path, PathBuf};

use super::names::environment_name;
use super::record::Record;
use crate::neif::NeifError;
use crate::neif::light::environment::EnvironmentKind;

/// Ending of the environment file.
const LIGHT: &str = "safetensors";
/// Ending of what is known of it.
const RECORD: &str = "toml";
/// Ending of its picture.
const PICTURE: &str = "png";

/// An environment of the library; its light has not been read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What it is called.
    pub name: String,
    /// The environment file.
    pub file: PathBuf,
    /// What is known of it.
    pub record: Record,
    /// Whether it came with the program.
    pub is_bundled: bool,
    /// Why nothing is known of it, where its record cannot be read.
    pub problem: Option<String>,
}

impl Entry {
    /// The one in a file, as its record says; none where the file is not named like an environment's.
    pub(super) fn of_file(file: PathBuf, is_bundled: bool) -> Option<Self> {
        let name = file.file_name()?.to_string_lossy();
        if name.starts_with('.') || file.extension()? != LIGHT {
            return None;
        }
        let (record, problem) = match Record::read(&record_of(&file)) {
            Ok(record) => (record, None),
            Err(problem) => (Record::default(), Some(problem)),
        };
        let named = record.name.clone().filter(|name| !name.trim().is_empty());
        Some(Self {
            name: named.unwrap_or_else(|| environment_name(&file)),
            file,
            record,
            is_bundled,
            problem,
        })
    }

    /// Whether it is called so, in lists or as a file.
    pub fn is_called(&self, name: &str) -> bool {
        self.name == name || self.file.file_stem().is_some_and(|stem| stem == name)
    }

    /// The same without regard to case, as some file systems have none.
    pub(super) fn is_nearly_called(&self, name: &str) -> bool {
        let stem = self.file.file_stem().unwrap_or_default();
        let names = [self.name.clone(), stem.to_string_lossy().into_owned()];
        names
            .iter()
            .any(|own| own.to_lowercase() == name.to_lowercase())
    }

    /// What kind of environment it is, by the beginning of its file.
    ///
    /// # Errors
    /// When the file is no environment.
    pub fn kind(&self) -> Result<EnvironmentKind, NeifError> {
        EnvironmentKind::of_file(&self.file)
    }

    /// Where it came from and what may be done with it, a line each; empty where nobody said.
    pub fn about(&self) -> String {
        let origin = self.record.origin.iter().map(|text| format!("From {text}"));
        let licence = self.record.licence.iter();
        let licence = licence.map(|text| format!("Licence: {text}"));
        origin.chain(licence).collect::<Vec<_>>().join("\n")
    }
}

/// The environment file of this name.
pub(super) fn light_in(folder: &Path, name: &str) -> PathBuf {
    // Not by `with_extension`: names may have dots.
    folder.join(format!("{name}.{LIGHT}"))
}

/// The file of what is known of an environment.
pub(super) fn record_of(light: &Path) -> PathBuf {
    light.with_extension(RECORD)
}

/// The file of an environment's picture.
pub(super) fn picture_of(light: &Path) -> PathBuf {
    light.with_extension(PICTURE)
}
