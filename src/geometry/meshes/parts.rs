//! Connected parts of a mesh: triangles that hang together by corners at the same place.

use std::collections::HashMap;

use glam::Vec3;

use crate::geometry::Mesh;

/// Which part of a mesh each of its triangles belongs to.
#[derive(Clone, Debug)]
pub struct MeshParts {
    of_triangle: Vec<u32>,
    n_parts: u32,
}

impl MeshParts {
    /// Finds the parts; corners at the same position are the same corner, as files split vertices at seams.
    pub fn new(mesh: &Mesh) -> Self {
        let mut parents = merged_positions(mesh);
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

    /// The part of a triangle, below [`Self::n_parts`].
    pub fn of_triangle(&self, triangle: u32) -> u32 {
        self.of_triangle[triangle as usize]
    }

    /// How many parts there are, at least 1.
    pub fn n_parts(&self) -> u32 {
        self.n_parts
    }
}

/// For each vertex the first one at its position.
fn merged_positions(mesh: &Mesh) -> Vec<u32> {
    let mut first_at: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let vertices = mesh.positions.iter().zip(0..);
    vertices
        .map(|(p, i)| {
            // Adding zero makes -0 and +0 the same position.
            let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
            *first_at.entry(key).or_insert(i)
        })
        .collect()
}

/// The root of a vertex's tree; halves the way for the next search.
fn root(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        parents[i as usize] = parents[parents[i as usize] as usize];
        i = parents[i as usize];
    }
    i
}
