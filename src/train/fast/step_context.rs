//! What all chunks of a step read.

use glam::Vec3;

use super::batch_size::BatchSize;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::radiance_field::RadianceField;
use crate::neif::light::display::Display;
use crate::neif::surface::material::Material;
use crate::train::config::TrainConfig;
use crate::train::pixels::store::PixelStore;
use crate::train::priors::glare::{self, UnseenDirections};
use crate::train::shape::normal_offsets::NormalOffsets;

/// What all chunks of a step read.
#[derive(Clone, Copy)]
pub(in crate::train) struct StepContext<'a> {
    pub(in crate::train) config: &'a TrainConfig,
    pub(in crate::train) pixels: &'a PixelStore,
    pub(in crate::train) frame: &'a FieldFrame,
    pub(in crate::train) field: &'a RadianceField,
    pub(in crate::train) field_transposed: &'a [f32],
    pub(in crate::train) density: &'a DensityGrid,
    pub(in crate::train) batch_size: BatchSize,
    pub(in crate::train) material: Option<&'a Material>,
    pub(in crate::train) material_transposed: &'a [f32],
    pub(in crate::train) display: Display,
    /// What each photo's exposure multiplies radiance by; empty where all are alike.
    pub(in crate::train) gains: &'a [Vec3],
    /// Whether exposures are sought.
    pub(in crate::train) finds_exposures: bool,
    /// Whether the photos' poses are refined.
    pub(in crate::train) finds_poses: bool,
    /// Where photos show nothing.
    pub(in crate::train) unseen: &'a UnseenDirections,
    /// Corrections of the normals, where they are refined, and whether they are learned yet.
    pub(in crate::train) offsets: Option<&'a NormalOffsets>,
    pub(super) tilts: bool,
    pub(in crate::train) step: u64,
    pub(in crate::train) samples_per_ray: usize,
    pub(in crate::train) uniform_share: f32,
}

impl StepContext<'_> {
    /// Groups of [`glare::GROUP`] rays a step into directions in which no photo shows what is far away.
    pub(super) fn n_glare_groups(&self) -> usize {
        let is_asked =
            self.material.is_some() && self.pixels.n_backgrounds() > 0 && self.unseen.share() > 0.0;
        usize::from(is_asked) * self.config.glare_rays.div_ceil(glare::GROUP)
    }

    /// The gain of a training view.
    pub(in crate::train) fn gain(&self, view: usize) -> Vec3 {
        self.gains.get(view).copied().unwrap_or(Vec3::ONE)
    }
}
