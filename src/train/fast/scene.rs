//! The fast model as a scene: snapshots, and its surface as it moves: normals settled, a mesh of outlines moved, pixels traced
//! anew.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::model::Fast;
use super::skips::SkipShares;
use crate::data::Dataset;
use crate::neif::light::environment::{Environment, EnvironmentPlace};
use crate::neif::surface::object::{ObjectModel, SurfaceField};
use crate::train::config::TrainConfig;
use crate::train::photos::exposures::Exposures;
use crate::train::photos::poses::Poses;
use crate::train::preparation::retrace_pixels;
use crate::train::scene_model::SceneModel;
use crate::train::step::now::Now;
use crate::train::{Snapshot, TrainError};

impl SceneModel for Fast {
    fn snapshot(&self, step: u64) -> Snapshot {
        let place = EnvironmentPlace {
            gamma: self.display.gamma,
            ..self.place.clone()
        };
        let material = self.material.as_ref();
        let material = material.map(|m| SurfaceField::Grid(m.settled()));
        let object = ObjectModel::of(self.surface.tracer.as_ref(), material);
        let environment = Environment::new(place, self.field.settled(), self.density.clone());
        let photos = self.photos.noted.as_ref().zip(self.gains());
        Snapshot {
            step,
            object: object.map(Arc::new),
            environment: Arc::new(environment),
            exposures: photos.map(|(photos, gains)| Arc::new(photos.with_gains(gains))),
        }
    }

    fn samples_per_ray(&self, config: &TrainConfig) -> f32 {
        self.n_samples(config) as f32
    }

    fn findings(&self) -> Vec<String> {
        self.pixels.findings()
    }

    fn skips(&self) -> Option<SkipShares> {
        let batches = self.work.chunks.iter().map(|chunk| &chunk.batch);
        let levels = self.field.value.levels();
        Some(SkipShares::of(batches, levels, &self.density))
    }

    fn gains(&self) -> Option<&[Vec3]> {
        self.photos.exposures.as_ref().and_then(Exposures::gains)
    }

    fn poses(&self) -> Option<&Poses> {
        let poses = self.photos.poses.as_ref();
        poses.filter(|poses| poses.are_corrected())
    }

    fn refines_normals(&self) -> bool {
        self.surface.refinement.is_some()
    }

    fn settle_normals(&mut self, step: u64) {
        let refinement = self.surface.refinement.as_mut();
        if let Some(tracer) = refinement.and_then(|refinement| refinement.settled(step)) {
            self.surface.tracer = Some(Arc::new(tracer));
        }
    }

    fn move_surface(&mut self, dataset: &Dataset, cancel: &AtomicBool) -> Result<(), TrainError> {
        if let (Some(refinement), Some(tracer)) =
            (&mut self.surface.refinement, &self.surface.tracer)
        {
            let outlines = (&*self.pixels.cameras(), self.pixels.outline_error_px());
            if let Some(moved) = refinement.moved(tracer.mesh(), dataset, outlines, cancel)? {
                self.surface.tracer = Some(Arc::new(moved));
            }
        }
        Ok(())
    }

    fn needs_retracing(&self) -> bool {
        self.surface.tracer.is_some() && (self.refines_normals() || self.poses().is_some())
    }

    fn trace_rest(&mut self) {
        self.pixels.trace_drawn(u64::MAX);
    }

    fn retrace(
        &mut self,
        now: &Now<'_>,
        dataset: &Dataset,
        cancel: &AtomicBool,
        on_progress: &(dyn Fn(f32) + Sync),
    ) -> Result<(), TrainError> {
        let tracer = self.surface.tracer.as_ref();
        let (scene, n_drawn) = ((dataset, tracer), now.n_objects());
        let pixels = &mut self.pixels;
        retrace_pixels(pixels, now.config, scene, n_drawn, cancel, on_progress)?;
        if let (Some(refinement), Some(tracer)) = (&mut self.surface.refinement, tracer) {
            refinement.was_traced(tracer.mesh());
        }
        Ok(())
    }
}
