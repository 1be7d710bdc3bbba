//! What becomes of a path that is typed, or chosen in the system's dialog.

use std::path::PathBuf;

use super::ask_path::ask;
use super::leaving;
use crate::app::session::leaving::Goal;
use crate::app::session::session_file::EXTENSION;
use crate::app::state::app_state::{AppState, PathPurpose};
use crate::app::state::command::{Command, Effect};
use crate::train::session::events::TrainCommand;

pub(super) fn apply_path(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    match (command, &mut state.overlays.path_dialog) {
        (Command::AskPath(purpose), _) => ask(state, purpose),
        (Command::ClosePathDialog, dialog) => *dialog = None,
        (Command::TypePath(typed), Some(dialog)) => {
            dialog.typed = typed;
            dialog.note = None;
        }
        (Command::UseTypedPath, Some(dialog)) => {
            let path = PathBuf::from(dialog.typed.trim());
            use_path(state, path, effects);
        }
        (Command::Browse(kind), Some(dialog)) => {
            dialog.is_browsing = true;
            dialog.note = None;
            effects.push(Effect::Browse(kind, dialog.purpose));
        }
        (Command::Browsed(result), Some(dialog)) => {
            dialog.is_browsing = false;
            match result {
                Ok(Some(path)) => use_path(state, path, effects),
                Ok(None) => {}
                Err(reason) => dialog.note = Some(reason),
            }
        }
        _ => {}
    }
}

fn use_path(state: &mut AppState, path: PathBuf, effects: &mut Vec<Effect>) {
    let Some(dialog) = &mut state.overlays.path_dialog else {
        return;
    };
    if path.as_os_str().is_empty() {
        dialog.note = Some("Type a path first.".to_owned());
        return;
    }
    let purpose = dialog.purpose;
    state.overlays.path_dialog = None;
    match purpose {
        PathPurpose::Open => leaving::go(state, Goal::Open(path), effects),
        PathPurpose::Save => {
            leaving::save_began(state);
            effects.push(Effect::Train(TrainCommand::Save(path)));
        }
        PathPurpose::AddEnvironment => effects.push(Effect::AddEnvironment(path)),
        PathPurpose::Masks => effects.push(Effect::SaveMasks(path)),
        PathPurpose::Log => effects.push(Effect::WriteLog(path)),
        PathPurpose::SaveSession => {
            let has_extension = path.extension().is_some_and(|ending| ending == EXTENSION);
            effects.push(Effect::SaveSession(if has_extension {
                path
            } else {
                path.with_added_extension(EXTENSION)
            }));
        }
    }
}
