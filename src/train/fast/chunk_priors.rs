//! What a chunk asks of the environment and of the surface beyond the colours of its pixels.

use glam::Vec3;

use super::chunk::{Chunk, N_CHUNKS};
use super::step_context::StepContext;
use crate::train::priors::depth_evidence::{fading, misplacement};
use crate::train::priors::distortion::distortion;
use crate::train::priors::{agreement, glare, unseen};
use crate::train::step::loss::SMOOTHNESS_STEP;

/// Mean reflectance up to which a surface may be a dielectric.
const DIELECTRIC: f32 = 0.08;
/// Mean reflectance from which on roughness and tint are asked to be smooth with all of the weight; below, in proportion.
const POLISHED: f32 = 0.3;

impl Chunk {
    /// Walls and floors are made of planes, from everywhere.
    pub(super) fn planarity_losses(&mut self, context: &StepContext<'_>) {
        let config = context.config;
        let scale = config.background_weight * config.planarity_weight
            / config.unseen_triples_alone.max(1) as f32;
        self.batch.d_weights.clear();
        if self.triples.is_empty() {
            return;
        }
        let bend = unseen::bend(&self.triples, scale, &mut self.batch);
        self.loss.priors += f64::from(scale) * bend;
    }

    /// Haze before the cameras is no part of the environment.
    pub(super) fn distortion_losses(&mut self, context: &StepContext<'_>) {
        let config = context.config;
        if context.material.is_none() || config.distortion_weight == 0.0 {
            return;
        }
        let scale = config.background_weight * config.distortion_weight
            / context.batch_size.backgrounds.max(1) as f32;
        let first = self.first_background_ray;
        let rays = first..first + self.backgrounds.len();
        self.loss.priors += f64::from(scale) * distortion(rays, scale, &mut self.batch);
    }

    /// What neighbouring photos place is where they place it.
    pub(super) fn depth_losses(&mut self, context: &StepContext<'_>) {
        let config = context.config;
        let weight = config.background_weight * config.depth_weight * fading(context.step);
        let scale = weight / context.batch_size.backgrounds.max(1) as f32;
        let rays = (self.first_background_ray..).zip(&self.backgrounds);
        let half_side = context.frame.half_side;
        let placed = rays.filter_map(|(ray, sample)| Some((ray, sample.nearness? * half_side)));
        self.loss.priors += f64::from(scale) * misplacement(placed, scale, &mut self.batch);
    }

    /// What narrow cones see, wide ones should.
    pub(super) fn agreement_losses(&mut self, context: &StepContext<'_>) {
        let n_groups = context.config.agreement_groups_alone.max(1);
        let scale = context.config.agreement_weight / n_groups as f32;
        let sum = agreement::disagreement(self.agreement.clone(), scale, &mut self.batch);
        self.loss.priors += f64::from(scale) * sum;
    }

    /// What photos do not show behind what they show is not brighter than white all over.
    pub(super) fn glare_losses(&mut self, context: &StepContext<'_>) {
        let n_rays = glare::GROUP * context.n_glare_groups();
        let weight = context.config.glare_weight * glare::trust(&self.material.surfaces);
        let scale = weight * context.unseen.share() / n_rays.max(1) as f32;
        let sum = glare::excess(self.glare.clone(), scale, &mut self.batch);
        self.loss.priors += f64::from(scale) * sum;
    }

    /// Eq. 8 by finite differences: `|Δ roughness| + |Δ tint|` over the step, where the image is smooth. What reflects little
    /// says as little of its roughness, and the same weight would make it all alike.
    pub(super) fn smoothness_losses(&mut self, context: &StepContext<'_>) {
        let weight = context.config.smoothness_weight
            / (SMOOTHNESS_STEP * self.pairs.len().max(1) as f32 * N_CHUNKS as f32);
        for pair in &self.pairs {
            let [a, b] = [pair.at, pair.beside].map(|at| self.material.surfaces[at]);
            let reflectance = 0.5 * (a.reflectance() + b.reflectance());
            // Taken as a constant: otherwise tints would fall in order to be asked less.
            let weight = weight * pair.weight * (reflectance / POLISHED).min(1.0);
            let (d_roughness, d_tint) = (a.roughness - b.roughness, a.tint - b.tint);
            self.loss.smoothness +=
                f64::from(weight * (d_roughness.abs() + d_tint.abs().element_sum()));
            // `signum` of zero is one; equal neighbours should feel nothing.
            let sign = |v: f32| if v == 0.0 { 0.0 } else { v.signum() * weight };
            let tint = Vec3::new(sign(d_tint.x), sign(d_tint.y), sign(d_tint.z));
            for (at, factor) in [(pair.at, 1.0), (pair.beside, -1.0)] {
                let d = &mut self.material.d_surfaces[at];
                d.roughness += factor * sign(d_roughness);
                d.tint += factor * tint;
            }
        }
    }

    /// What reflects like a metal is not diffuse.
    pub(super) fn metal_gradients(&mut self, context: &StepContext<'_>) {
        let weight = context.config.metal_weight / context.batch_size.objects as f32;
        for slot in &self.slots {
            let share = weight / slot.paths.len() as f32;
            for path in &self.paths[slot.paths.clone()] {
                let surface = &self.material.surfaces[path.points.start];
                let metal = (surface.reflectance() - DIELECTRIC).max(0.0);
                let d = &mut self.material.d_surfaces[path.points.start];
                d.diffuse += Vec3::splat(share * metal);
            }
        }
    }
}
