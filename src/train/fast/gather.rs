//! From the chunks' gradients to those of the parts, summed in order, and the density cache refreshed.

use super::chunk::Chunk;
use super::model::Fast;
use crate::neif::field::radiance_field::RadianceField;
use crate::neif::surface::material::Material;
use crate::train::shape::refinement;
use crate::train::step::now::Now;

/// Pull of gamma's logarithm to 0, in squared differences of what is shown: photos have the curve of sRGB. Gains that are found
/// make up for almost any gamma, and where a mesh is wrong a lower one is wrong by less.
const GAMMA_PULL: f32 = 0.1;

impl Fast {
    /// Those of the fields: networks, then each level by one task; and refreshes the density cache.
    pub(super) fn gather_gradients(&mut self, now: &Now<'_>) {
        let (chunks, density) = (&self.work.chunks, &mut self.density);
        let (field, material) = (&mut self.field, self.material.as_mut());
        let (step, parity) = (now.step, (now.step % 2) as usize);
        rayon::scope(|scope| {
            field.gather(
                scope,
                chunks,
                RadianceField::levels,
                |chunk: &Chunk| &chunk.d_field_networks,
                |field, level, chunk, table| field.scatter_level(level, &chunk.batch, table),
            );
            scope.spawn(move |_| {
                // Every second chunk, in turn: the running means need no more, and each look is a cache miss.
                for chunk in chunks.iter().skip(parity).step_by(2) {
                    chunk.observe(density);
                }
                density.seen.iter_mut().for_each(|seen| seen.forget(step));
            });
            if let Some(material) = material {
                material.gather(
                    scope,
                    chunks,
                    Material::levels,
                    |chunk| &chunk.d_material_network,
                    |field, level, chunk, table| field.scatter_level(level, &chunk.material, table),
                );
            }
        });
    }

    /// Those of the display transform, and what the pixels say of normals, exposures and poses.
    pub(super) fn gather_rows(&mut self, now: &Now<'_>) {
        let d_gamma = self.sum(|c| c.loss.d_gamma) as f32;
        self.display.gradient = d_gamma + GAMMA_PULL * self.display.gamma.ln();
        let chunks = &self.work.chunks;
        if let Some(refinement) = &mut self.surface.refinement
            && now.step > refinement::DELAY
        {
            let batches: Vec<_> = chunks.iter().map(|c| &c.offsets).collect();
            let rows = chunks.iter().flat_map(|c| &c.tilted.rows);
            refinement.gather(&batches, self.work.batch_size.objects, rows);
        }
        if let Some(exposures) = &mut self.photos.exposures {
            let rows = chunks.iter().map(|chunk| &chunk.photo_rows.exposures);
            exposures.gather(now.step, rows.flatten());
        }
        if let Some(poses) = &mut self.photos.poses {
            let rows = chunks.iter().map(|chunk| &chunk.photo_rows.poses);
            poses.gather(now.step, rows.flatten());
        }
    }
}
