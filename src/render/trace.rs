//! What a pixel sees of the mesh: its first hit with footprint, and what its reflected lobe meets of the object.
//!
//! Geometry does not change while stage two trains, so trainer and renderer trace each pixel once and keep this.

use glam::{Quat, Vec3};

use crate::geometry::{Camera, Hit, Ray, SurfaceTracer, orthonormal_basis};
use crate::neif::shading::{Blocked, RING_ANGLES, RING_RAYS, SurfacePoint};

/// Standard deviation of a uniform pixel, pixels: `1/sqrt(12)`.
const PIXEL_STD: f32 = 0.288_675_13;

/// A surface point and what its lobe meets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TracedPoint {
    /// The point the pixel sees.
    pub point: SurfacePoint,
    /// How much of its lobe meets the object again.
    pub blocked: Blocked,
    /// The point met, when any tested ray is blocked.
    pub second: Option<SecondPoint>,
}

/// Where a reflected ray meets the object again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SecondPoint {
    /// The point; `to_eye` looks back to the first one.
    pub point: SurfacePoint,
    /// Distance between the two, world units.
    pub distance: f32,
}

/// The first hit of the ray through `(x_px, y_px)`.
pub fn trace_pixel(
    tracer: &SurfaceTracer,
    camera: &Camera,
    x_px: f32,
    y_px: f32,
) -> Option<SurfacePoint> {
    let ray = camera.ray(x_px, y_px);
    let hit = tracer.intersect(&ray, 0.0, f32::INFINITY)?;
    let neighbours = [camera.ray(x_px + 1.0, y_px), camera.ray(x_px, y_px + 1.0)];
    Some(surface_point(tracer, &hit, &ray, &neighbours))
}

/// The lobe's fan of rays: how many meet the object, and the first point met (the mirror ray's if it does).
///
/// `turn` (radians) turns the rings, so that neighbouring pixels test different directions.
pub fn trace_bounce(
    tracer: &SurfaceTracer,
    point: &SurfacePoint,
    turn: f32,
) -> (Blocked, Option<SecondPoint>) {
    let axis = point.reflected();
    let start = tracer.self_distance();
    let mirror = tracer.intersect(
        &Ray {
            origin: point.position,
            direction: axis,
        },
        start,
        f32::INFINITY,
    );
    let mut blocked = Blocked {
        core: if mirror.is_some() { 1.0 } else { 0.0 },
        rings: [0.0; 2],
    };
    let mut met = mirror.map(|hit| second_point(tracer, point, axis, &hit));
    let (tangent, bitangent) = orthonormal_basis(axis);
    for (ring, &angle) in RING_ANGLES.iter().enumerate() {
        let mut counts = [0_u32; 2];
        for k in 0..RING_RAYS {
            let phi =
                turn + std::f32::consts::TAU * (k as f32 + 0.5 * ring as f32) / RING_RAYS as f32;
            let side = tangent * phi.cos() + bitangent * phi.sin();
            let direction = (axis * angle.cos() + side * angle.sin()).normalize_or_zero();
            // Directions below the horizon are no part of the reflected lobe.
            if direction.dot(point.normal) <= 0.0 {
                continue;
            }
            counts[0] += 1;
            let ray = Ray {
                origin: point.position,
                direction,
            };
            if let Some(hit) = tracer.intersect(&ray, start, f32::INFINITY) {
                counts[1] += 1;
                met = met.or_else(|| Some(second_point(tracer, point, direction, &hit)));
            }
        }
        blocked.rings[ring] = if counts[0] > 0 {
            counts[1] as f32 / counts[0] as f32
        } else {
            blocked.core
        };
    }
    (blocked, met)
}

fn second_point(
    tracer: &SurfaceTracer,
    from: &SurfacePoint,
    direction: Vec3,
    hit: &Hit,
) -> SecondPoint {
    let ray = Ray {
        origin: from.position,
        direction,
    };
    // The footprint at the second surface, as the two rays that a neighbouring pixel would send.
    let width = from.base + from.spread * hit.t;
    let angle = width / PIXEL_STD / hit.t.max(1e-12);
    let (tangent, bitangent) = orthonormal_basis(direction);
    let turned = |axis: Vec3| Ray {
        origin: from.position,
        direction: Quat::from_axis_angle(axis, angle.min(0.5)) * direction,
    };
    let point = surface_point(tracer, hit, &ray, &[turned(tangent), turned(bitangent)]);
    SecondPoint {
        point,
        distance: hit.t,
    }
}

fn surface_point(
    tracer: &SurfaceTracer,
    hit: &Hit,
    ray: &Ray,
    neighbours: &[Ray; 2],
) -> SurfacePoint {
    let footprint = tracer.footprint(hit, ray, &neighbours[0], &neighbours[1]);
    SurfacePoint {
        position: hit.position,
        normal: hit.normal,
        to_eye: -ray.direction,
        base: footprint.position_per_px * PIXEL_STD,
        spread: footprint.reflection_per_px * PIXEL_STD,
    }
}
