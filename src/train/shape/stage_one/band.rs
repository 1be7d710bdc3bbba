//! The nodes of a grid that lie near its zero surface, and a stiff sheet through them.

use rayon::prelude::*;

use crate::geometry::ScalarGrid;
use crate::train::statistics::cauchy_weight;

/// No node.
const NONE: u32 = u32::MAX;
/// Nodes a task; sums are taken by chunk in order, so that the threads do not change a bit.
const CHUNK: usize = 1 << 13;

/// Nodes near the surface, numbered; a number is called slot.
#[derive(Debug)]
pub(super) struct Band {
    /// `[n]` index of each slot's node.
    pub(super) nodes: Vec<u32>,
    slot_of_node: Vec<u32>,
    /// `[n]` slots of the six neighbours; a node with them all feels the sheet's bending.
    neighbours: Vec<[u32; 6]>,
}

impl Band {
    /// The nodes whose value is less than `reach` cells from zero.
    pub(super) fn new(grid: &ScalarGrid, reach: f32) -> Self {
        let limit = reach * grid.cell;
        let mut slot_of_node = vec![NONE; grid.values.len()];
        let mut nodes = Vec::new();
        for (node, value) in grid.values.iter().enumerate() {
            if value.abs() < limit {
                slot_of_node[node] = nodes.len() as u32;
                nodes.push(node as u32);
            }
        }
        let slot_or_none = |node: Option<usize>| node.map_or(NONE, |node| slot_of_node[node]);
        let neighbours = nodes
            .par_iter()
            .map(|node| {
                let pairs = grid.neighbours(*node as usize);
                std::array::from_fn(|i| slot_or_none(pairs[i / 2][i % 2]))
            })
            .collect();
        Self {
            nodes,
            slot_of_node,
            neighbours,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The slot of a node.
    pub(super) fn slot(&self, node: usize) -> Option<usize> {
        let slot = self.slot_of_node[node];
        (slot != NONE).then_some(slot as usize)
    }

    /// Slots of the six neighbours, two along each axis.
    pub(super) fn neighbours_of(&self, slot: usize) -> [Option<usize>; 6] {
        self.neighbours[slot].map(|n| (n != NONE).then_some(n as usize))
    }

    /// The same where none is missing.
    pub(super) fn all_neighbours(&self, slot: usize) -> Option<[u32; 6]> {
        Some(self.neighbours[slot]).filter(|neighbours| !neighbours.contains(&NONE))
    }

    /// `out = L u`: the sum of the neighbours less six times the node, zero where one is missing.
    pub(super) fn laplacian(&self, u: &[f32], out: &mut [f32]) {
        self.fill(out, |slot, neighbours| {
            if neighbours.contains(&NONE) {
                return 0.0;
            }
            neighbours.iter().map(|n| u[*n as usize]).sum::<f32>() - 6.0 * u[slot]
        });
    }

    /// `out = scale * LT v`, where `v` is zero at nodes that lack a neighbour.
    pub(super) fn laplacian_transposed(&self, v: &[f32], scale: f32, out: &mut [f32]) {
        self.fill(out, |slot, neighbours| {
            let known = neighbours.iter().filter(|n| **n != NONE);
            scale * (known.map(|n| v[*n as usize]).sum::<f32>() - 6.0 * v[slot])
        });
    }

    /// `[n]` `v` after so many rounds of means with the neighbours, a node itself counting twice; nodes that lack a neighbour
    /// have no say.
    pub(super) fn smoothed(&self, v: &[f32], n_rounds: usize) -> Vec<f32> {
        let mut smooth = v.to_vec();
        for _ in 0..n_rounds {
            let before = smooth.clone();
            self.fill(&mut smooth, |slot, neighbours| {
                let inner = neighbours.iter().filter(|n| self.is_inner(**n));
                let start = (2.0 * before[slot], 2.0);
                let (sum, n) = inner.fold(start, |(sum, n), other| {
                    (sum + before[*other as usize], n + 1.0)
                });
                sum / n
            });
        }
        smooth
    }

    /// Whether a slot has all neighbours.
    fn is_inner(&self, slot: u32) -> bool {
        slot != NONE && !self.neighbours[slot as usize].contains(&NONE)
    }

    /// `[n]` weights of the differences of `v` between a node and its neighbours: 1 where it is even, a half where two differ
    /// by `scale`, zero where one of them lacks a neighbour.
    pub(super) fn evenness(&self, v: &[f32], scale: f32) -> Vec<[f32; 6]> {
        let weights = |(i, neighbours): (usize, &[u32; 6])| {
            neighbours.map(|n| {
                if !self.is_inner(i as u32) || !self.is_inner(n) {
                    return 0.0;
                }
                cauchy_weight(v[i] - v[n as usize], scale)
            })
        };
        let slots = self.neighbours.par_iter().enumerate();
        slots.map(weights).collect()
    }

    /// `out = own v + D v`: `D v` is the sum of the weighted differences to the neighbours, half the gradient of the sum of
    /// their weighted squares.
    pub(super) fn unevenness(&self, v: &[f32], weights: &[[f32; 6]], own: f32, out: &mut [f32]) {
        self.fill(out, |slot, neighbours| {
            let pairs = neighbours.iter().zip(&weights[slot]);
            let differences = pairs
                .filter(|(_, weight)| **weight > 0.0)
                .map(|(n, weight)| weight * (v[slot] - v[*n as usize]));
            own * v[slot] + differences.sum::<f32>()
        });
    }

    /// Sets each slot's number to what `value` makes of it and of the slots of its neighbours.
    fn fill(&self, out: &mut [f32], value: impl Fn(usize, &[u32; 6]) -> f32 + Sync) {
        let slots = out.par_iter_mut().zip(&self.neighbours).enumerate();
        slots
            .with_min_len(CHUNK)
            .for_each(|(slot, (out, neighbours))| *out = value(slot, neighbours));
    }
}

/// The dot product, the same on any number of threads.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    let chunks: Vec<f64> = a
        .par_chunks(CHUNK)
        .zip(b.par_chunks(CHUNK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum())
        .collect();
    chunks.iter().sum()
}

/// `y += factor * x`.
pub(super) fn add_scaled(y: &mut [f32], factor: f32, x: &[f32]) {
    let pairs = y.par_iter_mut().zip(x).with_min_len(CHUNK);
    pairs.for_each(|(y, x)| *y += factor * x);
}
