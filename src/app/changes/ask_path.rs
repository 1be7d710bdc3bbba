//! Asking for a path.

use std::path::PathBuf;

use crate::app::session::session_file::EXTENSION;
use crate::app::state::app_state::{AppState, PathDialog, PathPurpose};
use crate::app::state::source::{Source, file_name};

/// Asks for a path, with what is likely typed already.
pub(super) fn ask(state: &mut AppState, purpose: PathPurpose) {
    let folder = run_folder_for(&state.source);
    let typed = match purpose {
        PathPurpose::Open | PathPurpose::AddEnvironment => PathBuf::new(),
        PathPurpose::Save => state.training.saved.clone().unwrap_or(folder),
        PathPurpose::Log => folder.with_extension("csv"),
        PathPurpose::Masks => folder.join("masks"),
        PathPurpose::SaveSession => {
            let file = state.session.file.clone();
            file.unwrap_or_else(|| folder.with_added_extension(EXTENSION))
        }
    };
    state.overlays.path_dialog = Some(PathDialog {
        purpose,
        typed: typed.display().to_string(),
        note: None,
        is_browsing: false,
    });
}

/// Where a run is saved unless another folder is typed.
fn run_folder_for(source: &Source) -> PathBuf {
    let home = directories::UserDirs::new()
        .map_or_else(|| PathBuf::from("."), |dirs| dirs.home_dir().to_owned());
    let name = match source {
        Source::Demo(_) => "demo".to_owned(),
        _ => (source.path()).map_or("run".to_owned(), |path| file_name(path)),
    };
    home.join("neif-runs").join(name)
}
