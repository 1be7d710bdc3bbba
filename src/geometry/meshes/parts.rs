//! Connected parts of a mesh: triangles that hang together by corners at the same place.

use std::collections::HashMap;

use glam::Vec3;

use crate::geometry::{Mesh, Ray, SurfaceTracer};

/// How far beside the surface a point may lie, in steps of [`SurfaceTracer::self_distance`]: on it but for rounding, or
/// as a texel's middle does.
const REACHES: [f32; 2] = [1.0, 16.0];

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

impl SurfaceTracer {
    /// The part of the mesh on which a world point lies; `None` for points away from the surface. `normal`: a unit
    /// direction, best that of the surface.
    pub fn part_at(&self, p_world: Vec3, normal: Vec3) -> Option<u32> {
        let across = |direction: Vec3, reach: f32| {
            let ray = Ray {
                origin: p_world + direction * reach,
                direction: -direction,
            };
            self.intersect(&ray, 0.0, 2.0 * reach)
        };
        // A ray through the point meets its triangle unless it runs along it; one of the axes does not.
        let hit = REACHES.into_iter().find_map(|steps| {
            let reach = steps * self.self_distance();
            let directions = [normal, Vec3::X, Vec3::Y, Vec3::Z];
            directions
                .into_iter()
                .find_map(|direction| across(direction, reach))
        })?;
        Some(self.parts().of_triangle(hit.triangle))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::test_mesh::{ellipsoid, together};
    use super::*;

    #[test]
    fn two_balls_are_two_parts_and_a_split_seam_is_none() {
        let ball = |x: f32| ellipsoid(Vec3::new(x, 0.0, 0.0), Vec3::ONE, 8);
        // The ellipsoid's poles are rings of vertices at one position, and its columns are shared.
        assert_eq!(MeshParts::new(&ball(0.0)).n_parts(), 1, "one ball");
        let both = together(&ball(-1.5), &ball(1.5));
        let tracer = SurfaceTracer::new(Arc::new(both));
        assert_eq!(tracer.parts().n_parts(), 2, "two balls");
        for (i, corners) in tracer.mesh().triangles.iter().enumerate() {
            let middle = corners
                .map(|v| tracer.mesh().positions[v as usize])
                .into_iter()
                .sum::<Vec3>()
                / 3.0;
            let expected = tracer.parts().of_triangle(i as u32);
            for normal in [Vec3::X, Vec3::new(0.6, 0.0, 0.8)] {
                assert_eq!(tracer.part_at(middle, normal), Some(expected), "{i}");
            }
        }
        assert_eq!(tracer.part_at(Vec3::ZERO, Vec3::X), None, "between them");
    }
}
