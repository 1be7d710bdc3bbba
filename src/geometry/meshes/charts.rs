//! Cuts a mesh into charts that can be laid flat: neighbouring triangles that face much the same way.
//!
//! A chart is projected along its mean normal. All its triangles face the viewer, so that it folds over itself only where
//! one layer lies behind another; those triangles are found on a grid and left to a later chart.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::mesh::{face_normal, merged_vertices};
use crate::geometry::{Mesh, orthonormal_basis};

/// Largest angle between a triangle and its chart's axis, as its cosine: 55 degrees stretch by 1.7.
const LEAST_COS: f32 = 0.573_576;
/// Cells along the longer side of a chart when it is searched for layers.
const OVERLAP_CELLS: f32 = 256.0;
/// How far inside a triangle a cell's middle must lie to count: neighbours share their edges.
const INSIDE: f32 = 1e-3;

/// Triangles that are laid flat together.
#[derive(Clone, Debug)]
pub(in crate::geometry) struct Chart {
    /// Indices of the mesh's triangles.
    pub(in crate::geometry) triangles: Vec<usize>,
    /// Where the corners of each lie, in scene units; the smallest coordinates are 0.
    pub(in crate::geometry) corners: Vec<[Vec2; 3]>,
    /// Width and height, the width no smaller.
    pub(in crate::geometry) size: Vec2,
}

/// Charts that hold every triangle once; the same for the same mesh.
pub(in crate::geometry) fn cut(mesh: &Mesh) -> Vec<Chart> {
    let normals: Vec<Vec3> = (0..mesh.triangles.len())
        .map(|i| face_normal(mesh.corners(i)))
        .collect();
    let neighbours = neighbours(mesh);
    let mut is_free = vec![true; mesh.triangles.len()];
    let mut charts = Vec::new();
    for seed in 0..mesh.triangles.len() {
        // A seed may begin several charts only if it was left over, and it never is from its own.
        if is_free[seed] {
            let mut axis = normals[seed];
            let mut members = Vec::new();
            // The second time about the mean of the first: a seed may lie at the edge of what is flat.
            for _ in 0..2 {
                members = grown(seed, axis, &normals, &neighbours, &is_free);
                let sum: Vec3 = members.iter().map(|&i| normals[i] * mesh.area(i)).sum();
                let mean = sum.normalize_or(axis);
                if normals[seed].dot(mean) > LEAST_COS {
                    axis = mean;
                }
            }
            let chart = flattened(mesh, &members, axis);
            for &triangle in &chart.triangles {
                is_free[triangle] = false;
            }
            charts.push(chart);
        }
    }
    charts
}

/// The triangles across the edges of each; vertices at the same place count as one.
fn neighbours(mesh: &Mesh) -> Vec<Vec<usize>> {
    let places = merged_vertices(&mesh.positions);
    let mut at_edge: HashMap<(u32, u32), Vec<usize>> = HashMap::new();
    let edges = |triangle: [u32; 3]| {
        let [a, b, c] = triangle.map(|v| places[v as usize]);
        [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b)))
    };
    for (i, &triangle) in mesh.triangles.iter().enumerate() {
        for edge in edges(triangle) {
            at_edge.entry(edge).or_default().push(i);
        }
    }
    let around = |(i, &triangle): (usize, &[u32; 3])| {
        let all = edges(triangle)
            .into_iter()
            .flat_map(|edge| at_edge[&edge].iter());
        all.copied().filter(|&other| other != i).collect()
    };
    mesh.triangles.iter().enumerate().map(around).collect()
}

/// The free triangles that hang together with the seed and face along the axis, nearest first.
fn grown(
    seed: usize,
    axis: Vec3,
    normals: &[Vec3],
    neighbours: &[Vec<usize>],
    is_free: &[bool],
) -> Vec<usize> {
    let mut members = vec![seed];
    let mut is_member = std::collections::HashSet::from([seed]);
    let mut next = 0;
    while let Some(&triangle) = members.get(next) {
        next += 1;
        for &other in &neighbours[triangle] {
            if is_free[other] && normals[other].dot(axis) > LEAST_COS && is_member.insert(other) {
                members.push(other);
            }
        }
    }
    members
}

/// The chart of those triangles that do not lie behind an earlier one.
fn flattened(mesh: &Mesh, members: &[usize], axis: Vec3) -> Chart {
    let (tangent, bitangent) = orthonormal_basis(axis);
    // Relative to a corner: far from the origin the differences would round away.
    let origin = mesh.corners(members[0])[0];
    let flat = |p: Vec3| Vec2::new((p - origin).dot(tangent), (p - origin).dot(bitangent));
    let all: Vec<[Vec2; 3]> = members
        .iter()
        .map(|&triangle| mesh.corners(triangle).map(flat))
        .collect();
    let kept = without_layers(&all);
    let triangles = kept.iter().map(|&k| members[k]).collect();
    let mut corners: Vec<[Vec2; 3]> = kept.iter().map(|&k| all[k]).collect();
    let (min, max) = bounds(&corners);
    let mut size = max - min;
    let is_upright = size.y > size.x;
    for corner in corners.iter_mut().flatten() {
        *corner -= min;
        if is_upright {
            // A quarter turn, so that it is wide and low.
            *corner = Vec2::new(corner.y, size.x - corner.x);
        }
    }
    if is_upright {
        size = Vec2::new(size.y, size.x);
    }
    Chart {
        triangles,
        corners,
        size,
    }
}

fn bounds(corners: &[[Vec2; 3]]) -> (Vec2, Vec2) {
    let start = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    corners
        .iter()
        .flatten()
        .fold(start, |(min, max), p| (min.min(*p), max.max(*p)))
}

/// Indices of the triangles that cover no cell of an earlier one; the first always stays.
fn without_layers(corners: &[[Vec2; 3]]) -> Vec<usize> {
    let (min, max) = bounds(corners);
    let longest = (max - min).max_element();
    let per_unit = OVERLAP_CELLS / longest.max(f32::MIN_POSITIVE);
    if !per_unit.is_finite() {
        return (0..corners.len()).collect();
    }
    let width = OVERLAP_CELLS as usize + 1;
    let mut is_taken = vec![false; width * width];
    let mut covered = Vec::new();
    let mut kept = Vec::new();
    for (k, corners) in corners.iter().enumerate() {
        covered.clear();
        let scaled = corners.map(|p| (p - min) * per_unit);
        for_each_cell(scaled, INSIDE, |x, y, _| covered.push(y * width + x));
        if covered.iter().all(|&cell| !is_taken[cell]) {
            kept.push(k);
            for &cell in &covered {
                is_taken[cell] = true;
            }
        }
    }
    kept
}

/// Calls `visit(x, y, barycentric)` for the unit cells whose middle lies in a triangle, by `inside` of its height.
pub(super) fn for_each_cell(
    corners: [Vec2; 3],
    inside: f32,
    mut visit: impl FnMut(usize, usize, Vec3),
) {
    let [a, b, c] = corners;
    let whole = (b - a).perp_dot(c - a);
    if whole == 0.0 {
        return;
    }
    let (min, max) = bounds(&[corners]);
    let first = (min - Vec2::splat(0.5)).ceil().max(Vec2::ZERO);
    let last = (max - Vec2::splat(0.5)).floor();
    for y in first.y as i64..=last.y as i64 {
        for x in first.x as i64..=last.x as i64 {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let weights = Vec3::new(
                (b - p).perp_dot(c - p),
                (c - p).perp_dot(a - p),
                (a - p).perp_dot(b - p),
            ) / whole;
            if weights.min_element() >= inside {
                visit(x as usize, y as usize, weights);
            }
        }
    }
}
