//! The paper's model under training, and a step of it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use super::PaperConfig;
use super::chunk::{Chunk, N_CHUNKS, StepContext};
use crate::data::Dataset;
use crate::geometry::SurfaceTracer;
use crate::neif::light::environment::{Environment, EnvironmentPlace};
use crate::neif::paper::{PaperField, PaperMaterial};
use crate::neif::surface::object::{ObjectModel, SurfaceField};
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::placement::environment_place;
use crate::train::preparation::Prepared;
use crate::train::random::SlotRandom;
use crate::train::scene_model::SceneModel;
use crate::train::step::chunks::{share, sum_in_order};
use crate::train::step::display::LearnedDisplay;
use crate::train::step::learned::Learned;
use crate::train::step::model::{Model, Stage, StepStats};
use crate::train::step::now::Now;
use crate::train::step::part::Part;
use crate::train::step::trainer::Trainer;
use crate::train::{Snapshot, TrainError};

/// Parameters that a task sums over the chunks.
const SUM_BLOCK: usize = 1 << 14;

/// Parameters, moments and pixels of a run of the paper's model.
#[derive(Debug)]
pub struct Paper {
    settings: PaperConfig,
    place: EnvironmentPlace,
    pub(in crate::train) pixels: PixelStore,
    tracer: Option<Arc<SurfaceTracer>>,
    pub(super) field: Learned<PaperField>,
    pub(super) material: Option<Learned<PaperMaterial>>,
    display: LearnedDisplay,
    chunks: Vec<Chunk>,
}

impl Paper {
    /// Traces every training pixel on the current thread pool; `on_progress` gets 0..1.
    ///
    /// # Errors
    /// When cancelled, when the configuration is unusable, or when no pixel can be trained on.
    pub fn trainer(
        config: &TrainConfig,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Trainer<Self>, TrainError> {
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
            });
        let model = Self {
            settings: paper,
            place: environment_place(config, dataset),
            pixels,
            tracer,
            field: Learned::new("field", field),
            material: material.map(|material| Learned::new("material", material)),
            display: LearnedDisplay::new(true),
            chunks: (0..N_CHUNKS).map(Chunk::new).collect(),
        };
        Ok(Trainer::of(config.clone(), model))
    }

    /// Object and background pixels of a step; without an object its share goes to the background.
    fn pixel_counts(&self, config: &TrainConfig) -> [usize; 2] {
        let (objects, backgrounds) = (config.object_pixels, config.background_pixels);
        match (self.material.is_some(), self.pixels.n_backgrounds() > 0) {
            (true, true) => [objects, backgrounds],
            (true, false) => [objects, 0],
            (false, _) => [0, objects + backgrounds],
        }
    }

    /// What the step minimises.
    pub(super) fn loss(&self) -> f64 {
        self.chunks.iter().map(|c| c.loss.weighted).sum()
    }

    fn stats(&self, config: &TrainConfig) -> StepStats {
        let sum = |f: fn(&Chunk) -> f64| self.chunks.iter().map(f).sum::<f64>();
        let n_rays: usize = self.chunks.iter().map(Chunk::n_rays).sum();
        StepStats {
            loss: self.loss() as f32,
            loss_object: (sum(|c| c.loss.object) / config.object_pixels as f64) as f32,
            loss_background: (sum(|c| c.loss.background) / config.background_pixels as f64) as f32,
            rays: n_rays as u32,
            samples: (2 * n_rays * config.samples_per_ray) as u32,
            skipped: !self.chunks.iter().all(|c| c.is_finite),
        }
    }
}

impl Model for Paper {
    fn format(&self) -> &'static str {
        "neif-paper-checkpoint-2"
    }

    fn run(&mut self, now: &Now<'_>, _on_done: &mut dyn FnMut(Stage)) -> StepStats {
        self.pixels.trace_drawn(now.n_objects());
        let mut chunks = std::mem::take(&mut self.chunks);
        let material = self.material.as_ref();
        let context = StepContext {
            config: now.config,
            paper: &self.settings,
            pixels: &self.pixels,
            frame: &self.place.frame,
            field: &self.field.value,
            field_transposed: &self.field.transposed,
            material: material.map(|m| (&m.value, m.transposed.as_slice())),
            display: self.display.display(),
            step: now.step,
        };
        let [objects, backgrounds] = self.pixel_counts(now.config);
        let with_index = chunks.par_iter_mut().enumerate();
        now.tasks.each("run", with_index, |(i, chunk)| {
            let of = |n| share(n, i, N_CHUNKS);
            chunk.run(&context, of(objects), of(backgrounds));
        });
        self.chunks = chunks;
        self.stats(now.config)
    }

    /// Block by block, whichever thread takes which.
    fn gather(&mut self, now: &Now<'_>) {
        let chunks = &self.chunks;
        let sum = |gradient: &mut [f32], part: fn(&Chunk) -> &[f32]| {
            let blocks = gradient.par_chunks_mut(SUM_BLOCK).enumerate();
            now.tasks.each("gather", blocks, |(i, block)| {
                let range = i * SUM_BLOCK..i * SUM_BLOCK + block.len();
                sum_in_order(block, chunks.iter().map(|c| &part(c)[range.clone()]));
            });
        };
        sum(&mut self.field.gradient, |c| &c.d_field);
        if let Some(material) = &mut self.material {
            sum(&mut material.gradient, |c| &c.d_material);
        }
        self.display.gradient = chunks.iter().map(|c| c.loss.d_gamma).sum::<f64>() as f32;
    }

    fn parts(&mut self) -> Vec<&mut dyn Part> {
        let mut parts: Vec<&mut dyn Part> = vec![&mut self.field];
        parts.extend(self.material.as_mut().map(|m| m as &mut dyn Part));
        parts.push(&mut self.display);
        parts
    }
}

impl SceneModel for Paper {
    fn snapshot(&self, step: u64) -> Snapshot {
        let place = EnvironmentPlace {
            gamma: self.display.gamma,
            ..self.place.clone()
        };
        let material = self.material.as_ref();
        let material = material.map(|m| SurfaceField::Paper(m.value.clone()));
        let object = ObjectModel::of(self.tracer.as_ref(), material);
        Snapshot {
            step,
            object: object.map(Arc::new),
            environment: Arc::new(Environment::of_paper(place, self.field.value.clone())),
            exposures: None,
        }
    }

    /// Of both passes.
    fn samples_per_ray(&self, config: &TrainConfig) -> f32 {
        2.0 * config.samples_per_ray as f32
    }

    fn findings(&self) -> Vec<String> {
        self.pixels.findings()
    }
}
