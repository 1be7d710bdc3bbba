//! What a pixel sees of the mesh: the light paths of its reflections, with footprints.
//!
//! Geometry does not change while stage two trains, so trainer and renderer trace each pixel once and keep this.

use glam::{Quat, Vec3};

use crate::geometry::{Camera, Hit, Ray, SurfaceTracer, orthonormal_basis};
use crate::neif::light_path::{Blocked, PathVertex, RING_ANGLES, RING_RAYS};
use crate::neif::shading::SurfacePoint;

/// Standard deviation of a uniform pixel, pixels: `1/sqrt(12)`.
pub const PIXEL_STD: f32 = 0.288_675_13;
/// Most vertices of a path. Between five touching balls one pixel in six meets the object a second time, one in
/// sixteen a third, and few a fourth.
pub const MAX_VERTICES: usize = 4;

/// Light paths one after the other in one list.
#[derive(Clone, Debug, Default)]
pub struct PathStore {
    vertices: Vec<PathVertex>,
    /// Where each path ends.
    ends: Vec<u32>,
}

impl PathStore {
    /// Number of paths.
    pub fn n_paths(&self) -> usize {
        self.ends.len()
    }

    /// The vertices of a path, at least one.
    pub fn path(&self, index: usize) -> &[PathVertex] {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.vertices[start as usize..self.ends[index] as usize]
    }

    /// Adds a path.
    pub fn push(&mut self, path: &[PathVertex]) {
        self.vertices.extend_from_slice(path);
        self.ends.push(self.vertices.len() as u32);
    }

    /// Adds all paths of another list.
    pub fn append(&mut self, other: &Self) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.ends.extend(other.ends.iter().map(|end| base + end));
    }
}

/// The first hit of the ray through `(x_px, y_px)`; `size_px` is the side of the square whose beam is meant.
pub fn trace_pixel(
    tracer: &SurfaceTracer,
    camera: &Camera,
    (x_px, y_px): (f32, f32),
    size_px: f32,
) -> Option<SurfacePoint> {
    let ray = camera.ray(x_px, y_px);
    let hit = tracer.intersect(&ray, 0.0, f32::INFINITY)?;
    let neighbours = [
        camera.ray(x_px + size_px, y_px),
        camera.ray(x_px, y_px + size_px),
    ];
    Some(surface_point(tracer, &hit, &ray, &neighbours))
}

/// The path of mirror directions that starts at `first`, with at most `path.len()` vertices; returns how many it has.
///
/// `turn` (radians) turns the rings of lobe rays, so that neighbouring pixels test different directions.
pub fn trace_path<'a>(
    tracer: &SurfaceTracer,
    first: SurfacePoint,
    turn: f32,
    path: &'a mut [PathVertex; MAX_VERTICES],
    max_vertices: usize,
) -> &'a [PathVertex] {
    path[0] = PathVertex {
        point: first,
        ..PathVertex::default()
    };
    let last = max_vertices.clamp(1, MAX_VERTICES) - 1;
    for k in 0..last {
        let (blocked, next) = trace_lobe(tracer, &path[k].point, turn + k as f32);
        path[k].blocked = blocked;
        let Some(next) = next else {
            return &path[..=k];
        };
        path[k + 1] = next;
    }
    &path[..=last]
}

/// The lobe's fan of rays: how many meet the object, and the first point met (the mirror ray's if it does).
fn trace_lobe(
    tracer: &SurfaceTracer,
    point: &SurfacePoint,
    turn: f32,
) -> (Blocked, Option<PathVertex>) {
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
    let mut met = mirror.map(|hit| next_vertex(tracer, point, axis, &hit));
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
                met = met.or_else(|| Some(next_vertex(tracer, point, direction, &hit)));
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

fn next_vertex(
    tracer: &SurfaceTracer,
    from: &SurfacePoint,
    direction: Vec3,
    hit: &Hit,
) -> PathVertex {
    // The beam widens as if it came from a point behind the mirror.
    let behind = (from.base / from.spread.max(1e-12)).min(1e3 * hit.t);
    let ray = Ray {
        origin: from.position - behind * direction,
        direction,
    };
    let angle = (from.spread / PIXEL_STD).min(0.5);
    let (tangent, bitangent) = orthonormal_basis(direction);
    let turned = |axis: Vec3| Ray {
        origin: ray.origin,
        direction: Quat::from_axis_angle(axis, angle) * direction,
    };
    PathVertex {
        point: surface_point(tracer, hit, &ray, &[turned(tangent), turned(bitangent)]),
        blocked: Blocked::default(),
        distance: hit.t,
        curvature: tracer.curvature(hit),
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
