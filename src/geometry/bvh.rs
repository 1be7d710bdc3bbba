//! Rays against a mesh: nearest hit and occlusion, over obvhs' compressed eight-wide BVH.
//!
//! The hierarchy is built over the mesh moved and scaled to the unit ball, so that its fixed
//! epsilons mean the same for scenes of 1e-3 and 1e4 units. Triangles are tested by the
//! edge-consistent scheme of Embree's Plücker intersector: an edge shared by two triangles gives
//! exactly opposite signs in both, hence no ray slips between neighbours.

use std::sync::Arc;
use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{INVALID_ID, Ray as BvhRay, RayHit};
use obvhs::triangle::Triangle;

use super::{Mesh, Ray};

/// A point where a ray meets the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in scene units.
    pub t: f32,
    /// Index into [`Mesh::triangles`].
    pub triangle: u32,
    /// Barycentric weight of the triangle's vertex 1.
    pub u: f32,
    /// Barycentric weight of the triangle's vertex 2.
    pub v: f32,
    /// The point, interpolated from the triangle (more accurate than `ray.at(t)`).
    pub position: Vec3,
    /// Interpolated unit shading normal, on the side of the surface that the ray comes from.
    /// Near a silhouette it may still point a little away from the ray.
    pub normal: Vec3,
    /// The triangle's unit normal, facing the ray's origin.
    pub geometric_normal: Vec3,
}

/// Traces rays against one mesh. Built once; shared between threads by reference.
pub struct SurfaceTracer {
    mesh: Arc<Mesh>,
    bvh: CwBvh,
    /// Corners in ball space, in the order of the BVH's leaves.
    leaves: Vec<[Vec3A; 3]>,
    /// Triangle index of each leaf.
    triangle_of_leaf: Vec<u32>,
    /// Ball space: `p_ball = (p_world - center) / radius`.
    center: Vec3,
    radius: f32,
}

impl std::fmt::Debug for SurfaceTracer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SurfaceTracer")
            .field("n_triangles", &self.leaves.len())
            .field("center", &self.center)
            .field("radius", &self.radius)
            .finish_non_exhaustive()
    }
}

impl SurfaceTracer {
    /// Builds the hierarchy over `mesh`.
    pub fn new(mesh: Arc<Mesh>) -> Self {
        let bounds = mesh.bounds();
        let center = bounds.center();
        let radius = (0.5 * bounds.diagonal()).max(f32::MIN_POSITIVE);
        let to_ball = |p: Vec3| Vec3A::from((p - center) / radius);
        let corners: Vec<[Vec3A; 3]> = (0..mesh.triangles.len())
            .map(|i| mesh.corners(i).map(to_ball))
            .collect();
        let boxes: Vec<Triangle> = corners
            .iter()
            .map(|&[v0, v1, v2]| Triangle { v0, v1, v2 })
            .collect();
        let bvh = build_cwbvh(
            &boxes,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        let triangle_of_leaf = bvh.primitive_indices.clone();
        Self {
            leaves: triangle_of_leaf
                .iter()
                .map(|i| corners[*i as usize])
                .collect(),
            mesh,
            bvh,
            triangle_of_leaf,
            center,
            radius,
        }
    }

    /// How far a ray that leaves the surface should start, so as not to hit where it starts: 1e-4 of the size.
    pub fn self_distance(&self) -> f32 {
        2e-4 * self.radius
    }

    /// The mesh that is traced.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// The nearest hit with `t_min < t < t_max` (scene units), from either side of the surface.
    pub fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        let ray_ball = self.ball_ray(ray, t_min, t_max)?;
        let mut nearest = RayHit::none();
        self.bvh.ray_traverse(ray_ball, &mut nearest, |ray, leaf| {
            intersect_triangle(ray, &self.leaves[leaf]).map_or(f32::INFINITY, |hit| hit.t)
        });
        if nearest.primitive_id == INVALID_ID {
            return None;
        }
        let leaf = nearest.primitive_id as usize;
        let hit = intersect_triangle(&ray_ball, &self.leaves[leaf])?;
        Some(self.hit(ray, self.triangle_of_leaf[leaf], &hit))
    }

    /// Whether anything lies on the ray with `t_min < t < t_max` (scene units).
    pub fn occluded(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        self.ball_ray(ray, t_min, t_max).is_some_and(|ray_ball| {
            !self.bvh.ray_traverse_miss(ray_ball, |ray, leaf| {
                intersect_triangle(ray, &self.leaves[leaf]).map_or(f32::INFINITY, |hit| hit.t)
            })
        })
    }

    /// The ray in ball space; `None` when a number is not finite or the interval is empty.
    fn ball_ray(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<BvhRay> {
        let origin = (ray.origin - self.center) / self.radius;
        let (t_min, t_max) = (t_min / self.radius, t_max / self.radius);
        let usable = origin.is_finite() && ray.direction.is_finite() && t_min < t_max;
        usable.then(|| BvhRay::new(origin.into(), ray.direction.into(), t_min, t_max))
    }

    fn hit(&self, ray: &Ray, triangle: u32, hit: &TriangleHit) -> Hit {
        let corners = self.mesh.triangles[triangle as usize];
        let [p0, p1, p2] = corners.map(|i| self.mesh.positions[i as usize]);
        let [n0, n1, n2] = corners.map(|i| self.mesh.normals[i as usize]);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut geometric_normal = face_normal([p0, p1, p2]);
        // Vertex normals say where outside is; some files wind their faces the other way round.
        if geometric_normal.dot(n0 + n1 + n2) < 0.0 {
            geometric_normal = -geometric_normal;
        }
        let mut normal =
            (weights[0] * n0 + weights[1] * n1 + weights[2] * n2).normalize_or(geometric_normal);
        if geometric_normal.dot(ray.direction) > 0.0 {
            geometric_normal = -geometric_normal;
            normal = -normal;
        }
        Hit {
            t: hit.t * self.radius,
            triangle,
            u: hit.u,
            v: hit.v,
            position: weights[0] * p0 + weights[1] * p1 + weights[2] * p2,
            normal,
            geometric_normal,
        }
    }
}

/// The unit normal of a triangle of any size.
pub(super) fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    // Scaled first: the cross product of edges of 1e-20 underflows.
    let size = ab
        .abs()
        .max_element()
        .max(ac.abs().max_element())
        .max(f32::MIN_POSITIVE);
    (ab / size).cross(ac / size).normalize_or_zero()
}

/// A hit in ball space.
struct TriangleHit {
    t: f32,
    u: f32,
    v: f32,
}

/// The hit of a ball-space ray on a triangle within `ray.tmin..ray.tmax`.
///
/// Edge tests by Plücker-like products as in Embree (`triangle_intersector_pluecker.h`).
#[inline(always)]
fn intersect_triangle(ray: &BvhRay, corners: &[Vec3A; 3]) -> Option<TriangleHit> {
    let [v0, v1, v2] = corners.map(|p| p - ray.origin);
    let (e0, e1, e2) = (v2 - v0, v0 - v1, v1 - v2);
    let u = e0.cross(v2 + v0).dot(ray.direction);
    let v = e1.cross(v0 + v1).dot(ray.direction);
    let w = e2.cross(v1 + v2).dot(ray.direction);
    let sum = u + v + w;
    let tolerance = f32::EPSILON * sum.abs();
    let inside = u.min(v).min(w) >= -tolerance || u.max(v).max(w) <= tolerance;
    if !inside || sum == 0.0 {
        return None;
    }
    let normal = e1.cross(e0);
    let t = v0.dot(normal) / ray.direction.dot(normal);
    // A ray in the triangle's plane has t = 0/0; written so that NaN misses.
    if !(t > ray.tmin && t <= ray.tmax) {
        return None;
    }
    let u = (u / sum).clamp(0.0, 1.0);
    Some(TriangleHit {
        t,
        u,
        v: (v / sum).clamp(0.0, 1.0 - u),
    })
}
