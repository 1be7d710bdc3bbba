//! What all chunks of a step read.

use glam::Vec3;

use super::batch_size::BatchSize;
use super::config::TrainConfig;
use super::normal_offsets::NormalOffsets;
use super::pixels::PixelStore;
use super::unseen_light::UnseenDirections;
use crate::neif::contraction::FieldFrame;
use crate::neif::density_grid::DensityGrid;
use crate::neif::display::Display;
use crate::neif::material::Material;
use crate::neif::mlp::Transposed;
use crate::neif::radiance_field::{FieldTransposed, RadianceField};

/// What all chunks of a step read.
#[derive(Clone, Copy)]
pub(super) struct StepContext<'a> {
    pub(super) config: &'a TrainConfig,
    pub(super) pixels: &'a PixelStore,
    pub(super) frame: &'a FieldFrame,
    pub(super) field: &'a RadianceField,
    pub(super) field_transposed: &'a FieldTransposed,
    pub(super) density: &'a DensityGrid,
    pub(super) batch_size: BatchSize,
    pub(super) material: Option<&'a Material>,
    pub(super) material_transposed: &'a Transposed,
    pub(super) display: Display,
    /// What each photo's exposure multiplies radiance by; empty where all are alike.
    pub(super) gains: &'a [Vec3],
    /// Whether exposures are sought.
    pub(super) finds_exposures: bool,
    /// Whether the photos' poses are refined.
    pub(super) finds_poses: bool,
    /// Where no photo looks.
    pub(super) unseen: &'a UnseenDirections,
    /// Corrections of the normals, where they are refined, and whether they are learned yet.
    pub(super) offsets: Option<&'a NormalOffsets>,
    pub(super) tilts: bool,
    pub(super) step: u64,
    pub(super) samples_per_ray: usize,
    pub(super) uniform_share: f32,
}

impl StepContext<'_> {
    /// Pairs of rays a step into directions in which no photo looks.
    pub(super) fn n_unseen_pairs(&self) -> usize {
        let is_asked = self.material.is_some()
            && self.unseen.share() > 0.0
            && self.step >= u64::from(self.config.evenness_delay);
        usize::from(is_asked) * self.config.unseen_pairs
    }

    /// The gain of a training view.
    pub(super) fn gain(&self, view: usize) -> Vec3 {
        self.gains.get(view).copied().unwrap_or(Vec3::ONE)
    }
}
