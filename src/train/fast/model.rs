//! The fast model under training: all that it has learned, and a step of it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use rayon::prelude::*;

use super::batch_size::BatchSize;
use super::chunk::Chunk;
use super::step_context::StepContext;
use super::work::Work;
use crate::data::{Dataset, exposures_differ};
use crate::geometry::SurfaceTracer;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::radiance_field::{FieldBatch, RadianceField};
use crate::neif::field::seen_grid::SeenGrid;
use crate::neif::light::environment::EnvironmentPlace;
use crate::neif::networks::hash_grid::FEATURES;
use crate::neif::surface::object::Material;
use crate::train::TrainError;
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::photos::exposures::Exposures;
use crate::train::photos::photo_exposures::PhotoExposures;
use crate::train::photos::poses::Poses;
use crate::train::pixels::store::PixelStore;
use crate::train::placement::{clear_density, environment_place};
use crate::train::preparation::Prepared;
use crate::train::priors::depth_evidence::clear_air;
use crate::train::priors::glare::UnseenDirections;
use crate::train::priors::ground::SeenGround;
use crate::train::priors::void::lay_floor;
use crate::train::random::SlotRandom;
use crate::train::scene_model::SceneModel as _;
use crate::train::shape::refinement::{self, Refinement};
use crate::train::step::display::LearnedDisplay;
use crate::train::step::learned::Learned;
use crate::train::step::model::{Model, Stage, StepStats};
use crate::train::step::now::Now;
use crate::train::step::part::Part;
use crate::train::step::trainer::Trainer;

/// Chunks of which a task encodes a level.
const ENCODED_TOGETHER: usize = 2;

/// Parameters, moments and pixels of a run.
#[derive(Debug)]
pub struct Fast {
    pub(in crate::train) place: EnvironmentPlace,
    pub(in crate::train) pixels: PixelStore,
    pub(in crate::train) field: Learned<RadianceField>,
    pub(in crate::train) density: DensityGrid,
    pub(in crate::train) material: Option<Learned<Material>>,
    pub(super) display: LearnedDisplay,
    pub(in crate::train) photos: Photos,
    pub(super) surface: Surface,
    unseen: UnseenDirections,
    pub(super) work: Work,
}

/// What is estimated of the photos themselves.
#[derive(Debug)]
pub(in crate::train) struct Photos {
    /// Where each photo has its own.
    pub(in crate::train) exposures: Option<Exposures>,
    /// The training photos, for what snapshots note of their exposures.
    pub(super) noted: Option<PhotoExposures>,
    /// Where the photos' poses are refined.
    pub(in crate::train) poses: Option<Poses>,
}

/// The object's surface as it is known by now.
#[derive(Debug)]
pub(super) struct Surface {
    /// Of the mesh that snapshots have.
    pub(super) tracer: Option<Arc<SurfaceTracer>>,
    /// Where the mesh's normals are refined.
    pub(super) refinement: Option<Refinement>,
}

impl Fast {
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
        let prepared = Prepared::new(config, dataset, cancel, on_progress)?;
        Ok(Self::of(config, dataset, prepared))
    }

    fn of(config: &TrainConfig, dataset: &Dataset, prepared: Prepared) -> Trainer<Self> {
        let Prepared {
            tracer,
            poses,
            pixels,
        } = prepared;
        let mut random = SlotRandom::new(config.seed, u64::MAX, 0);
        let place = environment_place(config, dataset);
        let frame = &place.frame;
        let field = RadianceField::new(config.field, || random.uniform());
        let material = dataset
            .object_box()
            .filter(|_| pixels.n_objects() > 0)
            .map(|bounds| {
                // A margin, so that the rim of the cube is never needed.
                let side = 1.05 * bounds.extent().max_element();
                Material::new(config.material, bounds.center(), side, || random.uniform())
            });
        let traced = tracer.as_deref();
        let outline_error_px = pixels.outline_error_px();
        let refinement = Refinement::of(config, dataset, traced, outline_error_px);
        // A background that is left out says nothing of exposures.
        let has_background = config.background != PhotoFit::Off;
        let has_haze = has_background && tracer.is_some() && exposures_differ(dataset);
        let mut density = clear_density(dataset, traced, frame, place.up);
        density.seen = Some(SeenGrid::default());
        if let Some(depths) = &pixels.depths {
            clear_air(&mut density, depths, frame);
        }
        let fit = config.photo_exposures;
        let has_exposures = has_haze || fit == PhotoFit::On;
        let ground = (has_background && has_exposures)
            .then(|| SeenGround::of(dataset))
            .flatten();
        if let Some(ground) = ground.as_ref().filter(|_| has_haze) {
            lay_floor(&mut density, dataset, frame, ground);
        }
        let seen_gains = pixels.depths.as_ref().and_then(|d| d.log_gains.clone());
        let known_gains = seen_gains.or_else(|| Some(ground?.log_gains().to_vec()));
        let exposures = (fit != PhotoFit::Off).then(|| match known_gains {
            Some(log_gains) => Exposures::known(log_gains, fit),
            None => Exposures::new(pixels.n_views(), fit),
        });
        let alike = vec![Vec3::ONE; pixels.n_views()];
        let noted = exposures.as_ref();
        let noted = noted.map(|_| PhotoExposures::of(dataset, &alike));
        let config = TrainConfig {
            distortion_weight: config.distortion_weight * if has_haze { 1.0 } else { 0.0 },
            ..config.clone()
        };
        let model = Self {
            pixels,
            work: Work::of(&field),
            field: Learned::new("field", field)
                .with_rounded_grids()
                .with_averages(),
            density,
            // An environment alone looks the same with any exponent: its own stays 1.
            display: LearnedDisplay::new(material.is_some()),
            material: material.map(|material| Learned::new("material", material).with_averages()),
            photos: Photos {
                exposures,
                noted,
                poses,
            },
            surface: Surface { tracer, refinement },
            unseen: UnseenDirections::new(dataset, frame),
            place,
        };
        Trainer::of(config, model)
    }

    pub(super) fn n_samples(&self, config: &TrainConfig) -> usize {
        match self.material {
            Some(_) => config.samples_per_ray,
            None => config.samples_per_ray_alone,
        }
    }

    fn context<'a>(&'a self, now: &Now<'a>) -> StepContext<'a> {
        let explored = now.step as f32 / now.config.exploration_steps.max(1) as f32;
        let material = self.material.as_ref();
        let Photos {
            exposures, poses, ..
        } = &self.photos;
        StepContext {
            config: now.config,
            pixels: &self.pixels,
            frame: &self.place.frame,
            field: &self.field.value,
            field_transposed: &self.field.transposed,
            density: &self.density,
            batch_size: self.work.batch_size,
            material: material.map(|m| &m.value),
            material_transposed: material.map_or(&[], |m| &m.transposed),
            display: self.display.display(),
            gains: self.gains().unwrap_or_default(),
            finds_exposures: exposures.as_ref().is_some_and(|e| e.are_sought(now.step)),
            finds_poses: poses.as_ref().is_some_and(|p| p.are_sought(now.step)),
            unseen: &self.unseen,
            offsets: self.surface.refinement.as_ref().map(|r| &r.offsets),
            tilts: now.step >= refinement::DELAY,
            step: now.step,
            samples_per_ray: self.n_samples(now.config),
            uniform_share: (1.0 - explored).max(now.config.uniform_share),
        }
    }

    /// Draws and places every chunk's rays.
    pub(super) fn prepare(&mut self, now: &Now<'_>) {
        self.pixels.trace_drawn(now.n_objects());
        let mut chunks = std::mem::take(&mut self.work.chunks);
        self.work.batch_size = BatchSize::of(now.config, now.progress);
        let size = self.work.batch_size;
        let context = self.context(now);
        let backgrounds = size.backgrounds * usize::from(self.pixels.n_backgrounds() > 0);
        let objects = context.material.map_or(0, |_| size.objects);
        // Without an object its share of the work goes to the background.
        let backgrounds = if objects == 0 {
            let n = (backgrounds + size.objects) * now.config.samples_per_ray;
            n.div_ceil(context.samples_per_ray)
        } else {
            backgrounds
        };
        now.tasks.each("prepare", chunks.par_iter_mut(), |chunk| {
            chunk.prepare(&context, objects, backgrounds);
        });
        self.work.chunks = chunks;
    }

    /// Encodes the step from the tables in bf16.
    fn encode(&mut self, now: &Now<'_>) {
        let tables = std::mem::take(&mut self.field.rounded);
        self.encode_by_level(now, |field, level, batch, out| {
            field.encode_level_bf16(level, &tables, batch, out);
        });
        self.field.rounded = tables;
    }

    /// Encodes level by level over the whole step: a thread takes tasks of one level in a row, whose table stays in its core's
    /// cache.
    pub(super) fn encode_by_level(
        &mut self,
        now: &Now<'_>,
        encode_level: impl Fn(&RadianceField, usize, &FieldBatch, &mut [f32]) + Sync,
    ) {
        let (field, chunks) = (&self.field.value, &self.work.chunks);
        let n: usize = chunks.iter().map(|c| c.batch.n()).sum();
        let mut tasks = Vec::new();
        for (level, out) in self.work.encoded.iter_mut().enumerate().rev() {
            out.resize(n * FEATURES, 0.0);
            let mut rest = out.as_mut_slice();
            for chunks in chunks.chunks(ENCODED_TOGETHER) {
                let n: usize = chunks.iter().map(|c| c.batch.n()).sum();
                let (head, tail) = rest.split_at_mut(n * FEATURES);
                tasks.push((level, chunks, head));
                rest = tail;
            }
        }
        let encode = |(level, chunks, mut rest): (usize, &[Chunk], &mut [f32])| {
            for chunk in chunks {
                let (head, tail) = rest.split_at_mut(chunk.batch.n() * FEATURES);
                encode_level(field, level, &chunk.batch, head);
                rest = tail;
            }
        };
        now.tasks.each("encode", tasks.into_par_iter(), encode);
    }

    pub(super) fn run_chunks(&mut self, now: &Now<'_>) {
        let mut chunks = std::mem::take(&mut self.work.chunks);
        let starts: Vec<usize> = chunks
            .iter()
            .scan(0, |end, chunk| {
                let start = *end;
                *end += chunk.batch.n();
                Some(start)
            })
            .collect();
        let context = self.context(now);
        let encoded = &self.work.encoded;
        let with_start = chunks.par_iter_mut().zip(starts);
        now.tasks.each("networks", with_start, |(chunk, start)| {
            let n = chunk.batch.n();
            for (level, values) in encoded.iter().enumerate() {
                context.field.insert_level(
                    level,
                    &values[start * FEATURES..(start + n) * FEATURES],
                    &mut chunk.batch,
                );
            }
            chunk.run(&context);
        });
        self.work.chunks = chunks;
    }

    /// Mean losses of the step's object and background pixels.
    fn pixel_losses(&self) -> [f64; 2] {
        [
            self.sum(|c| c.loss.object) / self.work.batch_size.objects as f64,
            self.sum(|c| c.loss.background) / self.work.batch_size.backgrounds as f64,
        ]
    }

    /// What the step minimises.
    pub(super) fn loss(&self, config: &TrainConfig) -> f64 {
        let [object, background] = self.pixel_losses();
        object
            + f64::from(config.background_weight) * background
            + self.sum(|c| c.loss.smoothness + c.loss.priors)
    }

    pub(super) fn sum(&self, of: fn(&Chunk) -> f64) -> f64 {
        self.work.chunks.iter().map(of).sum()
    }

    fn stats(&self, config: &TrainConfig) -> StepStats {
        let [object, background] = self.pixel_losses();
        let chunks = &self.work.chunks;
        StepStats {
            loss: self.loss(config) as f32,
            loss_object: object as f32,
            loss_background: background as f32,
            rays: chunks.iter().map(|c| c.batch.rays.len() as u32).sum(),
            samples: chunks.iter().map(|c| c.batch.n() as u32).sum(),
            skipped: !chunks.iter().all(|c| c.is_finite),
        }
    }
}

impl Model for Fast {
    fn format(&self) -> &'static str {
        "neif-checkpoint-1"
    }

    fn run(&mut self, now: &Now<'_>, on_done: &mut dyn FnMut(Stage)) -> StepStats {
        self.prepare(now);
        on_done(Stage::Prepare);
        self.encode(now);
        on_done(Stage::Encode);
        self.run_chunks(now);
        on_done(Stage::Networks);
        self.stats(now.config)
    }

    fn gather(&mut self, now: &Now<'_>) {
        self.gather_gradients(now);
    }

    fn parts(&mut self) -> Vec<&mut dyn Part> {
        let mut parts: Vec<&mut dyn Part> = vec![&mut self.field];
        parts.extend(self.material.as_mut().map(|m| m as &mut dyn Part));
        parts.push(&mut self.display);
        parts.push(&mut self.density);
        parts.extend(self.photos.poses.as_mut().map(|p| p as &mut dyn Part));
        let refinement = self.surface.refinement.as_mut();
        parts.extend(refinement.map(|r| r as &mut dyn Part));
        // The last, as a checkpoint without them leaves none.
        parts.push(&mut self.photos.exposures);
        parts
    }

    fn follow(&mut self) {
        let poses = self.photos.poses.as_mut();
        if let Some(cameras) = poses.and_then(Poses::take_changed) {
            self.pixels.set_cameras(&cameras);
        }
    }

    fn probe(&mut self, now: &Now<'_>) -> bool {
        self.probe_density(now)
    }
}
