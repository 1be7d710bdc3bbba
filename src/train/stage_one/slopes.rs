//! Conditions on the slope of a grid of distances: that its surface has the normals that photos show.

use glam::Vec3;

use super::band::Band;
use crate::geometry::{Mesh, ScalarGrid};

/// Least standard deviation of a normal, radians: below, its place on the grid is not known well enough.
const LEAST_DEVIATION: f32 = 0.015;
/// Standard deviations of a normal that count as one: what its pixels fail to explain is in part not its fault.
const TRUSTED: f32 = 0.7;
/// Weight of a normal that deviates by as many radians as outlines err by cells: neighbours' errors are alike.
const EQUALLY_SURE: f32 = 0.5;
/// Weight below which a normal says nothing.
const LEAST_WEIGHT: f32 = 1e-4;
/// Share of the evenness that is asked of a surface whose normals are known.
const KNOWN_EVENNESS: f32 = 0.3;

/// Unit normal at each node of a grid, and its weight beside that of a ray along an outline, 0 where none is known.
pub(super) type Normals = Vec<(Vec3, f32)>;

/// The normals of a mesh, which deviate by so many radians, at the nodes around its vertices; outlines err by
/// `outline_error` cells.
pub(super) fn normals_around(
    mesh: &Mesh,
    deviations: &[f32],
    grid: &ScalarGrid,
    outline_error: f32,
) -> Normals {
    let mut sums = vec![(Vec3::ZERO, 0.0, 0.0); grid.values.len()];
    let vertices = mesh.positions.iter().zip(&mesh.normals).zip(deviations);
    for ((position, normal), deviation) in vertices {
        let deviation = (TRUSTED * deviation).max(LEAST_DEVIATION);
        let weight = EQUALLY_SURE * (outline_error / deviation).powi(2);
        if weight < LEAST_WEIGHT {
            continue;
        }
        let corners = grid.corners(*position);
        for (node, share) in corners.nodes.iter().zip(corners.weights) {
            let (sum, weights, shares) = &mut sums[*node];
            *sum += share * weight * *normal;
            *weights += share * weight;
            *shares += share;
        }
    }
    sums.into_iter()
        .map(|(sum, weights, shares)| {
            let weight = if shares > 0.0 { weights / shares } else { 0.0 };
            (sum.normalize_or_zero(), weight)
        })
        .collect()
}

/// `[n]` share of the evenness that is asked of the surface at a band's nodes.
pub(super) fn asked_evenness(band: &Band, normals: &Normals) -> Vec<f32> {
    let weight = |node: &u32| normals.get(*node as usize).map_or(0.0, |known| known.1);
    let asked = |weight: f32| (1.0 + KNOWN_EVENNESS * weight) / (1.0 + weight);
    band.nodes.iter().map(|node| asked(weight(node))).collect()
}

/// The conditions at the nodes of a band, by central differences.
#[derive(Debug)]
pub(super) struct Slopes(Vec<Slope>);

#[derive(Clone, Copy, Debug)]
struct Slope {
    /// Slots of the six neighbours.
    neighbours: [u32; 6],
    weight: f32,
    /// What is missing to the wanted slope, cells a cell.
    missing: Vec3,
}

impl Slopes {
    /// Of the normals at the nodes of the band's grid; `values`: `[n]` distances of its slots, cells.
    pub(super) fn new(band: &Band, normals: &Normals, values: &[f32]) -> Self {
        let slope = |(slot, node): (usize, &u32)| {
            let (normal, weight) = *normals.get(*node as usize)?;
            let neighbours = band.all_neighbours(slot).filter(|_| weight > 0.0)?;
            Some(Slope {
                neighbours,
                weight,
                missing: normal - central_difference(&neighbours, values),
            })
        };
        Self(band.nodes.iter().enumerate().filter_map(slope).collect())
    }

    /// Adds to the right side of the normal equations.
    pub(super) fn add_missing(&self, right: &mut [f32]) {
        for slope in &self.0 {
            slope.spread(slope.missing, right);
        }
    }

    /// Adds their part of the normal equations' matrix times `u`.
    pub(super) fn apply(&self, u: &[f32], out: &mut [f32]) {
        for slope in &self.0 {
            slope.spread(central_difference(&slope.neighbours, u), out);
        }
    }
}

/// Slope at a node whose six neighbours have these slots, by what `values` holds for them.
fn central_difference(neighbours: &[u32; 6], values: &[f32]) -> Vec3 {
    let value = |i: usize| values[neighbours[i] as usize];
    Vec3::from_array([0, 2, 4].map(|i| 0.5 * (value(i + 1) - value(i))))
}

impl Slope {
    /// `out += weight * D^T by`.
    fn spread(&self, by: Vec3, out: &mut [f32]) {
        for axis in 0..3 {
            let d = 0.5 * self.weight * by[axis];
            out[self.neighbours[2 * axis + 1] as usize] += d;
            out[self.neighbours[2 * axis] as usize] -= d;
        }
    }
}
