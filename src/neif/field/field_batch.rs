//! The working memory of a batch of field rays, and which of its samples are worth a backward pass.

use std::ops::Range;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::composite::{CompositeBuffers, WIDTH, density};
use super::proposal::{ConeRay, OPAQUE_LENGTH};
use super::samples::RaySamples;
use crate::neif::kernels::math::all_finite;
use crate::neif::light::lobe::mean_length;
use crate::neif::networks::mlp::{Mlp, MlpBuffers, keep_rows};

/// Share of a ray's light behind which everything is hidden from it: at a half, specks of plain walls count as unseen, as a
/// surface is a few cells thick.
const REACHED: f32 = 0.9;

/// Half the thickness of a surface that is met at one distance, shares of that.
const HALF_SURFACE: f32 = 1e-4;

/// One ray to evaluate.
#[derive(Clone, Copy, Debug)]
pub struct FieldRay {
    /// The cone, field coordinates.
    pub cone: ConeRay,
    /// Unit direction, for the view dependence.
    pub direction: [f32; 3],
    /// Concentration of the lobe; infinite for a pixel's ray.
    pub kappa: f32,
}

impl FieldRay {
    /// The ray of a pixel from `origin` along a unit direction, field coordinates; `base` and `spread` as in [`ConeRay`].
    pub fn of_pixel(origin: [f32; 3], direction: [f32; 3], base: f32, spread: f32) -> Self {
        Self {
            cone: ConeRay {
                origin,
                direction,
                base,
                spread,
                lobe_variance: 0.0,
            },
            direction,
            kappa: f32::INFINITY,
        }
    }

    /// A cone about the unit direction `axis` whose directions have this variance per transverse axis, radians squared.
    /// The widest lobe there is, 1/3, knows no direction; beyond it the formulas mean nothing.
    pub fn of_cone(origin: Vec3, axis: Vec3, variance: f32, base: f32) -> Self {
        let lobe_variance = variance.min(1.0 / 3.0);
        let kappa = 1.0 / lobe_variance;
        Self {
            cone: ConeRay {
                origin: origin.to_array(),
                direction: (axis * mean_length(kappa)).to_array(),
                base,
                spread: 0.0,
                lobe_variance,
            },
            direction: axis.to_array(),
            kappa,
        }
    }
}

/// Share of the greatest gradient on a ray below which a sample is left out of the backward pass; 0 keeps all.
///
/// Adam makes steps of the same length from small gradients as from large ones, so that the many samples that hardly
/// matter pull as hard as the few that do: without them training is faster and, for the environment, better.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CutOff {
    /// For rays of lobes, in `[0, 1)`.
    pub lobes: f32,
    /// For rays of background pixels, in `[0, 1)`.
    pub pixels: f32,
}

/// Working memory of one batch of rays, reused from batch to batch.
#[derive(Clone, Debug, Default)]
pub struct FieldBatch {
    /// The rays; `clear` and push.
    pub rays: Vec<FieldRay>,
    /// The samples on them, written by [`super::radiance_field::RadianceField::place`].
    pub(in crate::neif) samples: RaySamples,
    /// Samples that take part in the backward pass, and where they are.
    pub(super) active: Vec<u32>,
    pub(super) active_positions: Vec<[f32; 3]>,
    pub(super) active_footprints: Vec<f32>,
    /// `[n][n_levels * 4]`.
    pub(in crate::neif) features: Vec<f32>,
    pub(in crate::neif) density: MlpBuffers,
    pub(in crate::neif) composite: CompositeBuffers,
    pub(super) color_input: Vec<f32>,
    pub(in crate::neif) color: MlpBuffers,
    /// `[n_rays]`: the result of [`super::radiance_field::RadianceField::forward`].
    pub radiance: Vec<[f32; 3]>,
    /// `[n_rays]`: written by the caller before [`super::radiance_field::RadianceField::backward`].
    pub d_radiance: Vec<[f32; 3]>,
    /// `[n_rays * n_samples]`, or empty: what the loss wants of the compositing weights themselves.
    pub d_weights: Vec<f32>,
    /// `[n_rays]`: `d loss / d lobe_variance`.
    pub d_lobe_variance: Vec<f32>,
}

impl FieldBatch {
    /// Leaves out the samples whose gradient is below the cut-off of the greatest on their ray, and moves the others to the
    /// front of all that the rest of the backward pass reads.
    pub(super) fn keep_active(&mut self, cut_off: CutOff, density_net: &Mlp) {
        self.active.clear();
        self.active_positions.clear();
        self.active_footprints.clear();
        let n_per_ray = self.samples.n_per_ray;
        let mut sizes = vec![0.0_f32; n_per_ray];
        let rays = self.density.d_output.chunks_exact(n_per_ray * WIDTH);
        for (ray, rows) in rays.enumerate() {
            for (size, row) in sizes.iter_mut().zip(rows.chunks_exact(WIDTH)) {
                *size = row.iter().map(|v| v.abs()).sum();
            }
            let share = if self.rays[ray].kappa.is_finite() {
                cut_off.lobes
            } else {
                cut_off.pixels
            };
            let least = share * sizes.iter().fold(0.0_f32, |m, v| m.max(*v));
            for (k, size) in sizes.iter().enumerate() {
                // A NaN is not below anything: it stays in and is found.
                if *size < least || *size == 0.0 {
                    continue;
                }
                let sample = ray * n_per_ray + k;
                self.active.push(sample as u32);
                self.active_positions.push(self.samples.positions[sample]);
                self.active_footprints.push(self.samples.footprints[sample]);
            }
        }
        self.density.keep_rows(&self.active, density_net);
        keep_rows(&self.active, density_net.n_in, &mut self.features);
    }

    /// Evaluates rays that meet one surface each: `light` gives their radiance and the distance along the unit direction. Of two
    /// samples, just before and behind it, the second has all the weight.
    pub(in crate::neif) fn end_at(&mut self, light: impl Fn(&FieldRay) -> ([f32; 3], f32)) {
        self.samples.n_per_ray = 2;
        self.samples.distances.clear();
        self.radiance.clear();
        for ray in &self.rays {
            let (radiance, distance) = light(ray);
            let length = Vec3::from(ray.cone.direction).length();
            self.radiance.push(radiance);
            let end = distance / length.max(1e-6);
            let around = [end * (1.0 - HALF_SURFACE), end * (1.0 + HALF_SURFACE)];
            self.samples.distances.extend(around);
        }
        self.composite.weights.clear();
        let weights = self.rays.iter().flat_map(|_| [0.0, 1.0]);
        self.composite.weights.extend(weights);
    }

    /// Samples of all rays.
    pub fn n(&self) -> usize {
        self.samples.n()
    }

    /// Calls `observe(cell, density)` for every sample of a forward pass: keeps the density cache fresh for free. The
    /// floor is opaque whatever the density there.
    pub fn observe_densities(&self, cells: &Range<u32>, mut observe: impl FnMut(u32, f32)) {
        let rows = self.density.output.chunks_exact(WIDTH);
        let samples = self.samples.cells.iter().zip(&self.samples.deltas);
        for ((&cell, &delta), row) in samples.zip(rows) {
            if cells.contains(&cell) && delta < OPAQUE_LENGTH {
                observe(cell, density(row[0]));
            }
        }
    }

    /// Whether all feature gradients are finite.
    pub fn has_finite_gradients(&self) -> bool {
        all_finite(&self.density.d_input)
    }

    /// `[n_rays * n_samples]` compositing weights of the last forward pass.
    pub fn weights(&self) -> &[f32] {
        &self.composite.weights
    }

    /// `[n_rays * n_samples]` distances of the samples.
    pub fn distances(&self) -> &[f32] {
        &self.samples.distances
    }

    /// Calls `visit(cell)` for the samples of a ray up to where nearly all of its light comes from, in the last forward pass.
    pub fn reached(&self, ray: usize, mut visit: impl FnMut(u32)) {
        let samples = self.samples_of(ray);
        let mut absorbed = 0.0;
        for (cell, weight) in self.samples.cells[samples.clone()]
            .iter()
            .zip(&self.weights()[samples])
        {
            visit(*cell);
            absorbed += weight;
            if absorbed > REACHED {
                return;
            }
        }
    }

    /// Mean of a value of cells over the light of a ray, in the last forward pass; 0 where it meets nothing.
    pub(in crate::neif) fn mean_over_light(&self, ray: usize, value: impl Fn(u32) -> f32) -> f32 {
        let samples = self.samples_of(ray);
        let values = self.samples.cells[samples.clone()].iter();
        self.weighted(samples, values.map(|cell| value(*cell))).0
    }

    /// Mean of values of samples by the samples' weights, and the sum of these.
    fn weighted(&self, samples: Range<usize>, values: impl Iterator<Item = f32>) -> (f32, f32) {
        let weighted = self.weights()[samples].iter().zip(values);
        let (moment, sum) = weighted.fold((0.0, 0.0), |(moment, sum), (weight, value)| {
            (moment + weight * value, sum + weight)
        });
        (moment / sum.max(f32::MIN_POSITIVE), sum)
    }

    /// Distance, field units, before which half of the light of a ray comes from, in the last forward pass.
    pub(crate) fn middle_of_light(&self, ray: usize) -> f32 {
        let samples = self.samples_of(ray);
        let weights = &self.weights()[samples.clone()];
        let half = 0.5 * weights.iter().sum::<f32>();
        let mut absorbed = 0.0;
        let reached = weights.iter().position(|weight| {
            absorbed += weight;
            absorbed > half
        });
        let distances = &self.distances()[samples];
        distances[reached.unwrap_or(distances.len() - 1)]
    }

    fn samples_of(&self, ray: usize) -> Range<usize> {
        let n = self.samples.n_per_ray;
        ray * n..(ray + 1) * n
    }

    /// Mean distance at which the light of a ray begins, field units, and the ray's opacity, in the last forward pass.
    pub fn end(&self, ray: usize) -> (f32, f32) {
        let samples = self.samples_of(ray);
        let distances = self.distances()[samples.clone()].iter();
        self.weighted(samples, distances.copied())
    }
}
