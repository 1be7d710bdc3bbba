//! The session: where it is saved, and how a saved one comes back.

use std::path::PathBuf;

use super::session_file::SessionFile;

/// What a person asks of the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionCommand {
    /// Save it where it was saved before; asks where to the first time.
    Save,
    /// Save it elsewhere.
    SaveAs,
    /// Bring back what an earlier window left behind.
    Restore,
    /// Forget that.
    Forget,
}

/// A photo's camera to stand at once the capture is read.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::app) struct WantedView {
    pub(in crate::app) name: String,
    pub(in crate::app) wipe: Option<f32>,
}

/// A session whose source is being opened.
#[derive(Clone, Debug, PartialEq)]
pub struct Pending {
    /// What it holds.
    pub session: Box<SessionFile>,
    /// Where it was saved; none where it was left behind.
    pub file: Option<PathBuf>,
}

/// The state of the session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionState {
    /// Where it is saved.
    pub file: Option<PathBuf>,
    /// What an earlier window left behind when it did not end properly.
    pub recovery: Option<Box<SessionFile>>,
    /// What is applied as soon as something is open.
    pub pending: Option<Pending>,
    pub(in crate::app) wanted_view: Option<WantedView>,
}
