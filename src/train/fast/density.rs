//! The density cache as a part of the fast model: kept in checkpoints, and looked into at random.

use rayon::prelude::*;

use super::model::Fast;
use crate::data::files::tensor_file::TensorFile;
use crate::neif::field::contraction::{contract, unit_cube};
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::floor::Floor;
use crate::neif::field::seen_grid::SeenGrid;
use crate::train::TrainError;
use crate::train::random::SlotRandom;
use crate::train::step::chunks::N_CHUNKS;
use crate::train::step::now::Now;
use crate::train::step::part::Part;

/// Steps between two rounds of random looks into the cells.
const PROBE_EVERY: u64 = 16;
/// Cells looked into a round.
const N_PROBES: usize = 8192;
/// Name of the cells in a checkpoint.
const CELLS: &str = "density.cells";

impl Fast {
    /// Looks into random cells when it is time, so that places no sample goes to are known too; whether it did.
    pub(super) fn probe_density(&mut self, now: &Now<'_>) -> bool {
        if !now.step.is_multiple_of(PROBE_EVERY) {
            return false;
        }
        let mut random = SlotRandom::new(now.config.seed, now.step, u64::MAX);
        let (cells, points): (Vec<usize>, Vec<_>) = (0..N_PROBES)
            .map(|_| {
                let cell = random.index(self.density.cells().len());
                let u = [random.uniform(), random.uniform(), random.uniform()];
                let place = unit_cube(contract(DensityGrid::point_in_cell(cell, u)).0);
                (cell, (place, 0.0))
            })
            .unzip();
        let field = &self.field.value;
        let densities: Vec<Vec<f32>> = self
            .work
            .probes
            .par_iter_mut()
            .zip(points.par_chunks(N_PROBES / N_CHUNKS))
            .map(|(probe, points)| field.densities(probe, points, &mut Vec::new()))
            .collect();
        for (cell, density) in cells.into_iter().zip(densities.into_iter().flatten()) {
            self.density.observe(cell as u32, density);
        }
        true
    }
}

impl Part for DensityGrid {
    /// It follows the samples, not a gradient.
    fn update(&mut self, _now: &Now<'_>) {}

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
