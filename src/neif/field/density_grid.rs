//! A running mean of the density on two coarse grids: one finer, over the inner box, and one over all contracted space; the
//! floor under them, and what of all that photos showed.

use std::ops::Range;

use glam::{IVec3, Vec3};

use super::cells::{INNER_CELLS, INNER_SIDE, OUTER_SIDE, cell_index};
use super::contraction::expand;
use super::floor::Floor;
use super::seen_grid::SeenGrid;
use crate::neif::kernels::math::{bf16_from_f32, f32_from_bf16};

/// A cell that is empty for good: no running mean gets there.
const VOID: u16 = 0;
/// Density of cells never seen, per field unit: faint, so that unknown space is looked at but hides nothing.
const INITIAL_DENSITY: f32 = 0.1;
/// Share of a new observation in the running mean.
const RATE: f32 = 0.1;

/// Cells next to a surface that say nothing about the line of sight.
const BESIDE: u32 = 3;

/// Running mean of the density, stored as the upper half of an `f32` (bf16): half the cache lines.
#[derive(Clone, Debug, PartialEq)]
pub struct DensityGrid {
    cells: Vec<u16>,
    /// What rays end on.
    pub floor: Option<Floor>,
    /// What photos showed; `None` where nobody knows.
    pub seen: Option<SeenGrid>,
}

impl Default for DensityGrid {
    fn default() -> Self {
        Self {
            cells: vec![bf16_from_f32(INITIAL_DENSITY); INNER_SIDE.pow(3) + OUTER_SIDE.pow(3)],
            floor: None,
            seen: None,
        }
    }
}

impl DensityGrid {
    /// All cells: first the inner grid, then the outer one, x fastest.
    pub fn cells(&self) -> &[u16] {
        &self.cells
    }

    /// The grid of stored cells; `None` when the count is wrong.
    pub fn from_cells(cells: Vec<u16>) -> Option<Self> {
        (cells.len() == INNER_SIDE.pow(3) + OUTER_SIDE.pow(3)).then_some(Self {
            cells,
            floor: None,
            seen: None,
        })
    }

    /// Declares every inner cell whose centre `is_void` (field coordinates) empty for good: the object's inside.
    ///
    /// No ray of a camera ever goes there, so what the field puts there is a ghost of the object that shows as soon
    /// as the environment is moved.
    pub fn hollow(&mut self, is_void: impl Fn([f32; 3]) -> bool) {
        let cells = 0..INNER_CELLS as usize;
        self.hollow_cells(cells.filter(|cell| is_void(Self::point_in_cell(*cell, [0.5; 3]))));
    }

    /// Declares cells empty for good, by their indices.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn hollow_cells(&mut self, cells: impl IntoIterator<Item = usize>) {
        for cell in cells {
            self.cells[cell] = VOID;
        }
    }

    /// Declares inner cells around void ones, within `reach` cells from centre to centre, empty for good too, where `may_be`
    /// (of the centre, field coordinates).
    pub fn widen_void(&mut self, reach: f32, may_be: impl Fn([f32; 3]) -> bool) {
        let (side, n) = (INNER_SIDE as i32, reach.floor() as i32);
        let line = || -n..=n;
        let steps: Vec<IVec3> = line()
            .flat_map(|x| line().flat_map(move |y| line().map(move |z| IVec3::new(x, y, z))))
            .filter(|step| step.length_squared() as f32 <= reach * reach)
            .collect();
        let void = (0..INNER_CELLS).filter(|index| self.is_void(*index));
        for index in void.collect::<Vec<_>>() {
            let i = index as i32;
            let cell = IVec3::new(i % side, i / side % side, i / side / side);
            for beside in steps.iter().map(|step| cell + step) {
                if beside.min_element() < 0 || beside.max_element() >= side {
                    continue;
                }
                let at = (beside.x + (beside.y + beside.z * side) * side) as usize;
                if self.cells[at] != VOID && may_be(Self::point_in_cell(at, [0.5; 3])) {
                    self.cells[at] = VOID;
                }
            }
        }
    }

    /// Side of an inner cell, field coordinates.
    pub const fn inner_cell() -> f32 {
        2.0 / INNER_SIDE as f32
    }

    /// Share of the way along the unit `direction` from `start`, up to the end of the inner box, that is empty for good,
    /// `[0, 1]`; field coordinates. The first cells say nothing about the line of sight: they lie
    /// beside the object's surface.
    pub fn void_share(&self, start: Vec3, direction: Vec3) -> f32 {
        let step = Self::inner_cell();
        let cells = (BESIDE..)
            .map(|k| start + direction * (k as f32 * step))
            .take_while(|x| x.abs().max_element() < 1.0);
        let (mut n, mut n_void) = (0_u32, 0_u32);
        for x in cells {
            n += 1;
            n_void += u32::from(self.is_void(cell_index(x.to_array())));
        }
        n_void as f32 / n.max(1) as f32
    }

    /// Whether the cell is empty for good.
    #[inline(always)]
    pub fn is_void(&self, index: u32) -> bool {
        self.cells[index as usize] == VOID
    }

    /// Mixes an observed density into the cell with `index` (see [`cell_index`]).
    pub fn observe(&mut self, index: u32, density: f32) {
        mix(&mut self.cells[index as usize], density);
    }

    /// The cells of both grids, to be refreshed side by side, and what photos showed.
    pub fn parts(&mut self) -> ([DensityCells<'_>; 2], Option<&mut SeenGrid>) {
        let (inner, outer) = self.cells.split_at_mut(INNER_CELLS as usize);
        let of = |first, cells| DensityCells { first, cells };
        ([of(0, inner), of(INNER_CELLS, outer)], self.seen.as_mut())
    }

    /// A point, in field coordinates, inside cell `index`, placed by three numbers in `[0, 1)`.
    pub fn point_in_cell(index: usize, u: [f32; 3]) -> [f32; 3] {
        let (index, side) = if index < INNER_SIDE.pow(3) {
            (index, INNER_SIDE)
        } else {
            (index - INNER_SIDE.pow(3), OUTER_SIDE)
        };
        let cell = [index % side, index / side % side, index / side / side];
        let unit: [f32; 3] =
            std::array::from_fn(|axis| (cell[axis] as f32 + u[axis]) / side as f32);
        if side == INNER_SIDE {
            unit.map(|v| v * 2.0 - 1.0)
        } else {
            expand(unit.map(|v| v * 4.0 - 2.0))
        }
    }

    /// The cells in eight bits each, two to a word: `8 log2(density) + 128`, steps of 9 %, 0 for void; for files.
    pub fn codes(&self) -> Vec<u16> {
        let code = |cell: u16| {
            let log = 8.0 * f32_from_bf16(cell).max(1e-30).log2() + 128.0;
            if cell == VOID {
                0
            } else {
                log.round().clamp(1.0, 255.0) as u16
            }
        };
        self.cells
            .chunks_exact(2)
            .map(|pair| code(pair[0]) | code(pair[1]) << 8)
            .collect()
    }

    /// The grid of stored codes; `None` when the count is wrong.
    pub fn from_codes(codes: &[u16]) -> Option<Self> {
        let decode = |code: u16| {
            let density = ((f32::from(code) - 128.0) / 8.0).exp2();
            if code == 0 {
                VOID
            } else {
                bf16_from_f32(density)
            }
        };
        Self::from_cells(
            codes
                .iter()
                .flat_map(|pair| [decode(pair & 0xff), decode(pair >> 8)])
                .collect(),
        )
    }
}

/// The cells of one of the grids.
#[derive(Debug)]
pub struct DensityCells<'a> {
    first: u32,
    cells: &'a mut [u16],
}

impl DensityCells<'_> {
    /// Indices of the cells.
    pub fn range(&self) -> Range<u32> {
        self.first..self.first + self.cells.len() as u32
    }

    /// [`DensityGrid::observe`] for a cell of [`Self::range`].
    pub fn observe(&mut self, index: u32, density: f32) {
        mix(&mut self.cells[(index - self.first) as usize], density);
    }
}

fn mix(cell: &mut u16, density: f32) {
    if *cell == VOID {
        return;
    }
    let mean = f32_from_bf16(*cell);
    // The cap keeps one absurd observation from outlasting a run.
    let mean = mean + RATE * (density.min(1e6) - mean);
    // A mean that underflowed would read as void.
    *cell = bf16_from_f32(mean.max(1e-30));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_open_where_cells_are_empty_for_good() {
        let mut grid = DensityGrid::default();
        grid.hollow(|x| x[0] > 0.5);
        let share = |direction| grid.void_share(Vec3::ZERO, direction);
        assert!((share(Vec3::X) - 0.5).abs() < 0.05, "{}", share(Vec3::X));
        assert_eq!([Vec3::NEG_X, Vec3::Y].map(share), [0.0; 2]);
        assert_eq!(grid.void_share(Vec3::splat(2.0), Vec3::X), 0.0, "outside");
    }

    #[test]
    fn what_is_void_is_widened_as_a_ball_where_it_may_be() {
        let mut grid = DensityGrid::default();
        let middle = [0.5 * DensityGrid::inner_cell(); 3];
        grid.hollow(|x| x.iter().all(|v| (v - middle[0]).abs() < 1e-4));
        grid.widen_void(2.5, |x| x[1] > -DensityGrid::inner_cell());
        let is_void = |dx: i32, dy: i32, dz: i32| {
            let step = |d: i32| d as f32 * DensityGrid::inner_cell();
            let x = [
                middle[0] + step(dx),
                middle[1] + step(dy),
                middle[2] + step(dz),
            ];
            grid.is_void(cell_index(x))
        };
        assert!(is_void(0, 0, 0) && is_void(2, 0, 0) && is_void(-2, 1, 1) && is_void(0, 2, 0));
        assert!(!is_void(3, 0, 0) && !is_void(2, 2, 0), "beyond 2.5 cells");
        assert!(is_void(0, -1, 0) && !is_void(0, -2, 0), "it may not be");
        // 81 cells in the ball, 3 x 3 of them beyond the limit.
        let n_void = (0..INNER_CELLS).filter(|i| grid.is_void(*i)).count();
        assert_eq!(n_void, 72);
    }

    #[test]
    fn a_cell_contains_its_points() {
        for index in (0..DensityGrid::default().cells.len()).step_by(7919) {
            let back = cell_index(DensityGrid::point_in_cell(index, [0.5; 3]));
            let point = DensityGrid::point_in_cell(index, [0.5; 3]);
            // Outer cells inside the inner box are never used.
            let unused = index >= INNER_SIDE.pow(3) && point.iter().all(|v| v.abs() < 1.0);
            let at_infinity = point.iter().any(|v| v.abs() > 50.0);
            assert!(
                back as usize == index || unused || at_infinity,
                "cell {index} came back as {back}"
            );
        }
    }

    #[test]
    fn codes_keep_the_density_within_their_step() {
        let mut grid = DensityGrid::default();
        for (i, cell) in grid.cells.iter_mut().enumerate() {
            *cell = bf16_from_f32(1e-3 * 1.01_f32.powi((i % 1500) as i32));
        }
        let back = DensityGrid::from_codes(&grid.codes()).unwrap();
        for (a, b) in grid.cells.iter().zip(&back.cells) {
            let ratio = f32_from_bf16(*a) / f32_from_bf16(*b);
            assert!((0.94..1.06).contains(&ratio), "{ratio}");
        }
        assert!(
            DensityGrid::from_codes(&[0; 3]).is_none(),
            "a wrong count must be refused"
        );
    }

    #[test]
    fn the_running_mean_converges() {
        let mut grid = DensityGrid::default();
        for _ in 0..200 {
            grid.observe(5, 30.0);
        }
        assert!(
            (f32_from_bf16(grid.cells[5]) - 30.0).abs() < 1.5,
            "{}",
            f32_from_bf16(grid.cells[5])
        );
    }
}
