//! How an object is stood on something: on the surfaces of an environment, or on a floor that a panorama is put on.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::anchor::{anchor, foot, object_size};
use crate::app::state::app_state::AppState;
use crate::app::state::command::Effect;
use crate::app::state::source::{EnvironmentContent, EnvironmentEntry};
use crate::geometry::Ray;
use crate::neif::{Environment, EnvironmentTransform};
use crate::render::{Support, motion_between};

/// Stands the object on what the shown environment has at a pixel; false where that is nothing. The camera goes with the
/// environment: in the picture, the object moves.
pub(in crate::app) fn set_down(state: &mut AppState, at: Vec2, window: (u32, u32)) -> bool {
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
    Some(support.under(foot(state), up, before))
}

/// Height of the photos' cameras above the object's foot, their median; without photos, twice the object's size.
fn camera_height(state: &AppState) -> f32 {
    let (up, foot) = (state.view.up, foot(state));
    let above = |eye: Vec3| (eye - foot).dot(up);
    let mut heights: Vec<f32> = state.views().map(|v| above(v.camera.position())).collect();
    heights.sort_unstable_by(f32::total_cmp);
    let median = heights.get(heights.len() / 2).copied();
    let is_usable = |height: &f32| *height > 0.0 && height.is_finite();
    median
        .filter(is_usable)
        .unwrap_or_else(|| 2.0 * object_size(state))
}

/// Puts the chosen panorama on a floor that the object stands on, as another environment that goes to the library: as if the
/// photos and the panorama had been taken from the same height. Nothing where the chosen environment is no panorama that lacks one.
pub(in crate::app) fn put_on_floor(state: &mut AppState, effects: &mut Vec<Effect>) {
    let chosen = state.look.environment.zip(state.chosen_environment());
    let Some((index, far)) = chosen.filter(|(_, chosen)| chosen.lacks_floor()) else {
        return;
    };
    let entry = &state.environments[index];
    let (name, path) = (
        format!("{} on a floor", entry.name),
        entry.path.with_extension("floor.safetensors"),
    );
    let about = entry.about.clone();
    let environment = Environment::clone(far).renamed(&name);
    let environment = environment.on_floor(camera_height(state));
    state.environments.push(EnvironmentEntry {
        name,
        path,
        about,
        content: EnvironmentContent::Ready(Arc::new(environment)),
    });
    let index = state.environments.len() - 1;
    state.look.environment = Some(index);
    set_down_in_the_middle(state);
    effects.push(Effect::KeepEnvironment(index));
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::app::state::app_state::tests::snapshot;
    use crate::app::state::look::Look;
    use crate::app::viewport::camera_control::Viewpoint;
    use crate::render::library::sky;
    use crate::render::test_scene::fog_above;

    /// A state lit by a floor at -0.5, seen from above.
    fn above_a_floor() -> AppState {
        let mut state = AppState {
            snapshot: Some(snapshot(1)),
            ..AppState::default()
        };
        let floor = state.environment_of_file(Path::new("/floor.safetensors"));
        state.environments[floor].content = EnvironmentContent::Ready(fog_above(-0.5));
        state.look.environment = Some(floor);
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
        assert!(set_down(&mut state, at, window));
        let after = [inside(&state, at), inside(&state, corner)];
        for (before, after) in before.as_flattened().iter().zip(after.as_flattened()) {
            assert!((*before - *after).length() < 1e-3, "{before} and {after}");
        }
        let foot = foot(&state);
        let seen = state.window_camera(window).project(foot).unwrap();
        assert!((seen - at).length() < 8.0, "the foot is at {seen}");
        assert_eq!(
            state.view.viewpoint.pivot,
            anchor(&state),
            "it turns about the object"
        );
    }

    #[test]
    fn an_imported_scan_has_the_object_on_what_is_below_its_middle() {
        let mut state = above_a_floor();
        set_down_in_the_middle(&mut state);
        let motion = state.look.transform.environment_from_world();
        let foot = motion.point(foot(&state));
        assert!((foot.z + 0.5).abs() < 0.05, "on the floor: {foot}");
        assert!(foot.truncate().length() < 0.05, "in the middle: {foot}");
    }

    #[test]
    fn a_panorama_gets_a_floor_as_far_below_the_cameras_as_the_object_stands() {
        let mut state = above_a_floor();
        let file = Path::new("/sky.hdr");
        let index = state.environment_of_file(file);
        state.environments[index].content =
            EnvironmentContent::Ready(Arc::new(sky([1.0; 3], Vec3::Z)));
        state.look = Look {
            environment: Some(index),
            ..Look::default()
        };
        let mut effects = Vec::new();
        put_on_floor(&mut state, &mut effects);
        let made = state.look.environment.unwrap();
        assert_eq!(effects, [Effect::KeepEnvironment(made)]);
        let floored = state.shown_environment().unwrap();
        assert!(floored.has_surfaces() && floored.name() == "sky on a floor");
        let height = floored.inner_box().center().z - floored.inner_box().min.z;
        assert!(
            (height - 2.0 * object_size(&state)).abs() < 1e-5,
            "no photos"
        );
        let motion = state.look.transform.environment_from_world();
        let foot = motion.point(foot(&state));
        let off = (foot - Vec3::NEG_Z * height).length();
        assert!(off < 1.5e-4 * height, "on it, within its thickness: {foot}");
        put_on_floor(&mut state, &mut effects);
        assert_eq!(effects.len(), 1, "it has one");
    }
}
