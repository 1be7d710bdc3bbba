//! One share of a step: drawn pixels, each ray through both passes, the losses, and the way back.

use std::ops::Range;

use glam::Vec3;

use super::PaperConfig;
use crate::geometry::orthonormal_basis;
use crate::neif::EnvironmentTransform;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::kernels::math::all_finite;
use crate::neif::light::display::Display;
use crate::neif::light::light_path::{self, LitVertex, PathVertex};
use crate::neif::paper::material::PaperMaterialBatch;
use crate::neif::paper::ray_pass::{PaperPlacement, RayLight};
use crate::neif::paper::{PaperField, PaperMaterial};
use crate::neif::surface::values::Surface;
use crate::train::config::TrainConfig;
use crate::train::pixels::store::{BackgroundSample, PixelStore};
use crate::train::random::SlotRandom;
use crate::train::step::chunks::jitter_slot;
use crate::train::step::loss::{PixelLoss, SMOOTHNESS_STEP, pixel_loss};

/// Chunks a step is cut into.
pub(super) const N_CHUNKS: usize = 16;

/// What all chunks of a step read.
#[derive(Clone, Copy)]
pub(super) struct StepContext<'a> {
    pub(super) config: &'a TrainConfig,
    pub(super) paper: &'a PaperConfig,
    pub(super) pixels: &'a PixelStore,
    pub(super) frame: &'a FieldFrame,
    pub(super) field: &'a PaperField,
    pub(super) field_transposed: &'a [f32],
    /// The material network and its transposed weights, when there is an object.
    pub(super) material: Option<(&'a PaperMaterial, &'a [f32])>,
    pub(super) display: Display,
    pub(super) step: u64,
}

/// Sums over a chunk's pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ChunkLoss {
    /// Squared errors of the second pass.
    pub(super) object: f64,
    pub(super) background: f64,
    /// All terms with their weights, the first pass's too.
    pub(super) weighted: f64,
    pub(super) d_gamma: f64,
}

/// A drawn object pixel.
#[derive(Clone, Copy, Debug)]
struct ObjectSlot {
    target: [f32; 3],
    smoothness: f32,
}

/// Working memory and gradients of one chunk.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    /// First slot of the random numbers of sample placement.
    jitter_slot: u64,
    slots: Vec<ObjectSlot>,
    vertices: Vec<PathVertex>,
    /// One a slot, its ray the slot's.
    lit: Vec<LitVertex>,
    backgrounds: Vec<BackgroundSample>,
    /// The points of the slots, then one beside each of them.
    points: Vec<Vec3>,
    surfaces: Vec<Surface>,
    d_surfaces: Vec<Surface>,
    material: PaperMaterialBatch,
    /// Of the slots, then of the background pixels.
    rays: Vec<FieldRay>,
    light: RayLight,
    radiance: Vec<[f32; 3]>,
    d_radiance: Vec<[f32; 3]>,
    d_lobe_variance: Vec<f32>,
    pub(super) d_field: Vec<f32>,
    pub(super) d_material: Vec<f32>,
    pub(super) loss: ChunkLoss,
    pub(super) is_finite: bool,
}

impl Chunk {
    /// The `index`-th chunk.
    pub(super) fn new(index: usize) -> Self {
        Self {
            jitter_slot: jitter_slot(index),
            ..Self::default()
        }
    }

    /// Rays of the last step.
    pub(super) fn n_rays(&self) -> usize {
        self.rays.len()
    }

    /// Losses and gradients of the pixels of slots `objects` and `backgrounds`.
    pub(super) fn run(
        &mut self,
        context: &StepContext<'_>,
        objects: Range<usize>,
        backgrounds: Range<usize>,
    ) {
        self.clear(context);
        if let Some((material, _)) = context.material {
            self.draw_objects(context, objects, material.side);
            material.forward(&self.points, &mut self.material, &mut self.surfaces);
            self.aim_lobes(context);
        }
        self.d_surfaces
            .resize(self.surfaces.len(), Surface::default());
        self.draw_backgrounds(context, backgrounds);
        for vec in [&mut self.radiance, &mut self.d_radiance] {
            vec.resize(self.rays.len(), [0.0; 3]);
        }
        self.d_lobe_variance.resize(self.rays.len(), 0.0);
        for ray in 0..self.rays.len() {
            self.learn_from_ray(context, ray);
        }
        if let Some((material, transposed)) = context.material {
            self.smoothness_losses(context);
            for lit in self.lit.chunks_exact(1) {
                light_path::roughness_backward(
                    lit,
                    &self.d_lobe_variance,
                    |_, lobe| lobe.d_variance,
                    &mut self.d_surfaces,
                );
            }
            self.d_material.resize(material.n_params(), 0.0);
            material.backward(
                transposed,
                &mut self.material,
                &self.d_surfaces,
                &mut self.d_material,
            );
        }
        self.is_finite = self.check_finite();
    }

    fn clear(&mut self, context: &StepContext<'_>) {
        self.loss = ChunkLoss::default();
        self.slots.clear();
        self.vertices.clear();
        self.lit.clear();
        self.backgrounds.clear();
        self.points.clear();
        self.surfaces.clear();
        self.d_surfaces.clear();
        self.rays.clear();
        self.radiance.clear();
        self.d_radiance.clear();
        self.d_lobe_variance.clear();
        self.d_field.clear();
        self.d_field.resize(context.field.n_params(), 0.0);
        self.d_material.clear();
    }

    /// The pixels' points first, then one beside each for the smoothness term.
    fn draw_objects(&mut self, context: &StepContext<'_>, objects: Range<usize>, side: f32) {
        let mut beside = Vec::with_capacity(objects.len());
        for (index, slot) in objects.enumerate() {
            let random = |slot| SlotRandom::new(context.config.seed, context.step, slot);
            let pixel = context.pixels.draw_object(&mut random(slot as u64));
            let first = self.vertices.len();
            context
                .pixels
                .unpack_paths(&pixel, &mut self.vertices, |_| ());
            // The mirror image is not followed further, nor by several beams.
            self.vertices.truncate(first + 1);
            let vertex = self.vertices[first];
            self.slots.push(ObjectSlot {
                target: pixel.target,
                smoothness: pixel.smoothness,
            });
            let phi = random(self.jitter_slot ^ (1 << 41) ^ index as u64).uniform()
                * std::f32::consts::TAU;
            let (tangent, bitangent) = orthonormal_basis(vertex.point.normal);
            let offset = (tangent * phi.cos() + bitangent * phi.sin()) * (SMOOTHNESS_STEP * side);
            self.points.push(vertex.point.position);
            beside.push(vertex.point.position + offset);
        }
        self.points.extend(beside);
    }

    /// From roughness to one lobe and one ray a pixel: there are no second vertices.
    fn aim_lobes(&mut self, context: &StepContext<'_>) {
        let still = EnvironmentTransform::default().environment_from_world();
        for (slot, vertex) in self.vertices.iter().enumerate() {
            light_path::aim(
                std::slice::from_ref(vertex),
                |_| (slot, self.surfaces[slot]),
                &still,
                context.frame,
                |_| None,
                &mut self.rays,
                &mut self.lit,
            );
        }
        assert_eq!(self.rays.len(), self.slots.len(), "one ray a pixel");
    }

    fn draw_backgrounds(&mut self, context: &StepContext<'_>, backgrounds: Range<usize>) {
        for slot in backgrounds {
            let mut random =
                SlotRandom::new(context.config.seed, context.step, (1 << 32) + slot as u64);
            let share = context.config.preconvolved_share;
            let sample = context.pixels.draw_background(&mut random, share);
            self.rays.push(FieldRay::of_pixel(
                context.frame.field_from_world(sample.origin).to_array(),
                sample.direction.to_array(),
                0.0,
                sample.spread,
            ));
            self.backgrounds.push(sample);
        }
    }

    /// Both passes of one ray, the loss of each, and the way back to networks and surface.
    fn learn_from_ray(&mut self, context: &StepContext<'_>, ray: usize) {
        let mut random = SlotRandom::new(
            context.config.seed,
            context.step,
            self.jitter_slot + ray as u64,
        );
        let placement = PaperPlacement {
            n_samples: context.config.samples_per_ray,
            uniform_share: context.config.uniform_share,
            shifts: [random.uniform() - 0.5, random.uniform() - 0.5],
        };
        let mut light = std::mem::take(&mut self.light);
        context
            .field
            .forward(&self.rays[ray], placement, &mut light);
        let weights = [context.paper.coarse_weight, 1.0];
        let is_object = ray < self.slots.len();
        let mut error = 0.0;
        for (pass, weight) in light.passes().into_iter().zip(weights) {
            self.radiance[ray] = pass.radiance;
            error = if is_object {
                self.object_loss(context, ray, weight)
            } else {
                self.background_loss(context, ray, weight)
            };
            self.d_lobe_variance[ray] += context.field.backward(
                context.field_transposed,
                &self.rays[ray],
                self.d_radiance[ray],
                pass,
                &mut self.d_field,
            );
        }
        self.light = light;
        // The second pass's, which came last.
        if is_object {
            self.loss.object += f64::from(error);
        } else {
            self.loss.background += f64::from(error);
        }
    }

    /// Eq. 7 and 9 and their way back for one object pixel; returns the squared error.
    fn object_loss(&mut self, context: &StepContext<'_>, slot: usize, weight: f32) -> f32 {
        let lit = &mut self.lit[slot..=slot];
        light_path::gather(lit, |_| Vec3::ONE, |ray| Vec3::from(self.radiance[ray]));
        let loss = pixel_loss(context.display, lit[0].outgoing(), self.slots[slot].target);
        let scale = weight / context.config.object_pixels as f32;
        light_path::backward(
            &self.lit[slot..=slot],
            loss.d_linear() * scale,
            &self.radiance,
            &mut self.d_radiance,
            &mut self.d_surfaces,
        );
        self.add(&loss, scale);
        loss.value
    }

    /// The same for a background pixel: the surface is a mirror there (specular 1, diffuse 0).
    fn background_loss(&mut self, context: &StepContext<'_>, ray: usize, weight: f32) -> f32 {
        let sample = &self.backgrounds[ray - self.slots.len()];
        let loss = pixel_loss(
            context.display,
            Vec3::from(self.radiance[ray]),
            sample.target,
        );
        let scale =
            weight * context.config.background_weight / context.config.background_pixels as f32;
        self.d_radiance[ray] = (loss.d_linear() * scale).to_array();
        self.add(&loss, scale);
        loss.value
    }

    fn add(&mut self, loss: &PixelLoss, scale: f32) {
        self.loss.weighted += f64::from(loss.value * scale);
        self.loss.d_gamma += f64::from(loss.d_gamma() * scale);
    }

    /// Eq. 8 by finite differences: `|Δ roughness| + |Δ specular|` over the step, where the image is smooth.
    fn smoothness_losses(&mut self, context: &StepContext<'_>) {
        let n = self.slots.len();
        let factor = context.config.smoothness_weight
            / (SMOOTHNESS_STEP * n.max(1) as f32 * N_CHUNKS as f32);
        for (at, slot) in self.slots.iter().enumerate() {
            let weight = factor * slot.smoothness;
            let (a, b) = (self.surfaces[at], self.surfaces[n + at]);
            let (d_roughness, d_specular) = (a.roughness - b.roughness, a.tint.x - b.tint.x);
            self.loss.weighted += f64::from(weight * (d_roughness.abs() + d_specular.abs()));
            // `signum` of zero is one; equal neighbours should feel nothing.
            let sign = |v: f32| if v == 0.0 { 0.0 } else { v.signum() * weight };
            for (at, factor) in [(at, 1.0), (n + at, -1.0)] {
                let d = &mut self.d_surfaces[at];
                d.roughness += factor * sign(d_roughness);
                // One number: the colours' gradients are summed, so one of them carries it.
                d.tint.x += factor * sign(d_specular);
            }
        }
    }

    fn check_finite(&self) -> bool {
        all_finite(&self.d_field) && all_finite(&self.d_material) && self.loss.weighted.is_finite()
    }
}
