//! A panorama on a level floor: the picture wrapped around a dome that stands on one, seen from the place of its camera.
//!
//! Without a floor an object would float in it. What the panorama shows below its horizon is put on a plane at the height of
//! the floor, the rest on a sphere about the camera ("ground projection"). Lengths are heights of the camera above the floor.

use glam::Vec3;

use crate::neif::field::field_batch::FieldRay;

/// Radius of the dome about the camera: the floor reaches as far, so that its edge is 6 degrees below the horizon.
const RADIUS: f32 = 10.0;
/// Least cosine between a ray and the normal of what it meets: below, its footprint is longer than one width can say.
const LEAST_COSINE: f32 = 0.05;
/// Distance of what a ray meets that passes by the dome.
const FAR: f32 = 1e6;

/// What a ray meets, as the panorama's camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meeting {
    /// Along the unit direction.
    pub(super) distance: f32,
    /// Unit, from the camera.
    pub(super) direction: Vec3,
    /// Variance of the ray's footprint there, radians squared a transverse axis: that of a disc of the same solid angle.
    pub(super) variance: f32,
}

/// Where a ray ends, of a camera in the origin with the floor at height -1 along `up` (unit).
pub(super) fn meet(ray: &FieldRay, up: Vec3) -> Meeting {
    let (origin, direction) = (Vec3::from(ray.cone.origin), Vec3::from(ray.direction));
    let fall = -direction.dot(up);
    let height = origin.dot(up) + 1.0;
    let floor = if height > 0.0 && fall > 0.0 {
        height / fall
    } else {
        f32::INFINITY
    };
    let along = origin.dot(direction);
    let discriminant = along * along - origin.length_squared() + RADIUS * RADIUS;
    let dome = if discriminant > 0.0 {
        discriminant.sqrt() - along
    } else {
        f32::NEG_INFINITY
    };
    if dome <= 0.0 {
        return Meeting {
            distance: FAR,
            direction,
            variance: ray.cone.variance(1.0),
        };
    }
    let distance = floor.min(dome);
    let met = origin + distance * direction;
    let reach = met.length().max(f32::MIN_POSITIVE);
    let seen = met / reach;
    // How the same piece is foreshortened along the ray and from the camera.
    let [by_ray, by_camera] = if floor < dome {
        [fall, -seen.dot(up)]
    } else {
        [direction.dot(seen), 1.0]
    };
    let foreshortened = by_camera / by_ray.max(LEAST_COSINE);
    Meeting {
        distance,
        direction: seen,
        variance: ray.cone.variance(distance) * foreshortened / (reach * reach),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    fn ray(origin: Vec3, direction: Vec3, spread: f32) -> FieldRay {
        FieldRay::of_pixel(origin.to_array(), direction.to_array(), 0.0, spread)
    }

    #[test]
    fn from_the_camera_s_place_nothing_changes_but_where_the_light_comes_from() {
        for direction in fibonacci_sphere(200) {
            let met = meet(&ray(Vec3::ZERO, direction, 0.1), Vec3::Y);
            assert!((met.direction - direction).length() < 1e-5, "{met:?}");
            assert!((met.variance / 0.01 - 1.0).abs() < 1e-4, "{met:?}");
            let end = met.distance * direction;
            let on_floor = (end.y + 1.0).abs() < 1e-4 && end.length() < RADIUS + 1e-4;
            let on_dome = (end.length() - RADIUS).abs() < 1e-4 && end.y > -1.0 - 1e-4;
            assert!(on_floor || on_dome, "{direction}: {end}");
        }
    }

    #[test]
    fn a_place_on_the_floor_is_the_same_from_anywhere() {
        let place = Vec3::new(2.0, -1.0, 0.7);
        for eye in [
            Vec3::new(1.0, -0.5, 0.0),
            Vec3::new(-3.0, 2.0, 4.0),
            Vec3::new(2.0, 0.4, 0.7),
        ] {
            let way = place - eye;
            let met = meet(&ray(eye, way.normalize_or_zero(), 0.0), Vec3::Y);
            assert!((met.distance - way.length()).abs() < 1e-4, "{eye}: {met:?}");
            let seen = place.normalize_or_zero();
            assert!((met.direction - seen).length() < 1e-5, "{eye}: {met:?}");
        }
    }

    #[test]
    fn footprints_cover_the_same_solid_angle() {
        // A narrow cone straight down from half the height: half as wide on the floor, at the same distance from the camera.
        let down = meet(&ray(Vec3::NEG_Y * 0.5, Vec3::NEG_Y, 0.01), Vec3::Y);
        assert!((down.variance - 0.25e-4).abs() < 1e-8, "{down:?}");
    }

    #[test]
    fn rays_from_below_and_outside_end_too() {
        for (origin, direction) in [
            (Vec3::new(0.0, -3.0, 0.0), Vec3::NEG_Y),
            (Vec3::new(0.0, -1.0, 0.0), Vec3::X),
            (Vec3::new(0.0, 50.0, 0.0), Vec3::Y),
            (Vec3::new(0.0, 50.0, 0.0), Vec3::X),
        ] {
            let met = meet(&ray(origin, direction, 0.1), Vec3::Y);
            assert!(met.distance > 0.0 && met.distance.is_finite(), "{met:?}");
            assert!(met.direction.is_normalized(), "{met:?}");
            assert!(met.variance.is_finite(), "{met:?}");
        }
    }
}
