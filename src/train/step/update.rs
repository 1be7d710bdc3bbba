//! The end of a step: gradients summed in order, parameters updated, the density cache refreshed.

use rayon::prelude::*;

use super::adam::{Rates, store_bf16};
use super::chunk::N_CHUNKS;
use super::learned::sum_in_order;
use super::trainer::Trainer;
use crate::neif::field::contraction::{contract, unit_cube};
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::networks::hash_grid::FEATURES;
use crate::train::random::SlotRandom;
use crate::train::shape::refinement;

/// Cells looked into a round.
const N_PROBES: usize = 8192;
/// Pull of gamma's logarithm to 0, in squared differences of what is shown: photos have the curve of sRGB. Gains that are found
/// make up for almost any gamma, and where a mesh is wrong a lower one is wrong by less.
const GAMMA_PULL: f32 = 0.1;

impl Trainer {
    /// Sums the chunks' gradients in order: networks, then each level by one task; and refreshes the density cache.
    pub(in crate::train) fn gather_gradients(&mut self) {
        let chunks = &self.work.chunks;
        let n_networks = self.field.value.n_network_params();
        let (networks, mut grids) = self.field.gradient.split_at_mut(n_networks);
        let (field, density) = (&self.field.value, &mut self.density);
        let material = self.material.as_mut();
        let (step, parity) = (self.counts.step, (self.counts.step % 2) as usize);
        rayon::scope(|scope| {
            for (level, shape) in field.levels().iter().enumerate() {
                let (table, rest) = grids.split_at_mut(shape.n_entries * FEATURES);
                grids = rest;
                scope.spawn(move |_| {
                    for chunk in chunks {
                        field.scatter_level(level, &chunk.batch, table);
                    }
                });
            }
            scope.spawn(move |_| {
                sum_in_order(
                    networks,
                    chunks.iter().map(|c| c.d_field_networks.as_slice()),
                );
            });
            scope.spawn(move |_| {
                // Every second chunk, in turn: the running means need no more, and each look is a cache miss.
                for chunk in chunks.iter().skip(parity).step_by(2) {
                    chunk.observe(density);
                }
                density.seen.iter_mut().for_each(|seen| seen.forget(step));
            });
            if let Some(learned) = material {
                let material = &learned.value;
                let (network, mut grids) =
                    learned.gradient.split_at_mut(material.n_network_params());
                sum_in_order(
                    network,
                    chunks.iter().map(|c| c.d_material_network.as_slice()),
                );
                for (level, shape) in material.levels().iter().enumerate() {
                    let (table, rest) = grids.split_at_mut(shape.n_entries * FEATURES);
                    grids = rest;
                    scope.spawn(move |_| {
                        for chunk in chunks {
                            material.scatter_level(level, &chunk.material, table);
                        }
                    });
                }
            }
        });
    }

    pub(super) fn update(&mut self, progress: f32) {
        self.counts.updates += 1;
        let warmup =
            ((self.counts.updates as f32) / self.config.warmup_steps.max(1) as f32).min(1.0);
        let decay = warmup * self.config.final_rate.powf(progress.clamp(0.0, 1.0));
        let rates = |n_head| Rates {
            n_head,
            head: decay * self.config.network_rate,
            tail: decay * self.config.grid_rate,
        };
        let n_head = self.field.value.n_network_params();
        self.field.adam.update_rounded(
            &mut self.field.value.params,
            &mut self.field.gradient,
            &mut self.work.tables,
            rates(n_head),
            self.counts.updates,
        );
        if let Some(m) = &mut self.material {
            let n_head = m.value.n_network_params();
            m.adam.update(
                &mut m.value.params,
                &mut m.gradient,
                rates(n_head),
                self.counts.updates,
            );
        }
        let d_gamma = self.sum(|c| c.loss.d_gamma) as f32 + GAMMA_PULL * self.display.gamma.ln();
        let rates = Rates {
            n_head: 1,
            head: decay * self.config.gamma_rate,
            tail: 0.0,
        };
        // An environment alone looks the same with any exponent: its own stays 1.
        if self.material.is_some() {
            let mut gamma = [self.display.gamma];
            self.display
                .adam
                .update(&mut gamma, &mut [d_gamma], rates, self.counts.updates);
            // Outside this range the transform is no display transform any more.
            self.display.gamma = gamma[0].clamp(0.2, 5.0);
        }
        if let Some(refinement) = &mut self.surface.refinement
            && self.counts.step > refinement::DELAY
        {
            let batches: Vec<_> = self.work.chunks.iter().map(|c| &c.offsets).collect();
            let rate = refinement::rate(progress);
            let n_pixels = self.work.batch_size.objects;
            refinement.offsets.update(&batches, rate, n_pixels);
            if let Some(evidence) = &mut refinement.evidence {
                evidence.add(self.work.chunks.iter().flat_map(|c| &c.tilted.rows));
            }
        }
        self.find_exposures();
        self.refine_poses();
        self.transpose();
    }

    /// All that is derived from the parameters: after they were set from outside.
    pub(in crate::train) fn derive(&mut self) {
        let field = &self.field.value;
        store_bf16(
            &field.params[field.n_network_params()..],
            &mut self.work.tables,
        );
        self.transpose();
    }

    fn transpose(&mut self) {
        self.field.value.transpose(&mut self.field.transposed);
        if let Some(m) = &mut self.material {
            m.value.transpose(&mut m.transposed);
        }
    }

    /// Looks into random cells of the density cache, so that places no sample goes to are known too.
    pub(super) fn probe_density(&mut self) {
        let mut random = SlotRandom::new(self.config.seed, self.counts.step, u64::MAX);
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
    }
}
