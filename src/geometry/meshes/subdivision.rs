//! Meshes of smaller triangles on the same surface, for normals that change faster than the surface needs, and the way back.

use std::collections::HashMap;

use crate::geometry::{Atlas, Mesh};

impl Mesh {
    /// Typical length of its edges, scene units: the side of a square as large as two triangles.
    pub fn edge_length(&self) -> f32 {
        (2.0 * self.surface_area() / self.triangles.len() as f64).sqrt() as f32
    }

    /// The same surface with each triangle cut in four at the middles of its edges, whose normals are between those of the
    /// ends. Its own vertices come first.
    #[must_use]
    pub fn subdivided(&self) -> Self {
        let mut positions = self.positions.clone();
        let mut normals = self.normals.clone();
        let triangles = quartered(&self.triangles, |[a, b], _| {
            positions.push(0.5 * (self.positions[a] + self.positions[b]));
            normals.push((self.normals[a] + self.normals[b]).normalize_or(self.normals[a]));
            positions.len() - 1
        });
        Self {
            positions,
            normals,
            triangles,
            n_degenerate: self.n_degenerate,
        }
    }

    /// The mesh that [`Self::subdivided`] made this of, with the normals that its vertices have here; `None` where it is not
    /// made so.
    pub fn undivided(&self) -> Option<Self> {
        let (fours, []) = self.triangles.as_chunks::<4>() else {
            return None;
        };
        let is_cut = |&[[a, ab, ca], [ab_b, b, bc], [ca_c, bc_c, c], inner]: &[[u32; 3]; 4]| {
            let at = |i: u32| self.positions[i as usize];
            let is_between = |p: u32, q: u32, middle: u32| at(middle) == 0.5 * (at(p) + at(q));
            [ab_b, bc_c, ca_c] == [ab, bc, ca]
                && inner == [ab, bc, ca]
                && is_between(a, b, ab)
                && is_between(b, c, bc)
                && is_between(c, a, ca)
        };
        if !fours.iter().all(is_cut) {
            return None;
        }
        let whole = |four: &[[u32; 3]; 4]| [four[0][0], four[1][1], four[2][2]];
        let triangles: Vec<[u32; 3]> = fours.iter().map(whole).collect();
        let n_vertices = triangles
            .iter()
            .flatten()
            .max()
            .map_or(0, |last| *last as usize + 1);
        Some(Self {
            positions: self.positions[..n_vertices].to_vec(),
            normals: self.normals[..n_vertices].to_vec(),
            triangles,
            n_degenerate: self.n_degenerate,
        })
    }
}

impl Atlas {
    /// The same texture for `finer`, which [`Mesh::subdivided`] makes of the unwrapped mesh.
    ///
    /// # Panics
    /// When `finer` has not four triangles for each of the mesh: a bug of the caller.
    #[must_use]
    pub fn subdivided(&self, finer: &Mesh) -> Self {
        assert_eq!(
            finer.triangles.len(),
            4 * self.triangles.len(),
            "it is not the subdivided mesh"
        );
        let mut vertices = self.vertices.clone();
        let mut places_px = self.places_px.clone();
        let fours = finer.triangles.as_chunks::<4>().0;
        let triangles = quartered(&self.triangles, |[p, q], (triangle, edge)| {
            places_px.push(0.5 * (self.places_px[p] + self.places_px[q]));
            let [.., inner] = fours[triangle];
            vertices.push(inner[edge]);
            vertices.len() - 1
        });
        Self {
            size_px: self.size_px,
            vertices,
            places_px,
            triangles,
        }
    }
}

/// Each triangle cut in four at the middles of its edges. `add([a, b], (i, k))` adds the middle of edge `k` of triangle `i`
/// between the vertices `a` and `b`, once for both sides, and gives its index.
fn quartered(
    triangles: &[[u32; 3]],
    mut add: impl FnMut([usize; 2], (usize, usize)) -> usize,
) -> Vec<[u32; 3]> {
    let mut middles = HashMap::with_capacity(3 * triangles.len() / 2);
    let mut quarters = Vec::with_capacity(4 * triangles.len());
    for (i, &[a, b, c]) in triangles.iter().enumerate() {
        let mut middle = |a: u32, b: u32, k: usize| {
            let ends = [a as usize, b as usize];
            let new = || add(ends, (i, k)) as u32;
            *middles.entry((a.min(b), a.max(b))).or_insert_with(new)
        };
        let [ab, bc, ca] = [middle(a, b, 0), middle(b, c, 1), middle(c, a, 2)];
        quarters.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    quarters
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::Vec3;

    use super::*;
    use crate::geometry::meshes::test_mesh::ellipsoid;

    #[test]
    fn a_subdivided_mesh_is_the_same_surface_with_half_as_long_edges() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::ONE, 24);
        let finer = mesh.subdivided();
        assert_eq!(finer.triangles.len(), 4 * mesh.triangles.len());
        let sides = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
        let edges: BTreeSet<[u32; 2]> = mesh.triangles.iter().flat_map(sides).collect();
        let edges: BTreeSet<[u32; 2]> = edges.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
        assert_eq!(finer.positions.len(), mesh.positions.len() + edges.len());
        assert_eq!(finer.positions[..mesh.positions.len()], mesh.positions[..]);
        let area = finer.surface_area() / mesh.surface_area();
        assert!((area - 1.0).abs() < 1e-5, "{area}");
        let length = finer.edge_length() / mesh.edge_length();
        assert!((length - 0.5).abs() < 1e-3, "{length}");
        for (p, n) in finer.positions.iter().zip(&finer.normals) {
            let off = p.normalize_or_zero().angle_between(*n);
            assert!(off < 0.01, "{off} radians at {p}");
        }
        for i in 0..finer.triangles.len() {
            let [a, b, c] = finer.corners(i);
            let outward: Vec3 = (b - a).cross(c - a);
            assert!(outward.dot(a + b + c) > 0.0, "triangle {i} is turned over");
        }
    }

    #[test]
    fn a_subdivided_mesh_leads_back_and_another_does_not() {
        let mesh = ellipsoid(Vec3::ONE, Vec3::new(1.0, 0.7, 0.4), 12);
        let mut finer = mesh.subdivided().subdivided();
        finer.normals.fill(Vec3::X);
        let back = finer.undivided().and_then(|mesh| mesh.undivided()).unwrap();
        assert_eq!(back.positions, mesh.positions);
        assert_eq!(back.triangles, mesh.triangles);
        assert_eq!(
            back.normals,
            vec![Vec3::X; mesh.positions.len()],
            "as they are now"
        );
        assert!(back.undivided().is_none());
        finer.positions[0] += 0.1;
        assert!(finer.undivided().is_none(), "bent since");
    }

    #[test]
    fn a_subdivided_atlas_shows_the_finer_mesh_where_its_own_was() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::ONE, 12);
        let finer = mesh.subdivided();
        let atlas = Atlas::new(&mesh, 256, 2).unwrap();
        let of_finer = atlas.subdivided(&finer);
        let own = atlas.texels(&mesh);
        let of_finer = of_finer.texels(&finer);
        let mut places = vec![None; 256 * 256];
        for texel in &own {
            places[texel.index as usize] = Some(texel.position);
        }
        let mut n_same = 0;
        for texel in &of_finer {
            if let Some(place) = places[texel.index as usize] {
                n_same += 1;
                let off = (texel.position - place).length();
                assert!(off < 0.02, "texel {} is {off} away", texel.index);
            }
        }
        assert!(
            n_same as f32 > 0.98 * own.len() as f32,
            "{n_same} of {}",
            own.len()
        );
    }
}
