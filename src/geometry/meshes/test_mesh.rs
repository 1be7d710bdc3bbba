//! Meshes for tests.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::geometry::Mesh;

/// A closed ellipsoid with exact normals: `n` rings of `2 n` vertices.
pub(crate) fn ellipsoid(center: Vec3, radii: Vec3, n: u32) -> Mesh {
    let columns = 2 * n;
    let mut positions = Vec::new();
    let mut normals = Vec::new();
    for ring in 0..=n {
        let theta = PI * ring as f32 / n as f32;
        // sin(pi) is not quite 0 in f32, and the pole must be one point.
        let sin = if ring == n { 0.0 } else { theta.sin() };
        for column in 0..columns {
            let phi = TAU * column as f32 / columns as f32;
            let unit = Vec3::new(sin * phi.cos(), sin * phi.sin(), theta.cos());
            positions.push(center + radii * unit);
            normals.push((unit / radii).normalize_or_zero());
        }
    }
    let mut triangles = Vec::new();
    for ring in 0..n {
        for column in 0..columns {
            let next = (column + 1) % columns;
            let (a, b) = (ring * columns + column, ring * columns + next);
            let (c, d) = (a + columns, b + columns);
            if ring > 0 {
                triangles.push([a, c, b]);
            }
            if ring + 1 < n {
                triangles.push([b, c, d]);
            }
        }
    }
    Mesh::new(positions, Some(normals), triangles).unwrap()
}

/// Both meshes as one.
pub(crate) fn together(a: &Mesh, b: &Mesh) -> Mesh {
    let n = a.positions.len() as u32;
    let triangles = b.triangles.iter().map(|corners| corners.map(|i| i + n));
    Mesh::new(
        [a.positions.as_slice(), &b.positions].concat(),
        Some([a.normals.as_slice(), &b.normals].concat()),
        a.triangles.iter().copied().chain(triangles).collect(),
    )
    .unwrap()
}

/// So many triangles, each `times` the same and smaller by a factor than those about it.
pub(crate) fn nested(n: usize, ratio: f32, times: usize) -> Vec<[Vec3; 3]> {
    let sizes = (0..n).map(|i| ratio.powi((i / times) as i32));
    sizes
        .map(|size| [Vec3::X, Vec3::Y, Vec3::Z].map(|corner| size * corner))
        .collect()
}
