//! The system's file dialog, on a thread of its own: it may hang, be missing, or stay open for long.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, TryRecvError, bounded};

use crate::app::session::session_file::EXTENSION;
use crate::app::state::app_state::PathPurpose;
use crate::app::state::command::Browse;

/// A dialog that is gone sooner than a person can act was never there.
const TOO_SOON: Duration = Duration::from_millis(300);
/// After this long the window no longer waits: the service behind the dialog may have hung.
const GIVE_UP: Duration = Duration::from_mins(3);

/// A dialog that was asked for.
#[derive(Debug)]
pub struct FileDialog {
    answer: Receiver<Option<PathBuf>>,
    opened: Instant,
}

impl FileDialog {
    /// Asks the system; `wake` is called when there is an answer.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn open(
        kind: Browse,
        purpose: PathPurpose,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        Self::with(move || ask(kind, purpose), wake)
    }

    /// Asks the system by `ask`, which may take long; `wake` is called when there is an answer.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn with(
        ask: impl FnOnce() -> Option<PathBuf> + Send + 'static,
        wake: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let (sender, answer) = bounded(1);
        std::thread::Builder::new()
            .name("neif-dialog".to_owned())
            .spawn(move || {
                let path = ask();
                if sender.send(path).is_ok() {
                    wake();
                }
            })?;
        Ok(Self {
            answer,
            opened: Instant::now(),
        })
    }

    /// The answer, once there is one: a path, nothing when it was cancelled, or why there is no
    /// dialog.
    pub fn poll(&self) -> Option<Result<Option<PathBuf>, String>> {
        let waited = self.opened.elapsed();
        let missing = || "There is no file dialog on this system: type the path, or drop the file on the window.";
        match self.answer.try_recv() {
            Ok(None) if waited < TOO_SOON => Some(Err(missing().to_owned())),
            Ok(path) => Some(Ok(path)),
            Err(TryRecvError::Disconnected) => Some(Err(missing().to_owned())),
            Err(TryRecvError::Empty) if waited > GIVE_UP => Some(Err(
                "The file dialog does not answer: type the path, or drop the file on the window."
                    .to_owned(),
            )),
            Err(TryRecvError::Empty) => None,
        }
    }
}

fn ask(kind: Browse, purpose: PathPurpose) -> Option<PathBuf> {
    let dialog = rfd::FileDialog::new();
    match (purpose, kind) {
        (PathPurpose::Log, _) => dialog
            .set_title("File for the figures")
            .set_file_name("metrics.csv")
            .save_file(),
        (PathPurpose::AddEnvironment, Browse::Folder) => dialog
            .set_title("Light the object with a run's environment")
            .pick_folder(),
        (PathPurpose::AddEnvironment, Browse::File) => dialog
            .set_title("Light the object with an environment")
            .add_filter("Environments", &["safetensors", "hdr", "exr"])
            .add_filter("All files", &["*"])
            .pick_file(),
        (PathPurpose::Save, _) => dialog.set_title("Folder for the run").pick_folder(),
        (PathPurpose::SaveSession, _) => dialog
            .set_title("File for the session")
            .add_filter("Sessions", &[EXTENSION])
            .save_file(),
        (PathPurpose::Open, Browse::Folder) => {
            dialog.set_title("Open a capture or a run").pick_folder()
        }
        (PathPurpose::Open, Browse::File) => dialog
            .set_title("Open a capture, an environment or a session")
            .add_filter(
                "Captures, environments and sessions",
                &["json", "safetensors", "hdr", "exr", EXTENSION],
            )
            .add_filter("All files", &["*"])
            .pick_file(),
    }
}
