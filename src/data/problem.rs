//! Findings about a capture that do not stop it from being used.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

/// How bad a [`Problem`] is; ordered from worst to mildest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, strum::Display)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Severity {
    /// Something is lost or the result will be wrong.
    Error,
    /// The result may suffer.
    Warning,
    /// Worth knowing: an assumption that was made.
    Note,
}

/// One finding, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// How bad it is.
    pub severity: Severity,
    /// The file concerned.
    pub file: Option<PathBuf>,
    /// What was found.
    pub what: String,
    /// What to do about it; may be empty.
    pub advice: String,
}

impl Problem {
    /// A finding about no file in particular.
    pub fn new(severity: Severity, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            severity,
            file: None,
            what: what.into(),
            advice: advice.into(),
        }
    }

    /// The same finding, about `file`.
    pub fn in_file(mut self, file: impl Into<PathBuf>) -> Self {
        self.file = Some(file.into());
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.severity)?;
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        f.write_str(&self.what)?;
        if !self.advice.is_empty() {
            write!(f, " ({})", self.advice)?;
        }
        Ok(())
    }
}

/// The first few of `names`, for a sentence.
pub(super) fn first_names(names: &[String]) -> String {
    const N_SHOWN: usize = 3;
    match names.split_at_checked(N_SHOWN) {
        Some((shown, rest)) if !rest.is_empty() => {
            format!("{} and {} more", shown.join(", "), rest.len())
        }
        _ => names.join(", "),
    }
}
