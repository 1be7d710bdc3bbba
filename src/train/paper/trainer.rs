//! The trainer of the paper's model: a plain value with the fast trainer's interface.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use rayon::prelude::*;

use super::PaperConfig;
use super::chunk::{Chunk, StepContext};
use crate::data::Dataset;
use crate::geometry::SurfaceTracer;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::light::display::Display;
use crate::neif::light::environment::{Environment, EnvironmentPlace};
use crate::neif::paper::{PaperField, PaperMaterial};
use crate::neif::surface::object::{ObjectModel, SurfaceField};
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::placement::{field_frame, up_direction};
use crate::train::preparation::Prepared;
use crate::train::random::SlotRandom;
use crate::train::step::adam::{Adam, Rates};
use crate::train::step::chunk::N_CHUNKS;
use crate::train::{Snapshot, StepStats, TrainError};

/// Parameters that a task sums over the chunks.
const SUM_BLOCK: usize = 1 << 14;

/// Parameters, moments and pixels of a run of the paper's model.
#[derive(Debug)]
pub struct PaperTrainer {
    config: TrainConfig,
    paper: PaperConfig,
    name: String,
    up: Vec3,
    pub(in crate::train) pixels: PixelStore,
    tracer: Option<Arc<SurfaceTracer>>,
    frame: FieldFrame,
    pub(super) field: Learned<PaperField>,
    pub(super) material: Option<Learned<PaperMaterial>>,
    pub(super) gamma: f32,
    pub(super) gamma_adam: Adam,
    pub(super) step: u64,
    /// Optimiser updates done: steps less the skipped ones.
    pub(super) updates: u64,
    pub(super) skipped: u64,
    chunks: Vec<Chunk>,
}

/// A network under training: its moments, gradient and transposed weights.
#[derive(Debug)]
pub(super) struct Learned<N> {
    pub(super) value: N,
    pub(super) adam: Adam,
    gradient: Vec<f32>,
    transposed: Vec<f32>,
}

impl<N> Learned<N> {
    fn new(value: N, n_params: usize) -> Self {
        Self {
            value,
            adam: Adam::new(n_params),
            gradient: vec![0.0; n_params],
            transposed: Vec::new(),
        }
    }
}

impl PaperTrainer {
    /// Traces every training pixel on the current thread pool; `on_progress` gets 0..1.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when no pixel can be trained on.
    pub fn new(
        config: &TrainConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Self, TrainError> {
        let Prepared { tracer, pixels, .. } = Prepared::new(config, dataset, cancel, on_progress)?;
        let paper = config.paper.unwrap_or_default();
        let mut random = SlotRandom::new(config.seed, u64::MAX, 0);
        let field = PaperField::new(paper.field, || random.uniform());
        let material = tracer
            .as_ref()
            .filter(|_| pixels.n_objects() > 0)
            .map(|tracer| {
                let bounds = tracer.mesh().bounds();
                let side = bounds.extent().max_element();
                PaperMaterial::new(paper.material, bounds.center(), side, || random.uniform())
            })
            .map(|material| {
                let n = material.n_params();
                Learned::new(material, n)
            });
        let n_field = field.n_params();
        let mut trainer = Self {
            config: config.clone(),
            paper,
            name: dataset.name.clone(),
            up: up_direction(dataset),
            pixels,
            tracer,
            frame: field_frame(dataset, config.inner_box_scale),
            field: Learned::new(field, n_field),
            material,
            gamma: 1.0,
            gamma_adam: Adam::new(1),
            step: 0,
            updates: 0,
            skipped: 0,
            chunks: (0..N_CHUNKS).map(Chunk::new).collect(),
        };
        trainer.transpose();
        Ok(trainer)
    }

    /// Takes one step on the current thread pool; `progress` in 0..1 drives the learning rates' decay.
    pub fn step(&mut self, progress: f32) -> StepStats {
        self.run_chunks();
        let stats = self.stats();
        self.step += 1;
        if stats.skipped {
            self.skipped += 1;
            return stats;
        }
        self.sum_gradients();
        self.update(progress);
        stats
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.step
    }

    /// Steps that learned nothing because a value was not finite.
    pub fn skipped_steps(&self) -> u64 {
        self.skipped
    }

    /// Field samples a ray, of both passes.
    pub fn samples_per_ray(&self) -> f32 {
        2.0 * self.config.samples_per_ray as f32
    }

    /// The model as it stands: a copy of the parameters.
    pub fn snapshot(&self) -> Snapshot {
        let place = EnvironmentPlace {
            name: self.name.clone(),
            frame: self.frame,
            gamma: self.gamma,
            n_samples: self.config.render_samples,
            up: self.up,
        };
        let object = self
            .material
            .as_ref()
            .zip(self.tracer.as_ref())
            .map(|(material, tracer)| {
                Arc::new(ObjectModel {
                    tracer: Arc::clone(tracer),
                    material: Arc::new(SurfaceField::Paper(material.value.clone())),
                })
            });
        Snapshot {
            step: self.step,
            object,
            environment: Arc::new(Environment::of_paper(place, self.field.value.clone())),
            exposures: None,
        }
    }

    /// Object and background pixels of a step; without an object its share goes to the background.
    fn pixel_counts(&self) -> [usize; 2] {
        let (objects, backgrounds) = (self.config.object_pixels, self.config.background_pixels);
        match (self.material.is_some(), self.pixels.n_backgrounds() > 0) {
            (true, true) => [objects, backgrounds],
            (true, false) => [objects, 0],
            (false, _) => [0, objects + backgrounds],
        }
    }

    fn run_chunks(&mut self) {
        let mut chunks = std::mem::take(&mut self.chunks);
        let context = StepContext {
            config: &self.config,
            paper: &self.paper,
            pixels: &self.pixels,
            frame: &self.frame,
            field: &self.field.value,
            field_transposed: &self.field.transposed,
            material: self
                .material
                .as_ref()
                .map(|m| (&m.value, m.transposed.as_slice())),
            display: Display { gamma: self.gamma },
            step: self.step,
        };
        let [objects, backgrounds] = self.pixel_counts();
        let share =
            |n: usize, i: usize| -> Range<usize> { n * i / N_CHUNKS..n * (i + 1) / N_CHUNKS };
        chunks.par_iter_mut().enumerate().for_each(|(i, chunk)| {
            chunk.run(&context, share(objects, i), share(backgrounds, i));
        });
        self.chunks = chunks;
    }

    fn stats(&self) -> StepStats {
        let sum = |f: fn(&Chunk) -> f64| self.chunks.iter().map(f).sum::<f64>();
        let n_rays: usize = self.chunks.iter().map(Chunk::n_rays).sum();
        StepStats {
            loss: sum(|c| c.loss.weighted) as f32,
            loss_object: (sum(|c| c.loss.object) / self.config.object_pixels as f64) as f32,
            loss_background: (sum(|c| c.loss.background) / self.config.background_pixels as f64)
                as f32,
            rays: n_rays as u32,
            samples: (2 * n_rays * self.config.samples_per_ray) as u32,
            skipped: !self.chunks.iter().all(|c| c.is_finite),
        }
    }

    /// Sums the chunks' gradients in order, whichever thread takes which block.
    fn sum_gradients(&mut self) {
        let chunks = &self.chunks;
        sum_in_order(&mut self.field.gradient, |i| &chunks[i].d_field);
        if let Some(material) = &mut self.material {
            sum_in_order(&mut material.gradient, |i| &chunks[i].d_material);
        }
    }

    fn update(&mut self, progress: f32) {
        self.updates += 1;
        let warmup = (self.updates as f32 / self.config.warmup_steps.max(1) as f32).min(1.0);
        let decay = warmup * self.config.final_rate.powf(progress.clamp(0.0, 1.0));
        // The optimiser takes what is behind the head in parallel.
        let rates = |rate: f32| Rates {
            n_head: 0,
            head: 0.0,
            tail: decay * rate,
        };
        let rate = self.config.network_rate;
        let field = &mut self.field;
        field.adam.update(
            &mut field.value.params,
            &mut field.gradient,
            rates(rate),
            self.updates,
        );
        if let Some(m) = &mut self.material {
            m.adam.update(
                &mut m.value.params,
                &mut m.gradient,
                rates(rate),
                self.updates,
            );
        }
        let d_gamma = self.chunks.iter().map(|c| c.loss.d_gamma).sum::<f64>() as f32;
        let mut gamma = [self.gamma];
        self.gamma_adam.update(
            &mut gamma,
            &mut [d_gamma],
            rates(self.config.gamma_rate),
            self.updates,
        );
        // Outside this range the transform is no display transform any more.
        self.gamma = gamma[0].clamp(0.2, 5.0);
        self.transpose();
    }

    pub(super) fn transpose(&mut self) {
        self.field.value.transpose(&mut self.field.transposed);
        if let Some(m) = &mut self.material {
            m.value.transpose(&mut m.transposed);
        }
    }

    /// Weighted loss of the next step and the gradients of both networks, without taking the step.
    #[cfg(test)]
    pub(super) fn loss_and_gradients(&mut self) -> (f64, Vec<f32>, Vec<f32>) {
        self.run_chunks();
        self.sum_gradients();
        let loss = self.chunks.iter().map(|c| c.loss.weighted).sum();
        let take = |gradient: &mut Vec<f32>| {
            let n = gradient.len();
            std::mem::replace(gradient, vec![0.0; n])
        };
        let material = self.material.as_mut().map(|m| take(&mut m.gradient));
        (
            loss,
            take(&mut self.field.gradient),
            material.unwrap_or_default(),
        )
    }
}

fn sum_in_order<'a>(total: &mut [f32], part: impl Fn(usize) -> &'a [f32] + Sync) {
    total
        .par_chunks_mut(SUM_BLOCK)
        .enumerate()
        .for_each(|(block, total)| {
            for chunk in 0..N_CHUNKS {
                let part = &part(chunk)[block * SUM_BLOCK..][..total.len()];
                for (sum, value) in total.iter_mut().zip(part) {
                    *sum += value;
                }
            }
        });
}
