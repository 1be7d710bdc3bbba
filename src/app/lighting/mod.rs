//! How the surroundings are seen, grabbed and compared: the part of the window's state beside the edits themselves.

pub mod gallery_pictures;
pub mod gizmo;
pub mod gizmo_ui;
pub mod lines;
pub mod lines_ui;
pub mod preview_side;
pub mod split_ui;
pub mod thumbnails;

use std::collections::BTreeSet;

use glam::{Vec2, Vec3};

use super::state::app_state::{AppState, Compare, EnvironmentContent, Look};
use crate::neif::EnvironmentTransform;
use crate::render::{Background, ToneMap};
use gizmo::{Grab, Handle, Snap};

/// Largest exposure of the picture either way, stops.
pub const LARGEST_DISPLAY_EV: f32 = 10.0;

/// What is chosen of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightingState {
    /// What stands behind the object.
    pub background: Background,
    /// Exposure of the picture, stops; the light stays.
    pub display_ev: f32,
    /// How light brighter than white is shown.
    pub tone_map: ToneMap,
    /// Whether the surroundings can be grabbed in the picture.
    pub is_gizmo_shown: bool,
    /// The handle that is held.
    pub grab: Option<Grab>,
    /// Whether axes and bounds are drawn.
    pub are_lines_shown: bool,
    /// The line between A and B, 0 (left) to 1 (right) of the viewport; none shows A alone.
    pub split: Option<f32>,
    /// B: the look that is kept to compare with.
    pub kept: Option<Look>,
    /// Environments taken off the list, by index: a removed one keeps its index, so that looks stay valid.
    pub removed: BTreeSet<usize>,
}

/// What may happen to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightingCommand {
    /// Choose what stands behind the object.
    SetBackground(Background),
    /// Expose the picture, in stops.
    SetDisplayEv(f32),
    /// Choose how light brighter than white is shown.
    SetToneMap(ToneMap),
    /// Show or hide the gizmo.
    ToggleGizmo,
    /// Take hold of a handle.
    Grab {
        /// Which.
        handle: Handle,
        /// Where, in pixels of the window from the top left.
        at: Vec2,
        /// Width and height in pixels.
        window: (u32, u32),
        /// Length of an arrow in pixels.
        arrow_px: f32,
    },
    /// Pull the held handle to a pixel.
    Drag {
        /// From the top left.
        at: Vec2,
        /// Whether in round steps.
        is_snapped: bool,
    },
    /// Let go of it.
    LetGo,
    /// Show or hide axes and bounds.
    ToggleLines,
    /// Take an environment off the list.
    Remove(usize),
    /// Show A and B beside each other, or A alone; what is seen is kept as B when there is none.
    ToggleSplit,
    /// Move the line between A and B.
    MoveSplit(f32),
    /// A becomes B and B becomes A.
    SwapSides,
    /// B becomes what A is.
    CopyToB,
}

/// Changes the state by a command.
pub fn apply(state: &mut AppState, command: LightingCommand) {
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
        LightingCommand::Grab {
            handle,
            at,
            window,
            arrow_px,
        } => {
            let camera = state.view.viewpoint.camera_for(window.0, window.1);
            let (start, anchor) = (state.look.transform, anchor(state));
            state.lighting.grab = Some(Grab {
                handle,
                start,
                anchor,
                camera,
                arrow_px,
                at,
            });
        }
        LightingCommand::Drag { at, is_snapped } => drag(state, at, is_snapped),
        LightingCommand::LetGo => state.lighting.grab = None,
        LightingCommand::ToggleLines => state.lighting.are_lines_shown ^= true,
        LightingCommand::Remove(index) => remove(state, index),
        LightingCommand::ToggleSplit
        | LightingCommand::MoveSplit(_)
        | LightingCommand::SwapSides
        | LightingCommand::CopyToB => apply_split(state, &command),
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
    for look in [Some(&mut state.look), state.lighting.kept.as_mut()]
        .into_iter()
        .flatten()
        .filter(|look| look.environment == Some(index))
    {
        look.environment = None;
    }
}

fn apply_split(state: &mut AppState, command: &LightingCommand) {
    let kept = state.lighting.kept.get_or_insert(state.look);
    match command {
        LightingCommand::ToggleSplit => {
            state.lighting.split = match state.lighting.split {
                Some(_) => None,
                None => Some(0.5),
            };
            // One line at a time.
            state.compare = Compare::default();
        }
        LightingCommand::MoveSplit(at) => state.lighting.split = Some(at.clamp(0.0, 1.0)),
        LightingCommand::SwapSides => std::mem::swap(kept, &mut state.look),
        LightingCommand::CopyToB => *kept = state.look,
        _ => {}
    }
}

/// The point of the environment that the gizmo holds, in its own coordinates: where the object stands in its own.
pub fn anchor(state: &AppState) -> Vec3 {
    let bounds = state.view.bounds.map(|bounds| bounds.center());
    bounds.unwrap_or(state.view.home.pivot)
}

/// Size that steps and axes are measured by, scene units: the object's diagonal, or a quarter of the surroundings'.
pub fn object_size(state: &AppState) -> f32 {
    let own = state.snapshot.as_ref();
    let surroundings = own.map(|own| 0.25 * own.environment.inner_box().diagonal());
    let object = state.view.bounds.map(|bounds| bounds.diagonal());
    object.or(surroundings).unwrap_or(1.0).max(1e-6)
}

/// Where the surroundings stand that the picture shows.
pub fn shown_transform(state: &AppState) -> EnvironmentTransform {
    if state.is_original_shown {
        EnvironmentTransform::default()
    } else {
        state.look.transform
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use super::*;
    use crate::app::state::app_state::EnvironmentEntry;
    use crate::neif::{Environment, MaterialEdit};
    use crate::render::test_scene::{environment, scene};
    use crate::train::Snapshot;

    fn state() -> AppState {
        let scene = scene();
        let snapshot = Snapshot {
            step: 1,
            object: scene.object,
            environment: scene.environment,
            exposures: None,
        };
        AppState {
            snapshot: Some(Arc::new(snapshot)),
            ..AppState::default()
        }
    }

    fn add(state: &mut AppState, environment: Arc<Environment>) -> usize {
        state.environments.push(EnvironmentEntry {
            name: "other".to_owned(),
            path: PathBuf::from("/other.safetensors"),
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
        let (a, b) = (
            state.scene_of(&snapshot),
            state.kept_scene_of(&snapshot).unwrap(),
        );
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
        let (first, second) = (
            add(&mut state, environment(5)),
            add(&mut state, environment(6)),
        );
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
}
