//! Where the environment is grabbed, and how it stands while it is.

use glam::Vec3;

use crate::app::state::app_state::AppState;
use crate::neif::EnvironmentTransform;

/// The point of the environment that the gizmo holds, in its own coordinates: where the object stands in its own.
pub(in crate::app) fn anchor(state: &AppState) -> Vec3 {
    let bounds = state.view.bounds.map(|bounds| bounds.center());
    bounds.unwrap_or(state.view.home.pivot)
}

/// The middle of the object's underside; without an object, what the camera turns about.
pub(in crate::app) fn foot(state: &AppState) -> Vec3 {
    let (middle, up) = (anchor(state), state.view.up);
    let heights = state.object().map(|object| {
        let positions = object.tracer.mesh().positions.iter();
        positions.map(|p| p.dot(up)).fold(f32::INFINITY, f32::min)
    });
    heights.map_or(middle, |lowest| middle + (lowest - middle.dot(up)) * up)
}

/// Size that steps and axes are measured by, scene units: the object's diagonal, or a quarter of the environment's.
pub(in crate::app) fn object_size(state: &AppState) -> f32 {
    let own = state.snapshot.as_ref();
    let room = own.map(|own| 0.25 * own.environment.inner_box().diagonal());
    let object = state.view.bounds.map(|bounds| bounds.diagonal());
    object.or(room).unwrap_or(1.0).max(1e-6)
}

/// Where the environment stands that the picture shows.
pub(in crate::app) fn shown_transform(state: &AppState) -> EnvironmentTransform {
    if state.is_original_shown {
        EnvironmentTransform::default()
    } else {
        state.look.transform
    }
}
