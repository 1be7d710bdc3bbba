//! What saving a session and bringing one back do.

use super::ask_path::ask;
use super::choose::{choose_environment, go_to_view, set_budget};
use crate::app::lighting::LARGEST_DISPLAY_EV;
use crate::app::session::saving::{SessionCommand, WantedView};
use crate::app::session::session_file::{SavedCamera, SavedKey, SessionFile};
use crate::app::state::app_state::{AppState, Compare, PathPurpose};
use crate::app::state::command::Effect;
use crate::app::state::training_state::Level;
use crate::data::View;

/// Changes the state by a command.
pub(super) fn apply(state: &mut AppState, command: SessionCommand, effects: &mut Vec<Effect>) {
    match (command, state.session.file.clone()) {
        (SessionCommand::Save, Some(file)) => effects.push(Effect::SaveSession(file)),
        (SessionCommand::Save | SessionCommand::SaveAs, _) => {
            ask(state, PathPurpose::SaveSession);
        }
        (SessionCommand::Restore, _) => {
            if let Some(session) = state.session.recovery.take() {
                effects.push(Effect::RestoreSession(session));
            }
        }
        (SessionCommand::Forget, _) => state.session.recovery = None,
    }
}

/// Brings back what a session holds beside its source, which has just been opened.
pub(in crate::app) fn bring_back(
    state: &mut AppState,
    session: &SessionFile,
    effects: &mut Vec<Effect>,
) {
    bring_back_window(state, session);
    state.look.edit = session.material;
    state.look.regions = session.regions;
    state.look.transform = session.transform;
    state.lighting.background = session.background;
    state.lighting.tone_map = session.tone_map;
    state.lighting.display_ev = session
        .display_ev
        .clamp(-LARGEST_DISPLAY_EV, LARGEST_DISPLAY_EV);
    state.export.keys = session.keys.iter().map(SavedKey::key_view).collect();
    let kept = session.kept.as_ref();
    state.lighting.kept = kept.map(|kept| kept.to_look(state, effects));
    // What is gone from the list of this program needs not be put on it to be taken off.
    state.remove_environments(&session.removed);
    state.compare = Compare::default();
    if let Some(camera) = &session.camera {
        stand_at(state, camera, session.wipe);
    }
    if let Some(path) = &session.environment {
        let index = state.environment_of_file(path);
        choose_environment(state, Some(index), effects);
    }
}

/// What has nothing to do with the source.
pub(in crate::app) fn bring_back_window(state: &mut AppState, session: &SessionFile) {
    state.layer = session.layer;
    set_budget(state, session.budget_secs);
    state.preferences.panels = session.panels;
}

fn stand_at(state: &mut AppState, camera: &SavedCamera, wipe: Option<f32>) {
    state.view.viewpoint = camera.viewpoint();
    state.view.at_view = None;
    // The capture, read later, must not put the camera elsewhere.
    state.view.was_moved = true;
    state.session.wanted_view = camera.view.clone().map(|name| WantedView { name, wipe });
    stand_at_wanted_view(state);
}

/// Goes to the view of the session's camera, if the capture is read by now; said where it has no such view.
pub(in crate::app) fn stand_at_wanted_view(state: &mut AppState) {
    if state.dataset.is_none() {
        return;
    }
    let Some(WantedView { name, wipe }) = state.session.wanted_view.take() else {
        return;
    };
    let is_wanted = |view: &View| view.full_name() == name;
    let index = state.views().position(is_wanted);
    if let Some(index) = index {
        go_to_view(state, index);
        state.compare.wipe = wipe.map(|at| at.clamp(0.0, 1.0));
    } else {
        let text = format!("The capture has no photo “{name}” any more");
        state.messages.say(Level::Warning, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::look::Look;
    use crate::app::state::source::Source;
    use crate::data::KeyView;
    use crate::render::{Background, Layer};

    #[test]
    fn a_session_brings_look_and_window_back() {
        let mut old = AppState {
            source: Source::Capture("/data/mug".into()),
            layer: Layer::Diffuse,
            ..AppState::default()
        };
        old.look.edit.tint_scale = 0.25;
        old.look.transform.exposure_ev = 2.0;
        old.look.environment = Some(old.environment_of_file("/env/hall.hdr".as_ref()));
        old.preferences.panels.left.is_hidden = true;
        old.lighting.background = Background::Blurred;
        old.lighting.display_ev = -1.5;
        old.lighting.kept = Some(Look::default());
        old.export.keys = vec![KeyView {
            camera: old.view.viewpoint.camera,
            time_secs: 2.5,
        }];
        old.view.viewpoint.pivot.x = 3.0;
        old.view.was_moved = true;
        let session = SessionFile::of(&old, None);
        let (mut new, mut effects) = (AppState::default(), Vec::new());
        bring_back(&mut new, &session, &mut effects);
        assert_eq!(effects, [Effect::LoadEnvironment(0)]);
        assert_eq!(
            (new.look, new.view.viewpoint),
            (old.look, old.view.viewpoint)
        );
        new.source = old.source;
        assert_eq!(
            SessionFile::of(&new, None),
            session,
            "the same session again"
        );
    }

    #[test]
    fn the_first_save_asks_where_to_and_later_ones_do_not() {
        let (mut state, mut effects) = (AppState::default(), Vec::new());
        apply(&mut state, SessionCommand::Save, &mut effects);
        let dialog = state.overlays.path_dialog.clone().unwrap();
        assert!(dialog.typed.ends_with(".neif-session"), "{}", dialog.typed);
        state.session.file = Some("/s.neif-session".into());
        apply(&mut state, SessionCommand::Save, &mut effects);
        assert_eq!(effects, [Effect::SaveSession("/s.neif-session".into())]);
    }
}
