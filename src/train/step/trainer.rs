//! The trainer: a plain value that owns all parameters and takes one optimisation step at a time.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use super::adam::Adam;
use super::batch_size::BatchSize;
use super::chunk::Chunk;
use super::learned::Learned;
use super::skips::SkipShares;
use super::step_context::StepContext;
use super::work::Work;
use crate::data::{Dataset, exposures_differ};
use crate::geometry::SurfaceTracer;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::radiance_field::{FieldBatch, RadianceField};
use crate::neif::field::seen_grid::SeenGrid;
use crate::neif::field::skip_counts::SkipCounts;
use crate::neif::light::display::Display;
use crate::neif::light::environment::{Environment, EnvironmentPlace};
use crate::neif::networks::hash_grid::FEATURES;
use crate::neif::surface::object::{Material, ObjectModel, SurfaceField};
use crate::train::TrainError;
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::photos::exposures::Exposures;
use crate::train::photos::photo_exposures::PhotoExposures;
use crate::train::photos::poses::Poses;
use crate::train::pixels::store::PixelStore;
use crate::train::placement::{clear_density, field_frame, up_direction};
use crate::train::preparation::Prepared;
use crate::train::priors::depth_evidence::clear_air;
use crate::train::priors::ground::SeenGround;
use crate::train::priors::unseen_light::UnseenDirections;
use crate::train::priors::void::lay_floor;
use crate::train::random::SlotRandom;
use crate::train::session::saved::snapshot::Snapshot;
use crate::train::shape::refinement::{self, Refinement};

/// Steps between two rounds of random looks into the density cache's cells.
const PROBE_EVERY: u64 = 16;

/// Parameters, moments and pixels of a run.
#[derive(Debug)]
pub struct Trainer {
    pub(in crate::train) config: TrainConfig,
    pub(in crate::train) place: Place,
    pub(in crate::train) pixels: PixelStore,
    pub(in crate::train) field: Learned<RadianceField, Vec<f32>>,
    pub(in crate::train) density: DensityGrid,
    pub(in crate::train) material: Option<Learned<Material, Vec<f32>>>,
    pub(in crate::train) display: LearnedDisplay,
    pub(in crate::train) photos: Photos,
    pub(in crate::train) surface: Surface,
    unseen: UnseenDirections,
    pub(in crate::train) counts: Counts,
    pub(in crate::train) work: Work,
}

/// The capture, and where it lies.
#[derive(Debug)]
pub(in crate::train) struct Place {
    name: String,
    up: glam::Vec3,
    pub(in crate::train) frame: FieldFrame,
}

/// The exponent of the display transform.
#[derive(Debug)]
pub(in crate::train) struct LearnedDisplay {
    pub(in crate::train) gamma: f32,
    pub(in crate::train) adam: Adam,
}

/// What is estimated of the photos themselves.
#[derive(Debug)]
pub(in crate::train) struct Photos {
    /// Where each photo has its own.
    pub(in crate::train) exposures: Option<Exposures>,
    /// The training photos, for what snapshots note of their exposures.
    noted: Option<PhotoExposures>,
    /// Where the photos' poses are refined.
    pub(in crate::train) poses: Option<Poses>,
}

/// The object's surface as it is known by now.
#[derive(Debug)]
pub(in crate::train) struct Surface {
    /// Of the mesh that snapshots have.
    pub(in crate::train) tracer: Option<Arc<SurfaceTracer>>,
    /// Where the mesh's normals are refined.
    pub(in crate::train) refinement: Option<Refinement>,
}

/// How far training has come.
#[derive(Debug, Default)]
pub(in crate::train) struct Counts {
    pub(in crate::train) step: u64,
    /// Optimiser updates done: steps less the skipped ones.
    pub(in crate::train) updates: u64,
    pub(in crate::train) skipped: u64,
}

/// The parts of a step, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Pixels drawn, surfaces evaluated, lobes aimed, samples placed.
    Prepare,
    /// Grid features of the field.
    Encode,
    /// Networks, compositing, pixel equation, loss, and back.
    Networks,
    /// Grid gradients, sums, density cache.
    Gather,
    /// Adam.
    Update,
    /// Random looks into the density cache, every 16th step.
    Probe,
}

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepStats {
    /// Weighted sum of all terms.
    pub loss: f32,
    /// Mean squared error of object pixels, summed over the colours.
    pub loss_object: f32,
    /// The same for background pixels.
    pub loss_background: f32,
    /// Field rays evaluated.
    pub rays: u32,
    /// Field samples evaluated.
    pub samples: u32,
    /// Whether a value was not finite, so that nothing was learned.
    pub skipped: bool,
}

impl Trainer {
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
        let prepared = Prepared::new(config, dataset, cancel, on_progress)?;
        Ok(Self::of(config, dataset, prepared))
    }

    fn of(config: &TrainConfig, dataset: &Dataset, prepared: Prepared) -> Self {
        let Prepared {
            tracer,
            poses,
            pixels,
        } = prepared;
        let mut random = SlotRandom::new(config.seed, u64::MAX, 0);
        let frame = field_frame(dataset, config.inner_box_scale);
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
        let up = up_direction(dataset);
        let mut density = clear_density(dataset, traced, &frame, up, refinement.is_none());
        density.seen = Some(SeenGrid::default());
        if let Some(depths) = &pixels.depths {
            clear_air(&mut density, depths, &frame);
        }
        let fit = config.photo_exposures;
        let has_exposures = has_haze || fit == PhotoFit::On;
        let ground = (has_background && has_exposures)
            .then(|| SeenGround::of(dataset))
            .flatten();
        if let Some(ground) = ground.as_ref().filter(|_| has_haze) {
            lay_floor(&mut density, dataset, &frame, ground);
        }
        let seen_gains = pixels.depths.as_ref().and_then(|d| d.log_gains.clone());
        let known_gains = seen_gains.or_else(|| Some(ground?.log_gains().to_vec()));
        let exposures = (fit != PhotoFit::Off).then(|| match known_gains {
            Some(log_gains) => Exposures::known(log_gains, fit),
            None => Exposures::new(pixels.n_views(), fit),
        });
        let alike = vec![glam::Vec3::ONE; pixels.n_views()];
        let noted = exposures.as_ref();
        let noted = noted.map(|_| PhotoExposures::of(dataset, &alike));
        let mut trainer = Self {
            config: TrainConfig {
                distortion_weight: config.distortion_weight * if has_haze { 1.0 } else { 0.0 },
                ..config.clone()
            },
            place: Place {
                name: dataset.name.clone(),
                up,
                frame,
            },
            pixels,
            work: Work::of(&field),
            field: Learned::new(field, |f| f.params.len()),
            density,
            material: material.map(|m| Learned::new(m, |m| m.params.len())),
            display: LearnedDisplay {
                gamma: 1.0,
                adam: Adam::new(1),
            },
            photos: Photos {
                exposures,
                noted,
                poses,
            },
            surface: Surface { tracer, refinement },
            unseen: UnseenDirections::of(dataset, &frame),
            counts: Counts::default(),
        };
        trainer.derive();
        trainer
    }

    /// Takes one step on the current thread pool; `progress` in 0..1 drives the learning rates' decay.
    pub fn step(&mut self, progress: f32) -> StepStats {
        self.step_by_stage(progress, &mut |_| ())
    }

    /// [`Self::step`], reporting after each stage that it is done: for benchmarks, since the trainer has no clock.
    pub fn step_by_stage(&mut self, progress: f32, on_done: &mut dyn FnMut(Stage)) -> StepStats {
        self.prepare(progress);
        on_done(Stage::Prepare);
        self.encode();
        on_done(Stage::Encode);
        self.run_chunks();
        on_done(Stage::Networks);
        let stats = self.stats();
        self.counts.step += 1;
        if stats.skipped {
            self.counts.skipped += 1;
            return stats;
        }
        self.gather_gradients();
        on_done(Stage::Gather);
        self.update(progress);
        on_done(Stage::Update);
        if self.counts.step.is_multiple_of(PROBE_EVERY) {
            self.probe_density();
            on_done(Stage::Probe);
        }
        stats
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.counts.step
    }

    /// Steps that learned nothing because a value was not finite.
    pub fn skipped_steps(&self) -> u64 {
        self.counts.skipped
    }

    /// What the shortcuts left out of the last step, counted now: costs about a hundredth of a step.
    pub fn skips(&self) -> SkipShares {
        let mut counts = SkipCounts::default();
        for chunk in &self.work.chunks {
            counts.add(&chunk.batch, self.field.value.levels(), &self.density);
        }
        SkipShares::of(&counts)
    }

    /// Field samples a ray.
    pub fn samples_per_ray(&self) -> f32 {
        self.n_samples() as f32
    }

    fn n_samples(&self) -> usize {
        match self.material {
            Some(_) => self.config.samples_per_ray,
            None => self.config.samples_per_ray_alone,
        }
    }

    /// The learned exponent of the display transform.
    pub fn gamma(&self) -> f32 {
        self.display.gamma
    }

    /// The mesh's tracer, when there is an object.
    pub fn tracer(&self) -> Option<&Arc<SurfaceTracer>> {
        self.surface.tracer.as_ref()
    }

    /// The model as it stands: a copy of the parameters.
    pub fn snapshot(&self) -> Snapshot {
        let place = EnvironmentPlace {
            name: self.place.name.clone(),
            frame: self.place.frame,
            gamma: self.display.gamma,
            n_samples: self.config.render_samples,
            up: self.place.up,
        };
        let object = self
            .material
            .as_ref()
            .zip(self.surface.tracer.as_ref())
            .map(|(material, tracer)| {
                Arc::new(ObjectModel {
                    tracer: Arc::clone(tracer),
                    material: Arc::new(SurfaceField::Grid(material.value.clone())),
                })
            });
        let environment = Environment::new(place, self.field.value.clone(), self.density.clone());
        let photos = self.photos.noted.as_ref().zip(self.gains());
        Snapshot {
            step: self.counts.step,
            object,
            environment: Arc::new(environment),
            exposures: photos.map(|(photos, gains)| Arc::new(photos.with_gains(gains))),
        }
    }

    fn context(&self) -> StepContext<'_> {
        let explored = self.counts.step as f32 / self.config.exploration_steps.max(1) as f32;
        StepContext {
            config: &self.config,
            pixels: &self.pixels,
            frame: &self.place.frame,
            field: &self.field.value,
            field_transposed: &self.field.transposed,
            density: &self.density,
            batch_size: self.work.batch_size,
            material: self.material.as_ref().map(|m| &m.value),
            material_transposed: self
                .material
                .as_ref()
                .map_or(&[][..], |m| m.transposed.as_slice()),
            display: Display {
                gamma: self.display.gamma,
            },
            gains: self.gains().unwrap_or_default(),
            finds_exposures: (self.photos.exposures.as_ref())
                .is_some_and(|e| e.are_sought(self.counts.step)),
            finds_poses: (self.photos.poses.as_ref())
                .is_some_and(|p| p.are_sought(self.counts.step)),
            unseen: &self.unseen,
            offsets: self.surface.refinement.as_ref().map(|r| &r.offsets),
            tilts: self.counts.step >= refinement::DELAY,
            step: self.counts.step,
            samples_per_ray: self.n_samples(),
            uniform_share: (1.0 - explored).max(self.config.uniform_share),
        }
    }

    /// Draws and places every chunk's rays.
    pub(in crate::train) fn prepare(&mut self, progress: f32) {
        let mut chunks = std::mem::take(&mut self.work.chunks);
        self.work.batch_size = BatchSize::of(&self.config, progress);
        let size = self.work.batch_size;
        let context = self.context();
        let backgrounds = size.backgrounds * usize::from(self.pixels.n_backgrounds() > 0);
        let objects = context.material.map_or(0, |_| size.objects);
        // Without an object its share of the work goes to the background.
        let backgrounds = if objects == 0 {
            let n = (backgrounds + size.objects) * self.config.samples_per_ray;
            n.div_ceil(self.n_samples())
        } else {
            backgrounds
        };
        chunks
            .par_iter_mut()
            .for_each(|chunk| chunk.prepare(&context, objects, backgrounds));
        self.work.chunks = chunks;
    }

    /// Encodes the step from the tables in bf16.
    fn encode(&mut self) {
        let tables = std::mem::take(&mut self.work.tables);
        self.encode_by_level(|field, level, batch, out| {
            field.encode_level_bf16(level, &tables, batch, out);
        });
        self.work.tables = tables;
    }

    /// Encodes level by level over the whole step: each level's table stays in its core's cache.
    pub(super) fn encode_by_level(
        &mut self,
        encode_level: impl Fn(&RadianceField, usize, &FieldBatch, &mut [f32]) + Sync,
    ) {
        let (field, chunks) = (&self.field.value, &self.work.chunks);
        let n: usize = chunks.iter().map(|c| c.batch.n()).sum();
        self.work
            .encoded
            .par_iter_mut()
            .enumerate()
            .rev()
            .for_each(|(level, out)| {
                out.resize(n * FEATURES, 0.0);
                let mut rest = out.as_mut_slice();
                for chunk in chunks {
                    let (head, tail) = rest.split_at_mut(chunk.batch.n() * FEATURES);
                    encode_level(field, level, &chunk.batch, head);
                    rest = tail;
                }
            });
    }

    pub(in crate::train) fn run_chunks(&mut self) {
        let mut chunks = std::mem::take(&mut self.work.chunks);
        let starts: Vec<usize> = chunks
            .iter()
            .scan(0, |end, chunk| {
                let start = *end;
                *end += chunk.batch.n();
                Some(start)
            })
            .collect();
        let context = self.context();
        let encoded = &self.work.encoded;
        chunks
            .par_iter_mut()
            .zip(starts)
            .for_each(|(chunk, start)| {
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
    pub(in crate::train) fn loss(&self) -> f64 {
        let [object, background] = self.pixel_losses();
        object
            + f64::from(self.config.background_weight) * background
            + self.sum(|c| c.loss.smoothness + c.loss.priors)
    }

    pub(super) fn sum(&self, of: fn(&Chunk) -> f64) -> f64 {
        self.work.chunks.iter().map(of).sum()
    }

    fn stats(&self) -> StepStats {
        let [object, background] = self.pixel_losses();
        StepStats {
            loss: self.loss() as f32,
            loss_object: object as f32,
            loss_background: background as f32,
            rays: self
                .work
                .chunks
                .iter()
                .map(|c| c.batch.rays.len() as u32)
                .sum(),
            samples: self.work.chunks.iter().map(|c| c.batch.n() as u32).sum(),
            skipped: !self.work.chunks.iter().all(|c| c.is_finite),
        }
    }
}
