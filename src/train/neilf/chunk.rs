//! One share of a step: drawn pixels, the light of their directions, the losses, and the way back.

use std::ops::Range;

use glam::Vec3;

use super::NeilfConfig;
use crate::geometry::orthonormal_basis;
use crate::neif::kernels::math::all_finite;
use crate::neif::light::display::Display;
use crate::neif::light::light_path::PathVertex;
use crate::neif::light::shading::SurfacePoint;
use crate::neif::neilf::brdf::{Sum, metallic};
use crate::neif::neilf::light::LightBatch;
use crate::neif::neilf::{Brdf, IncidentLight};
use crate::neif::surface::material::{Material, MaterialBatch};
use crate::neif::surface::values::Surface;
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::random::SlotRandom;
use crate::train::step::loss::{SMOOTHNESS_STEP, pixel_loss};

/// Chunks a step is cut into.
pub(super) const N_CHUNKS: usize = 16;

/// Every so many pixels one takes part in the smoothness term.
const SMOOTHNESS_STRIDE: usize = 4;

/// What all chunks of a step read.
#[derive(Clone, Copy)]
pub(super) struct StepContext<'a> {
    pub(super) config: &'a TrainConfig,
    pub(super) neilf: &'a NeilfConfig,
    pub(super) pixels: &'a PixelStore,
    pub(super) lattice: &'a [Vec3],
    pub(super) light: &'a IncidentLight,
    pub(super) light_transposed: &'a [f32],
    pub(super) material: &'a Material,
    pub(super) material_transposed: &'a [f32],
    pub(super) display: Display,
    pub(super) step: u64,
}

/// Sums over a chunk's pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ChunkLoss {
    /// Squared errors.
    pub(super) object: f64,
    /// The smoothness term with its weight.
    pub(super) smoothness: f64,
    pub(super) d_gamma: f64,
}

/// A drawn pixel.
#[derive(Clone, Copy, Debug)]
struct Slot {
    point: SurfacePoint,
    target: [f32; 3],
    smoothness: f32,
    /// Turn of the lattice about the normal, radians.
    turn: f32,
    /// The part of the outgoing radiance that needs no light.
    constant: Vec3,
}

/// Working memory and gradients of one chunk.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    slots: Vec<Slot>,
    /// Of one pixel's paths.
    vertices: Vec<PathVertex>,
    /// The slots' points, then the neighbours of every fourth.
    positions: Vec<Vec3>,
    encoded: Vec<f32>,
    pub(super) material: MaterialBatch,
    pub(super) light: LightBatch,
    /// `[n_rows]`: directions, and the weights of the light from them.
    directions: Vec<Vec3>,
    responses: Vec<Vec3>,
    pub(super) d_light_network: Vec<f32>,
    pub(super) d_material_network: Vec<f32>,
    pub(super) loss: ChunkLoss,
    pub(super) is_finite: bool,
}

impl Chunk {
    /// Losses and gradients of the pixels of `slots`, but for those of the grids' values.
    pub(super) fn run(&mut self, context: &StepContext<'_>, slots: Range<usize>) {
        self.loss = ChunkLoss::default();
        self.draw(context, slots);
        context
            .material
            .forward(&self.positions, &mut self.material, &mut self.encoded);
        self.material.d_surfaces.clear();
        self.material
            .d_surfaces
            .resize(self.positions.len(), Surface::default());
        for (d, len) in [
            (&mut self.d_light_network, context.light.n_network_params()),
            (
                &mut self.d_material_network,
                context.material.n_network_params(),
            ),
        ] {
            d.clear();
            d.resize(len, 0.0);
        }
        self.choose_directions(context);
        self.light_and_losses(context);
        self.smoothness_losses(context);
        context.material.backward(
            context.material_transposed,
            &mut self.material,
            &mut self.d_material_network,
        );
        self.is_finite = self.check_finite();
    }

    fn draw(&mut self, context: &StepContext<'_>, slots: Range<usize>) {
        self.slots.clear();
        self.positions.clear();
        let mut beside = Vec::with_capacity(slots.len());
        for (index, slot) in slots.enumerate() {
            let mut random = SlotRandom::new(context.config.seed, context.step, slot as u64);
            let pixel = context.pixels.draw_object(&mut random);
            self.vertices.clear();
            context
                .pixels
                .unpack_paths(&pixel, &mut self.vertices, |_| ());
            // Every pixel of the store has a path, and a path has a vertex.
            let point = self.vertices[0].point;
            let mut angle = || random.uniform() * std::f32::consts::TAU;
            self.slots.push(Slot {
                point,
                target: pixel.target,
                smoothness: pixel.smoothness,
                turn: angle(),
                constant: Vec3::ZERO,
            });
            self.positions.push(point.position);
            if index.is_multiple_of(SMOOTHNESS_STRIDE) {
                let (sin, cos) = angle().sin_cos();
                let (tangent, bitangent) = orthonormal_basis(point.normal);
                let step = SMOOTHNESS_STEP * context.material.side;
                beside.push(point.position + (tangent * cos + bitangent * sin) * step);
            }
        }
        self.positions.extend(beside);
    }

    /// From the surfaces to the directions that light is needed from, and its weights.
    fn choose_directions(&mut self, context: &StepContext<'_>) {
        let (brdf, lattice) = (context.neilf.brdf, context.lattice);
        self.light.clear();
        self.directions.clear();
        self.responses.clear();
        for (slot, surface) in self.slots.iter_mut().zip(&self.material.surfaces) {
            let first = self.directions.len();
            brdf.directions(
                surface,
                &slot.point,
                lattice,
                slot.turn,
                &mut self.directions,
            );
            self.responses.resize(self.directions.len(), Vec3::ZERO);
            let directions = &self.directions[first..];
            let sum = Sum {
                point: &slot.point,
                directions,
                n_lattice: lattice.len(),
            };
            slot.constant = brdf.forward(surface, sum, &mut self.responses[first..]);
            context
                .light
                .push(&mut self.light, slot.point.position, directions);
        }
        context.light.encode(&mut self.light);
    }

    fn light_and_losses(&mut self, context: &StepContext<'_>) {
        let n_rows = self.light.n_rows();
        self.light.d_radiance.resize(n_rows, Vec3::ZERO);
        for tile in self.light.tiles() {
            context.light.forward(&mut self.light, &tile);
            for slot in tile.clone() {
                self.pixel(context, slot);
            }
            context.light.backward(
                context.light_transposed,
                &mut self.light,
                &tile,
                &mut self.d_light_network,
            );
        }
        context.light.sum_positions(&mut self.light);
    }

    /// The sum over the directions, the error (Eq. 9), and back to light and surface.
    fn pixel(&mut self, context: &StepContext<'_>, index: usize) {
        let (slot, rows) = (&self.slots[index], self.light.rows(index));
        let (responses, radiance) = (&self.responses[rows.clone()], &self.light.radiance);
        let terms = responses.iter().zip(&radiance[rows.clone()]);
        let out = slot.constant + terms.map(|(r, l)| *r * *l).sum::<Vec3>();
        let loss = pixel_loss(context.display, out, slot.target);
        let scale = 1.0 / context.neilf.pixels as f32;
        let d_out = loss.d_linear() * scale;
        self.loss.object += f64::from(loss.value);
        self.loss.d_gamma += f64::from(loss.d_gamma() * scale);
        let d_radiance = &mut self.light.d_radiance[rows.clone()];
        for (d, response) in d_radiance.iter_mut().zip(responses) {
            *d = *response * d_out;
        }
        context.neilf.brdf.backward(
            &self.material.surfaces[index],
            Sum {
                point: &slot.point,
                directions: &self.directions[rows.clone()],
                n_lattice: context.lattice.len(),
            },
            &radiance[rows],
            d_out,
            &mut self.material.d_surfaces[index],
        );
    }

    /// The bilateral smoothness, by finite differences: of roughness and metallic (Eq. 12 of arXiv:2203.07182), or of
    /// roughness and tint (Eq. 8 of the paper).
    fn smoothness_losses(&mut self, context: &StepContext<'_>) {
        let n_pairs = self.positions.len() - self.slots.len();
        let factor = context.config.smoothness_weight
            / (SMOOTHNESS_STEP * n_pairs.max(1) as f32 * N_CHUNKS as f32);
        // `signum` of zero is one; equal neighbours should feel nothing.
        let sign = |v: f32| if v == 0.0 { 0.0 } else { v.signum() };
        for pair in 0..n_pairs {
            let (at, beside) = (pair * SMOOTHNESS_STRIDE, self.slots.len() + pair);
            let weight = factor * self.slots[at].smoothness;
            let (a, b) = (self.material.surfaces[at], self.material.surfaces[beside]);
            let d_roughness = a.roughness - b.roughness;
            let mut sum = d_roughness.abs();
            let d_metallic = metallic(&a) - metallic(&b);
            let d_tint = a.tint - b.tint;
            sum += match context.neilf.brdf {
                Brdf::Disney => d_metallic.abs(),
                Brdf::Lobe => d_tint.abs().element_sum(),
            };
            self.loss.smoothness += f64::from(weight * sum);
            for (index, surface, factor) in [(at, a, weight), (beside, b, -weight)] {
                let d = &mut self.material.d_surfaces[index];
                d.roughness += factor * sign(d_roughness);
                match context.neilf.brdf {
                    Brdf::Disney => {
                        d.diffuse.x += factor * sign(d_metallic) * (1.0 - metallic(&surface));
                    }
                    Brdf::Lobe => d.tint += d_tint.map(sign) * factor,
                }
            }
        }
    }

    fn check_finite(&self) -> bool {
        all_finite(&self.d_light_network)
            && all_finite(&self.d_material_network)
            && (self.loss.object + self.loss.smoothness).is_finite()
    }
}
