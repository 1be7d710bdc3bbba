//! The parts of a mesh that hang together.

use crate::geometry::{Mesh, MeshError};

impl Mesh {
    /// The mesh without connected parts of less than `least_share` of the largest one's area.
    /// Vertices that no triangle uses are dropped. Triangles hang together by shared vertices.
    pub fn without_specks(&self, least_share: f64) -> Result<Self, MeshError> {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        for [a, b, c] in &self.triangles {
            for other in [b, c] {
                let (a, b) = (root(&mut parent, *a), root(&mut parent, *other));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
        let mut area = vec![0.0_f64; self.positions.len()];
        let roots: Vec<usize> = self
            .triangles
            .iter()
            .map(|[a, _, _]| root(&mut parent, *a) as usize)
            .collect();
        for (i, part) in roots.iter().enumerate() {
            let [a, b, c] = self.corners(i);
            area[*part] += 0.5 * f64::from((b - a).cross(c - a).length());
        }
        let least = least_share * area.iter().copied().fold(0.0, f64::max);
        let mut number = vec![u32::MAX; self.positions.len()];
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for (triangle, part) in self.triangles.iter().zip(&roots) {
            if area[*part] < least {
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

/// The first vertex of the part that `vertex` belongs to; paths are halved on the way.
fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        let above = parent[parent[vertex as usize] as usize];
        parent[vertex as usize] = above;
        vertex = above;
    }
    vertex
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
