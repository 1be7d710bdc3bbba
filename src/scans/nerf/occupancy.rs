//! Where a field has anything at all: grids of cells around a point, each twice as wide as the one before.
//!
//! The cascades are those of instant-ngp (Appendix E.2 of arXiv:2201.05989): equally many cells each, so that they grow with
//! the distance from the middle, as what is seen from there does.

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use super::field::{Densities, Field, Scratch};
use crate::geometry::Aabb;

/// Points asked about at once.
const BATCH: usize = 4096;
/// Fraction of the light that all cells of a cascade left out may take together.
const LEFT_OUT: f32 = 0.005;

/// Where a field has anything: cubes around a point.
#[derive(Clone, Debug)]
pub(super) struct Occupancy {
    center: Vec3,
    /// Half the side of the smallest cascade.
    half: f32,
    /// Cells along a side, a multiple of 4.
    n: u32,
    /// A bit a cell, x running fastest, by cascade.
    cascades: Vec<Vec<u64>>,
}

/// Cubes around a point: what an [`Occupancy`] covers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cubes {
    pub(super) center: Vec3,
    /// Half the side of the smallest.
    pub(super) half: f32,
    pub(super) n_cascades: u32,
    /// Cells along a side, a multiple of 4.
    pub(super) n: u32,
}

impl Cubes {
    /// Half the side of a cascade.
    pub(super) fn half_of(&self, cascade: u32) -> f32 {
        self.half * (cascade as f32).exp2()
    }

    /// All of them.
    pub(super) fn outer(&self) -> Aabb {
        let half = self.half_of(self.n_cascades - 1);
        Aabb {
            min: self.center - half,
            max: self.center + half,
        }
    }

    /// The middle of a cell.
    fn cell_center(&self, cascade: u32, cell: UVec3, n: u32) -> Vec3 {
        let half = self.half_of(cascade);
        let at = (cell.as_vec3() + 0.5) / n as f32;
        self.center + (2.0 * at - 1.0) * half
    }
}

impl Occupancy {
    /// From what a program says about each cell of each cascade.
    pub(super) fn from_cells(
        cubes: &Cubes,
        is_occupied: impl Fn(u32, UVec3) -> bool + Sync,
    ) -> Self {
        let n = cubes.n;
        let cascade = |cascade: u32| -> Vec<u64> {
            let words = (0..(n * n * n).div_ceil(64)).into_par_iter();
            let word = words.map(|word| {
                let bits = (0..64).filter(|bit| {
                    let index = word * 64 + bit;
                    index < n * n * n && is_occupied(cascade, cell_of(index, n))
                });
                bits.fold(0, |word, bit| word | 1 << bit)
            });
            word.collect()
        };
        Self {
            center: cubes.center,
            half: cubes.half,
            n,
            cascades: (0..cubes.n_cascades).map(cascade).collect(),
        }
    }

    /// By asking the field: first in cells of twice the width, then within those with anything in or beside them.
    pub(super) fn of_field(field: &dyn Field, cubes: &Cubes) -> Self {
        let n_coarse = cubes.n / 2;
        let mut occupancy = Self::from_cells(cubes, |_, _| false);
        for cascade in 0..cubes.n_cascades {
            let is_inner = |cell: UVec3, n: u32| {
                let inner = UVec3::splat(n / 4 + 1).cmple(cell).all();
                cascade > 0 && inner && cell.cmplt(UVec3::splat(3 * n / 4 - 1)).all()
            };
            let cells = (0..n_coarse.pow(3)).map(|index| cell_of(index, n_coarse));
            let coarse: Vec<UVec3> = cells.filter(|cell| !is_inner(*cell, n_coarse)).collect();
            let hits = occupied(field, cubes, cascade, &coarse, n_coarse);
            let near = spread(&hits, n_coarse);
            let corners = (0..8).map(|i| UVec3::new(i & 1, i >> 1 & 1, i >> 2));
            let corners: Vec<UVec3> = corners.collect();
            let fine: Vec<UVec3> = near
                .iter()
                .flat_map(|cell| corners.iter().map(move |corner| *cell * 2 + corner))
                .collect();
            let hits = occupied(field, cubes, cascade, &fine, cubes.n);
            let bits = &mut occupancy.cascades[cascade as usize];
            for cell in spread(&hits, cubes.n) {
                let index = index_of(cell, cubes.n);
                bits[index as usize / 64] |= 1 << (index % 64);
            }
        }
        occupancy
    }

    /// What lies at a point: whether there may be anything, and how wide its cell is; `None` outside of all.
    pub(super) fn at(&self, p: Vec3) -> Option<(bool, f32)> {
        let away = (p - self.center).abs().max_element() / self.half;
        if away.is_nan() {
            return None;
        }
        // The smallest cascade that holds it.
        let cascade = if away < 1.0 {
            0
        } else {
            away.log2().floor() as usize + 1
        };
        let bits = self.cascades.get(cascade)?;
        let half = self.half * (cascade as f32).exp2();
        let at = (p - self.center) / half * 0.5 + 0.5;
        let cell = (at * self.n as f32)
            .as_uvec3()
            .min(UVec3::splat(self.n - 1));
        let index = index_of(cell, self.n);
        let is_occupied = bits[index as usize / 64] >> (index % 64) & 1 == 1;
        Some((is_occupied, 2.0 * half / self.n as f32))
    }

    /// How far a ray goes from a point until it leaves the point's cell, which is `width` wide.
    pub(super) fn exit(&self, p: Vec3, inverse_direction: Vec3, width: f32) -> f32 {
        let at = (p - self.center) / width;
        let ahead = inverse_direction.cmpge(Vec3::ZERO);
        let to = Vec3::select(ahead, at.floor() + 1.0, at.ceil() - 1.0);
        let steps = (to - at) * width * inverse_direction;
        // A direction along an axis never leaves across the others.
        let steps = Vec3::select(steps.is_nan_mask(), Vec3::INFINITY, steps);
        steps.min_element().max(0.0)
    }

    /// The middles of the occupied cells of a cascade and those cells' width.
    pub(super) fn occupied_cells(&self, cascade: u32) -> (Vec<Vec3>, f32) {
        let cubes = Cubes {
            center: self.center,
            half: self.half,
            n_cascades: self.cascades.len() as u32,
            n: self.n,
        };
        let bits = &self.cascades[cascade as usize];
        let indices = (0..self.n.pow(3)).filter(|i| bits[*i as usize / 64] >> (i % 64) & 1 == 1);
        let centers = indices.map(|i| cubes.cell_center(cascade, cell_of(i, self.n), self.n));
        let width = 2.0 * cubes.half_of(cascade) / self.n as f32;
        (centers.collect(), width)
    }

    pub(super) fn n_cascades(&self) -> u32 {
        self.cascades.len() as u32
    }
}

/// Those of the cells, `n` along a side, at whose middle a field has something.
fn occupied(field: &dyn Field, cubes: &Cubes, cascade: u32, cells: &[UVec3], n: u32) -> Vec<UVec3> {
    let threshold = LEFT_OUT / (2.0 * cubes.half_of(cascade));
    let batches = cells.par_chunks(BATCH);
    let found = batches.flat_map_iter(|cells| {
        let centers = cells
            .iter()
            .map(|cell| cubes.cell_center(cascade, *cell, n));
        let centers: Vec<Vec3> = centers.collect();
        let mut answers = Densities::default();
        field.densities(&centers, &mut Scratch::default(), &mut answers);
        let pairs = cells.iter().zip(answers.densities);
        let found = pairs.filter(|(_, density)| *density > threshold);
        found.map(|(cell, _)| *cell).collect::<Vec<_>>()
    });
    found.collect()
}

/// The cells and those that touch them, `n` along a side; in order, each once.
fn spread(cells: &[UVec3], n: u32) -> Vec<UVec3> {
    let mut is_near = vec![false; n.pow(3) as usize];
    for cell in cells {
        let (low, high) = (
            cell.saturating_sub(UVec3::ONE),
            (cell + 1).min(UVec3::splat(n - 1)),
        );
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    is_near[index_of(UVec3::new(x, y, z), n) as usize] = true;
                }
            }
        }
    }
    let near = (0..n.pow(3)).filter(|index| is_near[*index as usize]);
    near.map(|index| cell_of(index, n)).collect()
}

fn cell_of(index: u32, n: u32) -> UVec3 {
    UVec3::new(index % n, index / n % n, index / (n * n))
}

fn index_of(cell: UVec3, n: u32) -> u32 {
    (cell.z * n + cell.y) * n + cell.x
}
