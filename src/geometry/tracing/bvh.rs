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
            let corners = self.mesh.triangles[triangle as usize];
            let positions = corners.map(|i| row(self.mesh.positions[i as usize]));
            let normals = corners.map(|i| row(self.mesh.normals[i as usize]));
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
            // From one corner: a weighted sum of large coordinates would be rounded several times.
            position: p0 + (hit.u * (p1 - p0) + hit.v * (p2 - p0)),
            normal,
            geometric_normal,
        }
    }
}

/// The unit normal of a triangle of any size.
pub(in crate::geometry) fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::geometry::fibonacci_sphere;
    use crate::geometry::meshes::test_mesh::{ellipsoid, nested};

    /// The nearest hit distance by trying every triangle in double precision (Möller–Trumbore).
    fn brute_force(mesh: &Mesh, ray: &Ray) -> Option<f64> {
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let mut nearest: Option<f64> = None;
        for i in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(i).map(|p: Vec3| p.as_dvec3());
            let (e1, e2) = (b - a, c - a);
            let p: DVec3 = d.cross(e2);
            let det = e1.dot(p);
            if det == 0.0 {
                continue;
            }
            let q = (o - a).cross(e1);
            let (u, v) = ((o - a).dot(p) / det, d.dot(q) / det);
            let t = e2.dot(q) / det;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 {
                nearest = Some(nearest.map_or(t, |n| n.min(t)));
            }
        }
        nearest
    }

    fn tracer_of(scale: f32, center: Vec3) -> SurfaceTracer {
        let radii = scale * Vec3::new(1.0, 0.4, 0.7);
        SurfaceTracer::new(Arc::new(ellipsoid(center, radii, 12)))
    }

    #[test]
    fn triangles_upon_and_within_each_other_are_hit_like_others() {
        for (n, ratio, times) in [(500, 0.97, 1), (600, 0.9, 20), (400, 1.0, 1)] {
            let corners: Vec<Vec3> = nested(n, ratio, times).concat();
            let triangles = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
            let mesh = Mesh::new(corners, None, triangles.collect()).unwrap();
            let tracer = SurfaceTracer::new(Arc::new(mesh));
            for direction in fibonacci_sphere(500) {
                let origin = Vec3::splat(2.0);
                let ray = Ray {
                    origin,
                    direction: (direction.abs() * ratio - origin).normalize_or_zero(),
                };
                let expected = brute_force(tracer.mesh(), &ray).map(|t| t as f32);
                let hit = tracer.intersect(&ray, 0.0, f32::INFINITY).map(|hit| hit.t);
                let is_same = hit.zip(expected).map(|(a, b)| (a - b).abs() < 1e-5);
                assert_eq!(is_same, expected.map(|_| true), "{hit:?}, {expected:?}");
            }
        }
    }

    #[test]
    fn hits_agree_with_brute_force_at_every_scale() {
        for (scale, center) in [
            (1e-3, Vec3::ZERO),
            (1.0, Vec3::new(5.0, -3.0, 2.0)),
            (1e4, Vec3::new(1e4, 0.0, 0.0)),
        ] {
            let tracer = tracer_of(scale, center);
            let mut n_hits = 0;
            for (i, from) in fibonacci_sphere(400).into_iter().enumerate() {
                let aim = fibonacci_sphere(401)[(i * 37) % 401] * (0.8 * scale);
                let origin = center + 3.0 * scale * from;
                let ray = Ray {
                    origin,
                    direction: (center + aim - origin).normalize_or_zero(),
                };
                let expected = brute_force(tracer.mesh(), &ray);
                let hit = tracer.intersect(&ray, 0.0, f32::INFINITY);
                assert_eq!(hit.is_some(), expected.is_some(), "scale {scale}, ray {i}");
                assert_eq!(
                    tracer.occluded(&ray, 0.0, f32::INFINITY),
                    hit.is_some(),
                    "ray {i}"
                );
                let (Some(hit), Some(t)) = (hit, expected) else {
                    continue;
                };
                n_hits += 1;
                let error = (f64::from(hit.t) - t).abs() / f64::from(scale);
                assert!(error < 1e-4, "scale {scale}, ray {i}: {error}");
                let off = (hit.position - ray.at(hit.t)).length() / scale;
                assert!(off < 1e-4, "scale {scale}, ray {i}: position off by {off}");
            }
            assert!(n_hits > 100, "scale {scale}: only {n_hits} rays hit");
        }
    }

    #[test]
    fn rays_that_leave_a_convex_surface_never_meet_it_however_far_away_it_is() {
        for away in [0.0, 100.0, 1e4] {
            let center = Vec3::new(away, -0.3 * away, 0.1 * away);
            let tracer = tracer_of(1.0, center);
            let mut n_hits = 0;
            for (i, from) in fibonacci_sphere(2000).into_iter().enumerate() {
                let aim = fibonacci_sphere(401)[(i * 37) % 401] * 0.8;
                let origin = center + 3.0 * from;
                let direction = (center + aim - origin).normalize_or_zero();
                let Some(hit) = tracer.intersect(&Ray { origin, direction }, 0.0, 9.0) else {
                    continue;
                };
                let cos = hit.geometric_normal.dot(direction);
                // Rays closer to the surface have no bound; those lobes are half below the horizon anyway.
                if cos > -0.2 {
                    continue;
                }
                n_hits += 1;
                let mirrored = Ray {
                    origin: hit.position,
                    direction: direction - 2.0 * cos * hit.geometric_normal,
                };
                let start = tracer.self_distance();
                assert!(
                    !tracer.occluded(&mirrored, start, f32::INFINITY),
                    "{away} units away, ray {i}, cosine {cos}"
                );
            }
            assert!(n_hits > 500, "{away} units away: only {n_hits} hits");
        }
    }

    #[test]
    fn no_ray_slips_through_an_edge_or_a_vertex() {
        let tracer = tracer_of(1.0, Vec3::ZERO);
        let mesh = tracer.mesh();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
            for aim in [a, 0.5 * (a + b), 0.3 * b + 0.7 * c] {
                let ray = Ray {
                    origin: Vec3::new(0.01, 0.02, -0.01),
                    direction: (aim - Vec3::new(0.01, 0.02, -0.01)).normalize_or_zero(),
                };
                assert!(tracer.occluded(&ray, 0.0, f32::INFINITY), "towards {aim}");
            }
        }
    }

    #[test]
    fn normals_face_the_ray_from_outside_and_inside() {
        let tracer = tracer_of(1.0, Vec3::ZERO);
        for (x, outward) in [(3.0, 1.0), (0.0, -1.0)] {
            let ray = Ray {
                origin: Vec3::new(x, 0.01, 0.01),
                direction: if x > 0.0 { Vec3::NEG_X } else { Vec3::X },
            };
            let hit = tracer.intersect(&ray, 0.0, f32::INFINITY).unwrap();
            assert!(
                hit.geometric_normal.dot(ray.direction) < 0.0,
                "faces the ray"
            );
            assert!(
                outward * hit.normal.x > 0.9,
                "shading normal {}",
                hit.normal
            );
        }
    }

    #[test]
    fn faces_wound_inward_still_take_their_side_from_the_vertex_normals() {
        let sphere = ellipsoid(Vec3::ZERO, Vec3::ONE, 16);
        let inverted = sphere
            .triangles
            .iter()
            .map(|[a, b, c]| [*a, *c, *b])
            .collect();
        let mesh = Mesh::new(sphere.positions, Some(sphere.normals), inverted).unwrap();
        let ray = Ray {
            origin: 3.0 * Vec3::X,
            direction: Vec3::NEG_X,
        };
        let hit = SurfaceTracer::new(Arc::new(mesh))
            .intersect(&ray, 0.0, 9.0)
            .unwrap();
        assert!(
            hit.normal.x > 0.99 && hit.geometric_normal.x > 0.9,
            "{hit:?}"
        );
    }

    #[test]
    fn the_interval_limits_the_search() {
        let tracer = tracer_of(1.0, Vec3::ZERO);
        let ray = Ray {
            origin: 3.0 * Vec3::X,
            direction: Vec3::NEG_X,
        };
        let near = tracer.intersect(&ray, 0.0, 10.0).unwrap().t;
        assert!((near - 2.0).abs() < 1e-4, "near side at {near}");
        let far = tracer.intersect(&ray, 2.5, 10.0).unwrap().t;
        assert!((far - 4.0).abs() < 1e-4, "far side at {far}");
        assert_eq!(tracer.intersect(&ray, 0.0, 1.9), None, "ends before");
        assert!(!tracer.occluded(&ray, 4.1, 10.0), "starts behind");
        let nowhere = Ray {
            origin: Vec3::NAN,
            direction: Vec3::X,
        };
        assert_eq!(tracer.intersect(&nowhere, 0.0, 1.0), None, "a broken ray");
    }

    #[test]
    fn a_single_triangle_is_a_mesh_too() {
        let mesh = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], None, vec![[0, 1, 2]]).unwrap();
        let tracer = SurfaceTracer::new(Arc::new(mesh));
        let ray = Ray {
            origin: Vec3::new(0.25, 0.5, 1.0),
            direction: Vec3::NEG_Z,
        };
        let hit = tracer.intersect(&ray, 0.0, 2.0).unwrap();
        assert!(
            (hit.u - 0.25).abs() < 1e-5 && (hit.v - 0.5).abs() < 1e-5,
            "{hit:?}"
        );
    }
}
