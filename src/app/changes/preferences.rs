//! What changes of the preferences do.

use crate::app::session::preferences::{PreferencesCommand, ZOOM_STEP};
use crate::app::state::app_state::AppState;

/// Changes the preferences.
pub(in crate::app) fn apply(state: &mut AppState, command: PreferencesCommand) {
    let preferences = &mut state.preferences;
    match command {
        PreferencesCommand::Theme(theme) => preferences.theme = theme,
        PreferencesCommand::Quality(quality) => {
            preferences.quality = quality;
            state.watch.budget_secs = quality.usual_secs();
        }
        PreferencesCommand::Zoom(steps) => {
            let zoom = preferences.zoom + steps * ZOOM_STEP;
            preferences.zoom = (zoom * 10.0).round() / 10.0;
        }
        PreferencesCommand::ResetZoom => preferences.zoom = 1.0,
        PreferencesCommand::TogglePanels => {
            let is_hidden = preferences.panels.is_any_shown();
            preferences.panels.left.is_hidden = is_hidden;
            preferences.panels.right.is_hidden = is_hidden;
        }
        PreferencesCommand::TogglePanel(side) => {
            preferences.panels.side_mut(side).is_hidden ^= true;
        }
        PreferencesCommand::Resize(side, width) => {
            preferences.panels.side_mut(side).width = Some(width.round());
        }
        PreferencesCommand::Fold(section) => {
            if !preferences.folded.remove(&section) {
                preferences.folded.insert(section);
            }
        }
        PreferencesCommand::ResizeWindow(size) => {
            preferences.window = Some(size.map(f32::round));
        }
    }
    state.preferences.limit();
}
