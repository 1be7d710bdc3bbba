//! Connected parts of a mesh: triangles that hang together by corners at the same place.

use std::collections::HashMap;

use super::mesh::merged_vertices;
use crate::geometry::{Mesh, MeshError};

/// Which part of a mesh each of its triangles belongs to.
#[derive(Clone, Debug)]
pub struct MeshParts {
    of_triangle: Vec<u32>,
    /// How many parts there are, at least 1.
    pub(in crate::geometry) n_parts: u32,
}

impl MeshParts {
    /// Finds the parts; corners at the same position are the same corner.
    pub fn new(mesh: &Mesh) -> Self {
        Self::joined(mesh, merged_vertices(&mesh.positions))
    }

    /// The parts whose triangles share vertices, or vertices that are the same: `parents` is each vertex, or an earlier one
    /// that it is the same as.
    fn joined(mesh: &Mesh, mut parents: Vec<u32>) -> Self {
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|i| root(&mut parents, i));
            // The least index becomes the root, so that no order of triangles matters.
            let least = a.min(b).min(c);
            for other in [a, b, c] {
                parents[other as usize] = least;
            }
        }
        let mut number_of_root = HashMap::new();
        let of_triangle = mesh.triangles.iter().map(|corners| {
            let next = number_of_root.len() as u32;
            *number_of_root
                .entry(root(&mut parents, corners[0]))
                .or_insert(next)
        });
        let of_triangle = of_triangle.collect();
        Self {
            of_triangle,
            n_parts: number_of_root.len() as u32,
        }
    }

    /// The part of a triangle, below their number.
    pub fn of_triangle(&self, triangle: u32) -> u32 {
        self.of_triangle[triangle as usize]
    }
}

impl Mesh {
    /// The mesh without connected parts of less than `least_share` of the largest one's area.
    /// Vertices that no triangle uses are dropped. Triangles hang together by shared vertices.
    pub fn without_specks(&self, least_share: f64) -> Result<Self, MeshError> {
        let vertices = 0..self.positions.len() as u32;
        let parts = MeshParts::joined(self, vertices.collect());
        let mut area = vec![0.0_f64; parts.n_parts as usize];
        for (i, part) in parts.of_triangle.iter().enumerate() {
            area[*part as usize] += f64::from(self.area(i));
        }
        let least = least_share * area.iter().copied().fold(0.0, f64::max);
        let mut number = vec![u32::MAX; self.positions.len()];
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for (triangle, part) in self.triangles.iter().zip(&parts.of_triangle) {
            if area[*part as usize] < least {
                continue;
            }
            triangles.push(triangle.map(|vertex| {
                let vertex = vertex as usize;
                if number[vertex] == u32::MAX {
                    number[vertex] = positions.len() as u32;
                    positions.push(self.positions[vertex]);
                    normals.push(self.normals[vertex]);
                }
                number[vertex]
            }));
        }
        Self::new(positions, Some(normals), triangles)
    }
}

/// The root of a vertex's tree; halves the way for the next search.
fn root(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        parents[i as usize] = parents[parents[i as usize] as usize];
        i = parents[i as usize];
    }
    i
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::test_mesh::{ellipsoid, together};

    #[test]
    fn small_parts_go_and_large_ones_stay() {
        let ball = ellipsoid(Vec3::ZERO, Vec3::ONE, 12);
        let other = ellipsoid(5.0 * Vec3::X, Vec3::splat(0.5), 12);
        let speck = ellipsoid(9.0 * Vec3::X, Vec3::splat(0.02), 12);
        let all = together(&together(&ball, &other), &speck);
        let kept = all.without_specks(0.01).unwrap();
        assert_eq!(
            kept.triangles.len(),
            ball.triangles.len() + other.triangles.len(),
            "faces"
        );
        assert!(kept.bounds().max.x < 6.0, "the speck is gone");
    }
}
