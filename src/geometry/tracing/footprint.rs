//! Ray differentials at a mirror hit: how far one pixel step moves the reflected ray.
//!
//! A pixel is not a line but a narrow beam; after a curved mirror it is a wider one. The
//! environment field is asked for the mean over that beam (design: "pixel footprint"). Igehy
//! 1999, "Tracing Ray Differentials", by finite differences of the neighbouring pixels' rays.

use glam::Vec3;

use crate::geometry::meshes::mesh::face_normal;
use crate::geometry::{Hit, Ray, SurfaceTracer};

/// The largest change of a unit direction: opposite directions.
const MAX_DIRECTION_CHANGE: f32 = 2.0;
/// Plane offsets are cut at this share of the hit distance: at grazing incidence a neighbour ray
/// runs nearly along the plane and its offset has no bound.
const MAX_OFFSET_SHARE: f32 = 0.1;
/// The barycentric weights of a neighbour are cut here: beyond a few triangles the vertex normals
/// of this one say nothing of the surface.
const MAX_BARYCENTRIC: f32 = 4.0;

/// How the reflected ray changes for a step of one pixel, as root mean square of the x and y step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFootprint {
    /// Sideways shift of the reflected ray's origin, perpendicular to it, in scene units.
    pub position_per_px: f32,
    /// Change of the unit reflected direction, in radians (for small changes).
    pub reflection_per_px: f32,
}

impl SurfaceTracer {
    /// The footprint at `hit` of `ray`, given the rays of the next pixel in x and in y.
    ///
    /// The neighbours are met with the plane of the hit triangle, without another search, and the
    /// vertex normals are continued over its edges. Always finite.
    pub fn footprint(&self, hit: &Hit, ray: &Ray, ray_dx: &Ray, ray_dy: &Ray) -> SurfaceFootprint {
        let tangent_frame = HitTriangle::new(self, hit, ray);
        let reflected = ray.direction.reflect(hit.normal);
        let steps = [ray_dx, ray_dy].map(|neighbour| {
            let offset = tangent_frame.plane_offset(hit, neighbour);
            let normal = tangent_frame.normal_at(hit, offset);
            let sideways = offset - offset.dot(reflected) * reflected;
            let turned = neighbour.direction.reflect(normal) - reflected;
            (
                sideways.length_squared(),
                turned.length_squared().min(MAX_DIRECTION_CHANGE.powi(2)),
            )
        });
        SurfaceFootprint {
            position_per_px: (0.5 * (steps[0].0 + steps[1].0)).sqrt(),
            reflection_per_px: (0.5 * (steps[0].1 + steps[1].1)).sqrt(),
        }
    }

    /// Turn of the shading normal for a step along the surface at `hit`, in radians a scene unit: root mean square
    /// over the directions. 0 on a flat or degenerate triangle.
    pub fn curvature(&self, hit: &Hit) -> f32 {
        let mesh = self.mesh();
        let [p0, p1, p2] = mesh.corners(hit.triangle as usize);
        let [n0, n1, n2] = mesh.corner_normals(hit.triangle as usize);
        // Normals are linear over the triangle: solve for their change along two orthonormal directions.
        let (e1, e2) = (p1 - p0, p2 - p0);
        let x = e1.normalize_or_zero();
        let across = e2 - e2.dot(x) * x;
        let (width, height) = (e1.length(), across.length());
        let dx = (n1 - n0) / width;
        let dy = (n2 - n0 - e2.dot(x) * dx) / height;
        let square = 0.5 * (dx.length_squared() + dy.length_squared());
        if square.is_finite() {
            square.sqrt()
        } else {
            0.0
        }
    }
}

/// The triangle that was hit, ready to be continued beyond its edges.
struct HitTriangle {
    normals: [Vec3; 3],
    geometric_normal: Vec3,
    /// Edge 0-1 and 0-2.
    edges: [Vec3; 2],
    max_offset: f32,
    /// -1 where the hit was seen from behind: the vertex normals are flipped then.
    side: f32,
}

impl HitTriangle {
    fn new(tracer: &SurfaceTracer, hit: &Hit, ray: &Ray) -> Self {
        let mesh = tracer.mesh();
        let [p0, p1, p2] = mesh.corners(hit.triangle as usize);
        let normals = mesh.corner_normals(hit.triangle as usize);
        let smooth = (1.0 - hit.u - hit.v) * normals[0] + hit.u * normals[1] + hit.v * normals[2];
        Self {
            normals,
            geometric_normal: face_normal([p0, p1, p2]),
            edges: [p1 - p0, p2 - p0],
            max_offset: MAX_OFFSET_SHARE * (hit.position - ray.origin).length(),
            side: if smooth.dot(hit.normal) < 0.0 {
                -1.0
            } else {
                1.0
            },
        }
    }

    /// Where `neighbour` meets the triangle's plane, relative to the hit; cut at `max_offset`.
    fn plane_offset(&self, hit: &Hit, neighbour: &Ray) -> Vec3 {
        let n = self.geometric_normal;
        let to_hit = hit.position - neighbour.origin;
        let t = n.dot(to_hit) / n.dot(neighbour.direction);
        // A neighbour that misses the plane (parallel or pointing away) passes at its nearest.
        let t = if t.is_finite() && t > 0.0 {
            t
        } else {
            to_hit.dot(neighbour.direction)
        };
        (t * neighbour.direction - to_hit).clamp_length_max(self.max_offset)
    }

    /// The unit shading normal at `offset` from the hit.
    fn normal_at(&self, hit: &Hit, offset: Vec3) -> Vec3 {
        let [e1, e2] = self.edges;
        // Barycentrics of a point in the plane: Cramer's rule, Ericson 2005, Sec. 3.4.
        let (d11, d12, d22) = (e1.dot(e1), e1.dot(e2), e2.dot(e2));
        let (b1, b2) = (offset.dot(e1), offset.dot(e2));
        let det = d11 * d22 - d12 * d12;
        let du = (d22 * b1 - d12 * b2) / det;
        let dv = (d11 * b2 - d12 * b1) / det;
        if !(du.is_finite() && dv.is_finite()) {
            return hit.normal;
        }
        // Scaling both keeps the direction of the step.
        let shrink = MAX_BARYCENTRIC / du.abs().max(dv.abs()).max(MAX_BARYCENTRIC);
        let (u, v) = (hit.u + shrink * du, hit.v + shrink * dv);
        let [n0, n1, n2] = self.normals;
        (self.side * ((1.0 - u - v) * n0 + u * n1 + v * n2)).normalize_or(hit.normal)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::meshes::test_mesh::ellipsoid;
    use crate::geometry::{Camera, Mesh};

    fn rays(camera: &Camera, x: f32, y: f32) -> [Ray; 3] {
        [
            camera.ray(x, y),
            camera.ray(x + 1.0, y),
            camera.ray(x, y + 1.0),
        ]
    }

    #[test]
    fn curvature_of_a_sphere_is_one_over_its_radius() {
        for scale in [1e-3_f32, 1.0, 1e4] {
            let tracer =
                SurfaceTracer::new(Arc::new(ellipsoid(Vec3::ZERO, Vec3::splat(scale), 200)));
            let camera = Camera::look_at(
                scale * Vec3::new(0.5, 4.0, 1.0),
                Vec3::ZERO,
                Vec3::Z,
                0.6,
                400,
                400,
            );
            for (x, y) in [(200.5, 200.5), (170.5, 230.5)] {
                let hit = tracer
                    .intersect(&camera.ray(x, y), 0.0, f32::INFINITY)
                    .unwrap();
                let curvature = tracer.curvature(&hit) * scale;
                assert!((curvature - 1.0).abs() < 0.05, "scale {scale}: {curvature}");
            }
        }
    }

    #[test]
    fn footprints_on_a_sphere_agree_with_traced_neighbours() {
        for scale in [1e-3_f32, 1.0, 1e4] {
            let sphere = ellipsoid(Vec3::ZERO, Vec3::splat(scale), 200);
            let tracer = SurfaceTracer::new(Arc::new(sphere));
            let eye = scale * Vec3::new(0.5, 4.0, 1.0);
            let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.6, 400, 400);
            for (x, y) in [
                (200.5, 200.5),
                (170.5, 230.5),
                (120.5, 180.5),
                (260.5, 300.5),
            ] {
                let [ray, dx, dy] = rays(&camera, x, y);
                let hit = tracer.intersect(&ray, 0.0, f32::INFINITY).unwrap();
                let footprint = tracer.footprint(&hit, &ray, &dx, &dy);
                let reflected = ray.direction.reflect(hit.normal);
                let (mut position, mut turn) = (0.0, 0.0);
                for neighbour in [dx, dy] {
                    let other = tracer.intersect(&neighbour, 0.0, f32::INFINITY).unwrap();
                    let dp = other.position - hit.position;
                    position += 0.5 * (dp - dp.dot(reflected) * reflected).length_squared();
                    let turned = neighbour.direction.reflect(other.normal) - reflected;
                    turn += 0.5 * turned.length_squared();
                }
                let ratio = footprint.position_per_px / position.sqrt();
                assert!(
                    (ratio - 1.0).abs() < 0.05,
                    "({x}, {y}): position off by {ratio}"
                );
                let ratio = footprint.reflection_per_px / turn.sqrt();
                assert!(
                    (ratio - 1.0).abs() < 0.05,
                    "({x}, {y}): reflection off by {ratio}"
                );
            }
        }
    }

    #[test]
    fn a_flat_mirror_turns_reflections_by_the_pixels_own_angle() {
        let positions = vec![
            Vec3::new(-9.0, -9.0, 0.0),
            Vec3::new(9.0, -9.0, 0.0),
            Vec3::new(0.0, 9.0, 0.0),
        ];
        let mesh = Mesh::new(positions, None, vec![[0, 1, 2]]).unwrap();
        let tracer = SurfaceTracer::new(Arc::new(mesh));
        let camera = Camera::look_at(3.0 * Vec3::Z, Vec3::ZERO, Vec3::Y, 0.5, 100, 100);
        let [ray, dx, dy] = rays(&camera, 50.0, 50.0);
        let hit = tracer.intersect(&ray, 0.0, 9.0).unwrap();
        let footprint = tracer.footprint(&hit, &ray, &dx, &dy);
        let angle = camera.pixel_angle();
        assert!(
            (footprint.reflection_per_px / angle - 1.0).abs() < 1e-3,
            "{footprint:?}"
        );
        assert!(
            (footprint.position_per_px / (3.0 * angle) - 1.0).abs() < 1e-3,
            "{footprint:?}"
        );
    }

    #[test]
    fn grazing_hits_and_broken_neighbours_stay_finite() {
        let tracer = SurfaceTracer::new(Arc::new(ellipsoid(Vec3::ZERO, Vec3::ONE, 40)));
        let camera = Camera::look_at(4.0 * Vec3::X, Vec3::ZERO, Vec3::Z, 0.6, 100, 100);
        let mut n_hits = 0;
        for x in 0..100 {
            let [ray, dx, dy] = rays(&camera, x as f32 + 0.5, 50.5);
            let Some(hit) = tracer.intersect(&ray, 0.0, 9.0) else {
                continue;
            };
            n_hits += 1;
            let away = Ray {
                direction: -ray.direction,
                ..ray
            };
            for (dx, dy) in [(dx, dy), (away, ray)] {
                let footprint = tracer.footprint(&hit, &ray, &dx, &dy);
                assert!(
                    footprint.position_per_px.is_finite(),
                    "column {x}: {footprint:?}"
                );
                assert!(
                    footprint.reflection_per_px <= MAX_DIRECTION_CHANGE,
                    "{footprint:?}"
                );
            }
        }
        assert!(n_hits > 50, "the sphere fills the row");
    }
}
