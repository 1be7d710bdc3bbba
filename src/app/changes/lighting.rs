//! What seeing, grabbing and comparing the environment do.

use glam::{Vec2, Vec3};

use crate::app::lighting::anchor::{anchor, object_size};
use crate::app::lighting::gizmo::{Grab, Snap};
use crate::app::lighting::{LARGEST_DISPLAY_EV, LightingCommand};
use crate::app::state::app_state::{AppState, Compare};
use crate::app::state::source::EnvironmentContent;
use crate::app::state::training_state::Level;
use crate::geometry::Ray;
use crate::neif::EnvironmentTransform;
use crate::render::{Support, motion_between};

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

/// Stands the object on what the shown environment has at a pixel; false where that is nothing. The camera goes with the
/// environment: in the picture, the object moves.
fn set_down(state: &mut AppState, at: Vec2, window: (u32, u32)) -> bool {
    let ray = state.window_camera(window).ray(at.x, at.y);
    let before = state.look.transform;
    let Some(after) = stood_on(state, &ray) else {
        return false;
    };
    let moved = motion_between(&before, &after);
    let pivot = anchor(state);
    let viewpoint = &mut state.view.viewpoint;
    viewpoint.camera.world_from_camera = moved * viewpoint.camera.world_from_camera;
    viewpoint.pivot = pivot;
    state.view.at_view = None;
    state.view.was_moved = true;
    state.look.transform = after;
    true
}

/// Stands the object on what is below the middle of the shown environment, if anything.
pub(in crate::app) fn set_down_in_the_middle(state: &mut AppState) {
    let Some(environment) = state.shown_environment() else {
        return;
    };
    let motion = state.look.transform.environment_from_world();
    let ray = Ray {
        origin: motion.world_point(environment.inner_box().center()),
        direction: motion.world_direction(-environment.up()),
    };
    if let Some(after) = stood_on(state, &ray) {
        state.look.transform = after;
    }
}

/// The transform with which the object stands on what a ray meets, world coordinates.
fn stood_on(state: &AppState, ray: &Ray) -> Option<EnvironmentTransform> {
    let before = &state.look.transform;
    let motion = before.environment_from_world();
    let inside = Ray {
        origin: motion.point(ray.origin),
        direction: motion.direction(ray.direction),
    };
    let support = Support::met_by(state.shown_environment()?, &inside)?;
    let up = state.view.up;
    Some(support.under(foot(state, up), up, before))
}

/// The middle of the object's underside; without an object, what the camera turns about.
fn foot(state: &AppState, up: Vec3) -> Vec3 {
    let middle = anchor(state);
    let heights = state.object().map(|object| {
        let positions = object.tracer.mesh().positions.iter();
        positions.map(|p| p.dot(up)).fold(f32::INFINITY, f32::min)
    });
    heights.map_or(middle, |lowest| middle + (lowest - middle.dot(up)) * up)
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
    use crate::app::viewport::camera_control::Viewpoint;
    use crate::neif::{Environment, MaterialEdit};
    use crate::render::test_scene::{environment, fog_above};

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

    /// A state lit by a floor at -0.5, seen from above.
    fn above_a_floor() -> AppState {
        let mut state = state();
        state.look.environment = Some(add(&mut state, fog_above(-0.5)));
        state.look.transform.rotate_deg.z = 30.0;
        let eye = Vec3::new(0.2, -0.3, 0.4);
        state.view.viewpoint = Viewpoint::look_at(eye, Vec3::new(0.1, 0.0, -0.5), Vec3::Z);
        state
    }

    /// Where the ray of a pixel is in the environment.
    fn inside(state: &AppState, at: Vec2) -> [Vec3; 2] {
        let ray = state.window_camera((400, 300)).ray(at.x, at.y);
        let motion = state.look.transform.environment_from_world();
        [motion.point(ray.origin), motion.direction(ray.direction)]
    }

    #[test]
    fn the_object_is_set_down_under_the_pointer_while_the_picture_stays_still() {
        let mut state = above_a_floor();
        let (at, window) = (Vec2::new(170.0, 190.0), (400, 300));
        let corner = Vec2::new(11.0, 7.0);
        let before = [inside(&state, at), inside(&state, corner)];
        apply(&mut state, LightingCommand::SetDown { at, window });
        let after = [inside(&state, at), inside(&state, corner)];
        for (before, after) in before.as_flattened().iter().zip(after.as_flattened()) {
            assert!((*before - *after).length() < 1e-3, "{before} and {after}");
        }
        let foot = foot(&state, Vec3::Z);
        let seen = state.window_camera(window).project(foot).unwrap();
        assert!((seen - at).length() < 8.0, "the foot is at {seen}");
        assert_eq!(
            state.view.viewpoint.pivot,
            anchor(&state),
            "it turns about the object"
        );
    }

    #[test]
    fn where_nothing_is_nothing_moves_and_it_is_said() {
        let mut state = above_a_floor();
        state.look.environment = None;
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

    #[test]
    fn an_imported_scan_has_the_object_on_what_is_below_its_middle() {
        let mut state = above_a_floor();
        set_down_in_the_middle(&mut state);
        let motion = state.look.transform.environment_from_world();
        let foot = motion.point(foot(&state, Vec3::Z));
        assert!((foot.z + 0.5).abs() < 0.05, "on the floor: {foot}");
        assert!(foot.truncate().length() < 0.05, "in the middle: {foot}");
    }
}
