//! What is known of the environment beyond the colours of single pixels, as losses or as air that stays empty.
//!
//! Before training: `depth_evidence` (plane sweep over neighbouring photos), `ground`, `void`, `line_of_sight` and
//! `camera_space`. As losses of each step: `distortion`, `agreement`, `unseen` and `glare`.

pub(super) mod agreement;
pub(super) mod camera_space;
pub(super) mod depth_evidence;
pub(super) mod distortion;
pub(super) mod glare;
pub(super) mod ground;
pub(super) mod line_of_sight;
pub(super) mod unseen;
pub(super) mod void;

use std::ops::Range;

use glam::Affine3A;

use crate::data::{Dataset, View};
use crate::geometry::Projector;
use crate::neif::field::radiance_field::FieldBatch;

/// The training photos, of very many `most`, evenly chosen.
fn some_views(dataset: &Dataset, most: usize) -> impl Iterator<Item = &View> {
    let stride = dataset.train.len().div_ceil(most).max(1);
    dataset.train.iter().step_by(stride)
}

/// Their cameras, ready for many points of the world.
fn some_projectors(dataset: &Dataset, most: usize) -> Vec<Projector> {
    some_views(dataset, most)
        .map(|view| view.camera.projector(Affine3A::IDENTITY))
        .collect()
}

/// Lets `of_samples` see the batch and add to its gradient by the compositing weights; it gets the samples of a ray by its index.
fn add_weight_gradient(
    batch: &mut FieldBatch,
    of_samples: impl FnOnce(&FieldBatch, &dyn Fn(usize) -> Range<usize>, &mut [f32]) -> f64,
) -> f64 {
    let mut d_weights = std::mem::take(&mut batch.d_weights);
    d_weights.resize(batch.weights().len(), 0.0);
    let n = batch.weights().len() / batch.rays.len().max(1);
    let sum = of_samples(batch, &|ray| ray * n..(ray + 1) * n, &mut d_weights);
    batch.d_weights = d_weights;
    sum
}
