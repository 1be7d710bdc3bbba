//! A baseline under training, and a step of it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use rayon::prelude::*;

use super::NeilfConfig;
use super::chunk::{Chunk, N_CHUNKS, StepContext};
use crate::data::Dataset;
use crate::geometry::SurfaceTracer;
use crate::neif::neilf::brdf::hemisphere;
use crate::neif::neilf::{IncidentLight, NeilfModel};
use crate::neif::surface::material::Material;
use crate::train::TrainError;
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::preparation::Prepared;
use crate::train::random::SlotRandom;
use crate::train::step::chunks::share;
use crate::train::step::display::LearnedDisplay;
use crate::train::step::learned::Learned;
use crate::train::step::model::{Model, Stage, StepStats};
use crate::train::step::now::Now;
use crate::train::step::part::Part;
use crate::train::step::trainer::Trainer;

/// Parameters, moments and pixels of a run.
#[derive(Debug)]
pub struct Neilf {
    settings: NeilfConfig,
    pixels: PixelStore,
    tracer: Arc<SurfaceTracer>,
    lattice: Vec<Vec3>,
    pub(super) light: Learned<IncidentLight>,
    pub(super) material: Learned<Material>,
    display: LearnedDisplay,
    chunks: Vec<Chunk>,
}

impl Neilf {
    /// Traces every training pixel on the current thread pool.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when the capture shows no object.
    pub fn trainer(
        config: &TrainConfig,
        neilf: &NeilfConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
    ) -> Result<Trainer<Self>, TrainError> {
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
        let model = Self {
            settings: *neilf,
            pixels,
            tracer,
            lattice: hemisphere(neilf.directions),
            light: Learned::new("light", light),
            material: Learned::new("material", material),
            display: LearnedDisplay::new(true),
            chunks: (0..N_CHUNKS).map(|_| Chunk::default()).collect(),
        };
        Ok(Trainer::of(config, model))
    }

    fn object_loss(&self) -> f64 {
        self.chunks.iter().map(|c| c.loss.object).sum::<f64>() / self.settings.pixels as f64
    }

    /// What the step minimises.
    pub(super) fn loss(&self) -> f64 {
        self.object_loss() + self.chunks.iter().map(|c| c.loss.smoothness).sum::<f64>()
    }

    fn stats(&self) -> StepStats {
        let n_rows: usize = self.chunks.iter().map(|c| c.light.n_rows()).sum();
        StepStats {
            loss: self.loss() as f32,
            loss_object: self.object_loss() as f32,
            loss_background: 0.0,
            rays: n_rows as u32,
            samples: n_rows as u32,
            skipped: !self.chunks.iter().all(|c| c.is_finite),
        }
    }
}

impl Trainer<Neilf> {
    /// The trained model as it stands: a copy of the parameters.
    pub fn trained(&self) -> NeilfModel {
        let model = &self.model;
        NeilfModel {
            tracer: Arc::clone(&model.tracer),
            brdf: model.settings.brdf,
            material: model.material.value.clone(),
            light: model.light.value.clone(),
            display: model.display.display(),
            lattice: hemisphere(model.settings.render_directions),
        }
    }
}

impl Model for Neilf {
    fn format(&self) -> &'static str {
        "neif-neilf-checkpoint-1"
    }

    fn run(&mut self, now: &Now<'_>, _on_done: &mut dyn FnMut(Stage)) -> StepStats {
        self.pixels.trace_drawn(now.n_objects());
        let mut chunks = std::mem::take(&mut self.chunks);
        let context = StepContext {
            config: now.config,
            neilf: &self.settings,
            pixels: &self.pixels,
            lattice: &self.lattice,
            light: &self.light.value,
            light_transposed: &self.light.transposed,
            material: &self.material.value,
            material_transposed: &self.material.transposed,
            display: self.display.display(),
            step: now.step,
        };
        let n = self.settings.pixels;
        let with_index = chunks.par_iter_mut().enumerate();
        now.tasks.each("run", with_index, |(i, chunk)| {
            chunk.run(&context, share(n, i, N_CHUNKS));
        });
        self.chunks = chunks;
        self.stats()
    }

    fn gather(&mut self, now: &Now<'_>) {
        let (chunks, light, material) = (&self.chunks, &mut self.light, &mut self.material);
        let mut jobs = Vec::new();
        light.gather(
            &mut jobs,
            chunks,
            IncidentLight::levels,
            |chunk: &Chunk| &chunk.d_light_network,
            |field, level, chunk, table| field.scatter_level(level, &chunk.light, table),
        );
        material.gather(
            &mut jobs,
            chunks,
            Material::levels,
            |chunk: &Chunk| &chunk.d_material_network,
            |field, level, chunk, table| field.scatter_level(level, &chunk.material, table),
        );
        now.tasks.all("gather", jobs);
        self.display.gradient = chunks.iter().map(|c| c.loss.d_gamma).sum::<f64>() as f32;
    }

    fn parts(&mut self) -> Vec<&mut dyn Part> {
        vec![&mut self.light, &mut self.material, &mut self.display]
    }
}
