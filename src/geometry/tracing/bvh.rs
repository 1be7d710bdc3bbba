//! Rays against a mesh: nearest hit and occlusion, over an eight-wide hierarchy.
//!
//! The hierarchy is built over the mesh moved and scaled to the unit ball, so that its fixed
//! epsilons mean the same for scenes of 1e-3 and 1e4 units. Triangles are tested by the
//! edge-consistent scheme of Embree's Plücker intersector: an edge shared by two triangles gives
//! exactly opposite signs in both, hence no ray slips between neighbours.

use std::sync::{Arc, OnceLock};

use glam::{Vec3, Vec3A};
use obvhs::ray::Ray as BvhRay;
use obvhs::triangle::Triangle;

use super::hierarchy::build_hierarchy;
use super::wide_bvh::{Slabs, Walk, WideBvh};
use crate::geometry::meshes::mesh::face_normal;
use crate::geometry::{Mesh, MeshParts, Ray};

/// Units in the last place of the mesh's coordinates that a ray must leave behind: half of one is the error of its
/// start, and a ray close to the surface needs a multiple of that to get clear of it.
const ROUNDINGS: f32 = 8.0;

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

/// What [`SurfaceTracer::rows`] gives.
#[derive(Clone, Debug)]
pub struct TracerRows {
    /// Sixteen rows a node, two a child: lower corner (bits of floats) and first leaf or node; upper corner and number of
    /// leaves, 0 for a node and `u32::MAX` for no child. In the coordinates of [`SurfaceTracer::bounding_ball`].
    pub nodes: Vec<[u32; 4]>,
    /// Number of leaves, a triangle each.
    pub n_leaves: usize,
    /// Three rows a leaf, its corners in the ball; then six a leaf, its corners and their unit normals in the world.
    pub triangles: Vec<[f32; 4]>,
}

/// Traces rays against one mesh. Built once; shared between threads by reference.
pub struct SurfaceTracer {
    mesh: Arc<Mesh>,
    bvh: WideBvh,
    /// Corners in ball space, in the order of the BVH's leaves.
    leaves: Vec<[Vec3A; 3]>,
    /// Triangle index of each leaf.
    triangle_of_leaf: Vec<u32>,
    /// Ball space: `p_ball = (p_world - center) / radius`.
    center: Vec3,
    radius: f32,
    parts: OnceLock<MeshParts>,
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
        let bvh = build_hierarchy(&boxes);
        Self {
            leaves: bvh
                .primitive_indices
                .iter()
                .map(|i| corners[*i as usize])
                .collect(),
            mesh,
            bvh: WideBvh::new(&bvh),
            triangle_of_leaf: bvh.primitive_indices,
            center,
            radius,
            parts: OnceLock::new(),
        }
    }

    /// How far a ray that leaves the surface should start, so as not to hit where it starts: 1e-4 of the size, and more
    /// where the mesh is so far from the origin that a point on it is rounded to either side of it by as much.
    pub fn self_distance(&self) -> f32 {
        let rounding = f32::EPSILON * self.center.abs().max_element();
        (2e-4 * self.radius).max(ROUNDINGS * rounding)
    }

    /// The mesh that is traced.
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// The mesh's connected parts, found when they are first asked for.
    pub fn parts(&self) -> &MeshParts {
        self.parts.get_or_init(|| MeshParts::new(&self.mesh))
    }

    /// Centre and radius of a ball that holds the mesh.
    pub fn bounding_ball(&self) -> (Vec3, f32) {
        (self.center, self.radius)
    }

    /// The nearest hit with `t_min < t < t_max` (scene units), from either side of the surface.
    pub fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        let ray_ball = self.ball_ray(ray, t_min, t_max)?;
        let mut nearest = None;
        let slabs = Slabs::new(&ray_ball);
        self.bvh
            .walk_ray(0, &slabs, &mut { ray_ball }, |ray, leaf| {
                if let Some(t) = self.leaf_distance(ray, leaf) {
                    ray.tmax = t;
                    nearest = Some(leaf);
                }
                Walk::On
            });
        self.hit_on_leaf(ray, &ray_ball, nearest?)
    }

    /// Whether anything lies on the ray with `t_min < t < t_max` (scene units).
    pub fn occluded(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        let Some(mut ray_ball) = self.ball_ray(ray, t_min, t_max) else {
            return false;
        };
        let slabs = Slabs::new(&ray_ball);
        // The walk is stopped by the first hit.
        !self.bvh.walk_ray(0, &slabs, &mut ray_ball, |ray, leaf| {
            match self.leaf_distance(ray, leaf) {
                Some(_) => Walk::Stop,
                None => Walk::On,
            }
        })
    }

    /// Hierarchy and triangles as rows of four, for a graphics card.
    pub fn rows(&self) -> TracerRows {
        let row = |v: Vec3| [v.x, v.y, v.z, 0.0];
        let in_ball = self.leaves.iter().flatten().map(|p| row(Vec3::from(*p)));
        let in_world = self.triangle_of_leaf.iter().flat_map(|&triangle| {
            let positions = self.mesh.corners(triangle as usize).map(row);
            let normals = self.mesh.corner_normals(triangle as usize).map(row);
            positions.into_iter().chain(normals)
        });
        TracerRows {
            nodes: self.bvh.rows(),
            n_leaves: self.leaves.len(),
            triangles: in_ball.chain(in_world).collect(),
        }
    }

    pub(in crate::geometry) fn bvh(&self) -> &WideBvh {
        &self.bvh
    }

    /// Corners of a leaf's triangle, ball space.
    pub(super) fn leaf(&self, leaf: usize) -> &[Vec3A; 3] {
        &self.leaves[leaf]
    }

    pub(super) fn to_ball(&self, p_world: Vec3) -> Vec3A {
        ((p_world - self.center) / self.radius).into()
    }

    /// The ray in ball space; `None` when a number is not finite or the interval is empty.
    pub(super) fn ball_ray(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<BvhRay> {
        let origin = self.to_ball(ray.origin);
        let (t_min, t_max) = (t_min / self.radius, t_max / self.radius);
        let usable = origin.is_finite() && ray.direction.is_finite() && t_min < t_max;
        usable.then(|| BvhRay::new(origin, ray.direction.into(), t_min, t_max))
    }

    /// Where a ball-space ray meets the leaf's triangle before its end, if it does.
    #[inline(always)]
    pub(super) fn leaf_distance(&self, ray: &BvhRay, leaf: usize) -> Option<f32> {
        let hit = intersect_triangle(ray, &self.leaves[leaf])?;
        (hit.t < ray.tmax).then_some(hit.t)
    }

    /// The hit of a ray, also given in ball space, on the triangle of `leaf`.
    pub(super) fn hit_on_leaf(&self, ray: &Ray, ray_ball: &BvhRay, leaf: usize) -> Option<Hit> {
        let hit = intersect_triangle(ray_ball, &self.leaves[leaf])?;
        Some(self.hit(ray, self.triangle_of_leaf[leaf], &hit))
    }

    fn hit(&self, ray: &Ray, triangle: u32, hit: &TriangleHit) -> Hit {
        let [p0, p1, p2] = self.mesh.corners(triangle as usize);
        let [n0, n1, n2] = self.mesh.corner_normals(triangle as usize);
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
            // From one corner: a weighted sum of large coordinates would be rounded several times.
            position: p0 + (hit.u * (p1 - p0) + hit.v * (p2 - p0)),
            normal,
            geometric_normal,
        }
    }
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

#[cfg(test)]
mod tests;
