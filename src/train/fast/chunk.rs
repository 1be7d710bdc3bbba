//! One share of a training step: drawn pixels, their rays, the loss, and the way back.

use std::ops::Range;

use glam::Vec3;

use super::step_context::StepContext;
use crate::geometry::orthonormal_basis;
use crate::neif::EnvironmentTransform;
use crate::neif::field::density_grid::DensityCells;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::field::seen_grid::SeenGrid;
use crate::neif::kernels::math::all_finite;
use crate::neif::light::light_path::{self, LitVertex, PathVertex};
use crate::neif::surface::material::MaterialBatch;
use crate::neif::surface::values::Surface;
use crate::train::photos::photo_rows::PhotoRows;
use crate::train::pixels::store::{BackgroundSample, ChromaSource, ObjectPixel};
use crate::train::priors::agreement;
use crate::train::priors::unseen::{self, Triple};
use crate::train::random::SlotRandom;
use crate::train::shape::normal_offsets::OffsetBatch;
use crate::train::shape::tilted_rays::{PixelError, TiltedRays};
use crate::train::step::chunks::{jitter_slot, share};
use crate::train::step::loss::{
    PixelLoss, SMOOTHNESS_STEP, clipped_pull, keep_luma, pixel_loss, share_chroma,
};

/// Chunks a step is cut into: twice as many as a large desktop has cores, each long enough for the networks' kernels.
pub(super) const N_CHUNKS: usize = 32;

/// Every so many object pixels one takes part in the smoothness term.
const SMOOTHNESS_STRIDE: usize = 4;

/// Sums over a chunk's pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::train) struct ChunkLoss {
    pub(in crate::train) object: f64,
    pub(in crate::train) background: f64,
    pub(in crate::train) smoothness: f64,
    /// What is asked of the environment beyond the photos.
    pub(in crate::train) priors: f64,
    pub(in crate::train) d_gamma: f64,
}

/// A drawn object pixel on its way through the step.
#[derive(Clone, Debug)]
pub(super) struct ObjectSlot {
    pub(super) pixel: ObjectPixel,
    pub(super) chroma: ChromaSource,
    /// Its paths, among the chunk's.
    pub(super) paths: Range<usize>,
}

/// A light path of an object pixel.
#[derive(Clone, Debug)]
pub(super) struct SlotPath {
    /// Material points of its vertices.
    pub(super) points: Range<usize>,
    /// Its lit vertices.
    pub(super) lit: Range<usize>,
}

/// Two material points of the smoothness term, and its weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct SmoothPair {
    pub(super) at: usize,
    pub(super) beside: usize,
    pub(super) weight: f32,
}

/// Working memory and gradients of one chunk.
#[derive(Debug, Default)]
pub(in crate::train) struct Chunk {
    index: usize,
    /// First slot of the random numbers of sample placement.
    jitter_slot: u64,
    pub(super) slots: Vec<ObjectSlot>,
    pub(super) paths: Vec<SlotPath>,
    vertices: Vec<PathVertex>,
    pub(super) lit: Vec<LitVertex>,
    pub(super) backgrounds: Vec<BackgroundSample>,
    /// Ray of the first background pixel; the others follow.
    pub(super) first_background_ray: usize,
    pub(super) triples: Vec<Triple>,
    /// Rays of the groups of cones that should agree.
    pub(super) agreement: Range<usize>,
    /// Rays that should bring no glare.
    pub(super) glare: Range<usize>,
    pub(super) pairs: Vec<SmoothPair>,
    errors: Vec<PixelError>,
    pub(in crate::train) tilted: TiltedRays,
    /// Corrections of the vertices' normals, and their gradients.
    pub(in crate::train) offsets: OffsetBatch,
    points: Vec<Vec3>,
    scratch: Vec<f32>,
    pub(in crate::train) material: MaterialBatch,
    pub(in crate::train) batch: FieldBatch,
    pub(super) d_field_networks: Vec<f32>,
    pub(in crate::train) d_material_network: Vec<f32>,
    pub(in crate::train) photo_rows: PhotoRows,
    pub(in crate::train) loss: ChunkLoss,
    pub(in crate::train) is_finite: bool,
}

impl Chunk {
    /// The `index`-th chunk.
    pub(in crate::train) fn new(index: usize) -> Self {
        Self {
            index,
            jitter_slot: jitter_slot(index),
            ..Self::default()
        }
    }

    /// The chunk's share of `n` slots.
    fn share(&self, n: usize) -> Range<usize> {
        share(n, self.index, N_CHUNKS)
    }

    /// Draws its share of so many object and background pixels, evaluates their surfaces and places the samples.
    pub(in crate::train) fn prepare(
        &mut self,
        context: &StepContext<'_>,
        objects: usize,
        backgrounds: usize,
    ) {
        let (objects, backgrounds) = (self.share(objects), self.share(backgrounds));
        self.slots.clear();
        self.paths.clear();
        self.vertices.clear();
        self.points.clear();
        self.pairs.clear();
        self.batch.rays.clear();
        if let Some(material) = context.material {
            self.draw_objects(context, objects);
            self.correct_normals(context);
            material.forward(&self.points, &mut self.material, &mut self.scratch);
            self.aim_lobes(context);
        }
        self.draw_backgrounds(context, backgrounds);
        let config = context.config;
        let is_alone = context.material.is_none() && context.pixels.n_backgrounds() > 0;
        let alone = |n: usize| self.share(if is_alone { n } else { 0 });
        let (triples, groups) = (
            alone(config.unseen_triples_alone),
            alone(config.agreement_groups_alone),
        );
        unseen::draw(context, triples, &mut self.batch, &mut self.triples);
        self.agreement = agreement::draw(context, groups, &mut self.batch);
        let drawn = (config.seed, context.step);
        let groups = self.share(context.n_glare_groups());
        self.glare = context.unseen.draw(drawn, groups, &mut self.batch);
        self.tilt_normals(context);
        let tilted = &self.tilted;
        let (seed, step, first) = (context.config.seed, context.step, self.jitter_slot);
        context.field.place(
            &mut self.batch,
            context.density,
            context.samples_per_ray,
            context.uniform_share,
            |ray| {
                let ray = tilted.placed_like(ray) as u64;
                let mut random = SlotRandom::new(seed, step, first + ray);
                [random.uniform() - 0.5, random.uniform() - 0.5]
            },
        );
    }

    /// The vertices of the object pixels' paths first, then the neighbours of the smoothness term.
    fn draw_objects(&mut self, context: &StepContext<'_>, objects: Range<usize>) {
        let drawn = context.pixels.draw_objects(objects.len(), |i| {
            let slot = (objects.start + i) as u64;
            SlotRandom::new(context.config.seed, context.step, slot)
        });
        for (mut pixel, chroma) in drawn {
            let (first, first_vertex) = (self.paths.len(), self.vertices.len());
            let paths = &mut self.paths;
            context
                .pixels
                .unpack_paths(&pixel, &mut self.vertices, |points| {
                    paths.push(SlotPath { points, lit: 0..0 });
                });
            let begin = self.vertices[first_vertex].point.position;
            context.pixels.follow_camera(&mut pixel, begin);
            self.slots.push(ObjectSlot {
                pixel,
                chroma,
                paths: first..self.paths.len(),
            });
        }
        self.points
            .extend(self.vertices.iter().map(|vertex| vertex.point.position));
        let side = context.material.map_or(1.0, |m| m.side);
        for (index, slot) in self.slots.iter().enumerate().step_by(SMOOTHNESS_STRIDE) {
            let mut random = SlotRandom::new(
                context.config.seed,
                context.step,
                self.jitter_slot ^ (1 << 41) ^ index as u64,
            );
            let phi = random.uniform() * std::f32::consts::TAU;
            let at = self.paths[slot.paths.start].points.start;
            let point = &self.vertices[at].point;
            let (tangent, bitangent) = orthonormal_basis(point.normal);
            let offset = (tangent * phi.cos() + bitangent * phi.sin()) * (SMOOTHNESS_STEP * side);
            self.pairs.push(SmoothPair {
                at,
                beside: self.points.len(),
                weight: slot.pixel.smoothness,
            });
            self.points.push(point.position + offset);
        }
    }

    /// From roughness to lobes and their rays, along every path.
    fn aim_lobes(&mut self, context: &StepContext<'_>) {
        let still = EnvironmentTransform::default().environment_from_world();
        self.lit.clear();
        for path in &mut self.paths {
            let (first, start) = (self.lit.len(), path.points.start);
            let n = light_path::aim(
                &self.vertices[path.points.clone()],
                |k| (start + k, self.material.surfaces[start + k]),
                &still,
                context.frame,
                |_| None,
                &mut self.batch.rays,
                &mut self.lit,
            );
            path.lit = first..first + n;
        }
    }

    /// Adds to the normals of all vertices what was learned of them since they were traced.
    fn correct_normals(&mut self, context: &StepContext<'_>) {
        let Some(offsets) = context.offsets else {
            return;
        };
        let positions = self.vertices.iter().map(|v| v.point.position);
        offsets.evaluate(positions, &mut self.offsets);
        for (i, vertex) in self.vertices.iter_mut().enumerate() {
            vertex.point.normal = self.offsets.corrected(i, vertex.point.normal);
        }
    }

    /// Second rays for the normals of all paths' first vertices.
    fn tilt_normals(&mut self, context: &StepContext<'_>) {
        self.tilted.begin(&self.batch);
        if context.offsets.is_none() || !context.tilts {
            return;
        }
        for (index, slot) in self.slots.iter().enumerate() {
            let share = 1.0 / (context.batch_size.objects * slot.paths.len()) as f32;
            let stream = self.jitter_slot ^ (1 << 42) ^ index as u64;
            let mut random = SlotRandom::new(context.config.seed, context.step, stream);
            for path in &self.paths[slot.paths.clone()] {
                let at = path.points.start;
                let vertex = (at, &self.vertices[at].point, &self.lit[path.lit.start]);
                let pixel = (index, share);
                self.tilted
                    .push(context, &mut random, vertex, pixel, &mut self.batch);
            }
        }
    }

    fn draw_backgrounds(&mut self, context: &StepContext<'_>, backgrounds: Range<usize>) {
        self.backgrounds.clear();
        self.first_background_ray = self.batch.rays.len();
        for slot in backgrounds {
            let mut random =
                SlotRandom::new(context.config.seed, context.step, (1 << 32) + slot as u64);
            let sample = context
                .pixels
                .draw_background(&mut random, context.config.preconvolved_share);
            self.batch.rays.push(FieldRay::of_pixel(
                context.frame.field_from_world(sample.origin).to_array(),
                sample.direction.to_array(),
                0.0,
                sample.spread,
            ));
            self.backgrounds.push(sample);
        }
    }

    /// Radiance, loss, and all gradients but the grids'.
    pub(in crate::train) fn run(&mut self, context: &StepContext<'_>) {
        self.loss = ChunkLoss::default();
        self.errors.clear();
        self.photo_rows.clear();
        self.d_field_networks.clear();
        self.d_field_networks
            .resize(context.field.n_network_params(), 0.0);
        context.field.forward(&mut self.batch);
        self.batch.d_radiance.clear();
        self.batch
            .d_radiance
            .resize(self.batch.rays.len(), [0.0; 3]);
        self.material.d_surfaces.clear();
        self.material
            .d_surfaces
            .resize(self.material.surfaces.len(), Surface::default());
        self.background_losses(context);
        self.planarity_losses(context);
        self.distortion_losses(context);
        self.depth_losses(context);
        self.agreement_losses(context);
        self.glare_losses(context);
        self.object_losses(context);
        self.tilted
            .backward(&self.batch, &self.errors, &mut self.offsets);
        context.field.backward(
            context.field_transposed,
            &mut self.batch,
            context.config.gradient_cut_off,
            &mut self.d_field_networks,
        );
        if let Some(material) = context.material {
            self.smoothness_losses(context);
            self.roughness_gradients(context);
            self.metal_gradients(context);
            self.d_material_network.clear();
            self.d_material_network
                .resize(material.n_network_params(), 0.0);
            material.backward(
                context.material_transposed,
                &mut self.material,
                &mut self.d_material_network,
            );
        }
        self.is_finite = self.check_finite();
    }

    fn background_losses(&mut self, context: &StepContext<'_>) {
        let config = context.config;
        let scale = config.background_weight / context.batch_size.backgrounds as f32;
        let clipped_weight = match context.material {
            Some(_) => config.clipped_weight,
            None => config.clipped_weight_alone,
        };
        for (sample, ray) in self.backgrounds.iter().zip(self.first_background_ray..) {
            let gain = context.gain(sample.view);
            let exposed = Vec3::from(self.batch.radiance[ray]) * gain;
            let loss = pixel_loss(context.display, exposed, sample.target);
            self.loss.background += f64::from(loss.value);
            self.loss.d_gamma += f64::from(loss.d_gamma() * scale);
            let (value, d) = clipped_pull(
                exposed,
                sample.target,
                config.clipped_radiance,
                context.material.is_some(),
            );
            self.loss.background += f64::from(clipped_weight * value);
            let d = d * clipped_weight;
            self.batch.d_radiance[ray] = ((loss.d_linear() + d) * gain * scale).to_array();
            let asked = (sample.view, exposed, &loss);
            self.photo_rows.ask(context, asked, || {
                let slope = context.pixels.slope(sample);
                (sample.direction, slope, self.batch.end(ray))
            });
        }
    }

    /// Refreshes cells of the density cache, after [`Self::run`].
    pub(super) fn observe(&self, cells: &mut DensityCells<'_>) {
        self.batch
            .observe_densities(&cells.range(), |cell, value| cells.observe(cell, value));
    }

    /// Notes what the background pixels show, after [`Self::run`].
    pub(super) fn note_seen(&self, seen: &mut SeenGrid) {
        for (sample, ray) in self.backgrounds.iter().zip(self.first_background_ray..) {
            self.batch.reached(ray, |cell| seen.see(cell, sample.view));
        }
    }

    /// Eq. 7 and its way back for all object pixels.
    fn object_losses(&mut self, context: &StepContext<'_>) {
        let losses = (0..self.slots.len()).map(|index| self.object_loss(context, index));
        let mut losses: Vec<PixelLoss> = losses.collect();
        let mut rest = losses.as_mut_slice();
        for alike in self.slots.chunk_by(|a, b| a.chroma == b.chroma) {
            let (of_them, others) = rest.split_at_mut(alike.len());
            match alike[0].chroma {
                ChromaSource::Own => {}
                ChromaSource::Mean(_) => share_chroma(of_them),
                ChromaSource::None => keep_luma(of_them),
            }
            rest = others;
        }
        for (index, loss) in losses.iter().enumerate() {
            self.object_backward(context, index, loss);
        }
    }

    /// Eq. 7 for one object pixel, the mean of its paths, against what the photo shows there. Of the photo's exposure and pose
    /// its colour is asked as it is: what is wrong in its chroma evens out.
    fn object_loss(&mut self, context: &StepContext<'_>, index: usize) -> PixelLoss {
        let slot = &self.slots[index];
        let mut out = Vec3::ZERO;
        for path in &self.paths[slot.paths.clone()] {
            let lit = &mut self.lit[path.lit.clone()];
            light_path::gather(
                lit,
                |_| Vec3::ONE,
                |ray| Vec3::from(self.batch.radiance[ray]),
            );
            out += lit[0].outgoing();
        }
        let pixel = &slot.pixel;
        let exposed = out * (1.0 / slot.paths.len() as f32) * context.gain(pixel.view);
        let loss = pixel_loss(context.display, exposed, pixel.target);
        let point = &self.vertices[self.paths[slot.paths.start].points.start].point;
        let asked = (pixel.view, exposed, &loss);
        self.photo_rows.ask(context, asked, || {
            let slope = context.pixels.object_slope(pixel, point.position);
            let eye = context.pixels.eye(pixel.view);
            let distance = point.position.distance(eye) / context.frame.half_side;
            (-point.to_eye, slope, (distance, 1.0))
        });
        loss
    }

    /// The way back for one object pixel.
    fn object_backward(&mut self, context: &StepContext<'_>, index: usize, loss: &PixelLoss) {
        let slot = &self.slots[index];
        let share = 1.0 / slot.paths.len() as f32;
        let gain = context.gain(slot.pixel.view);
        let scale = 1.0 / context.batch_size.objects as f32;
        self.loss.object += f64::from(loss.value);
        self.loss.d_gamma += f64::from(loss.d_gamma() * scale);
        let d_out = loss.d_linear() * gain * (scale * share);
        self.errors.push(PixelError::new(loss, gain, d_out));
        for path in &self.paths[slot.paths.clone()] {
            light_path::backward(
                &self.lit[path.lit.clone()],
                d_out,
                &self.batch.radiance,
                &mut self.batch.d_radiance,
                &mut self.material.d_surfaces,
            );
        }
    }

    fn check_finite(&self) -> bool {
        all_finite(&self.d_field_networks)
            && self.offsets.is_finite()
            && all_finite(&self.d_material_network)
            && self.batch.has_finite_gradients()
            && (self.loss.object + self.loss.background + self.loss.smoothness + self.loss.priors)
                .is_finite()
    }
}
