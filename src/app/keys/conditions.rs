//! When a line of the table of commands can be used, and commands that depend on the state.

use egui::{Key, Modifiers};

use super::binding::{Binding, CAMERA, LAYERS, key};
use crate::app::lighting::LightingCommand;
use crate::app::state::app_state::AppState;
use crate::app::state::command::Command;
use crate::app::state::source::Source;
use crate::app::state::training_state::Phase;
use crate::app::state::watch::{Comparison, WatchCommand};

pub(super) const fn layer(
    keys: &'static str,
    number: Key,
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    key(LAYERS, (keys, Modifiers::NONE, number), what, command)
}

pub(super) const fn from(
    (keys, number): (&'static str, Key),
    what: &'static str,
    command: fn(&AppState) -> Command,
) -> Binding {
    key(CAMERA, (keys, Modifiers::COMMAND, number), what, command)
}

/// Switches a comparison on, or off where it is on.
pub(super) fn compare(state: &AppState, with: Comparison) -> Command {
    let is_on = state.compare.with_photo == with;
    Command::Watch(WatchCommand::Compare(if is_on {
        Comparison::Off
    } else {
        with
    }))
}

pub(super) fn has_photos(state: &AppState) -> bool {
    state.view_at(0).is_some()
}

pub(super) fn is_something_open(state: &AppState) -> bool {
    state.source != Source::Nothing
}

pub(super) fn is_running(state: &AppState) -> bool {
    matches!(state.training.phase, Phase::Training | Phase::Paused)
}

pub(super) fn can_start(state: &AppState) -> bool {
    let phase = &state.training.phase;
    let is_idle = matches!(phase, Phase::Idle | Phase::Finished(_) | Phase::Failed(_));
    is_idle && !phase.takes_commands() && state.source.is_trainable()
}

/// The picture brighter by so many stops, its light as it is.
pub(super) fn expose(state: &AppState, by_ev: f32) -> Command {
    let ev = state.lighting.display_ev + by_ev;
    Command::Lighting(LightingCommand::SetDisplayEv(ev))
}
