//! Tangents of an unwrapped mesh, the frame of its normal map.

use glam::{Vec3, Vec4};

use crate::geometry::{Atlas, Mesh};

impl Atlas {
    /// A tangent for each unwrapped vertex as glTF has them (glTF 2.0, 3.7.2.1): where the texture's u grows along the surface, unit
    /// and across the vertex's normal, and the side of the bitangent, which points to the texture's top, `w * normal x tangent`.
    /// `mesh` is the one that was unwrapped. As `MikkTSpace` does, neighbouring triangles are averaged, here by their size.
    pub fn tangents(&self, mesh: &Mesh) -> Vec<Vec4> {
        let mut along_u = vec![Vec3::ZERO; self.vertices.len()];
        let mut along_v = along_u.clone();
        for triangle in &self.triangles {
            let at = |k: usize| {
                let vertex = triangle[k] as usize;
                let position = mesh.positions[self.vertices[vertex] as usize];
                (position, self.places_px[vertex])
            };
            let [(p, uv), (q, q_uv), (r, r_uv)] = [at(0), at(1), at(2)];
            let (to_q, to_r) = (q - p, r - p);
            let (q_uv, r_uv) = (q_uv - uv, r_uv - uv);
            // Both are longer by the triangle's size in the texture, and turned over where it is.
            let turned = q_uv.perp_dot(r_uv).signum();
            let du = turned * (to_q * r_uv.y - to_r * q_uv.y);
            let dv = turned * (to_r * q_uv.x - to_q * r_uv.x);
            for vertex in triangle.map(|v| v as usize) {
                along_u[vertex] += du;
                along_v[vertex] += dv;
            }
        }
        let tangents = self.vertices.iter().zip(along_u.iter().zip(&along_v));
        tangents
            .map(|(vertex, (du, dv))| {
                let normal = mesh.normals[*vertex as usize];
                let across = du.reject_from_normalized(normal);
                let tangent = across.normalize_or(normal.any_orthonormal_vector());
                // v grows downward.
                let is_up = normal.cross(tangent).dot(*dv) < 0.0;
                tangent.extend(if is_up { 1.0 } else { -1.0 })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    /// A square in the plane z = 0, seen from above.
    fn square(places_px: [Vec2; 4]) -> (Mesh, Atlas) {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let atlas = Atlas {
            size_px: 4,
            vertices: vec![0, 1, 2, 3],
            places_px: places_px.to_vec(),
            triangles: triangles.clone(),
        };
        (Mesh::new(positions, None, triangles).unwrap(), atlas)
    }

    #[test]
    fn tangents_follow_the_texture_and_bitangents_point_to_its_top() {
        // As one sees it: u to the right, v downward.
        let [o, right, up] = [Vec2::new(0.0, 4.0), Vec2::X * 4.0, Vec2::Y * -4.0];
        let (mesh, atlas) = square([o, o + right, o + right + up, o + up]);
        assert_eq!(
            atlas.tangents(&mesh),
            vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4]
        );
        // A quarter turn.
        let (mesh, atlas) = square([o, o + up, o + up + right, o + right]);
        let turned = atlas.tangents(&mesh);
        // And that is a mirror image: u grows along y, the texture's top lies along x.
        assert_eq!(turned, vec![Vec4::new(0.0, 1.0, 0.0, -1.0); 4]);
    }
}
