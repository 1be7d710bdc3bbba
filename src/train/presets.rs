//! The built-in settings, by name.

use super::TrainError;
use super::config::{PhotoFit, TrainConfig};
use super::paper::PaperConfig;
use crate::neif::field::radiance_field::FieldConfig;
use crate::neif::light::environment::PAPER_UNIFORM_SHARE;
use crate::neif::networks::hash_grid::GridConfig;

impl TrainConfig {
    /// For many sharp photos and more than two minutes: an environment of finer cells in tables four times as large. They lie
    /// outside the cores' caches, so that a step takes twice as long, and each value is met by fewer rays.
    fn quality() -> Self {
        let fast = Self::default();
        Self {
            field: FieldConfig {
                grid: GridConfig {
                    finest: 1536,
                    log2_table_size: 18,
                    ..fast.field.grid
                },
                ..fast.field
            },
            ..fast
        }
    }

    /// The paper's model, losses and weights: the slow reference. What the paper leaves open is mip-NeRF's (rates,
    /// decay), with a batch that suits a CPU: a ray costs a billion operations.
    fn paper() -> Self {
        Self {
            paper: Some(PaperConfig::default()),
            photo_exposures: PhotoFit::Off,
            refine_poses: PhotoFit::Off,
            shared_chroma: false,
            object_pixels: 32,
            background_pixels: 32,
            batch_growth: 0.0,
            samples_per_ray: 128,
            samples_per_ray_alone: 128,
            render_samples: 128,
            grid_decay: 0.0,
            network_rate: 5e-4,
            final_rate: 0.01,
            background_weight: 0.1,
            unseen_triples_alone: 0,
            glare_rays: 0,
            distortion_weight: 0.0,
            depth_weight: 0.0,
            agreement_groups_alone: 0,
            roughness_delay: 0,
            bounces: 0,
            subpixels: false,
            uniform_share: PAPER_UNIFORM_SHARE,
            ..Self::default()
        }
    }

    /// The built-in preset of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn preset(name: &str) -> Result<Self, TrainError> {
        match name {
            "fast" => Ok(Self::default()),
            "quality" => Ok(Self::quality()),
            "paper" => Ok(Self::paper()),
            _ => Err(TrainError::Config {
                field: "preset",
                what: format!(
                    "`{name}` is not known; known: fast, quality, paper, or a .toml file"
                ),
            }),
        }
    }
}
