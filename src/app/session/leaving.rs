//! The question before training that was never saved is lost: by closing, or by opening something else.

use std::path::PathBuf;

/// What would end the training.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Goal {
    /// Closing the window.
    Close,
    /// Opening this.
    Open(PathBuf),
    /// Opening the bundled capture.
    OpenDemo,
}

/// The question, while it is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leaving {
    /// What waits for the answer.
    pub goal: Goal,
    /// While the run is saved first: how many saves there were before.
    pub saving_after: Option<usize>,
}

/// Answers, and what raises the question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeavingCommand {
    /// Close the window.
    Close,
    /// Save the run, then go on.
    Save,
    /// Go on and lose it.
    Discard,
    /// Stay.
    Cancel,
}
