//! Where an object can be set down in an environment: the surface that a ray meets, and the motion of the environment that
//! brings it under the object.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use crate::geometry::Ray;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;
use crate::neif::{Environment, EnvironmentTransform};

/// Opacity of a ray below which it meets nothing.
const OPAQUE: f32 = 0.5;
/// Turn between a ray and those around it that the normal is taken from, radians: wider than the field's noise, narrower
/// than a table seen from across a room.
const AROUND: f32 = 0.05;
/// So many are around it.
const N_AROUND: usize = 8;
/// By how much more or less than the ray in the middle one of them may reach and meet the same surface, share of that.
const SAME_SURFACE: f32 = 0.4;
/// Cosine to the up direction from which on a normal becomes it: tables and floors are level.
const LEVEL: f32 = 0.8;

/// A point of a surface in an environment, the environment's own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Support {
    /// Where.
    pub point: Vec3,
    /// Unit, towards the eye; the environment's up direction where the surface is about level.
    pub normal: Vec3,
}

impl Support {
    /// What a ray in the environment's own coordinates meets first; `None` where it meets nothing, and in environments
    /// without surfaces.
    pub fn met_by(environment: &Environment, ray: &Ray) -> Option<Self> {
        if !environment.has_surfaces() {
            return None;
        }
        let (right, down) = ray.direction.any_orthonormal_pair();
        let turned = (0..N_AROUND).map(|i| {
            let (sin, cos) = (i as f32 / N_AROUND as f32 * TAU).sin_cos();
            (ray.direction + AROUND * (cos * right + sin * down)).normalize_or(ray.direction)
        });
        let directions = [ray.direction].into_iter().chain(turned);
        let ends = ends(environment, ray.origin, directions);
        let point = (*ends.first()?)?;
        let reach = point.distance(ray.origin);
        let is_same = |p: &Vec3| (p.distance(ray.origin) / reach - 1.0).abs() < SAME_SURFACE;
        let rim = ends[1..].iter().copied().flatten().filter(is_same);
        let rim: Vec<Vec3> = rim.collect();
        // The triangles' areas add up to that within the rim, whatever the point in the middle.
        let sum = (0..rim.len()).map(|i| (rim[i] - point).cross(rim[(i + 1) % rim.len()] - point));
        let normal = sum.sum::<Vec3>().try_normalize()?;
        let normal = normal * -normal.dot(ray.direction).signum();
        let is_level = normal.dot(environment.up()) > LEVEL;
        let normal = if is_level { environment.up() } else { normal };
        Some(Self { point, normal })
    }

    /// The transform with which this point of the environment is at `foot` and its normal along `up`, world coordinates: with
    /// the least turn from the one that it has, and the same size and light.
    pub fn under(
        &self,
        foot: Vec3,
        up: Vec3,
        transform: &EnvironmentTransform,
    ) -> EnvironmentTransform {
        let normal = transform
            .environment_from_world()
            .world_direction(self.normal);
        let turned = transform.turned(arc(normal, up));
        let moved = turned.environment_from_world().world_point(self.point);
        EnvironmentTransform {
            translate: turned.translate + foot - moved,
            ..turned
        }
    }
}

/// The least turn from one unit direction to another.
fn arc(from: Vec3, to: Vec3) -> Quat {
    if from.dot(to) < -0.9999 {
        return Quat::from_axis_angle(from.any_orthonormal_vector(), std::f32::consts::PI);
    }
    Quat::from_rotation_arc(from, to)
}

/// How the world moves that an environment is fixed in when its transform changes, sizes alike.
pub fn motion_between(before: &EnvironmentTransform, after: &EnvironmentTransform) -> Affine3A {
    let (before, after) = (
        before.environment_from_world(),
        after.environment_from_world(),
    );
    let axis = |axis| after.world_direction(before.direction(axis));
    let rotation = glam::Mat3::from_cols(axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z));
    let origin = after.world_point(before.point(Vec3::ZERO));
    Affine3A::from_mat3_translation(rotation, origin)
}

/// Where rays from a point end, the environment's own coordinates.
fn ends(
    environment: &Environment,
    origin: Vec3,
    directions: impl Iterator<Item = Vec3>,
) -> Vec<Option<Vec3>> {
    let frame = environment.frame();
    let start = frame.field_from_world(origin);
    let mut batch = FieldBatch::default();
    let rays = directions
        .map(|direction| FieldRay::of_pixel(start.to_array(), direction.to_array(), 0.0, 0.0));
    batch.rays.extend(rays);
    environment.light(&mut batch, &mut LightScratch::default());
    let end = |i: usize| {
        let (distance, opacity) = batch.end(i);
        let direction = Vec3::from(batch.rays[i].cone.direction);
        let is_met = opacity > OPAQUE && distance.is_finite();
        is_met.then(|| frame.world_from_field(start + distance * direction))
    };
    (0..batch.rays.len()).map(end).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::fog_where;

    /// A floor at -0.5 and a wall from x = 0.4 on.
    fn corner() -> std::sync::Arc<Environment> {
        fog_where(|x| x.z <= -0.5 || x.x >= 0.4)
    }

    fn ray(direction: Vec3) -> Ray {
        Ray {
            origin: Vec3::new(-0.1, 0.05, 0.1),
            direction: direction.normalize_or_zero(),
        }
    }

    #[test]
    fn a_ray_meets_the_floor_and_the_wall() {
        let environment = corner();
        let floor = Support::met_by(&environment, &ray(Vec3::new(0.1, 0.1, -1.0))).unwrap();
        assert!((floor.point.z + 0.5).abs() < 0.05, "{floor:?}");
        assert_eq!(floor.normal, environment.up(), "level");
        let wall = Support::met_by(&environment, &ray(Vec3::new(1.0, 0.1, 0.05))).unwrap();
        assert!((wall.point.x - 0.4).abs() < 0.05, "{wall:?}");
        assert!(wall.normal.dot(Vec3::NEG_X) > 0.95, "{wall:?}");
    }

    #[test]
    fn what_is_met_comes_under_the_foot_and_the_rest_moves_with_it() {
        let before = EnvironmentTransform {
            rotate_deg: Vec3::new(70.0, -20.0, 10.0),
            translate: Vec3::new(1.0, 2.0, -3.0),
            scale: 1.7,
            exposure_ev: 0.5,
            ..EnvironmentTransform::default()
        };
        let support = Support {
            point: Vec3::new(0.2, -0.3, 0.4),
            normal: Vec3::Z,
        };
        for up in [Vec3::Z, Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8)] {
            let foot = Vec3::new(-1.0, 0.5, 0.25);
            let after = support.under(foot, up, &before);
            let motion = after.environment_from_world();
            assert!(
                (motion.world_point(support.point) - foot).length() < 1e-4,
                "{up}"
            );
            assert!(motion.world_direction(Vec3::Z).dot(up) > 0.9999, "{up}");
            assert_eq!(
                (after.scale, after.exposure_ev),
                (1.7, 0.5),
                "size and light"
            );
            let moved = motion_between(&before, &after);
            let p = Vec3::new(0.3, 0.1, -0.2);
            let (from, to) = (
                before.environment_from_world().world_point(p),
                motion.world_point(p),
            );
            assert!(
                (moved.transform_point3(from) - to).length() < 1e-4,
                "{up}: the rest"
            );
        }
    }
}
