//! Triangle meshes with one normal a vertex.

use std::collections::HashMap;

use glam::{Affine3A, Mat3A, Vec3};
use thiserror::Error;

use crate::geometry::Aabb;

/// Why positions and faces do not make a mesh.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MeshError {
    /// No triangle with an area is left.
    #[error("the mesh has no faces ({n_vertices} vertices, {n_degenerate} degenerate triangles)")]
    NoFaces {
        /// Vertices given.
        n_vertices: usize,
        /// Triangles without an area, which were dropped.
        n_degenerate: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {index}, but there are {n_vertices} vertices")]
    IndexOutOfRange {
        /// Which triangle.
        triangle: usize,
        /// The vertex index it names.
        index: u32,
        /// Vertices given.
        n_vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("the position of vertex {vertex} is not finite")]
    NonFinitePosition {
        /// Which vertex.
        vertex: usize,
    },
}

/// A triangle mesh. Fields are public for reading; [`Mesh::new`] is what guarantees that indices
/// are in range, positions finite, normals unit and triangles non-degenerate.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// `[n_vertices]` positions.
    pub positions: Vec<Vec3>,
    /// `[n_vertices]` unit shading normals.
    pub normals: Vec<Vec3>,
    /// `[n_triangles]` vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles without an area that were dropped on construction.
    pub n_degenerate: usize,
}

impl Mesh {
    /// A mesh of the given faces. Vertices are neither welded nor split.
    ///
    /// Triangles without an area are dropped and counted. Normals that are missing, zero or not
    /// finite are replaced by smooth ones: the mean of the face normals around the *position*
    /// (so that a texture seam does not become a crease), weighted by the angle at the vertex
    /// (Thürmer and Wüthrich 1998).
    pub fn new(
        positions: Vec<Vec3>,
        normals: Option<Vec<Vec3>>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<Self, MeshError> {
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NonFinitePosition { vertex });
        }
        check_indices(&triangles, positions.len())?;
        let n_given = triangles.len();
        let mut triangles = triangles;
        triangles.retain(|&[a, b, c]| {
            let corners = [a, b, c].map(|v| positions[v as usize]);
            // Below this the cross product is rounding noise and has no direction.
            a != b && b != c && c != a && scaled_area_vector(corners).length_squared() > 1e-14
        });
        let n_degenerate = n_given - triangles.len();
        if triangles.is_empty() {
            return Err(MeshError::NoFaces {
                n_vertices: positions.len(),
                n_degenerate,
            });
        }
        let normals = complete_normals(&positions, normals, &triangles);
        Ok(Self {
            positions,
            normals,
            triangles,
            n_degenerate,
        })
    }

    /// The corner positions of triangle `i`.
    #[inline]
    pub fn corners(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].map(|v| self.positions[v as usize])
    }

    /// The shading normals at the corners of triangle `i`.
    #[inline]
    pub fn corner_normals(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].map(|v| self.normals[v as usize])
    }

    /// The smallest box around the vertices that faces use.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_points((0..self.triangles.len()).flat_map(|i| self.corners(i)))
    }

    /// The area of triangle `i`, in square scene units.
    pub(super) fn area(&self, i: usize) -> f32 {
        let [a, b, c] = self.corners(i);
        0.5 * (b - a).cross(c - a).length()
    }

    /// The sum of the triangle areas, in square scene units.
    pub fn surface_area(&self) -> f64 {
        (0..self.triangles.len())
            .map(|i| {
                let [a, b, c] = self.corners(i).map(|p: Vec3| p.as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            })
            .sum()
    }

    /// The mesh moved by `to_from_here`; normals by its inverse transpose, winding kept outward
    /// when the transform mirrors.
    pub fn transformed(&self, to_from_here: Affine3A) -> Self {
        let normal_matrix = normal_matrix(to_from_here);
        let mirrored = to_from_here.matrix3.determinant() < 0.0;
        let flip = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        Self {
            positions: self
                .positions
                .iter()
                .map(|p| to_from_here.transform_point3(*p))
                .collect(),
            normals: self
                .normals
                .iter()
                .map(|n| (normal_matrix * *n).normalize_or(*n))
                .collect(),
            triangles: self.triangles.iter().map(|t| flip(*t)).collect(),
            n_degenerate: self.n_degenerate,
        }
    }
}

/// The matrix that carries normals along with `to_from_here`: the cofactor matrix of its linear
/// part, which unlike the inverse transpose exists for flattening transforms too.
fn normal_matrix(to_from_here: Affine3A) -> Mat3A {
    let m = to_from_here.matrix3;
    let cofactors = Mat3A::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    if m.determinant() < 0.0 {
        -cofactors
    } else {
        cofactors
    }
}

fn check_indices(triangles: &[[u32; 3]], n_vertices: usize) -> Result<(), MeshError> {
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|i| **i as usize >= n_vertices) {
            return Err(MeshError::IndexOutOfRange {
                triangle,
                index,
                n_vertices,
            });
        }
    }
    Ok(())
}

/// A vector along the face normal; not finite for a triangle that is a point.
///
/// Edges are divided by their longest component first: the area of a triangle of size 1e-20
/// would underflow, and it is as good a triangle as any.
fn scaled_area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let size = ab.abs().max_element().max(ac.abs().max_element());
    (ab / size).cross(ac / size)
}

/// The unit normal of a triangle of any size; zero without an area.
pub(in crate::geometry) fn face_normal(corners: [Vec3; 3]) -> Vec3 {
    scaled_area_vector(corners).normalize_or_zero()
}

/// For each vertex the first one at its position, as files split vertices at seams.
pub(super) fn merged_vertices(positions: &[Vec3]) -> Vec<u32> {
    let mut first_at: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let vertices = positions.iter().zip(0..);
    vertices
        .map(|(p, i)| {
            // Adding zero makes -0 and +0 the same position.
            let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
            *first_at.entry(key).or_insert(i)
        })
        .collect()
}

/// The given normals made unit, with smooth ones where they are missing or useless.
fn complete_normals(
    positions: &[Vec3],
    given: Option<Vec<Vec3>>,
    triangles: &[[u32; 3]],
) -> Vec<Vec3> {
    let mut normals = given
        .filter(|normals| normals.len() == positions.len())
        .unwrap_or_else(|| vec![Vec3::ZERO; positions.len()]);
    for n in &mut normals {
        *n = if n.is_finite() {
            n.normalize_or_zero()
        } else {
            Vec3::ZERO
        };
    }
    let mut needed = vec![false; positions.len()];
    for triangle in triangles {
        for &v in triangle {
            needed[v as usize] |= normals[v as usize] == Vec3::ZERO;
        }
    }
    if needed.contains(&true) {
        let smooth = smooth_normals(positions, triangles);
        for (v, n) in normals.iter_mut().enumerate() {
            if needed[v] {
                *n = smooth[v];
            }
        }
    }
    for n in &mut normals {
        // Vertices that no face uses; any unit vector keeps the promise of unit length.
        if *n == Vec3::ZERO {
            *n = Vec3::Z;
        }
    }
    normals
}

/// Angle-weighted vertex normals, shared by all vertices at the same position.
fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let merged = merged_vertices(positions);
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for &triangle in triangles {
        let corners = triangle.map(|v| positions[v as usize]);
        let normal = face_normal(corners);
        for i in 0..3 {
            let to_next = corners[(i + 1) % 3] - corners[i];
            let to_previous = corners[(i + 2) % 3] - corners[i];
            let cos = to_next
                .normalize_or_zero()
                .dot(to_previous.normalize_or_zero());
            sums[merged[triangle[i] as usize] as usize] += cos.clamp(-1.0, 1.0).acos() * normal;
        }
    }
    let sums = merged.iter().map(|&v| sums[v as usize]);
    sums.map(Vec3::normalize_or_zero).collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_mesh::ellipsoid;
    use super::*;

    fn square() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        (positions, vec![[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn triangles_without_an_area_are_dropped_and_counted() {
        let (mut positions, mut triangles) = square();
        positions.push(0.5 * Vec3::X);
        triangles.extend([[0, 0, 1], [0, 4, 1]]);
        let mesh = Mesh::new(positions, None, triangles).unwrap();
        assert_eq!((mesh.triangles.len(), mesh.n_degenerate), (2, 2), "counts");
        assert!((mesh.surface_area() - 1.0).abs() < 1e-9, "area");
    }

    #[test]
    fn tiny_and_huge_triangles_are_not_degenerate() {
        for scale in [1e-25_f32, 1e-3, 1e4, 1e15] {
            let (positions, triangles) = square();
            let positions = positions.into_iter().map(|p| scale * p).collect();
            let mesh = Mesh::new(positions, None, triangles).unwrap();
            assert_eq!(mesh.n_degenerate, 0, "scale {scale}");
            assert!(
                mesh.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-6),
                "normals"
            );
        }
    }

    #[test]
    fn bad_input_is_refused_by_name() {
        let (positions, triangles) = square();
        assert_eq!(
            Mesh::new(positions.clone(), None, vec![]).unwrap_err(),
            MeshError::NoFaces {
                n_vertices: 4,
                n_degenerate: 0
            },
            "no faces"
        );
        assert_eq!(
            Mesh::new(positions.clone(), None, vec![[0, 1, 9]]).unwrap_err(),
            MeshError::IndexOutOfRange {
                triangle: 0,
                index: 9,
                n_vertices: 4
            },
            "index"
        );
        let mut broken = positions;
        broken[2].y = f32::NAN;
        assert_eq!(
            Mesh::new(broken, None, triangles).unwrap_err(),
            MeshError::NonFinitePosition { vertex: 2 },
            "position"
        );
    }

    #[test]
    fn computed_normals_agree_with_those_of_a_sphere() {
        let sphere = ellipsoid(Vec3::ONE, Vec3::splat(2.0), 32);
        let computed = Mesh::new(sphere.positions.clone(), None, sphere.triangles.clone()).unwrap();
        for (a, b) in computed.normals.iter().zip(&sphere.normals) {
            assert!(a.angle_between(*b) < 0.02, "{a} against {b}");
        }
    }

    #[test]
    fn useless_normals_are_replaced_and_good_ones_kept() {
        let (positions, triangles) = square();
        let slanted = Vec3::new(0.6, 0.0, 0.8);
        let given = vec![slanted, Vec3::ZERO, Vec3::NAN, 5.0 * Vec3::Z];
        let mesh = Mesh::new(positions, Some(given), triangles).unwrap();
        let expected = [slanted, Vec3::Z, Vec3::Z, Vec3::Z];
        for (a, b) in mesh.normals.iter().zip(expected) {
            assert!((*a - b).length() < 1e-6, "{a} against {b}");
        }
    }

    #[test]
    fn normals_follow_uneven_and_mirroring_transforms() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::ONE, 24);
        for scale in [Vec3::new(1.0, 2.0, 0.5), Vec3::new(-1.0, 2.0, 0.5)] {
            let moved = mesh.transformed(Affine3A::from_scale(scale));
            let recomputed =
                Mesh::new(moved.positions.clone(), None, moved.triangles.clone()).unwrap();
            for (a, b) in moved.normals.iter().zip(&recomputed.normals) {
                assert!(a.angle_between(*b) < 0.1, "scale {scale}: {a} against {b}");
            }
        }
    }
}
