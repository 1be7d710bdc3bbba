//! The surface on which a grid of signed distances is zero.

use glam::Vec3;

use crate::geometry::{Mesh, MeshError, ScalarGrid};

/// The zero surface of `grid` as a mesh, outside where the values are positive; normals are the
/// grid's gradients.
///
/// Surface nets (Gibson 1998): a vertex in each cell that the surface crosses, at the mean of the
/// crossings of its edges and then moved onto the surface; a quad for each crossed edge. Faces on
/// the grid's border are left out, so the values there should be positive. Errors when nothing is
/// crossed.
pub fn iso_surface(grid: &ScalarGrid) -> Result<Mesh, MeshError> {
    const NONE: u32 = u32::MAX;
    let [nx, ny, nz] = grid.size;
    let strides = grid.strides();
    let mut vertex_of_cell = vec![NONE; grid.values.len()];
    let mut positions = Vec::new();
    let mut quads: Vec<([usize; 4], bool)> = Vec::new();
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            for x in 0..nx - 1 {
                let place = [x, y, z];
                let cell = x + y * strides[1] + z * strides[2];
                if let Some(vertex) = cell_vertex(grid, place, cell) {
                    vertex_of_cell[cell] = positions.len() as u32;
                    positions.push(vertex);
                }
                collect_quads(grid, place, cell, &mut quads);
            }
        }
    }
    let mut triangles = Vec::with_capacity(2 * quads.len());
    for (cells, is_leaving) in quads {
        let [a, b, c, d] = cells.map(|cell| vertex_of_cell[cell]);
        let [a, b, c, d] = if is_leaving {
            [a, b, c, d]
        } else {
            [d, c, b, a]
        };
        // The shorter diagonal bends less.
        let length = |i: u32, j: u32| positions[i as usize].distance_squared(positions[j as usize]);
        if length(a, c) <= length(b, d) {
            triangles.extend([[a, b, c], [a, c, d]]);
        } else {
            triangles.extend([[a, b, d], [b, c, d]]);
        }
    }
    let normals = positions
        .iter()
        .map(|p| grid.gradient(*p).normalize_or_zero())
        .collect();
    Mesh::new(positions, Some(normals), triangles)
}

/// The surface's vertex in a cell, if the surface passes it.
fn cell_vertex(grid: &ScalarGrid, place: [usize; 3], cell: usize) -> Option<Vec3> {
    let strides = grid.strides();
    let offset = |i: usize| {
        (0..3)
            .map(|axis| ((i >> axis) & 1) * strides[axis])
            .sum::<usize>()
    };
    let values: [f32; 8] = std::array::from_fn(|i| grid.values[cell + offset(i)]);
    let n_inside = values.iter().filter(|v| **v < 0.0).count();
    if n_inside == 0 || n_inside == 8 {
        return None;
    }
    let (mut sum, mut n) = (Vec3::ZERO, 0.0);
    for i in 0..8_usize {
        for axis in 0..3 {
            let j = i | (1 << axis);
            if j != i && (values[i] < 0.0) != (values[j] < 0.0) {
                let corner = Vec3::from_array(std::array::from_fn(|k| ((i >> k) & 1) as f32));
                let mut step = Vec3::ZERO;
                step[axis] = values[i] / (values[i] - values[j]);
                sum += corner + step;
                n += 1.0;
            }
        }
    }
    let in_cell = |p: Vec3| {
        let low = grid.position(place);
        p.clamp(low, low + grid.cell)
    };
    let mean = grid.position(place) + grid.cell * sum / n;
    // One step of Newton's method; it stays in the cell, or quads would cross.
    let gradient = grid.gradient(mean);
    let step = grid.sample(mean) / gradient.length_squared().max(f32::MIN_POSITIVE);
    let moved = in_cell(mean - step * gradient);
    Some(if moved.is_finite() { moved } else { mean })
}

/// The quads around the crossed edges that start at a cell's first corner.
fn collect_quads(
    grid: &ScalarGrid,
    place: [usize; 3],
    cell: usize,
    quads: &mut Vec<([usize; 4], bool)>,
) {
    let strides = grid.strides();
    let is_inside = |node: usize| grid.values[node] < 0.0;
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // Four cells share the edge only away from the border.
        if place[u] == 0 || place[v] == 0 {
            continue;
        }
        let (here, next) = (is_inside(cell), is_inside(cell + strides[axis]));
        if here != next {
            let (du, dv) = (strides[u], strides[v]);
            quads.push(([cell - du - dv, cell - dv, cell, cell - du], here));
        }
    }
}
