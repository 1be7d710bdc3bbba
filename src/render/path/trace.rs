//! What a pixel sees of the mesh: the light paths of its reflections, with footprints.
//!
//! Surfaces stay where they are while stage two trains, so trainer and renderer trace each pixel once and keep this;
//! where normals are refined, once for each mesh with better ones.

use glam::{Quat, Vec2, Vec3};

use crate::geometry::{Camera, Fan, Hit, Ray, SurfaceTracer, orthonormal_basis};
use crate::neif::light::light_path::{Blocked, PathVertex, RING_ANGLES, RING_RAYS};
use crate::neif::light::shading::SurfacePoint;

/// Side of the square whose mean a pixel is, pixels: as wide as Blender's filter (Blackman-Harris, three pixels from end to
/// end); lenses and demosaicing blur as much or more.
pub const PIXEL_SIDE: f32 = 1.44;
/// Its standard deviation along an axis, pixels: `PIXEL_SIDE / sqrt(12)`.
pub const PIXEL_STD: f32 = 0.288_675_13 * PIXEL_SIDE;
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
}

/// A surface point with the side of the mesh's triangle that it lies on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// The point.
    pub point: SurfacePoint,
    /// The triangle's unit normal, facing where the point is seen from.
    pub face_normal: Vec3,
}

/// The ray through a point of a camera's picture and what it meets first.
#[derive(Clone, Copy, Debug)]
pub struct PixelHit {
    ray: Ray,
    hit: Hit,
}

impl PixelHit {
    /// Traces the ray through `at_px`.
    pub fn trace(tracer: &SurfaceTracer, camera: &Camera, at_px: Vec2) -> Option<Self> {
        let ray = camera.ray(at_px.x, at_px.y);
        let hit = tracer.intersect(&ray, 0.0, f32::INFINITY)?;
        Some(Self { ray, hit })
    }

    /// The point met by a ray through `at_px`, with a beam whose `sides` are shares of a pixel.
    pub fn seen(
        &self,
        tracer: &SurfaceTracer,
        camera: &Camera,
        at_px: Vec2,
        sides: [Vec2; 2],
    ) -> Seen {
        let neighbours = sides.map(|side| camera.ray(at_px.x + side.x, at_px.y + side.y));
        seen(tracer, &self.hit, &self.ray, &neighbours)
    }
}

/// The first hit of the ray through `at_px`, with the beam of a pixel `size_px` times as wide.
pub fn trace_pixel(
    tracer: &SurfaceTracer,
    camera: &Camera,
    at_px: (f32, f32),
    size_px: f32,
) -> Option<Seen> {
    let sides = Vec2::AXES.map(|axis| size_px * axis);
    trace_beam(tracer, camera, at_px.into(), sides)
}

/// The first hit of the ray through `at_px`, with a beam whose `sides` are shares of a pixel.
pub fn trace_beam(
    tracer: &SurfaceTracer,
    camera: &Camera,
    at_px: Vec2,
    sides: [Vec2; 2],
) -> Option<Seen> {
    let hit = PixelHit::trace(tracer, camera, at_px)?;
    Some(hit.seen(tracer, camera, at_px, sides))
}

/// What a ray that leaves the surface at `origin` meets of it.
pub(in crate::render) fn meet_again(
    tracer: &SurfaceTracer,
    origin: Vec3,
    direction: Vec3,
) -> Option<Hit> {
    let ray = Ray { origin, direction };
    tracer.intersect(&ray, tracer.self_distance(), f32::INFINITY)
}

/// Whether the object hides from a point of its surface what lies `distance` away.
pub(in crate::render) fn is_hidden(
    tracer: &SurfaceTracer,
    origin: Vec3,
    direction: Vec3,
    distance: f32,
) -> bool {
    let ray = Ray { origin, direction };
    tracer.occluded(&ray, tracer.self_distance(), distance)
}

/// The path of mirror directions that starts at `first`, with at most `path.len()` vertices; returns how many it has.
///
/// `turn` (radians) turns the rings of lobe rays, so that neighbouring pixels test different directions.
pub fn trace_path<'a>(
    tracer: &SurfaceTracer,
    first: &Seen,
    turn: f32,
    path: &'a mut [PathVertex; MAX_VERTICES],
    max_vertices: usize,
) -> &'a [PathVertex] {
    path[0] = PathVertex {
        point: first.point,
        ..PathVertex::default()
    };
    let mut face_normal = first.face_normal;
    let last = max_vertices.clamp(1, MAX_VERTICES) - 1;
    for k in 0..last {
        let from = Seen {
            point: path[k].point,
            face_normal,
        };
        let fan = lobe_fan(tracer, &from);
        if fan.is_free() {
            return &path[..=k];
        }
        let (blocked, next) = trace_lobe(tracer, &fan, &from.point, turn + k as f32);
        path[k].blocked = blocked;
        let Some((next, next_face_normal)) = next else {
            return &path[..=k];
        };
        (path[k + 1], face_normal) = (next, next_face_normal);
    }
    &path[..=last]
}

/// The cone that holds all rays of the lobe at a point.
fn lobe_fan<'a>(tracer: &'a SurfaceTracer, from: &Seen) -> Fan<'a> {
    let (point, axis) = (from.point.position, from.point.reflected());
    let widest = RING_ANGLES[RING_ANGLES.len() - 1];
    tracer.fan(point, from.face_normal, axis, widest)
}

/// The lobe's rays: how many meet the object, and the first point met (the mirror ray's if it does) with its
/// triangle's normal.
fn trace_lobe(
    tracer: &SurfaceTracer,
    fan: &Fan<'_>,
    point: &SurfacePoint,
    turn: f32,
) -> (Blocked, Option<(PathVertex, Vec3)>) {
    let axis = point.reflected();
    let mirror = fan.intersect(point.position, axis);
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
            // Where it meets matters only if nothing was met before.
            if met.is_some() {
                counts[1] += u32::from(fan.occluded(point.position, direction));
            } else if let Some(hit) = fan.intersect(point.position, direction) {
                counts[1] += 1;
                met = Some(next_vertex(tracer, point, direction, &hit));
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
) -> (PathVertex, Vec3) {
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
    let seen = seen(tracer, hit, &ray, &[turned(tangent), turned(bitangent)]);
    let vertex = PathVertex {
        point: seen.point,
        blocked: Blocked::default(),
        distance: hit.t,
        curvature: tracer.curvature(hit),
    };
    (vertex, seen.face_normal)
}

fn seen(tracer: &SurfaceTracer, hit: &Hit, ray: &Ray, neighbours: &[Ray; 2]) -> Seen {
    let footprint = tracer.footprint(hit, ray, &neighbours[0], &neighbours[1]);
    Seen {
        point: SurfacePoint {
            position: hit.position,
            normal: hit.normal,
            to_eye: -ray.direction,
            base: footprint.position_per_px * PIXEL_STD,
            spread: footprint.reflection_per_px * PIXEL_STD,
        },
        face_normal: hit.geometric_normal,
    }
}
