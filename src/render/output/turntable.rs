//! Turntables: the camera around the object, or the environment around both.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use super::film::Shot;
use crate::geometry::{Camera, orthonormal_basis};
use crate::neif::EnvironmentTransform;
use crate::render::scene::Scene;

/// Side of the pictures of [`first_camera`], in pixels.
const SIDE_PX: u32 = 512;
/// Vertical field of view of [`first_camera`], in radians.
const FOV_Y: f32 = 40.0 * TAU / 360.0;
/// Height of [`first_camera`] over the object's middle, as an angle in radians.
const ELEVATION: f32 = 20.0 * TAU / 360.0;
/// Space left around the object.
const MARGIN: f32 = 1.15;

/// What turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Spin {
    /// The camera, around the object.
    #[default]
    Camera,
    /// The environment, around the object and the camera.
    Environment,
}

/// The point that a turntable turns about: the middle of the object, or of an environment without one.
pub fn turning_point(scene: &Scene) -> Vec3 {
    match &scene.object {
        Some(object) => object.tracer.mesh().bounds().center(),
        None => scene.environment.inner_box().center(),
    }
}

/// A camera that sees the whole object from a little above (`up`: unit), or looks out of the middle of an environment
/// without one.
pub fn first_camera(scene: &Scene, up: Vec3) -> Camera {
    let center = turning_point(scene);
    let (level, _) = orthonormal_basis(up);
    let look = |eye, target| Camera::look_at(eye, target, up, FOV_Y, SIDE_PX, SIDE_PX);
    match &scene.object {
        Some(object) => {
            let radius = 0.5 * object.tracer.mesh().bounds().diagonal();
            let distance = MARGIN * radius / (0.5 * FOV_Y).sin();
            let toward_eye = level * ELEVATION.cos() + up * ELEVATION.sin();
            look(center + distance * toward_eye, center)
        }
        None => look(center, center + level),
    }
}

/// `n` cameras at equal angles about the `up` axis (unit) through `center`, counter-clockwise seen from above; the first
/// is `first` itself.
pub fn cameras(first: &Camera, center: Vec3, up: Vec3, n: u32) -> Vec<Camera> {
    turned(first, up, n, |turn| {
        let about_center = Affine3A::from_rotation_translation(turn, center - turn * center);
        Camera {
            world_from_camera: about_center * first.world_from_camera,
            ..*first
        }
    })
}

/// `n` places of the environment at equal angles about the `up` axis (unit) through `center`, counter-clockwise seen
/// from above; the first is `first` itself.
pub fn transforms(
    first: &EnvironmentTransform,
    center: Vec3,
    up: Vec3,
    n: u32,
) -> Vec<EnvironmentTransform> {
    turned(first, up, n, |turn| EnvironmentTransform {
        translate: center + turn * (first.translate - center),
        ..first.turned(turn)
    })
}

/// The `n` pictures of a turntable about the axis through a centre (point and unit direction), begun at `camera` and
/// `transform`.
pub fn shots(
    spin: Spin,
    camera: &Camera,
    transform: &EnvironmentTransform,
    (center, up): (Vec3, Vec3),
    n: u32,
) -> Vec<Shot> {
    let still = (vec![*camera; n as usize], vec![*transform; n as usize]);
    let (cameras, transforms) = match spin {
        Spin::Camera => (cameras(camera, center, up, n), still.1),
        Spin::Environment => (still.0, transforms(transform, center, up, n)),
    };
    let shot = |(i, (camera, transform))| Shot {
        name: format!("turn_{i:03}"),
        camera,
        transform,
    };
    let places = cameras.into_iter().zip(transforms);
    places.enumerate().map(shot).collect()
}

/// `n` equal turns about `up`, the first of which is none.
fn turned<T: Copy>(first: &T, up: Vec3, n: u32, turned: impl Fn(Quat) -> T) -> Vec<T> {
    let turn = |i: u32| Quat::from_axis_angle(up, TAU * i as f32 / n as f32);
    let others = (1..n).map(|i| turned(turn(i)));
    std::iter::once(*first)
        .take(n as usize)
        .chain(others)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::{camera, scene};

    #[test]
    fn cameras_keep_their_distance_and_height_and_see_the_middle_at_one_place() {
        let first = camera(60, 40);
        let center = Vec3::new(0.3, -0.2, 0.1);
        let cameras = cameras(&first, center, Vec3::Z, 5);
        assert_eq!(cameras[0], first);
        let at = first.project(center).expect("seen");
        for camera in &cameras {
            let off = camera.project(center).expect("seen") - at;
            assert!(off.length() < 1e-2, "{off}");
            assert!((camera.position().z - first.position().z).abs() < 1e-5);
        }
        // Counter-clockwise from above: a fifth of a turn takes +x towards +y.
        let angle = |camera: &Camera| {
            let p = camera.position() - center;
            p.y.atan2(p.x)
        };
        let step = (angle(&cameras[1]) - angle(&first)).rem_euclid(TAU);
        assert!((step - TAU / 5.0).abs() < 1e-4, "{step}");
    }

    #[test]
    fn a_turned_environment_looks_like_one_from_a_camera_turned_back() {
        let center = Vec3::new(0.3, -0.2, 0.1);
        let first = EnvironmentTransform {
            rotate_deg: Vec3::new(10.0, 20.0, 30.0),
            translate: Vec3::new(1.0, 2.0, 3.0),
            scale: 1.5,
            ..EnvironmentTransform::default()
        };
        let n = 6;
        let turned = transforms(&first, center, Vec3::Z, n);
        let cameras = cameras(&camera(60, 40), center, Vec3::Z, n);
        assert_eq!(turned[0], first);
        for i in 1..n as usize {
            let (from, back) = (
                cameras[0].ray(7.0, 9.0),
                cameras[n as usize - i].ray(7.0, 9.0),
            );
            let (a, b) = (
                turned[i].environment_from_world(),
                first.environment_from_world(),
            );
            let origins = a.point(from.origin) - b.point(back.origin);
            let directions = a.direction(from.direction) - b.direction(back.direction);
            let off = origins.length() + directions.length();
            assert!(off < 1e-4, "turn {i}: off by {off}");
        }
    }

    #[test]
    fn the_first_camera_sees_all_of_the_object() {
        let scene = scene();
        let camera = first_camera(&scene, Vec3::Z);
        let object = scene.object.as_ref().expect("an object");
        for corner in object.tracer.mesh().bounds().corners() {
            let p = camera.project(corner).expect("in front");
            let inside = 0.0..SIDE_PX as f32;
            assert!(inside.contains(&p.x) && inside.contains(&p.y), "{p}");
        }
    }
}
