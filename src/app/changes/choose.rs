//! What several commands do: choose an environment, stand at a view.

use crate::app::state::app_state::AppState;
use crate::app::state::command::Effect;
use crate::app::state::source::EnvironmentContent;
use crate::app::state::training_state::Level;
use crate::app::viewport::camera_control::Viewpoint;

/// Chooses an environment; one that cannot be used is said and not chosen.
pub(in crate::app) fn choose_environment(
    state: &mut AppState,
    index: Option<usize>,
    effects: &mut Vec<Effect>,
) {
    state.look.environment = index;
    let Some(entry) = index.and_then(|i| state.environments.get_mut(i)) else {
        state.look.environment = None;
        return;
    };
    if let EnvironmentContent::Failed(reason) = &entry.content {
        let reason = reason.clone();
        state.look.environment = None;
        state.messages.say(Level::Error, reason);
    } else if let Some(index) = index {
        load_environment(state, index, effects);
    }
}

/// Has an environment of the list read, unless it is or will be.
pub(in crate::app) fn load_environment(
    state: &mut AppState,
    index: usize,
    effects: &mut Vec<Effect>,
) {
    if let Some(entry) = state.environments.get_mut(index)
        && matches!(entry.content, EnvironmentContent::NotLoaded)
    {
        entry.content = EnvironmentContent::Loading;
        effects.push(Effect::LoadEnvironment(index));
    }
}

/// Puts the camera where a photo was taken.
pub(in crate::app) fn go_to_view(state: &mut AppState, index: usize) {
    if let Some(view) = state.view_at(index) {
        state.view.viewpoint = Viewpoint::of_camera(&view.camera, state.view.viewpoint.pivot);
        state.view.at_view = Some(index);
        state.view.was_moved = true;
    }
}

/// Goes to the nearest photo unless the camera stands at one; false, and said, where there is none.
pub(super) fn stand_at_photo(state: &mut AppState) -> bool {
    if state.view.at_view.is_none() {
        let Some(index) = state.nearest_view() else {
            let words = "There is no photo to compare with";
            state.messages.say(Level::Info, words);
            return false;
        };
        go_to_view(state, index);
    }
    true
}

/// Training time for the next run, seconds.
pub(super) fn set_budget(state: &mut AppState, secs: f64) {
    state.watch.budget_secs = secs.clamp(5.0, 86_400.0);
}
