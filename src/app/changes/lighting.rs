//! What seeing, grabbing and comparing the environment do.

use glam::Vec2;

use crate::app::lighting::anchor::{anchor, object_size};
use crate::app::lighting::gizmo::{Grab, Snap};
use crate::app::lighting::standing::set_down;
use crate::app::lighting::{LARGEST_DISPLAY_EV, LightingCommand};
use crate::app::state::app_state::{AppState, Compare};
use crate::app::state::source::EnvironmentContent;
use crate::app::state::training_state::Level;

/// Changes the state by a command.
pub(super) fn apply(state: &mut AppState, command: LightingCommand) {
    match command {
        LightingCommand::SetBackground(background) => state.lighting.background = background,
        LightingCommand::SetDisplayEv(ev) => {
            state.lighting.display_ev = ev.clamp(-LARGEST_DISPLAY_EV, LARGEST_DISPLAY_EV);
        }
        LightingCommand::SetToneMap(map) => state.lighting.tone_map = map,
        LightingCommand::ToggleGizmo => {
            state.lighting.is_gizmo_shown ^= true;
            state.lighting.grab = None;
        }
        LightingCommand::ToggleSettingDown => state.lighting.is_setting_down ^= true,
        LightingCommand::SetDown { at, window } => {
            if !set_down(state, at, window) {
                let said = "There is nothing to stand on";
                state.messages.say(Level::Info, said);
            }
        }
        LightingCommand::Grab {
            handle,
            at,
            window,
            arrow_px,
        } => {
            state.lighting.grab = Some(Grab {
                handle,
                start: state.look.transform,
                anchor: anchor(state),
                camera: state.window_camera(window),
                arrow_px,
                at,
            });
        }
        LightingCommand::Drag { at, is_snapped } => drag(state, at, is_snapped),
        LightingCommand::LetGo => state.lighting.grab = None,
        LightingCommand::ToggleLines => state.lighting.are_lines_shown ^= true,
        LightingCommand::Remove(index) => remove(state, index),
        LightingCommand::ToggleSplit => {
            state.lighting.kept.get_or_insert(state.look);
            state.lighting.split = state.lighting.split.is_none().then_some(0.5);
            // One line at a time.
            state.compare = Compare::default();
        }
        LightingCommand::MoveSplit(at) => {
            state.lighting.kept.get_or_insert(state.look);
            state.lighting.split = Some(at.clamp(0.0, 1.0));
        }
        LightingCommand::SwapSides => {
            let kept = state.lighting.kept.get_or_insert(state.look);
            std::mem::swap(kept, &mut state.look);
        }
        LightingCommand::CopyToB => state.lighting.kept = Some(state.look),
    }
}

fn drag(state: &mut AppState, at: Vec2, is_snapped: bool) {
    let snap = is_snapped.then(|| Snap::for_object(object_size(state)));
    if let Some(moved) = (state.lighting.grab.as_ref()).and_then(|grab| grab.dragged_to(at, snap)) {
        state.look.transform = moved;
    }
}

fn remove(state: &mut AppState, index: usize) {
    let Some(entry) = state.environments.get_mut(index) else {
        return;
    };
    // One that is being read stays so; it is not chosen when it comes.
    if !matches!(entry.content, EnvironmentContent::Loading) {
        entry.content = EnvironmentContent::NotLoaded;
    }
    state.lighting.removed.insert(index);
    for look in std::iter::once(&mut state.look).chain(&mut state.lighting.kept) {
        look.environment.take_if(|chosen| *chosen == index);
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use super::*;
    use crate::app::state::app_state::tests::snapshot;
    use crate::app::state::look::Look;
    use crate::app::state::source::EnvironmentEntry;
    use crate::neif::{Environment, MaterialEdit};
    use crate::render::test_scene::environment;

    fn state() -> AppState {
        AppState {
            snapshot: Some(snapshot(1)),
            ..AppState::default()
        }
    }

    fn add(state: &mut AppState, environment: Arc<Environment>) -> usize {
        state.environments.push(EnvironmentEntry {
            name: "other".to_owned(),
            path: PathBuf::from("/other.safetensors"),
            about: String::new(),
            content: EnvironmentContent::Ready(environment),
        });
        state.environments.len() - 1
    }

    #[test]
    fn a_run_s_own_file_chosen_from_the_list_is_the_light_it_was_trained_in() {
        let mut state = state();
        let own = Environment::clone(&state.snapshot.as_ref().unwrap().environment);
        state.look.environment = Some(add(&mut state, Arc::new(own)));
        assert!(state.scene().unwrap().has_own_light(), "read again");
        state.look.environment = Some(add(&mut state, environment(77)));
        assert!(!state.scene().unwrap().has_own_light(), "another one");
    }

    #[test]
    fn what_was_seen_is_kept_as_b_and_edits_go_to_a() {
        let mut state = state();
        apply(&mut state, LightingCommand::ToggleSplit);
        state.look.edit.tint_scale = 0.25;
        let snapshot = state.snapshot.clone().unwrap();
        let a = state.scene_of(&snapshot);
        let b = state.kept_scene_of(&snapshot).unwrap();
        assert_eq!((a.edit.tint_scale, b.edit.tint_scale), (0.25, 1.0));
        apply(&mut state, LightingCommand::SwapSides);
        assert_eq!(state.look.edit, MaterialEdit::default());
        apply(&mut state, LightingCommand::CopyToB);
        assert_eq!(state.lighting.kept, Some(state.look));
        apply(&mut state, LightingCommand::ToggleSplit);
        assert_eq!(state.lighting.split, None);
    }

    #[test]
    fn a_removed_environment_lights_nothing_and_leaves_the_others_their_places() {
        let mut state = state();
        let first = add(&mut state, environment(5));
        let second = add(&mut state, environment(6));
        state.look.environment = Some(first);
        state.lighting.kept = Some(Look {
            environment: Some(second),
            ..Look::default()
        });
        apply(&mut state, LightingCommand::Remove(first));
        assert_eq!(state.look.environment, None);
        assert_eq!(state.lighting.kept.unwrap().environment, Some(second));
        assert!(state.scene().unwrap().has_own_light(), "back to its own");
    }

    #[test]
    fn where_nothing_is_nothing_moves_and_it_is_said() {
        let mut state = state();
        state.snapshot = None;
        let before = state.look;
        let (at, window) = (Vec2::new(170.0, 190.0), (400, 300));
        apply(&mut state, LightingCommand::SetDown { at, window });
        assert_eq!(state.look, before, "nothing moves");
        let mut said = state.messages.all();
        assert!(
            said.any(|m| m.text.contains("nothing to stand on")),
            "it is said"
        );
    }
}
