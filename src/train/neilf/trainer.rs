//! The trainer of the baselines: a plain value with the fast trainer's interface.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use rayon::prelude::*;

use super::NeilfConfig;
use super::chunk::{Chunk, StepContext};
use crate::data::Dataset;
use crate::geometry::SurfaceTracer;
use crate::neif::light::display::Display;
use crate::neif::neilf::brdf::hemisphere;
use crate::neif::neilf::{IncidentLight, NeilfModel};
use crate::neif::networks::hash_grid::FEATURES;
use crate::neif::surface::material::Material;
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::preparation::Prepared;
use crate::train::random::SlotRandom;
use crate::train::step::adam::{Adam, Rates};
use crate::train::step::chunk::N_CHUNKS;
use crate::train::step::learned::sum_in_order;
use crate::train::{StepStats, TrainError};

/// Parameters, moments and pixels of a run.
#[derive(Debug)]
pub struct NeilfTrainer {
    config: TrainConfig,
    neilf: NeilfConfig,
    pixels: PixelStore,
    tracer: Arc<SurfaceTracer>,
    lattice: Vec<Vec3>,
    pub(super) light: Learned<IncidentLight, Vec<f32>>,
    pub(super) material: Learned<Material, Vec<f32>>,
    gamma: f32,
    gamma_adam: Adam,
    step: u64,
    /// Optimiser updates done: steps less the skipped ones.
    updates: u64,
    skipped: u64,
    chunks: Vec<Chunk>,
}

/// A field under training: its moments, gradient and transposed weights.
#[derive(Debug)]
pub(super) struct Learned<F, T> {
    pub(super) value: F,
    adam: Adam,
    /// Zero between steps: [`Adam::update`] clears it.
    gradient: Vec<f32>,
    transposed: T,
}

impl<F, T: Default> Learned<F, T> {
    fn new(value: F, n_params: usize) -> Self {
        Self {
            value,
            adam: Adam::new(n_params),
            gradient: vec![0.0; n_params],
            transposed: T::default(),
        }
    }
}

impl NeilfTrainer {
    /// Traces every training pixel on the current thread pool.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when the capture shows no object.
    pub fn new(
        config: &TrainConfig,
        neilf: &NeilfConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
    ) -> Result<Self, TrainError> {
        // What a point receives from the object is part of its incident light, and blurred backgrounds are not used.
        let config = TrainConfig {
            bounces: 0,
            subpixels: false,
            preconvolved_levels: 0,
            shared_chroma: false,
            ..config.clone()
        };
        let Prepared { tracer, pixels, .. } = Prepared::new(&config, dataset, cancel, &|_| ())?;
        let Some(tracer) = tracer.filter(|_| pixels.n_objects() > 0) else {
            return Err(TrainError::NoPixels {
                dataset: dataset.root.clone(),
            });
        };
        let mut random = SlotRandom::new(config.seed, u64::MAX, 0);
        let mut uniform = || random.uniform();
        let bounds = tracer.mesh().bounds();
        // A margin, so that the rim of the cube is never needed.
        let side = 1.05 * bounds.extent().max_element();
        let material = Material::new(config.material, bounds.center(), side, &mut uniform);
        let light = IncidentLight::new(neilf.light, material.corner, side, &mut uniform);
        let (n_light, n_material) = (light.params.len(), material.params.len());
        let mut trainer = Self {
            config,
            neilf: *neilf,
            pixels,
            tracer,
            lattice: hemisphere(neilf.directions),
            light: Learned::new(light, n_light),
            material: Learned::new(material, n_material),
            gamma: 1.0,
            gamma_adam: Adam::new(1),
            step: 0,
            updates: 0,
            skipped: 0,
            chunks: (0..N_CHUNKS).map(|_| Chunk::default()).collect(),
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
        self.gather_gradients();
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

    /// The model as it stands: a copy of the parameters.
    pub fn model(&self) -> NeilfModel {
        NeilfModel {
            tracer: Arc::clone(&self.tracer),
            brdf: self.neilf.brdf,
            material: self.material.value.clone(),
            light: self.light.value.clone(),
            display: Display { gamma: self.gamma },
            lattice: hemisphere(self.neilf.render_directions),
        }
    }

    fn run_chunks(&mut self) {
        let mut chunks = std::mem::take(&mut self.chunks);
        let context = StepContext {
            config: &self.config,
            neilf: &self.neilf,
            pixels: &self.pixels,
            lattice: &self.lattice,
            light: &self.light.value,
            light_transposed: &self.light.transposed,
            material: &self.material.value,
            material_transposed: &self.material.transposed,
            display: Display { gamma: self.gamma },
            step: self.step,
        };
        let n = self.neilf.pixels;
        let share = |i: usize| -> Range<usize> { n * i / N_CHUNKS..n * (i + 1) / N_CHUNKS };
        chunks
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, chunk)| chunk.run(&context, share(i)));
        self.chunks = chunks;
    }

    fn stats(&self) -> StepStats {
        let sum = |f: fn(&Chunk) -> f64| self.chunks.iter().map(f).sum::<f64>();
        let object = sum(|c| c.loss.object) / self.neilf.pixels as f64;
        let n_rows: usize = self.chunks.iter().map(|c| c.light.n_rows()).sum();
        StepStats {
            loss: (object + sum(|c| c.loss.smoothness)) as f32,
            loss_object: object as f32,
            loss_background: 0.0,
            rays: n_rows as u32,
            samples: n_rows as u32,
            skipped: !self.chunks.iter().all(|c| c.is_finite),
        }
    }

    /// Sums the chunks' gradients in order: the networks, and each level by one task.
    fn gather_gradients(&mut self) {
        let chunks = &self.chunks;
        let (light, material) = (&self.light.value, &self.material.value);
        let (light_network, mut light_grids) =
            self.light.gradient.split_at_mut(light.n_network_params());
        let (material_network, mut material_grids) = self
            .material
            .gradient
            .split_at_mut(material.n_network_params());
        rayon::scope(|scope| {
            for (level, shape) in light.levels().iter().enumerate() {
                let (table, rest) = light_grids.split_at_mut(shape.n_entries * FEATURES);
                light_grids = rest;
                scope.spawn(move |_| {
                    for chunk in chunks {
                        light.scatter_level(level, &chunk.light, table);
                    }
                });
            }
            for (level, shape) in material.levels().iter().enumerate() {
                let (table, rest) = material_grids.split_at_mut(shape.n_entries * FEATURES);
                material_grids = rest;
                scope.spawn(move |_| {
                    for chunk in chunks {
                        material.scatter_level(level, &chunk.material, table);
                    }
                });
            }
            sum_in_order(
                light_network,
                chunks.iter().map(|c| c.d_light_network.as_slice()),
            );
            sum_in_order(
                material_network,
                chunks.iter().map(|c| c.d_material_network.as_slice()),
            );
        });
    }

    fn update(&mut self, progress: f32) {
        self.updates += 1;
        let warmup = (self.updates as f32 / self.config.warmup_steps.max(1) as f32).min(1.0);
        let decay = warmup * self.config.final_rate.powf(progress.clamp(0.0, 1.0));
        let (network, grid) = (self.config.network_rate, self.config.grid_rate);
        let rates = |n_head| Rates {
            n_head,
            head: decay * network,
            tail: decay * grid,
        };
        let (light, material) = (&mut self.light, &mut self.material);
        let n_head = light.value.n_network_params();
        let params = &mut light.value.params;
        light
            .adam
            .update(params, &mut light.gradient, rates(n_head), self.updates);
        let n_head = material.value.n_network_params();
        let params = &mut material.value.params;
        material
            .adam
            .update(params, &mut material.gradient, rates(n_head), self.updates);
        let d_gamma = self.chunks.iter().map(|c| c.loss.d_gamma).sum::<f64>() as f32;
        let mut gamma = [self.gamma];
        let rates = Rates {
            n_head: 1,
            head: decay * self.config.gamma_rate,
            tail: 0.0,
        };
        self.gamma_adam
            .update(&mut gamma, &mut [d_gamma], rates, self.updates);
        // Outside this range the transform is no display transform any more.
        self.gamma = gamma[0].clamp(0.2, 5.0);
        self.transpose();
    }

    pub(super) fn transpose(&mut self) {
        self.light.value.transpose(&mut self.light.transposed);
        self.material.value.transpose(&mut self.material.transposed);
    }

    /// Weighted loss of the next step and the gradients of light and material, without taking the step.
    #[cfg(test)]
    pub(super) fn loss_and_gradients(&mut self) -> (f64, [Vec<f32>; 2]) {
        self.run_chunks();
        let sum = |f: fn(&Chunk) -> f64| self.chunks.iter().map(f).sum::<f64>();
        let loss = sum(|c| c.loss.object) / self.neilf.pixels as f64 + sum(|c| c.loss.smoothness);
        self.gather_gradients();
        let take = |gradient: &mut Vec<f32>| {
            let n = gradient.len();
            std::mem::replace(gradient, vec![0.0; n])
        };
        let gradients = [
            take(&mut self.light.gradient),
            take(&mut self.material.gradient),
        ];
        (loss, gradients)
    }
}
