//! What an object sends to the things near it: its diffuse part, and what it mirrors of the light around it.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use rayon::prelude::*;

use super::GroundResolution;
use super::light::Stand;
use crate::geometry::{Hit, Ray, orthonormal_basis};
use crate::neif::environment::LightScratch;
use crate::neif::material::MaterialBatch;
use crate::neif::radiance_field::{FieldBatch, FieldRay};
use crate::neif::shading::fresnel;
use crate::neif::{Environment, EnvironmentTransform, ObjectModel};
use crate::render::irradiance::{Probe, Probes};
use crate::render::lamps::Lamps;

/// Share of the mean light below which a surface is too dark for its colour to be known.
const DARK: f32 = 0.02;
/// Largest ratio of present to trained light that is believed.
const MAX_RATIO: f32 = 64.0;

/// Radiance from all directions to the middle of an object, as a small picture in the axes of the environment; lamps are
/// left out.
pub(super) struct Around {
    up: Vec3,
    across: Vec3,
    along: Vec3,
    n_rows: usize,
    /// Row by row, from the top.
    pixels: Vec<Vec3>,
    mean: Vec3,
}

impl Around {
    /// Looks around. What no photo showed of what lies below counts as the mean of the rest: the object hid it.
    fn of(stand: &Stand<'_>, resolution: GroundResolution) -> Self {
        let up = stand.environment.up();
        let (across, along) = orthonormal_basis(up);
        let middle = stand.foot().middle;
        // About as many pixels in the upper half as directions from which a floor is lit.
        let n_rows = (resolution.n_directions as f32).sqrt().round() as usize;
        let mut around = Self {
            up,
            across,
            along,
            n_rows,
            pixels: Vec::new(),
            mean: Vec3::ZERO,
        };
        let mut batch = FieldBatch::default();
        for row in 0..n_rows {
            let variance = around.solid_angle(row) / (4.0 * PI);
            for column in 0..2 * n_rows {
                let direction = around.direction(row, column);
                let ray = FieldRay::of_cone(middle, direction, variance, 0.0);
                batch.rays.push(ray);
            }
        }
        stand
            .environment
            .light(&mut batch, &mut LightScratch::default());
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0_f32);
        let seen: Vec<(Vec3, f32)> = (0..batch.rays.len())
            .map(|ray| {
                let radiance = stand.lamps.below(Vec3::from(batch.radiance[ray]));
                // From above, what the object mirrors tells enough.
                let is_below = Vec3::from(batch.rays[ray].direction).dot(up) < 0.0;
                let share = if is_below {
                    stand.environment.seen_share(&batch, ray)
                } else {
                    1.0
                };
                let weight = around.solid_angle(ray / (2 * n_rows)) * (share + 1e-3);
                sum += weight * radiance;
                weights += weight;
                (radiance, share)
            })
            .collect();
        around.mean = sum / weights;
        let pixels = seen.into_iter();
        around.pixels = pixels
            .map(|(radiance, share)| around.mean.lerp(radiance, share))
            .collect();
        around
    }

    /// Of a pixel of a row, steradians.
    fn solid_angle(&self, row: usize) -> f32 {
        let edge = |row: usize| (PI * row as f32 / self.n_rows as f32).cos();
        (edge(row) - edge(row + 1)) * PI / self.n_rows as f32
    }

    /// The middle of a pixel.
    fn direction(&self, row: usize, column: usize) -> Vec3 {
        let step = PI / self.n_rows as f32;
        let (sin, cos) = (step * (row as f32 + 0.5)).sin_cos();
        let azimuth = step * (column as f32 + 0.5);
        self.up * cos + (self.across * azimuth.cos() + self.along * azimuth.sin()) * sin
    }

    /// Radiance from a unit direction in the axes of the environment.
    pub(super) fn radiance(&self, direction: Vec3) -> Vec3 {
        let polar = direction.dot(self.up).clamp(-1.0, 1.0).acos();
        let azimuth = direction.dot(self.along).atan2(direction.dot(self.across));
        let step = PI / self.n_rows as f32;
        let row = ((polar / step) as usize).min(self.n_rows - 1);
        let column = ((azimuth.rem_euclid(TAU) / step) as usize).min(2 * self.n_rows - 1);
        self.pixels[row * 2 * self.n_rows + column]
    }

    /// Irradiance of a surface with this unit normal that nothing shadows, lamps left out.
    fn irradiance(&self, normal: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (row, pixels) in self.pixels.chunks_exact(2 * self.n_rows).enumerate() {
            let solid_angle = self.solid_angle(row);
            for (column, radiance) in pixels.iter().enumerate() {
                let cos = normal.dot(self.direction(row, column)).max(0.0);
                sum += *radiance * (cos * solid_angle);
            }
        }
        sum
    }
}

/// An object as a source of light.
pub(super) struct Bounce<'a> {
    stand: &'a Stand<'a>,
    around: Around,
    probes: &'a Probes,
    /// Diffuse radiance and tint at each probe.
    surfaces: Vec<(Vec3, Vec3)>,
    /// Mean of what it sends.
    mean: Vec3,
}

impl<'a> Bounce<'a> {
    /// The object of a stand, by `probes` on it; where it was trained in other light, that light's irradiance at the
    /// probes is `trained`.
    pub(super) fn new(
        stand: &'a Stand<'a>,
        trained: Option<&[Vec3]>,
        probes: &'a Probes,
        resolution: GroundResolution,
    ) -> Self {
        let around = Around::of(stand, resolution);
        let positions: Vec<Vec3> = probes.probes().iter().map(|p| p.position).collect();
        let mut batch = MaterialBatch::default();
        let material = &stand.object.material;
        material.forward(&positions, &mut batch, &mut Vec::new());
        let ratios = trained.map(|then| {
            let now = irradiance(stand, &around, probes);
            let dark = DARK * then.iter().sum::<Vec3>() / then.len().max(1) as f32;
            let least = Vec3::splat(f32::MIN_POSITIVE);
            let ratio = |(now, then): (&Vec3, &Vec3)| (*now + dark) / (*then + dark).max(least);
            now.iter().zip(then).map(ratio).collect::<Vec<_>>()
        });
        let ratio = |i: usize| {
            let ratio = ratios.as_ref().map_or(Vec3::ONE, |ratios| ratios[i]);
            ratio.min(Vec3::splat(MAX_RATIO))
        };
        let surfaces = batch.surfaces.iter().enumerate();
        let surfaces: Vec<(Vec3, Vec3)> = surfaces
            .map(|(i, surface)| (surface.diffuse * ratio(i), surface.tint))
            .collect();
        let n = surfaces.len().max(1) as f32;
        let sent = surfaces
            .iter()
            .map(|(diffuse, tint)| *diffuse + *tint * around.mean);
        let mean = sent.sum::<Vec3>() / n;
        Self {
            stand,
            around,
            probes,
            surfaces,
            mean,
        }
    }

    /// The light around the object.
    pub(super) fn around(&self) -> &Around {
        &self.around
    }

    /// Radiance that comes back along a ray (unit world direction) that met the object.
    pub(super) fn radiance(&self, hit: &Hit, direction: Vec3) -> Vec3 {
        let (mut diffuse, mut tint, mut sum) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        self.probes.near(hit.position, hit.normal, |i, weight| {
            diffuse += weight * self.surfaces[i].0;
            tint += weight * self.surfaces[i].1;
            sum += weight;
        });
        if sum <= 0.0 {
            return self.mean;
        }
        let cos = -hit.normal.dot(direction);
        let fresnel = fresnel(tint / sum, cos.max(0.0));
        let mirrored = (direction + 2.0 * cos * hit.normal).normalize_or(hit.normal);
        let tracer = &self.stand.object.tracer;
        let onward = Ray {
            origin: hit.position,
            direction: mirrored,
        };
        let arriving = if tracer.occluded(&onward, tracer.self_distance(), f32::INFINITY) {
            self.mean
        } else {
            self.around.radiance(self.stand.motion.direction(mirrored))
        };
        diffuse / sum * (Vec3::ONE - fresnel) + fresnel * arriving
    }
}

/// Irradiance at the probes of an object in the light that it was trained in, as [`Bounce::new`] takes it.
pub(crate) fn trained_irradiance(
    object: &ObjectModel,
    (own, lamps): (&Environment, &Lamps),
    probes: &Probes,
    resolution: GroundResolution,
) -> Vec<Vec3> {
    let stand = Stand {
        object,
        environment: own,
        motion: EnvironmentTransform::default().environment_from_world(),
        lamps,
    };
    irradiance(&stand, &Around::of(&stand, resolution), probes)
}

/// Irradiance at the probes: lamps with their shadows, the rest without.
fn irradiance(stand: &Stand<'_>, around: &Around, probes: &Probes) -> Vec<Vec3> {
    let (lamps, tracer) = (stand.lamps.points(&stand.motion), &stand.object.tracer);
    let at = |place: &Probe| {
        around.irradiance(stand.motion.direction(place.normal))
            + lamps.irradiance(Some(tracer), place.position, place.normal)
    };
    probes.probes().par_iter().map(at).collect()
}
