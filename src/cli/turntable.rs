//! Cameras on a circle around the object, or around the middle of surroundings without one.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};
use neif::geometry::{Camera, orthonormal_basis};
use neif::render::Scene;

use super::render::NamedCamera;

/// Side of the pictures, in pixels.
const SIDE_PX: u32 = 512;
/// Vertical field of view, in radians.
const FOV_Y: f32 = 40.0 * TAU / 360.0;
/// Height of the circle over the object's middle, as an angle in radians.
const ELEVATION: f32 = 20.0 * TAU / 360.0;
/// Space left around the object.
const MARGIN: f32 = 1.15;

/// `n` cameras at equal angles, counter-clockwise seen from above; `up`: unit.
pub(crate) fn cameras(scene: &Scene, n: u32, up: Vec3) -> Vec<NamedCamera> {
    let bounds = scene
        .object
        .as_ref()
        .map(|object| object.tracer.mesh().bounds());
    let camera = |i: u32| {
        let turn = Quat::from_axis_angle(up, TAU * i as f32 / n as f32);
        let (outward, _) = orthonormal_basis(up);
        let level = turn * outward;
        if let Some(bounds) = bounds {
            let radius = 0.5 * bounds.diagonal();
            let distance = MARGIN * radius / (0.5 * FOV_Y).sin();
            let toward_eye = level * ELEVATION.cos() + up * ELEVATION.sin();
            look(bounds.center() + distance * toward_eye, bounds.center(), up)
        } else {
            // Without an object the circle is a point, from which the camera looks outward.
            let center = scene.environment.inner_box().center();
            look(center, center + level, up)
        }
    };
    (0..n)
        .map(|i| NamedCamera {
            name: format!("turn_{i:03}"),
            camera: camera(i),
        })
        .collect()
}

fn look(eye: Vec3, target: Vec3, up: Vec3) -> Camera {
    Camera::look_at(eye, target, up, FOV_Y, SIDE_PX, SIDE_PX)
}
