//! Moving the environment by dragging in the picture.

use glam::{Quat, Vec2, Vec3};

use super::camera_control::Viewpoint;
use crate::neif::EnvironmentTransform;

/// Degrees a drag by one point of the screen turns the environment.
pub const DEGREES_PER_POINT: f32 = 0.3;

/// The transform turned further by `degrees` about the axis `up` (unit) through the world's origin.
pub fn turned(transform: &EnvironmentTransform, up: Vec3, degrees: f32) -> EnvironmentTransform {
    let mut rotate_deg = transform.rotate_deg;
    if up.x == 0.0 && up.y == 0.0 {
        // Z is the last of the three rotations, so it adds up; the numbers stay plain.
        rotate_deg.z += degrees * up.z.signum();
    } else {
        let turn = Quat::from_axis_angle(up, degrees.to_radians());
        rotate_deg = transform.turned(turn).rotate_deg;
    }
    EnvironmentTransform {
        rotate_deg: rotate_deg.map(wrapped),
        ..*transform
    }
}

/// The same about the axis through `center`, world coordinates: what is there stays in its place. An object lies anywhere in
/// the coordinates of its capture.
pub fn turned_about(
    transform: &EnvironmentTransform,
    center: Vec3,
    up: Vec3,
    degrees: f32,
) -> EnvironmentTransform {
    let turn = Quat::from_axis_angle(up, degrees.to_radians());
    EnvironmentTransform {
        translate: center + turn * (transform.translate - center),
        ..turned(transform, up, degrees)
    }
}

/// The same angle within -180 to 180 degrees.
fn wrapped(degrees: f32) -> f32 {
    let angle = (degrees + 180.0).rem_euclid(360.0) - 180.0;
    if angle.is_finite() { angle } else { 0.0 }
}

/// The transform moved along with a drag by `drag_px` pixels (right, down) in a picture whose
/// window has that height, at the pivot's distance.
pub fn shifted(
    transform: &EnvironmentTransform,
    view: &Viewpoint,
    drag_px: Vec2,
    window: (u32, u32),
) -> EnvironmentTransform {
    let camera = view.camera_for(window.0, window.1);
    let axes = camera.world_from_camera.matrix3;
    let per_px = view.distance() / camera.fx.max(1e-6);
    let shift =
        (Vec3::from(axes.x_axis) * drag_px.x - Vec3::from(axes.y_axis) * drag_px.y) * per_px;
    EnvironmentTransform {
        translate: transform.translate + shift,
        ..*transform
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_about_up_turns_what_is_seen_about_up() {
        let start = EnvironmentTransform {
            rotate_deg: Vec3::new(20.0, -35.0, 50.0),
            translate: Vec3::new(0.5, 2.0, -1.0),
            scale: 1.5,
            ..Default::default()
        };
        let center = Vec3::new(-4.0, 1.0, 6.0);
        for up in [Vec3::Z, Vec3::Y, Vec3::NEG_Y, Vec3::X] {
            let end = turned_about(&start, center, up, 40.0);
            let turn = Quat::from_axis_angle(up, 40_f32.to_radians());
            let p = Vec3::new(0.3, -1.0, 2.0);
            let before = start.environment_from_world().point(p);
            let turned = center + turn * (p - center);
            let after = end.environment_from_world().point(turned);
            assert!(
                (before - after).length() < 1e-4,
                "{up}: {before} and {after}"
            );
        }
    }

    #[test]
    fn angles_stay_within_a_turn() {
        let mut transform = EnvironmentTransform::default();
        for _ in 0..100 {
            transform = turned(&transform, Vec3::Z, 33.0);
        }
        assert!(
            transform.rotate_deg.abs().max_element() <= 180.0,
            "{}",
            transform.rotate_deg
        );
    }

    #[test]
    fn a_shift_follows_the_pointer_at_the_pivot() {
        let view = Viewpoint::look_at(Vec3::new(0.0, -3.0, 0.5), Vec3::ZERO, Vec3::Z);
        let window = (800, 600);
        let moved = shifted(
            &EnvironmentTransform::default(),
            &view,
            Vec2::new(40.0, -25.0),
            window,
        );
        let camera = view.camera_for(window.0, window.1);
        let seen = camera.project(moved.translate).unwrap() - camera.project(Vec3::ZERO).unwrap();
        assert!((seen - Vec2::new(40.0, -25.0)).length() < 0.05, "{seen}");
    }
}
