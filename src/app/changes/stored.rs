//! Between the window and what is stored of it: looks and sessions.

use std::path::{Path, PathBuf};

use super::choose::load_environment;
use crate::app::session::session_file::{
    SavedCamera, SavedKey, SavedSource, SessionFile, SourceKind, VERSION,
};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Effect;
use crate::app::state::look::{Look, StoredLook};
use crate::app::state::source::Source;
use crate::data::View;

impl SavedCamera {
    fn of(state: &AppState) -> Self {
        let view = state.view.at_view.and_then(|i| state.view_at(i));
        Self {
            view: view.map(View::full_name),
            ..Self::of_viewpoint(&state.view.viewpoint)
        }
    }
}

impl SessionFile {
    /// The session as it is; `run` is where its training is saved, if it is.
    pub fn of(state: &AppState, run: Option<PathBuf>) -> Self {
        let kind = match state.source {
            Source::Nothing => None,
            Source::Demo(_) => Some(SourceKind::Demo),
            Source::Capture(_) => Some(SourceKind::Capture),
            Source::Run(_) => Some(SourceKind::Run),
            Source::Environment(_) => Some(SourceKind::Environment),
        };
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let look = StoredLook::of(state, &state.look);
        Self {
            version: VERSION,
            layer: state.layer,
            budget_secs: state.watch.budget_secs,
            wipe: state.compare.wipe,
            environment: look.environment.map(|path| absolute(&path)),
            source: kind
                .zip(state.source.path())
                .map(|(kind, path)| SavedSource {
                    kind,
                    path: absolute(path),
                    run: run.map(|run| absolute(&run)),
                }),
            background: state.lighting.background,
            display_ev: state.lighting.display_ev,
            tone_map: state.lighting.tone_map,
            removed: state.removed_environments().map(absolute).collect(),
            regions: state.look.regions,
            material: state.look.edit,
            transform: state.look.transform,
            camera: state.view.was_moved.then(|| SavedCamera::of(state)),
            kept: state.lighting.kept.map(|kept| StoredLook::of(state, &kept)),
            keys: state.export.keys.iter().map(SavedKey::of).collect(),
            panels: state.preferences.panels,
        }
    }
}

impl StoredLook {
    /// A look of this state.
    pub fn of(state: &AppState, look: &Look) -> Self {
        let entry = look.environment.and_then(|i| state.environments.get(i));
        Self {
            environment: entry.map(|entry| entry.path.clone()),
            regions: look.regions,
            material: look.edit,
            transform: look.transform,
        }
    }

    /// The look, its environment put on the list and read where it is not.
    pub fn to_look(&self, state: &mut AppState, effects: &mut Vec<Effect>) -> Look {
        let path = self.environment.as_ref();
        let environment = path.map(|path| state.environment_of_file(path));
        if let Some(index) = environment {
            load_environment(state, index, effects);
        }
        Look {
            edit: self.material,
            regions: self.regions,
            transform: self.transform,
            environment,
        }
    }
}
