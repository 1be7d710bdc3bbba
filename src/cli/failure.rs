//! How a command ends: what went wrong, and the exit code that says so to scripts.

use std::{fmt, path::Path, process::ExitCode};

/// Why a command did not do its work.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The arguments or the given data cannot be used: exit code 2.
    Unusable(anyhow::Error),
    /// Anything else, such as a full disk: exit code 1.
    Failed(anyhow::Error),
    /// The person pressed Ctrl-C: exit code 130.
    Interrupted,
}

impl Failure {
    /// Wraps an error about arguments or data that were given.
    pub(crate) fn unusable(error: impl Into<anyhow::Error>) -> Self {
        Self::Unusable(error.into())
    }

    /// Says what is wrong with a file or folder that was given.
    pub(crate) fn at(path: &Path, what: impl fmt::Display) -> Self {
        Self::Unusable(anyhow::anyhow!("{}: {what}", path.display()))
    }

    /// The exit code of the process.
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Failed(_) => 1,
            Self::Unusable(_) => 2,
            Self::Interrupted => 130,
        })
    }

    /// The message with its chain of causes; `None` when there is nothing to say.
    pub(crate) fn message(&self) -> Option<String> {
        match self {
            Self::Unusable(error) | Self::Failed(error) => Some(with_causes(error)),
            Self::Interrupted => None,
        }
    }
}

/// An error with its causes, each said once: many name their cause themselves.
fn with_causes(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Errors without a verdict are failures of the work, not of the input.
impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Failed(error.into())
    }
}

/// Marks the error of a step that only fails because of what was given.
pub(crate) trait OrUnusable<T> {
    /// Turns an error into [`Failure::Unusable`].
    fn or_unusable(self) -> Result<T, Failure>;
}

impl<T, E: Into<anyhow::Error>> OrUnusable<T> for Result<T, E> {
    fn or_unusable(self) -> Result<T, Failure> {
        self.map_err(Failure::unusable)
    }
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::*;

    #[test]
    fn causes_are_named_once() {
        let full = std::io::Error::other("disk full");
        let named = Err::<(), _>(full).context("run/a: disk full");
        assert_eq!(with_causes(&named.unwrap_err()), "run/a: disk full");
        let silent = Err::<(), _>(std::io::Error::other("disk full")).context("run/a");
        assert_eq!(with_causes(&silent.unwrap_err()), "run/a: disk full");
    }
}
