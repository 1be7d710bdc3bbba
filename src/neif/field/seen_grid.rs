//! Which parts of space the photos showed: what they did not show is constrained by reflections only.
//!
//! A cell of half the density cache's resolution holds a bit for each of eight groups of photos. A bit is set when a background
//! pixel's ray reaches the cell while training. Early in a run rays reach what later turns out to be hidden, so
//! the grid forgets: it keeps the bits of the last one or two periods.

use super::cells::{INNER_CELLS, INNER_SIDE, OUTER_SIDE};
use crate::data::files::tensor_file::{TensorFile, TensorFileError};

/// Photos of the same number modulo this share a bit.
const GROUPS: usize = 8;
/// Steps after which what was seen before the last so many is forgotten.
const PERIOD: u64 = 4096;
/// Cells an axis of the two grids.
const INNER: usize = INNER_SIDE / 2;
const OUTER: usize = OUTER_SIDE / 2;
/// Number of cells.
const N_CELLS: usize = INNER * INNER * INNER + OUTER * OUTER * OUTER;
/// Groups by which a place is seen for certain: parallax needs two.
const CERTAIN: f32 = 2.0;
/// Name of the array in files, two cells to a word.
const NAME: &str = "density.seen";

/// Bits of the groups of photos that showed each cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeenGrid {
    /// Of the present period.
    now: Vec<u8>,
    /// Of the one before.
    before: Vec<u8>,
    /// Whether either has a bit: asked for every few pixels of a picture.
    is_any: bool,
}

impl Default for SeenGrid {
    fn default() -> Self {
        Self {
            now: vec![0; N_CELLS],
            before: vec![0; N_CELLS],
            is_any: false,
        }
    }
}

impl SeenGrid {
    /// Notes that photo number `view` shows the cell with this index of the density cache.
    #[inline]
    pub fn see(&mut self, density_cell: u32, view: usize) {
        self.now[coarse(density_cell)] |= 1 << (view % GROUPS);
        self.is_any = true;
    }

    /// Begins a new period where `step` ends one.
    pub fn forget(&mut self, step: u64) {
        if step.is_multiple_of(PERIOD) {
            self.before.copy_from_slice(&self.now);
            self.now.fill(0);
            self.is_any = has_bits(&self.before);
        }
    }

    /// How surely photos showed the cell with this index of the density cache, `[0, 1]`: 1 from two groups of photos on.
    #[inline]
    pub fn share(&self, density_cell: u32) -> f32 {
        let cell = coarse(density_cell);
        let groups = (self.now[cell] | self.before[cell]).count_ones();
        (groups as f32 / CERTAIN).min(1.0)
    }

    /// Whether any cell was shown.
    pub fn is_any(&self) -> bool {
        self.is_any
    }

    /// Adds it to an environment's file, where it forgets nothing any more.
    pub fn store(&self, file: &mut TensorFile) {
        let either = self.now.iter().zip(&self.before);
        let bits: Vec<u8> = either.map(|(now, before)| now | before).collect();
        file.insert_u16(NAME, &[N_CELLS / 2], words(&bits));
    }

    /// Adds both periods to a checkpoint.
    pub fn store_both(&self, file: &mut TensorFile) {
        let both = [self.now.as_slice(), &self.before].concat();
        file.insert_u16(NAME, &[N_CELLS], words(&both));
    }

    /// Reads it from a file of either kind; `None` where the file has none.
    ///
    /// # Errors
    /// When what is there has another size.
    pub fn stored(file: &TensorFile) -> Result<Option<Self>, TensorFileError> {
        if file.tensor(NAME).is_err() {
            return Ok(None);
        }
        let words = match file.u16(NAME, &[N_CELLS]) {
            Ok(both) => both,
            Err(_one) => file.u16(NAME, &[N_CELLS / 2])?,
        };
        let mut now: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let before = match now.len() {
            N_CELLS => vec![0; N_CELLS],
            _ => now.split_off(N_CELLS),
        };
        Ok(Some(Self {
            is_any: has_bits(&now) || has_bits(&before),
            now,
            before,
        }))
    }
}

fn has_bits(cells: &[u8]) -> bool {
    cells.iter().any(|bits| *bits != 0)
}

fn words(bytes: &[u8]) -> Vec<u16> {
    let pairs = bytes.chunks_exact(2);
    pairs
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
        .collect()
}

/// The cell that holds a cell of the density cache.
#[inline]
fn coarse(density_cell: u32) -> usize {
    let index = density_cell as usize;
    match index.checked_sub(INNER_CELLS as usize) {
        None => halved::<INNER_SIDE>(index),
        Some(outer) => INNER * INNER * INNER + halved::<OUTER_SIDE>(outer),
    }
}

/// The cell of a grid of half the side; the side is constant, as divisions by what is not are slow.
#[inline]
fn halved<const SIDE: usize>(index: usize) -> usize {
    let (x, y, z) = (index % SIDE, index / SIDE % SIDE, index / SIDE / SIDE);
    x / 2 + (y / 2 + z / 2 * (SIDE / 2)) * (SIDE / 2)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::neif::field::cells::cell_index;
    use crate::neif::field::density_grid::DensityGrid;

    #[test]
    fn what_two_photos_showed_is_certain_and_its_neighbours_are_not() {
        let mut seen = SeenGrid::default();
        for far in [1.0, 5.0] {
            let cell = cell_index([0.3 * far, -0.2 * far, 0.7 * far]);
            let beside = cell_index([-0.3 * far, -0.2 * far, 0.7 * far]);
            for view in [3, 11, 3] {
                seen.see(cell, view);
            }
            assert!(seen.share(cell) < 0.6, "one group: {}", seen.share(cell));
            seen.see(cell, 4);
            assert_eq!((seen.share(cell), seen.share(beside)), (1.0, 0.0));
        }
    }

    #[test]
    fn it_forgets_what_was_seen_two_periods_ago() {
        let mut seen = SeenGrid::default();
        seen.see(7, 1);
        seen.forget(PERIOD - 1);
        seen.forget(PERIOD);
        assert!(seen.share(7) > 0.0, "the period before");
        seen.forget(2 * PERIOD);
        assert_eq!(seen.share(7), 0.0);
    }

    #[test]
    fn every_cell_of_the_cache_has_one() {
        let all = 0..DensityGrid::default().cells().len() as u32;
        let mut count = vec![0_u8; N_CELLS];
        all.for_each(|cell| count[coarse(cell)] += 1);
        assert!(count.iter().all(|n| *n == 8), "eight to a cell");
    }

    #[test]
    fn files_keep_it_and_refuse_another_size() {
        let mut seen = SeenGrid::default();
        seen.see(9, 2);
        seen.forget(PERIOD);
        seen.see(1_000_000, 3);
        let mut file = TensorFile::default();
        let back = |file: &TensorFile| {
            let file = TensorFile::from_bytes(&file.to_bytes(), Path::new("a.file")).unwrap();
            SeenGrid::stored(&file)
        };
        assert_eq!(back(&file).unwrap(), None);
        seen.store_both(&mut file);
        assert_eq!(back(&file).unwrap().as_ref(), Some(&seen));
        seen.store(&mut file);
        let merged = back(&file).unwrap().expect("stored");
        assert_eq!(merged.share(9), seen.share(9));
        assert_eq!(merged.share(1_000_000), seen.share(1_000_000));
        file.insert_u16(NAME, &[3], vec![0; 3]);
        assert!(back(&file).unwrap_err().to_string().contains(NAME));
    }
}
