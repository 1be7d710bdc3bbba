//! Tests of `bvh`.

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

fn toward(origin: Vec3, target: Vec3) -> Ray {
    Ray {
        origin,
        direction: (target - origin).normalize_or_zero(),
    }
}

#[test]
fn triangles_upon_and_within_each_other_are_hit_like_others() {
    for (n, ratio, times) in [(500, 0.97, 1), (600, 0.9, 20), (400, 1.0, 1)] {
        let corners: Vec<Vec3> = nested(n, ratio, times).concat();
        let triangles = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let mesh = Mesh::new(corners, None, triangles.collect()).unwrap();
        let tracer = SurfaceTracer::new(Arc::new(mesh));
        for direction in fibonacci_sphere(500) {
            let ray = toward(Vec3::splat(2.0), direction.abs() * ratio);
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
            let ray = toward(center + 3.0 * scale * from, center + aim);
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
            let ray = toward(center + 3.0 * from, center + aim);
            let Some(hit) = tracer.intersect(&ray, 0.0, 9.0) else {
                continue;
            };
            let cos = hit.geometric_normal.dot(ray.direction);
            // Rays closer to the surface have no bound; those lobes are half below the horizon anyway.
            if cos > -0.2 {
                continue;
            }
            n_hits += 1;
            let mirrored = Ray {
                origin: hit.position,
                direction: ray.direction - 2.0 * cos * hit.geometric_normal,
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
            let ray = toward(Vec3::new(0.01, 0.02, -0.01), aim);
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
    let ray = toward(3.0 * Vec3::X, Vec3::ZERO);
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
    let ray = toward(3.0 * Vec3::X, Vec3::ZERO);
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
    let ray = toward(Vec3::new(0.25, 0.5, 1.0), Vec3::new(0.25, 0.5, 0.0));
    let hit = tracer.intersect(&ray, 0.0, 2.0).unwrap();
    assert!(
        (hit.u - 0.25).abs() < 1e-5 && (hit.v - 0.5).abs() < 1e-5,
        "{hit:?}"
    );
}
