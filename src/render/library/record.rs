//! What is known of an environment beside its light.

use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use super::error::LibraryError;
use crate::data::write_atomically;

/// Where an environment of the library came from; its `NAME.toml`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Record {
    /// Shown in lists, and what it is asked for by; none is the file's name.
    pub name: Option<String>,
    /// The file or address that it was made from.
    pub origin: Option<String>,
    /// What may be done with it, in words.
    pub licence: Option<String>,
    /// When it was added, in seconds since the beginning of 1970 (UTC).
    pub added_unix_secs: Option<u64>,
}

impl Record {
    /// The same, added now.
    pub(super) fn added_now(mut self) -> Self {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        self.added_unix_secs = since.ok().as_ref().map(Duration::as_secs);
        self
    }

    /// Reads the file; what it does not say, or says by not being there, is unknown.
    ///
    /// # Errors
    /// What is wrong with the file, by its name.
    pub(super) fn read(file: &Path) -> Result<Self, String> {
        let wrong = |what: String| format!("{}: {}", file.display(), what.trim_end());
        match std::fs::read_to_string(file) {
            Ok(text) => toml::from_str(&text).map_err(|error| wrong(error.to_string())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(wrong(error.to_string())),
        }
    }

    /// Writes the file whole or not at all.
    pub(super) fn write(&self, file: &Path) -> Result<(), LibraryError> {
        let text = toml::to_string(self).expect("plain strings and numbers serialise");
        write_atomically(file, |into| into.write_all(text.as_bytes()))
            .map_err(|error| LibraryError::io(file, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_comes_back_from_its_file_and_a_missing_one_knows_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        assert_eq!(Record::read(&file), Ok(Record::default()));
        let record = Record {
            name: Some("a \"b\"\n".to_owned()),
            licence: Some("CC0".to_owned()),
            ..Record::default()
        };
        let record = record.added_now();
        assert!(record.added_unix_secs > Some(1_700_000_000), "{record:?}");
        record.write(&file).unwrap();
        assert_eq!(Record::read(&file), Ok(record));
    }

    #[test]
    fn a_damaged_record_is_named_with_the_field() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        for (text, expected) in [
            ("license = \"CC0\"", "license"),
            ("added_unix_secs = -1", "added_unix_secs"),
            ("name = [", "a.toml"),
        ] {
            std::fs::write(&file, text).unwrap();
            let error = Record::read(&file).unwrap_err();
            assert!(
                error.contains("a.toml") && error.contains(expected),
                "{error}"
            );
        }
        std::fs::write(&file, [0xff, 0xfe]).unwrap();
        assert!(Record::read(&file).is_err(), "no text");
    }
}
