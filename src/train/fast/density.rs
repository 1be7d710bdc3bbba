//! The density cache as a part of the fast model: kept in checkpoints, and looked into at random.

use rayon::prelude::*;

use super::chunk::N_CHUNKS;
use super::model::Fast;
use crate::data::files::tensor_file::TensorFile;
use crate::neif::field::contraction::{contract, unit_cube};
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::floor::Floor;
use crate::neif::field::seen_grid::SeenGrid;
use crate::train::TrainError;
use crate::train::random::SlotRandom;
use crate::train::step::now::Now;
use crate::train::step::part::Part;
use crate::train::step::tasks::Job;

/// Steps between two rounds of random looks into the cells.
const PROBE_EVERY: u64 = 16;
/// Cells looked into a round.
const N_PROBES: usize = 8192;
/// Those of a task.
const PROBE_BLOCK: usize = N_PROBES / N_CHUNKS;
/// Name of the cells in a checkpoint.
const CELLS: &str = "density.cells";

impl Fast {
    /// Looks into random cells when it is time, so that places no sample goes to are known too; whether it did.
    pub(super) fn probe_density(&mut self, now: &Now<'_>) -> bool {
        if !now.step.is_multiple_of(PROBE_EVERY) {
            return false;
        }
        let (field, n_cells) = (&self.field.value, self.density.cells().len());
        let mut probed = vec![(0, 0.0); N_PROBES];
        let blocks = probed.par_chunks_mut(PROBE_BLOCK).enumerate();
        let probes = self.work.probes.par_iter_mut().zip(blocks);
        now.tasks.each("probe", probes, |(probe, (index, block))| {
            let slot = u64::MAX - index as u64;
            let mut random = SlotRandom::new(now.config.seed, now.step, slot);
            let mut points = Vec::with_capacity(block.len());
            for (cell, _) in block.iter_mut() {
                *cell = random.index(n_cells);
                let u = [random.uniform(), random.uniform(), random.uniform()];
                let place = contract(DensityGrid::point_in_cell(*cell, u)).0;
                points.push((unit_cube(place), 0.0));
            }
            let densities = field.densities(probe, &points, &mut Vec::new());
            for ((_, density), value) in block.iter_mut().zip(densities) {
                *density = value;
            }
        });
        for (cell, density) in probed {
            self.density.observe(cell as u32, density);
        }
        true
    }
}

impl Part for DensityGrid {
    /// It follows the samples, not a gradient.
    fn update<'a>(&'a mut self, _now: &Now<'_>, _jobs: &mut Vec<Job<'a>>) {}

    fn store(&self, file: &mut TensorFile) {
        file.insert_u16(CELLS, &[self.cells().len()], self.cells().to_vec());
        if let Some(floor) = self.floor {
            floor.store(file);
        }
        self.seen.iter().for_each(|seen| seen.store_both(file));
    }

    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        let cells = file.u16(CELLS, &[self.cells().len()])?.to_vec();
        let mut density = Self::from_cells(cells).ok_or_else(|| TrainError::Checkpoint {
            file: file.origin().to_owned(),
            what: "has another density grid",
        })?;
        density.floor = Floor::stored(file)?;
        density.seen = Some(SeenGrid::stored(file)?.unwrap_or_default());
        *self = density;
        Ok(())
    }
}
