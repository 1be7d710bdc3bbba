//! Conditions on the slope of a grid of distances: that its surface has the normals that photos show.

use glam::Vec3;

use super::band::Band;
use crate::geometry::{Mesh, ScalarGrid};
use crate::train::statistics::{cauchy_weight, middle_or};

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
/// Error of pixels, in those that are usual, at which photos contradict the surface: half the evenness is asked there, and its
/// normals weigh half, as they were learned in the wrong place.
const CONTRADICTED: f32 = 3.0;
/// Cells about the mesh in which its pixels' errors count.
const SPREAD: usize = 5;

/// What photos say of the normals of a mesh.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct KnownNormals<'a> {
    pub(in crate::train) mesh: &'a Mesh,
    /// `[n_vertices]` standard deviations, radians; infinite where a normal is unknown.
    pub(in crate::train) deviations: &'a [f32],
    /// `[n_vertices]` mean squared errors of the pixels that show them; 0 where none does.
    pub(in crate::train) errors: &'a [f32],
}

/// The same at the nodes of a grid; empty where nothing is known.
#[derive(Debug, Default)]
pub(super) struct Normals {
    /// `[n_nodes]` unit normals, and their weights beside that of a ray along an outline, 0 where none is known.
    known: Vec<(Vec3, f32)>,
    /// `[n_nodes]` pixels' errors in those that are usual, beside the mesh.
    errors: Vec<Option<f32>>,
}

/// Sums over the vertices around a node.
#[derive(Clone, Copy, Default)]
struct Around {
    normal: Vec3,
    weight: f32,
    error: f32,
    share: f32,
}

impl Normals {
    /// At the nodes around the mesh's vertices; outlines err by `outline_error` cells.
    pub(super) fn around(seen: KnownNormals<'_>, grid: &ScalarGrid, outline_error: f32) -> Self {
        let (mesh, errors) = (seen.mesh, seen.errors);
        let above_zero = errors.iter().copied().filter(|e| *e > 0.0);
        let usual = middle_or(1.0, above_zero.collect());
        let mut nodes = vec![Around::default(); grid.values.len()];
        for (vertex, position) in mesh.positions.iter().enumerate() {
            let deviation = (TRUSTED * seen.deviations[vertex]).max(LEAST_DEVIATION);
            let error = errors[vertex] / usual;
            let weight = EQUALLY_SURE * (outline_error / deviation).powi(2);
            let weight = weight * cauchy_weight(error, CONTRADICTED);
            let weight = if weight < LEAST_WEIGHT { 0.0 } else { weight };
            let corners = grid.corners(*position);
            for (node, share) in corners.nodes.iter().zip(corners.weights) {
                let around = &mut nodes[*node];
                around.normal += share * weight * mesh.normals[vertex];
                around.weight += share * weight;
                around.error += share * error;
                around.share += share;
            }
        }
        let mean = |sum: f32, share: f32| (share > 0.0).then(|| sum / share);
        let known = nodes.iter().map(|node| {
            let weight = mean(node.weight, node.share).unwrap_or_default();
            (node.normal.normalize_or_zero(), weight)
        });
        Self {
            known: known.collect(),
            errors: nodes.iter().map(|n| mean(n.error, n.share)).collect(),
        }
    }

    /// `[n]` share of the evenness that is asked of the surface at a band's nodes: less where normals are known, and least where
    /// photos contradict it, so that what lies beside goes on as it is bent, and meets there in a crease.
    pub(super) fn asked_evenness(&self, band: &Band) -> Vec<f32> {
        let weight = |node: &u32| self.known.get(*node as usize).map_or(0.0, |known| known.1);
        let errors = self.errors_within(band);
        let asked = |(node, error): (&u32, f32)| {
            let weight = weight(node);
            (1.0 + KNOWN_EVENNESS * weight) / (1.0 + weight) * cauchy_weight(error, CONTRADICTED)
        };
        band.nodes.iter().zip(errors).map(asked).collect()
    }

    /// `[n]` errors at all nodes of a band: away from the mesh as they are beside it.
    fn errors_within(&self, band: &Band) -> Vec<f32> {
        let at = |node: &u32| self.errors.get(*node as usize).copied().flatten();
        let mut errors: Vec<Option<f32>> = band.nodes.iter().map(at).collect();
        for _ in 0..SPREAD {
            let before = errors.clone();
            for (slot, error) in errors.iter_mut().enumerate().filter(|(_, e)| e.is_none()) {
                let neighbours = band.neighbours_of(slot).into_iter().flatten();
                let known = neighbours.filter_map(|other| before[other]);
                let (n, sum) = known.fold((0.0, 0.0), |(n, sum), error| (n + 1.0, sum + error));
                *error = (n > 0.0).then(|| sum / n);
            }
        }
        errors.into_iter().map(Option::unwrap_or_default).collect()
    }
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
            let (normal, weight) = *normals.known.get(*node as usize)?;
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
