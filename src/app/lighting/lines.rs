//! Lines in the world: the bounds and the axes of the environment, and the world's own axes.

use glam::{Vec2, Vec3};

use crate::app::lighting::gizmo::Axis;
use crate::geometry::Camera;
use crate::neif::{Environment, EnvironmentTransform};

/// Pieces of a line: where some of it is behind the camera, the rest is drawn.
const PIECES: usize = 24;
/// Farther out than this many picture heights nothing is drawn.
const FAR_OUT: f32 = 20.0;

/// What a line is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineKind {
    /// The inner box of the environment.
    Bounds,
    /// An axis of the environment, through the middle of its inner box.
    Environment(Axis),
    /// An axis of the world, through the origin.
    World(Axis),
}

/// A line between two world points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    pub(super) kind: LineKind,
    pub(super) ends: [Vec3; 2],
}

/// All lines of an environment that stands as `transform` says; what is infinitely far has no bounds, only directions.
/// The world's axes are `size` long.
pub(super) fn lines(
    environment: &Environment,
    transform: &EnvironmentTransform,
    size: f32,
) -> Vec<Line> {
    let motion = transform.environment_from_world();
    let mut all = Vec::new();
    let mut line = |kind, a, b| all.push(Line { kind, ends: [a, b] });
    for axis in Axis::ALL {
        line(LineKind::World(axis), Vec3::ZERO, axis.unit() * size);
    }
    let bounds = environment.inner_box();
    let (center, half) = (bounds.center(), 0.5 * bounds.extent());
    let world = |p: Vec3| motion.world_point(p);
    let start = if environment.is_far() {
        Vec3::ZERO
    } else {
        world(center)
    };
    for axis in Axis::ALL {
        let end = start + motion.world_direction(axis.unit()) * size;
        line(LineKind::Environment(axis), start, end);
    }
    if environment.is_far() {
        return all;
    }
    // Four edges along each axis, by the signs of the other two coordinates.
    for axis in 0..3 {
        for (a, b) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let mut corner = Vec3::ZERO;
            corner[(axis + 1) % 3] = a;
            corner[(axis + 2) % 3] = b;
            let along = Vec3::AXES[axis];
            let end = |sign: f32| world(center + half * (corner + along * sign));
            line(LineKind::Bounds, end(-1.0), end(1.0));
        }
    }
    all
}

/// The seen part of a line, as pixels of the camera's picture: runs of points, each to be joined.
pub(super) fn on_screen(camera: &Camera, line: &Line) -> Vec<Vec<Vec2>> {
    let [a, b] = line.ends;
    let far = FAR_OUT * camera.height.max(1) as f32;
    let mut runs = Vec::new();
    let mut run = Vec::new();
    for i in 0..=PIECES {
        let seen = camera.project(a.lerp(b, i as f32 / PIECES as f32));
        match seen.filter(|p| p.abs().max_element() < far) {
            Some(p) => run.push(p),
            None => runs.push(std::mem::take(&mut run)),
        }
    }
    runs.push(run);
    runs.retain(|run: &Vec<Vec2>| run.len() > 1);
    runs
}

/// Where the ends of the world's axes appear on a small compass: right and down in lengths of an axis, and how far each
/// points towards the viewer, -1 to 1.
pub(super) fn compass(camera: &Camera) -> [(Axis, Vec2, f32); 3] {
    let axes = camera.world_from_camera.matrix3;
    let part =
        |column: glam::Vec3A, axis: Axis| Vec3::from(column).normalize_or_zero().dot(axis.unit());
    Axis::ALL.map(|axis| {
        let to = Vec2::new(part(axes.x_axis, axis), -part(axes.y_axis, axis));
        (axis, to, part(axes.z_axis, axis))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::environment;

    #[test]
    fn bounds_move_turn_and_grow_with_the_environment() {
        let environment = environment(3);
        let transform = EnvironmentTransform {
            rotate_deg: Vec3::new(0.0, 0.0, 90.0),
            translate: Vec3::new(5.0, 0.0, 0.0),
            scale: 2.0,
            ..EnvironmentTransform::default()
        };
        let all = lines(&environment, &transform, 1.0);
        let bounds: Vec<_> = all
            .iter()
            .filter(|line| line.kind == LineKind::Bounds)
            .collect();
        assert_eq!(bounds.len(), 12, "edges");
        let side = environment.inner_box().extent().x;
        for line in bounds {
            let length = line.ends[0].distance(line.ends[1]);
            assert!((length - 2.0 * side).abs() < 1e-3 * side, "{length}");
            let middle = line.ends[0].midpoint(line.ends[1]);
            let off = (middle - Vec3::X * 5.0).length();
            let expected = side * 2.0_f32.sqrt();
            assert!((off - expected).abs() < 1e-3 * side, "{off}");
        }
        let x = all
            .iter()
            .find(|line| line.kind == LineKind::Environment(Axis::X))
            .unwrap();
        assert!(((x.ends[1] - x.ends[0]) - Vec3::Y).length() < 1e-4, "{x:?}");
    }

    #[test]
    fn a_line_that_passes_the_camera_is_drawn_as_far_as_it_is_seen() {
        let camera = Camera::look_at(Vec3::ZERO, Vec3::Y, Vec3::Z, 0.8, 400, 300);
        let line = |a, b| Line {
            kind: LineKind::Bounds,
            ends: [a, b],
        };
        let passing = line(Vec3::new(0.5, -10.0, 0.0), Vec3::new(0.5, 10.0, 0.0));
        let runs = on_screen(&camera, &passing);
        assert!(runs.len() == 1 && runs[0].len() < PIECES, "{runs:?}");
        let behind = line(Vec3::new(0.0, -2.0, 0.0), Vec3::new(1.0, -2.0, 0.0));
        assert!(on_screen(&camera, &behind).is_empty(), "behind");
    }

    #[test]
    fn the_compass_shows_up_upwards() {
        let camera = Camera::look_at(Vec3::new(3.0, -3.0, 0.0), Vec3::ZERO, Vec3::Z, 0.8, 4, 4);
        let [_, _, (axis, to, towards)] = compass(&camera);
        assert_eq!(axis, Axis::Z);
        assert!((to - Vec2::NEG_Y).length() < 1e-4 && towards.abs() < 1e-4);
    }
}
