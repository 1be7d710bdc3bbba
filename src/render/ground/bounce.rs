//! What an object sends to the things near it: its diffuse part, and what it mirrors of the light around it.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::GroundResolution;
use super::stand::Stand;
use crate::geometry::Hit;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;
use crate::neif::light::shading::fresnel;
use crate::neif::surface::material::MaterialBatch;
use crate::render::irradiance::{Probe, Probes, ratio};
use crate::render::lamps::MovedLamps;
use crate::render::output::panorama::PanoramaView;
use crate::render::path::trace::is_hidden;

/// Radiance from all directions to the middle of an object, as a small panorama in the axes of the environment; lamps are
/// left out.
pub(super) struct Around {
    view: PanoramaView,
    /// Of each pixel its unit direction times its solid angle, and the radiance from there.
    pixels: Vec<(Vec3, Vec3)>,
    mean: Vec3,
}

impl Around {
    /// Looks around. What no photo showed of what lies below counts as the mean of the rest: the object hid it.
    fn of(stand: &Stand<'_>, resolution: GroundResolution) -> Self {
        let up = stand.environment.up();
        // About as many pixels in the upper half as directions from which a floor is lit.
        let n_rows = (resolution.n_directions as f32).sqrt().round() as usize;
        let view = PanoramaView {
            at: stand.object.tracer.mesh().bounds().center(),
            up,
            roughness: 0.0,
            width: 2 * n_rows as u32,
        };
        let size = Vec2::new(2.0 * n_rows as f32, n_rows as f32);
        let pixels: Vec<(Vec3, f32)> = (0..2 * n_rows * n_rows)
            .map(|i| {
                let (row, column) = (i / (2 * n_rows), i % (2 * n_rows));
                let place = (Vec2::new(column as f32, row as f32) + 0.5) / size;
                let edge = |row: usize| (PI * row as f32 / size.y).cos();
                let solid_angle = (edge(row) - edge(row + 1)) * TAU / size.x;
                (view.direction(place), solid_angle)
            })
            .collect();
        let mut batch = FieldBatch::default();
        let middle = stand.middle();
        batch
            .rays
            .extend(pixels.iter().map(|(direction, solid_angle)| {
                FieldRay::of_cone(middle, *direction, solid_angle / (4.0 * PI), 0.0)
            }));
        let scratch = &mut LightScratch::default();
        let most = resolution.most_samples;
        stand.environment.light_by(most, &mut batch, scratch);
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0_f32);
        let mut seen = Vec::with_capacity(pixels.len());
        for (ray, (direction, solid_angle)) in pixels.iter().enumerate() {
            let radiance = stand.lamps.below(Vec3::from(batch.radiance[ray]));
            // From above, what the object mirrors constrains the radiance well enough.
            let share = if direction.dot(up) < 0.0 {
                stand.environment.seen_share(&batch, ray)
            } else {
                1.0
            };
            let weight = solid_angle * (share + 1e-3);
            sum += weight * radiance;
            weights += weight;
            seen.push((radiance, share));
        }
        let mean = sum / weights;
        let pixels = pixels.iter().zip(seen);
        let pixels = pixels.map(|((direction, solid_angle), (radiance, share))| {
            (*direction * *solid_angle, mean.lerp(radiance, share))
        });
        Self {
            view,
            pixels: pixels.collect(),
            mean,
        }
    }

    /// Radiance from a unit direction in the axes of the environment.
    pub(super) fn radiance(&self, direction: Vec3) -> Vec3 {
        let width = self.view.width as usize;
        let place = self.view.place(direction);
        let at = |share: f32, n: usize| ((share * n as f32) as usize).min(n - 1);
        self.pixels[at(place.y, width / 2) * width + at(place.x, width)].1
    }

    /// Irradiance of a surface with this unit normal that nothing shadows, lamps left out.
    fn irradiance(&self, normal: Vec3) -> Vec3 {
        let pixels = self.pixels.iter();
        pixels
            .map(|(toward, radiance)| *radiance * normal.dot(*toward).max(0.0))
            .sum()
    }
}

/// An object as a source of light.
pub(super) struct Bounce<'a> {
    stand: &'a Stand<'a>,
    /// In world coordinates.
    pub(super) lamps: MovedLamps,
    pub(super) around: Around,
    probes: &'a Probes,
    /// Diffuse radiance and tint at each probe.
    surfaces: Vec<(Vec3, Vec3)>,
    /// Mean of what it sends.
    mean: Vec3,
}

impl<'a> Bounce<'a> {
    /// The object of a stand, by `probes` on it, in the light that it was trained in.
    pub(super) fn new(
        stand: &'a Stand<'a>,
        probes: &'a Probes,
        resolution: GroundResolution,
    ) -> Self {
        let around = Around::of(stand, resolution);
        let positions: Vec<Vec3> = probes.probes().iter().map(|p| p.position).collect();
        let mut batch = MaterialBatch::default();
        let material = &stand.object.material;
        material.forward(&positions, &mut batch, &mut Vec::new());
        let surfaces = batch.surfaces.iter().map(|s| (s.diffuse, s.tint));
        let surfaces: Vec<(Vec3, Vec3)> = surfaces.collect();
        Self {
            stand,
            lamps: stand.lamps.points(&stand.motion),
            mean: mean_sent(&surfaces, &around),
            around,
            probes,
            surfaces,
        }
    }

    /// The same where it was trained in other light, whose irradiance at the probes is `trained`.
    pub(super) fn relit(mut self, trained: &[Vec3]) -> Self {
        let present = self.irradiance();
        let mean = |light: &[Vec3]| light.iter().sum::<Vec3>() / light.len().max(1) as f32;
        let (mean_now, mean_then) = (mean(&present), mean(trained));
        let light = present.iter().zip(trained);
        for ((diffuse, _), (now, then)) in self.surfaces.iter_mut().zip(light) {
            *diffuse *= ratio((*now, mean_now), (*then, mean_then));
        }
        self.mean = mean_sent(&self.surfaces, &self.around);
        self
    }

    /// Irradiance at the probes: lamps with their shadows, the rest without.
    pub(super) fn irradiance(&self) -> Vec<Vec3> {
        let (motion, tracer) = (&self.stand.motion, &self.stand.object.tracer);
        let at = |place: &Probe| {
            let (position, normal) = (place.position, place.normal);
            self.around.irradiance(motion.direction(normal))
                + self.lamps.irradiance(Some(tracer), position, normal)
        };
        self.probes.probes().par_iter().map(at).collect()
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
        let arriving = if is_hidden(tracer, hit.position, mirrored, f32::INFINITY) {
            self.mean
        } else {
            self.around.radiance(self.stand.motion.direction(mirrored))
        };
        diffuse / sum * (Vec3::ONE - fresnel) + fresnel * arriving
    }
}

/// Mean of what surfaces of this diffuse radiance and tint send.
fn mean_sent(surfaces: &[(Vec3, Vec3)], around: &Around) -> Vec3 {
    let sent = surfaces.iter();
    let sent = sent.map(|(diffuse, tint)| *diffuse + *tint * around.mean);
    sent.sum::<Vec3>() / surfaces.len().max(1) as f32
}
