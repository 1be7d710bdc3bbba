//! The cells that the coarse grids cut space into: finer ones over the inner box, then all of contracted space.

use super::contraction::unit_cube;
use crate::neif::kernels::math;

/// Cells per axis of the grid over the inner box.
pub const INNER_SIDE: usize = 128;

/// Cells per axis of the grid over all contracted space.
pub(super) const OUTER_SIDE: usize = 96;

/// Cells of the inner grid, which come first.
pub(super) const INNER_CELLS: u32 = (INNER_SIDE * INNER_SIDE * INNER_SIDE) as u32;

/// The cell that holds a point in field coordinates.
#[inline(always)]
pub fn cell_index(x: [f32; 3]) -> u32 {
    let m = x[0].abs().max(x[1].abs()).max(x[2].abs());
    // Both, and then a choice: vectorises.
    let inner = inner_cell_index(x);
    let outer = INNER_CELLS + cell_of(unit_cube(contract_point(x)), OUTER_SIDE);
    if m < 1.0 { inner } else { outer }
}

/// The inner cell that holds a point in field coordinates, or is nearest to it.
#[inline(always)]
pub fn inner_cell_index(x: [f32; 3]) -> u32 {
    cell_of(x.map(|v| v * 0.5 + 0.5), INNER_SIDE)
}

/// The cell of a grid with `side` cells an axis that holds a point of the unit cube; points outside go to the rim.
#[inline(always)]
pub(in crate::neif) fn cell_of(unit: [f32; 3], side: usize) -> u32 {
    // The minimum and maximum also map NaN inside the grid.
    let top = side as f32 - 0.5;
    let [x, y, z] = unit.map(|v| math::floor_small((v * side as f32).max(0.0).min(top)).1);
    x + (y + z * side as u32) * side as u32
}

/// [`super::contraction::contract`] without the scale, which costs a cube root.
#[inline(always)]
pub(super) fn contract_point(x: [f32; 3]) -> [f32; 3] {
    let m = x[0].abs().max(x[1].abs()).max(x[2].abs()).max(1.0);
    let inverse = 1.0 / m;
    x.map(|v| v * (2.0 - inverse) * inverse)
}
