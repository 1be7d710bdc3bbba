//! The session as it is now, written every few seconds, so that a window that did not end properly
//! can be brought back.
//!
//! Each open window has a slot of its own: a file beside a lock that the system takes away when the
//! program ends, however it ends. A slot that nobody holds and that still has its file was left behind.

use std::fs::File;
use std::path::{Path, PathBuf};

use directories::ProjectDirs;

use super::session_file::{EXTENSION, SessionFile};
use crate::app::state::app_state::AppState;
use crate::app::state::look::Look;
use crate::app::state::source::Source;
use crate::app::work::keeper::{Keep, Keeper};

/// Time between two looks at whether something has changed, in seconds.
const INTERVAL_SECS: f64 = 10.0;
/// Windows that may be open at once; more are not saved.
const MAX_SLOTS: usize = 16;

/// A window's own file.
#[derive(Debug)]
struct Slot {
    file: PathBuf,
    /// Held while the window is open.
    _lock: File,
}

/// Saves the session every few seconds.
#[derive(Debug, Default)]
pub(in crate::app) struct Autosave {
    slot: Option<Slot>,
    written: Option<SessionFile>,
    looked_secs: f64,
}

impl Autosave {
    /// In the folder for the program's data; does nothing where there is none.
    pub(in crate::app) fn new() -> Self {
        let dirs = ProjectDirs::from("", "", "neif");
        dirs.map_or_else(Self::default, |dirs| Self::in_folder(dirs.data_local_dir()))
    }

    /// In this folder.
    pub(in crate::app) fn in_folder(folder: &Path) -> Self {
        if let Err(error) = std::fs::create_dir_all(folder) {
            tracing::warn!("{}: no autosave: {error}", folder.display());
        }
        let slots =
            || (0..MAX_SLOTS).map(move |i| folder.join(format!("autosave-{i}.{EXTENSION}")));
        // What was left behind is taken up first.
        let left_behind = slots().filter(|file| file.exists());
        let slot = left_behind.chain(slots()).find_map(Slot::take);
        Self {
            slot,
            ..Self::default()
        }
    }

    /// The file that an earlier window has left behind, if there is one.
    pub(in crate::app) fn left_behind(&self) -> Option<&Path> {
        let file = self.slot.as_ref().map(|slot| slot.file.as_path());
        file.filter(|file| file.exists())
    }

    /// Saves what has changed, if it is time; else the seconds until then.
    pub(in crate::app) fn look(&mut self, state: &AppState, keeper: &Keeper) -> Option<f64> {
        let slot = self.slot.as_ref()?;
        let wait = self.looked_secs + INTERVAL_SECS - state.messages.now_secs;
        if wait > 0.0 {
            return Some(wait);
        }
        self.looked_secs = state.messages.now_secs;
        let is_edited = state.look != Look::default() || state.view.was_moved;
        if state.source == Source::Nothing || !(is_edited || self.written.is_some()) {
            return None;
        }
        let session = SessionFile::of(state, state.training.saved.clone());
        if self.written.as_ref() != Some(&session) {
            keeper.keep(&slot.file, Keep::Write(session.to_text()));
            self.written = Some(session);
        }
        None
    }

    /// The window ends properly: nothing is left behind but what was offered and not answered.
    pub(in crate::app) fn end(&self, state: &AppState, keeper: &Keeper) {
        if let Some(slot) = &self.slot {
            let unanswered = state.session.recovery.as_ref();
            let keep = unanswered.map_or(Keep::Remove, |session| Keep::Write(session.to_text()));
            keeper.keep(&slot.file, keep);
        }
    }
}

impl Slot {
    /// The slot with this file, unless another window has it.
    fn take(file: PathBuf) -> Option<Self> {
        let lock = File::create(file.with_extension("lock")).ok()?;
        lock.try_lock().ok()?;
        Some(Self { file, _lock: lock })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_window_leaves_behind_is_found_by_the_next_and_not_by_one_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = Keeper::new(|| {}).unwrap();
        let mut state = AppState {
            source: Source::Capture("/data/mug".into()),
            ..AppState::default()
        };
        let mut first = Autosave::in_folder(folder.path());
        state.messages.now_secs = 11.0;
        assert_eq!(first.look(&state, &keeper), None);
        state.look.edit.tint_scale = 0.5;
        assert_eq!(first.look(&state, &keeper), Some(10.0), "not yet");
        state.messages.now_secs = 22.0;
        first.look(&state, &keeper);
        drop(keeper);
        let beside = Autosave::in_folder(folder.path());
        assert_eq!(beside.left_behind(), None, "the first window is still open");
        drop((first, beside));
        let next = Autosave::in_folder(folder.path());
        let left = SessionFile::read(next.left_behind().unwrap()).unwrap();
        assert_eq!(left.material.tint_scale, 0.5);
        let keeper = Keeper::new(|| {}).unwrap();
        next.end(&state, &keeper);
        drop(keeper);
        assert_eq!(next.left_behind(), None, "it ended properly");
    }
}
