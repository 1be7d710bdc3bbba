//! The way in: [`apply`] changes plain state by a command; what needs threads, files or the system comes back as an
//! [`Effect`], which the window carries out.

use glam::Vec2;

use super::choose::{choose_environment, go_to_view, set_budget, stand_at_photo};
use super::paths::apply_path;
use super::{export, history, inspect, leaving, lighting, palette, preferences, saving, watch};
use crate::app::lighting::standing;
use crate::app::object::{self, ObjectCommand, ObjectState};
use crate::app::session::leaving::Goal;
use crate::app::state::app_state::{AppState, Compare, Overlays};
use crate::app::state::command::{Command, Effect, Train};
use crate::app::state::history::HistoryCommand;
use crate::app::state::look::Look;
use crate::app::state::training_state::{Level, Phase};
use crate::app::state::watch::Comparison;
use crate::app::viewport::camera_control::CameraMove;
use crate::train::session::events::TrainCommand;
use crate::train::session::plan::Budget;

/// Changes the state by a command; `effects` gets what remains to be done.
pub fn apply(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    let before = history::before(state, &command);
    dispatch(state, command, effects);
    if state.is_original_shown && state.look == Look::default() {
        state.is_original_shown = false;
    }
    history::after(state, before);
}

fn dispatch(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    match command {
        Command::Open(path) => leaving::go(state, Goal::Open(path), effects),
        Command::OpenDemo => leaving::go(state, Goal::OpenDemo, effects),
        Command::AskPath(_)
        | Command::ClosePathDialog
        | Command::TypePath(_)
        | Command::UseTypedPath
        | Command::Browse(_)
        | Command::Browsed(_) => apply_path(state, command, effects),
        Command::Train(train) => apply_train(state, train, effects),
        Command::SetPace(pace) => {
            state.pace = pace;
            effects.push(Effect::UseThreads(pace.threads()));
        }
        Command::SetBudget(secs) => set_budget(state, secs),
        Command::SetAutoStart(on) => state.preferences.is_auto_start = on,
        Command::Edit(edit) => state.look.edit = edit,
        Command::MoveEnvironment(transform) => state.look.transform = transform,
        Command::MatchExposure => effects.push(Effect::MatchExposure),
        Command::PutOnFloor => standing::put_on_floor(state, effects),
        Command::StopImport(index) => effects.push(Effect::StopImport(index)),
        Command::ChooseEnvironment(index) => choose_environment(state, index, effects),
        Command::Lighting(command) => lighting::apply(state, command),
        Command::ShowOriginal(on) => state.is_original_shown = on,
        Command::ShowLayer(layer) => state.layer = layer,
        Command::SetWipe(at) if at.is_none() || stand_at_photo(state) => {
            state.compare.wipe = at.map(|at| at.clamp(0.0, 1.0));
            state.compare.with_photo = Comparison::Off;
        }
        Command::HoldPhoto(on) if !on || stand_at_photo(state) => state.compare.is_photo_held = on,
        Command::SetWipe(_) | Command::HoldPhoto(_) => {}
        Command::Export(command) => export::apply(state, command, effects),
        Command::ToggleFullScreen => state.is_full_screen ^= true,
        Command::ToggleHelp => state.overlays.is_help_open ^= true,
        Command::ToggleLog => state.preferences.is_log_open ^= true,
        Command::CloseOverlays => close_front(state),
        Command::Inspect(command) => inspect::apply(state, command),
        Command::Dismiss(index) => state.messages.dismiss(index),
        Command::Watch(command) => watch::apply(state, command),
        Command::Palette(command) => {
            if let Some(chosen) = palette::apply(state, command) {
                apply(state, chosen, effects);
            }
        }
        Command::Object(command) => object::changes::apply(state, command, effects),
        Command::History(command) if state.object.is_open => {
            let command = match command {
                HistoryCommand::Undo => ObjectCommand::Undo,
                HistoryCommand::Redo => ObjectCommand::Redo,
            };
            object::changes::apply(state, command, effects);
        }
        Command::History(command) => history::apply(state, command, effects),
        Command::Session(command) => saving::apply(state, command, effects),
        Command::Leaving(command) => leaving::apply(state, command, effects),
        Command::Preferences(command) => preferences::apply(state, command),
        Command::MoveCamera(movement) => move_camera(state, movement),
        Command::SetUp(up) => {
            state.view.up = up;
            move_camera(state, CameraMove::Level);
        }
        Command::PivotAt { at, window } => set_pivot(state, at, window),
        Command::GoToView(index) => go_to_view(state, index),
        Command::StepView(by) => step_view(state, by),
        Command::FrameObject => {
            if let Some(bounds) = state.view.bounds {
                state.view.viewpoint.frame(&bounds);
                leave_view(state);
            }
        }
        Command::ResetView => {
            state.view.viewpoint = state.view.home;
            state.view.was_moved = true;
            state.view.at_view = state.view_at(0).is_some().then_some(0);
        }
    }
}

/// Closes the windows over the main one; where there is none, forgets the picked point.
fn close_front(state: &mut AppState) {
    if state.overlays != Overlays::default() {
        state.overlays = Overlays::default();
    } else if state.export.is_open {
        state.export.is_open = false;
    } else if state.preferences.is_log_open {
        state.preferences.is_log_open = false;
    } else if state.object.is_open {
        // What was drawn is not lost to a key.
        if state.object.strokes.is_empty() {
            state.object = ObjectState::default();
        }
    } else {
        state.inspect.forget();
    }
    state.leaving = None;
}

fn apply_train(state: &mut AppState, train: Train, effects: &mut Vec<Effect>) {
    let phase = &state.training.phase;
    match train {
        Train::Start => effects.push(Effect::StartTraining),
        Train::PauseOrResume if *phase == Phase::Paused => {
            effects.push(Effect::Train(TrainCommand::Resume));
        }
        Train::PauseOrResume if *phase == Phase::Training => {
            effects.push(Effect::Train(TrainCommand::Pause));
        }
        Train::Step if matches!(phase, Phase::Training | Phase::Paused) => {
            effects.push(Effect::Train(TrainCommand::StepOnce));
        }
        Train::Extend(secs) if phase.takes_commands() => {
            effects.push(Effect::Train(TrainCommand::Extend(Budget::Seconds(secs))));
            if matches!(phase, Phase::Finished(_)) {
                state.training.phase = Phase::Training;
            }
        }
        Train::Stop if state.training.is_unsaved() && phase.takes_commands() => {
            state.overlays.is_stop_asked = true;
        }
        Train::Stop | Train::StopForSure => {
            state.overlays.is_stop_asked = false;
            effects.push(Effect::Train(TrainCommand::Stop));
        }
        Train::PauseOrResume | Train::Step | Train::Extend(_) => {}
    }
}

fn move_camera(state: &mut AppState, movement: CameraMove) {
    state.view.viewpoint.apply(movement, state.view.up);
    leave_view(state);
}

fn step_view(state: &mut AppState, by: isize) {
    // Away from all views, the first press goes to the nearest.
    let (from, by) = match state.view.at_view {
        Some(at) => (at, by),
        None => (state.nearest_view().unwrap_or(0), 0),
    };
    let n = state.views().count() as isize;
    if n > 0 {
        go_to_view(state, (from as isize + by).rem_euclid(n) as usize);
    }
}

fn leave_view(state: &mut AppState) {
    state.view.at_view = None;
    state.view.was_moved = true;
    state.compare = Compare::default();
}

fn set_pivot(state: &mut AppState, at: Vec2, window: (u32, u32)) {
    match state.hit_at(at, window) {
        Some(hit) => state.view.viewpoint.pivot = hit.position,
        None if state.object().is_some() => state.messages.say(
            Level::Info,
            "Double-click the object to turn about that point",
        ),
        None => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::work::pace::Pace;
    use crate::train::session::handle::Threads;

    #[test]
    fn a_chosen_pace_is_kept_and_training_hears_of_it() {
        let (mut state, mut effects) = (AppState::default(), Vec::new());
        apply(&mut state, Command::SetPace(Pace::Responsive), &mut effects);
        assert_eq!(state.pace, Pace::Responsive);
        assert_eq!(effects, [Effect::UseThreads(Threads::OneFewer)]);
    }
}
