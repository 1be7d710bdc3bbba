//! The system's file dialog, on a thread of its own: it may hang, be missing, or stay open for long.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, TryRecvError, bounded};
use egui::Context;

use super::threads::spawn;
use crate::app::session::session_file::EXTENSION;
use crate::app::state::app_state::PathPurpose;
use crate::app::state::command::{Browse, Command};
use crate::app::state::export::ExportSettings;

/// A dialog that is gone sooner than a person can act was never there.
const TOO_SOON: Duration = Duration::from_millis(300);
/// After this long the window no longer waits: the service behind the dialog may have hung.
const GIVE_UP: Duration = Duration::from_mins(3);

/// What a dialog gave: a path, nothing where it was cancelled, or why there is no dialog.
type Answer = Result<Option<PathBuf>, String>;

/// A dialog that was asked for.
#[derive(Debug)]
pub(super) struct FileDialog {
    answer: Receiver<Option<PathBuf>>,
    opened: Instant,
    /// What its answer causes.
    command: fn(Answer) -> Command,
}

impl FileDialog {
    /// Asks the system by `ask`, which may take long; `ctx` is woken when there is an answer.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(super) fn open(
        ctx: &Context,
        ask: impl FnOnce() -> Option<PathBuf> + Send + 'static,
        command: fn(Answer) -> Command,
    ) -> std::io::Result<Self> {
        let (sender, answer) = bounded(1);
        let ctx = ctx.clone();
        spawn("neif-dialog", 0, move || {
            if sender.send(ask()).is_ok() {
                ctx.request_repaint();
            }
        })?;
        Ok(Self {
            answer,
            opened: Instant::now(),
            command,
        })
    }

    /// What its answer causes, once there is one.
    pub(super) fn poll(&self) -> Option<Command> {
        let waited = self.opened.elapsed();
        let missing = "There is no file dialog on this system: type the path, or drop the file on the window.";
        let hung =
            "The file dialog does not answer: type the path, or drop the file on the window.";
        let answer = match self.answer.try_recv() {
            Ok(None) if waited < TOO_SOON => Err(missing.to_owned()),
            Ok(path) => Ok(path),
            Err(TryRecvError::Disconnected) => Err(missing.to_owned()),
            Err(TryRecvError::Empty) if waited > GIVE_UP => Err(hung.to_owned()),
            Err(TryRecvError::Empty) => return None,
        };
        Some((self.command)(answer))
    }
}

/// Asks where an export goes, which is `path` unless something else is chosen.
pub(super) fn ask_export(settings: &ExportSettings, path: &Path) -> Option<PathBuf> {
    let mut dialog = rfd::FileDialog::new().set_title("Export to");
    if let Some(folder) = path.ancestors().skip(1).find(|folder| folder.is_dir()) {
        dialog = dialog.set_directory(folder);
    }
    if settings.needs_folder() {
        return dialog.pick_folder();
    }
    if let Some(name) = path.file_name() {
        dialog = dialog.set_file_name(name.to_string_lossy());
    }
    let ending = settings.kind().extension();
    dialog
        .add_filter(ending.to_uppercase(), &[ending])
        .save_file()
}

/// Asks for a path for that purpose.
pub(super) fn ask(kind: Browse, purpose: PathPurpose) -> Option<PathBuf> {
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
        (PathPurpose::Masks, _) => dialog.set_title("Folder for the masks").pick_folder(),
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
