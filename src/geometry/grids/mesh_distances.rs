//! Signed distances to a mesh on a grid.

use glam::Vec3;

use crate::geometry::{Aabb, Mesh, ScalarGrid};

/// Cells around a triangle within which nodes get their distance to it.
const NEAR: f32 = 1.5;

impl ScalarGrid {
    /// Fills the grid with the distances to a closed mesh, scene units, negative inside: true ones near its surface, the sign
    /// with `reach` cells elsewhere. What lies beyond the grid is outside.
    pub fn fill_distances(&mut self, mesh: &Mesh, reach: f32) {
        let limit = reach * self.cell;
        // The face whose plane is further away decides where two are equally near.
        let mut nearest = vec![(f32::INFINITY, 0.0_f32); self.values.len()];
        for i in 0..mesh.triangles.len() {
            let corners = mesh.corners(i);
            let [a, b, c] = corners;
            let Some(normal) = (b - a).cross(c - a).try_normalize() else {
                continue;
            };
            for (node, p) in self.nodes_near(corners) {
                let off = p - nearest_on_triangle(p, corners);
                let (distance, along) = (off.length(), off.dot(normal));
                let (least, side) = &mut nearest[node];
                let is_tie = (distance - *least).abs() < 1e-4 * self.cell;
                if (is_tie && along.abs() > side.abs()) || (!is_tie && distance < *least) {
                    (*least, *side) = (distance.min(*least), along);
                }
            }
        }
        for (row, values) in self.values.chunks_mut(self.size[0]).enumerate() {
            let row = &nearest[row * values.len()..][..values.len()];
            let mut sign = 1.0_f32;
            for (value, (distance, side)) in values.iter_mut().zip(row) {
                if distance.is_finite() {
                    sign = 1.0_f32.copysign(*side);
                }
                *value = distance.min(limit).copysign(sign);
            }
        }
    }

    /// Indices and places of the nodes in the box around a triangle.
    fn nodes_near(&self, corners: [Vec3; 3]) -> impl Iterator<Item = (usize, Vec3)> {
        let place = |p: Vec3| ((p - self.origin) / self.cell).max(Vec3::ZERO);
        let bounds = Aabb::from_points(corners);
        let low = place(bounds.min - NEAR * self.cell).ceil();
        let high = place(bounds.max + NEAR * self.cell).floor();
        let [along_x, along_y, along_z] = [0, 1, 2]
            .map(|axis| low[axis] as usize..(high[axis] as usize + 1).min(self.size[axis]));
        along_z.flat_map(move |z| {
            let along_x = along_x.clone();
            along_y.clone().flat_map(move |y| {
                along_x.clone().map(move |x| {
                    let node = x + self.size[0] * (y + self.size[1] * z);
                    (node, self.position([x, y, z]))
                })
            })
        })
    }
}

/// The point of a triangle that is nearest to `p` (Ericson, Real-Time Collision Detection, 5.1.5).
fn nearest_on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let along = |corner: Vec3| (ab.dot(p - corner), ac.dot(p - corner));
    let (d1, d2) = along(a);
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let (d3, d4) = along(b);
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let (d5, d6) = along(c);
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + d1 / (d1 - d3) * ab;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + d2 / (d2 - d6) * ac;
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
    }
    a + (vb * ab + vc * ac) / (va + vb + vc)
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;

    #[test]
    fn distances_to_a_leaning_block_are_exact_at_its_faces_edges_and_corners() {
        let half = Vec3::new(0.5, 0.3, 0.15);
        let lean = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize_or_zero(), 0.7);
        let corner = |i: usize| {
            let side = |axis: usize| if (i >> axis) & 1 == 1 { 1.0 } else { -1.0 };
            lean * (half * Vec3::new(side(0), side(1), side(2)))
        };
        // Two triangles a face, all seen counterclockwise from outside.
        let faces = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let triangles = faces
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
        let corners = (0..8).map(corner).collect();
        let mesh = Mesh::new(corners, None, triangles.collect()).unwrap();
        let bounds = Aabb {
            min: Vec3::splat(-0.9),
            max: Vec3::new(0.9, 0.8, 0.8),
        };
        let mut grid = ScalarGrid::over(&bounds, 40, 0.0);
        grid.fill_distances(&mesh, 6.0);
        let (mut n_near, mut n_deep) = (0, 0);
        for node in 0..grid.values.len() {
            let p = lean.inverse() * grid.position(grid.place(node));
            let beyond = p.abs() - half;
            let truth = beyond.max(Vec3::ZERO).length() + beyond.max_element().min(0.0);
            let value = grid.values[node];
            if truth.abs() < grid.cell {
                n_near += 1;
                assert!((value - truth).abs() < 1e-5, "{value} instead of {truth}");
            } else {
                n_deep += usize::from(truth < 0.0);
                assert!(value.signum() == truth.signum(), "{value} is {truth}");
                assert!(value.abs() <= 6.0 * grid.cell);
            }
        }
        assert!(n_near > 1000 && n_deep > 300, "{n_near}, {n_deep} nodes");
    }
}
