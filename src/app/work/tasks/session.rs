//! Saving the session, and opening a saved one step by step: its source first, the rest once that is open.

use std::path::{Path, PathBuf};

use super::{News, Work};
use crate::app::assets;
use crate::app::changes::saving::{bring_back, bring_back_window};
use crate::app::session::saving::Pending;
use crate::app::session::session_file::{SavedSource, SessionFile, SourceKind};
use crate::app::state::app_state::AppState;
use crate::app::state::source::Source;
use crate::app::state::training_state::Level;
use crate::train::session::events::TrainCommand;

impl Work {
    /// Writes the session, and the run beside it where its training is not saved yet.
    pub(super) fn save_session(&self, state: &mut AppState, file: PathBuf) {
        let mut run = state.training.saved.clone();
        let is_kept_anyway = matches!(state.source, Source::Run(_));
        if state.training.phase.takes_commands() && state.training.is_unsaved() && !is_kept_anyway {
            let folder = run.unwrap_or_else(|| free_run_folder(&file));
            self.send(state, TrainCommand::Save(folder.clone()));
            run = Some(folder);
        }
        let session = SessionFile::of(state, run);
        self.keeper
            .save(&file, session.to_text(), "Session saved to");
        self.remember(state, &file);
        state.session.file = Some(file);
    }

    /// Takes in what has been written since the last frame.
    pub(super) fn poll_keeper(&self, state: &mut AppState) {
        while let Some(ending) = self.keeper.next() {
            match ending {
                Ok(Some(text)) => state.messages.say(Level::Info, text),
                Ok(None) => {}
                Err(reason) => state.messages.say(Level::Error, reason),
            }
        }
    }

    /// Begins to bring a session back; `file` is where it was saved.
    pub(super) fn open_session(
        &mut self,
        state: &mut AppState,
        session: Box<SessionFile>,
        file: Option<PathBuf>,
    ) -> Option<News> {
        if let Some(file) = &file {
            self.remember(state, file);
        }
        let source = session.source.clone();
        bring_back_window(state, &session);
        state.session.pending = Some(Pending { session, file });
        source.and_then(|source| self.open_source(state, &source))
    }

    fn open_source(&mut self, state: &mut AppState, source: &SavedSource) -> Option<News> {
        let run = source.run.as_ref().filter(|run| run.exists());
        let path = run.unwrap_or(&source.path);
        if source.run.is_some() && run.is_none() {
            let text = format!(
                "The session's trained run is gone: {}",
                missing(source.run.as_deref())
            );
            state.messages.say(Level::Warning, text);
        }
        match source.kind {
            SourceKind::Demo if run.is_none() => {
                let path = assets::demo()?;
                Some(self.open_capture(state, Source::Demo(path)))
            }
            _ if !path.exists() => {
                let text = format!(
                    "What the session shows is gone: {}\nopen it where it is now, and the session's edits come back",
                    missing(Some(path))
                );
                state.messages.say(Level::Error, text);
                None
            }
            SourceKind::Capture if run.is_none() => {
                Some(self.open_capture(state, Source::Capture(path.clone())))
            }
            SourceKind::Environment => {
                self.reset(state);
                state.source = Source::Nothing;
                self.opener.open(path);
                Some(News::Reset)
            }
            SourceKind::Demo | SourceKind::Capture | SourceKind::Run => {
                self.opener.open(path);
                None
            }
        }
    }

    /// Brings the rest of a session back, now that its source is open.
    pub(super) fn bring_back_pending(&mut self, state: &mut AppState) {
        if let Some(Pending { session, file }) = state.session.pending.take() {
            let mut effects = Vec::new();
            bring_back(state, &session, &mut effects);
            state.session.file = file;
            for effect in effects {
                self.carry_out(state, effect);
            }
        }
    }
}

fn missing(path: Option<&Path>) -> String {
    let path = path.unwrap_or(Path::new("")).display();
    format!("{path}: no such file or folder")
}

/// A folder for the run beside the session's file where nothing lies yet.
fn free_run_folder(file: &Path) -> PathBuf {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let first = file.with_file_name(format!("{stem}-run"));
    let later = (2..1000).map(|i| file.with_file_name(format!("{stem}-run-{i}")));
    let mut free = std::iter::once(first.clone()).chain(later);
    free.find(|folder| !folder.exists()).unwrap_or(first)
}
