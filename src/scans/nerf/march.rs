//! Pictures of a field: rays are marched through the cells that hold something, many rays at once.
//!
//! The sum over a ray is that of Eq. 3 of arXiv:2003.08934, with the density taken from the middle of each step.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::field::{Densities, Field, Scratch};
use super::occupancy::Occupancy;
use crate::geometry::{Aabb, Ray};

/// Rays marched together: as many as keep batches long and their buffers in the cache.
const RAYS: usize = 2048;
/// Steps of a ray between two looks at whether any light is left.
const STEPS: usize = 4;
/// Light that is left where a ray ends.
const MIN_TRANSMITTANCE: f32 = 1e-3;
/// Part of a pixel below which a step's colour is not asked for.
const MIN_WEIGHT: f32 = 2e-5;
/// Opacity below which a pixel shows nothing.
const MIN_OPACITY: f32 = 1e-3;

/// How long steps are, in a field's coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    /// The shortest.
    pub(super) min: f32,
    /// Step over distance from the eye, where that is more.
    pub(super) cone: f32,
    /// The longest, in cells.
    pub(super) max_cells: f32,
    /// Distance from the eye at which rays start.
    pub(super) near: f32,
    /// How far rays go.
    pub(super) far: f32,
}

/// What a ray sees.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    pub(super) color: [f32; 3],
    pub(super) opacity: f32,
    /// Mean distance, in a field's coordinates; infinite where nothing is.
    pub(super) distance: f32,
}

/// A field and what is needed to look at it.
#[derive(Clone, Copy, Debug)]
pub(super) struct March<'a> {
    pub(super) field: &'a dyn Field,
    pub(super) occupancy: &'a Occupancy,
    pub(super) steps: Steps,
    /// The box outside of which nothing is shown.
    pub(super) shown: Aabb,
}

/// A ray on its way.
#[derive(Clone, Copy, Debug)]
struct Walker {
    /// Index of its answer.
    i: usize,
    ray: Ray,
    inverse_direction: Vec3,
    t: f32,
    t_end: f32,
    transmittance: f32,
}

/// A step of a ray: the middle and the length.
#[derive(Clone, Copy, Debug)]
struct Step {
    walker: usize,
    t: f32,
    length: f32,
    weight: f32,
}

/// Buffers of a batch of rays.
#[derive(Debug, Default)]
struct Batch {
    scratch: Scratch,
    answers: Densities,
    steps: Vec<Step>,
    points: Vec<Vec3>,
    features: Vec<f32>,
    directions: Vec<Vec3>,
    colors: Vec<[f32; 3]>,
}

impl March<'_> {
    /// What rays in the field's coordinates see; `None` when cancelled.
    pub(super) fn see(
        &self,
        n: usize,
        ray: impl Fn(usize) -> Ray + Sync,
        cancel: &AtomicBool,
    ) -> Option<Vec<Seen>> {
        let mut seen = vec![Seen::default(); n];
        let chunks = seen.par_chunks_mut(RAYS).enumerate();
        chunks.try_for_each_init(Batch::default, |batch, (chunk, seen)| {
            let walkers = (0..seen.len()).filter_map(|i| self.start(i, ray(chunk * RAYS + i)));
            let mut walkers: Vec<Walker> = walkers.collect();
            while !walkers.is_empty() {
                if cancel.load(Ordering::Relaxed) {
                    return None;
                }
                self.advance(&mut walkers, seen, batch);
            }
            for seen in seen {
                seen.distance = if seen.opacity > MIN_OPACITY {
                    seen.distance / seen.opacity
                } else {
                    f32::INFINITY
                };
            }
            Some(())
        })?;
        Some(seen)
    }

    /// The ray where it enters the box.
    fn start(&self, i: usize, ray: Ray) -> Option<Walker> {
        let inverse_direction = ray.direction.recip();
        let (start, end) = self.shown.span(&ray)?;
        let walker = Walker {
            i,
            ray,
            inverse_direction,
            t: start.max(self.steps.near),
            t_end: end.min(self.steps.far),
            transmittance: 1.0,
        };
        (walker.t < walker.t_end).then_some(walker)
    }

    /// Takes each ray a few steps on, and drops those that have ended.
    fn advance(&self, walkers: &mut Vec<Walker>, seen: &mut [Seen], batch: &mut Batch) {
        batch.steps.clear();
        batch.points.clear();
        for (w, walker) in walkers.iter_mut().enumerate() {
            for _ in 0..STEPS {
                let Some((t, length)) = self.step(walker) else {
                    break;
                };
                batch
                    .points
                    .push(walker.ray.origin + t * walker.ray.direction);
                batch.steps.push(Step {
                    walker: w,
                    t,
                    length,
                    weight: 0.0,
                });
            }
        }
        if batch.points.is_empty() {
            walkers.clear();
            return;
        }
        self.field
            .densities(&batch.points, &mut batch.scratch, &mut batch.answers);
        self.weigh(walkers, batch);
        self.field.colors(
            &batch.features,
            &batch.directions,
            &mut batch.scratch,
            &mut batch.colors,
        );
        let visible = batch.steps.iter().filter(|step| step.weight > 0.0);
        for (step, color) in visible.zip(&batch.colors) {
            let seen = &mut seen[walkers[step.walker].i];
            for (sum, value) in seen.color.iter_mut().zip(color) {
                *sum += step.weight * value;
            }
            seen.opacity += step.weight;
            seen.distance += step.weight * step.t;
        }
        walkers
            .retain(|walker| walker.t < walker.t_end && walker.transmittance > MIN_TRANSMITTANCE);
    }

    /// Finds how much of each step is seen, and gathers what the colours of those that are depend on.
    fn weigh(&self, walkers: &mut [Walker], batch: &mut Batch) {
        let n_features = self.field.n_features();
        batch.features.clear();
        batch.directions.clear();
        for (i, step) in batch.steps.iter_mut().enumerate() {
            let walker = &mut walkers[step.walker];
            if walker.transmittance <= MIN_TRANSMITTANCE {
                continue;
            }
            let left = (-batch.answers.densities[i] * step.length).exp();
            let weight = walker.transmittance * (1.0 - left);
            walker.transmittance *= left;
            if weight > MIN_WEIGHT {
                step.weight = weight;
                let features = &batch.answers.features[i * n_features..][..n_features];
                batch.features.extend(features);
                batch.directions.push(walker.ray.direction);
            }
        }
    }

    /// The middle and the length of the next step of a ray through something.
    fn step(&self, walker: &mut Walker) -> Option<(f32, f32)> {
        while walker.t < walker.t_end {
            let wanted = self.steps.min.max(walker.t * self.steps.cone);
            let p = walker.ray.origin + walker.t * walker.ray.direction;
            let width = self
                .occupancy
                .at(p)
                .map_or(f32::INFINITY, |(_, width)| width);
            let length = wanted.min(self.steps.max_cells * width);
            let t = walker.t + 0.5 * length;
            let p = walker.ray.origin + t * walker.ray.direction;
            let Some((is_occupied, width)) = self.occupancy.at(p) else {
                break;
            };
            if is_occupied {
                walker.t += length;
                return Some((t, length));
            }
            // To the far side of the cell, and a little on so as not to stay.
            let exit = self.occupancy.exit(p, walker.inverse_direction, width);
            walker.t = (t + exit + 1e-3 * width - 0.5 * length).max(walker.t + 1e-3 * width);
        }
        walker.t = walker.t_end;
        None
    }
}
