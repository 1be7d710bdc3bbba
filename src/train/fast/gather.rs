//! From the chunks' gradients to those of the parts, summed in order, and the density cache refreshed.

use super::chunk::Chunk;
use super::model::Fast;
use crate::neif::field::radiance_field::RadianceField;
use crate::neif::surface::material::Material;
use crate::train::shape::refinement;
use crate::train::step::now::Now;
use crate::train::step::tasks::Job;

/// Pull of gamma's logarithm to 0, in squared differences of what is shown: photos have the curve of sRGB. Gains that are found
/// make up for almost any gamma, and where a mesh is wrong a lower one is wrong by less.
const GAMMA_PULL: f32 = 0.1;

impl Fast {
    /// All of a step's sums, as jobs of one pass; and refreshes the density cache.
    pub(super) fn gather_gradients(&mut self, now: &Now<'_>) {
        let d_gamma = self.sum(|c| c.loss.d_gamma) as f32;
        self.display.gradient = d_gamma + GAMMA_PULL * self.display.gamma.ln();
        let (chunks, step) = (&self.work.chunks, now.step);
        let mut jobs: Vec<Job<'_>> = Vec::new();
        // Every second chunk, in turn: the running means need no more, and each look is a cache miss.
        let observed = chunks.iter().skip((step % 2) as usize).step_by(2);
        let (grids, seen) = self.density.parts();
        for mut cells in grids {
            let observed = observed.clone();
            jobs.push(Box::new(move || {
                observed.for_each(|chunk| chunk.observe(&mut cells));
            }));
        }
        self.field.gather(
            &mut jobs,
            chunks,
            RadianceField::levels,
            |chunk: &Chunk| &chunk.d_field_networks,
            |field, level, chunk, table| field.scatter_level(level, &chunk.batch, table),
        );
        if let Some(seen) = seen {
            jobs.push(Box::new(move || {
                observed.for_each(|chunk| chunk.note_seen(seen));
                seen.forget(step);
            }));
        }
        if let Some(material) = &mut self.material {
            material.gather(
                &mut jobs,
                chunks,
                Material::levels,
                |chunk| &chunk.d_material_network,
                |field, level, chunk, table| field.scatter_level(level, &chunk.material, table),
            );
        }
        let refinement = self.surface.refinement.as_mut();
        if let Some(refinement) = refinement.filter(|_| step > refinement::DELAY) {
            let n_objects = self.work.batch_size.objects;
            jobs.push(Box::new(move || {
                let batches: Vec<_> = chunks.iter().map(|c| &c.offsets).collect();
                let rows = chunks.iter().flat_map(|c| &c.tilted.rows);
                refinement.gather(&batches, n_objects, rows);
            }));
        }
        if let Some(exposures) = &mut self.photos.exposures {
            let rows = chunks.iter().map(|chunk| &chunk.photo_rows.exposures);
            jobs.push(Box::new(move || exposures.gather(step, rows.flatten())));
        }
        if let Some(poses) = &mut self.photos.poses {
            let rows = chunks.iter().map(|chunk| &chunk.photo_rows.poses);
            jobs.push(Box::new(move || poses.gather(step, rows.flatten())));
        }
        now.tasks.all("gather", jobs);
    }
}
