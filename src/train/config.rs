//! Everything that decides a training result; written beside it.

use serde::{Deserialize, Serialize};

use super::TrainError;
use super::paper::PaperConfig;
use crate::neif::field::radiance_field::{CutOff, FieldConfig};
use crate::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};
use crate::neif::surface::material::MaterialConfig;
use crate::render::path::trace::MAX_VERTICES;

/// Pixels that a validation measures, over all validation views.
const VALIDATION_PIXELS: usize = 16_384;
/// The same where a pixel costs a hundred times as much.
const PAPER_VALIDATION_PIXELS: usize = 1024;

/// Whether the normals of the object's mesh are refined while training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Normals {
    /// Where the mesh was made from masks or depth maps.
    #[default]
    Auto,
    /// Never: they are right.
    Given,
    /// Always.
    Refined,
}

/// Whether something of the photos, their exposures, poses or backgrounds, is looked at while training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase", try_from = "NotedFit")]
pub enum PhotoFit {
    /// Where the photos ask for it: exposures and poses are used once what is found is more than the fields are wrong.
    #[default]
    #[value(skip)]
    Auto,
    /// Always.
    #[value(help = None::<&'static str>)]
    On,
    /// Never.
    #[value(help = None::<&'static str>)]
    Off,
}

/// [`PhotoFit`] in a file; runs from before noted a flag, or the rate of learning it.
#[derive(Deserialize)]
#[serde(untagged)]
enum NotedFit {
    Flag(bool),
    Rate(f32),
    Name(String),
}

impl TryFrom<NotedFit> for PhotoFit {
    type Error = String;

    fn try_from(noted: NotedFit) -> Result<Self, String> {
        let is_on = match noted {
            NotedFit::Flag(is_on) => is_on,
            NotedFit::Rate(rate) => rate > 0.0,
            NotedFit::Name(name) => match name.as_str() {
                "auto" => return Ok(Self::Auto),
                "on" => true,
                "off" => false,
                _ => return Err(format!("`{name}` is none of auto, on, off")),
            },
        };
        Ok(if is_on { Self::On } else { Self::Off })
    }
}

/// Settings of a training run. Lengths are relative to the capture unless a unit is named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Seed of all random choices.
    pub seed: u64,
    /// Worker threads; 0 is all cores. The result does not depend on it.
    pub threads: usize,
    /// Object pixels a step.
    pub object_pixels: usize,
    /// Background pixels a step.
    pub background_pixels: usize,
    /// By how many times these the batch has grown at the end of the plan. Small steps find the scene quickly; later the
    /// noise of a small batch is what limits, and what a step costs whatever its size is shared by more rays.
    pub batch_growth: f32,
    /// Field samples a ray while training.
    pub samples_per_ray: usize,
    /// The same without an object, with as many fewer rays a step: photos that look around see each place from few
    /// sides, and with few samples each photo keeps a copy of it of its own.
    pub samples_per_ray_alone: usize,
    /// Field samples a ray when rendering.
    pub render_samples: usize,
    /// Half side of the field's inner box, in largest distances of a camera from its centre.
    pub inner_box_scale: f32,
    /// The environment's radiance field.
    pub field: FieldConfig,
    /// The object's surface field.
    pub material: MaterialConfig,
    /// Learning rate of grid values.
    pub grid_rate: f32,
    /// Weight of half the square of each grid value in the loss of a step that changes it, at first; it falls as the square of
    /// the learning rates. What the photos determine little stays smooth: Adam's steps are as long there as anywhere.
    pub grid_decay: f32,
    /// Learning rate of network weights.
    pub network_rate: f32,
    /// Learning rate of the display gamma.
    pub gamma_rate: f32,
    /// Whether exposure and white balance of each training photo are found (a gain a colour, 1 in the mean over the photos)
    /// where they are not read off the ground.
    #[serde(alias = "exposure_rate")]
    pub photo_exposures: PhotoFit,
    /// Whether the poses of the training photos are refined.
    pub refine_poses: PhotoFit,
    /// Whether object pixels whose chroma their photo's file has in common are compared by each one's luma and the mean of their
    /// chroma, drawn together.
    pub shared_chroma: bool,
    /// Whether the environment is learned from the background of the photos, not from reflections alone. `Auto`: where
    /// there is no object, or the background is neither cut away nor stands still in the picture as on a turntable.
    pub background: PhotoFit,
    /// Whether the mesh's normals are refined.
    pub normals: Normals,
    /// Steps over which the learning rates rise from zero.
    pub warmup_steps: u32,
    /// What is left of the learning rates at the end of the planned run (exponential decay).
    pub final_rate: f32,
    /// Weight of background and pre-convolved pixels against object pixels (`lambda_p`).
    pub background_weight: f32,
    /// Weight of the bilateral smoothness of roughness and tint (`lambda_s`, Eq. 8).
    pub smoothness_weight: f32,
    /// Share of background pixels drawn from blurred levels.
    pub preconvolved_share: f32,
    /// Blurred levels beside the sharp one: standard deviations 1, 2, 4, 8, 16 pixels.
    pub preconvolved_levels: usize,
    /// Triples of rays a step from where no camera stood, without an object; 0 is none.
    pub unseen_triples_alone: usize,
    /// Weight of the bend of what they meet against background pixels.
    pub planarity_weight: f32,
    /// Weight, against background pixels, of what keeps their light in one place along each ray, with an object and where
    /// the photos' exposures differ; 0 is none.
    pub distortion_weight: f32,
    /// Weight, against background pixels, of their light coming from where neighbouring photos place it; 0 is none.
    pub depth_weight: f32,
    /// Groups of cones a step whose light should agree over their widths, without an object; 0 is none.
    pub agreement_groups_alone: usize,
    /// Weight of their disagreement.
    pub agreement_weight: f32,
    /// Rays a step into directions in which no photo shows what is far away, with an object; 0 is none.
    #[serde(alias = "unseen_pairs")]
    pub glare_rays: usize,
    /// Weight of their light brighter than white, where most of it is, times the share of all directions that these are; falls
    /// with what the object mirrors.
    pub glare_weight: f32,
    /// Pull of the diffuse part of what reflects like a metal towards black: no real surface has both.
    pub metal_weight: f32,
    /// Radiance that clipped light is pulled to. A photo says no more of a lamp than that it
    /// is brighter than white; left alone it stays there or grows without end, and what is rough, or lit by it, is wrong.
    pub clipped_radiance: f32,
    /// Weight of that pull against object pixels.
    pub clipped_weight: f32,
    /// Weight of that pull without an object: nothing else says how bright a lamp is.
    pub clipped_weight_alone: f32,
    /// Steps before roughness is learned: while the environment is still blurred, every surface would seem a mirror,
    /// and a mirror gives no gradient back to roughness.
    pub roughness_delay: u32,
    /// How often a reflection that meets the object again is followed; 0 is never, 3 the most.
    pub bounces: usize,
    /// Whether pixels whose mirror image turns fast (edges within the object, strong curvature, grazing views) are trained
    /// by several narrower beams.
    pub subpixels: bool,
    /// Steps over which the uniform share of the sample placement falls from 1 to `uniform_share`.
    pub exploration_steps: u32,
    /// Uniform share of the sample placement after that.
    pub uniform_share: f32,
    /// Which samples are left out of the backward pass.
    pub gradient_cut_off: CutOff,
    /// Pixels kept for training; larger captures are thinned at random.
    pub max_pixels: usize,
    /// Whether training may end before its budget when the validation error has settled.
    pub early_stop: bool,
    /// The paper's networks instead of the fast fields, when there; see [`PaperConfig`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper: Option<PaperConfig>,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            threads: 0,
            object_pixels: 512,
            background_pixels: 512,
            batch_growth: 1.0,
            samples_per_ray: 12,
            samples_per_ray_alone: 24,
            render_samples: 24,
            inner_box_scale: 1.1,
            field: FieldConfig {
                grid: GridConfig {
                    n_levels: 8,
                    coarsest: 16,
                    finest: 768,
                    log2_table_size: 16,
                    least_weight: LEAST_WEIGHT,
                },
                n_hidden: 64,
                view_dependent: true,
                integrated: true,
                is_far: false,
            },
            material: MaterialConfig {
                grid: GridConfig {
                    n_levels: 4,
                    coarsest: 12,
                    finest: 192,
                    log2_table_size: 16,
                    least_weight: LEAST_WEIGHT,
                },
                n_hidden: 64,
                rgb_tint: true,
            },
            grid_rate: 1e-2,
            grid_decay: 4e-7,
            network_rate: 1e-2,
            gamma_rate: 5e-4,
            photo_exposures: PhotoFit::Auto,
            refine_poses: PhotoFit::Auto,
            shared_chroma: true,
            background: PhotoFit::Auto,
            normals: Normals::Auto,
            warmup_steps: 50,
            final_rate: 0.1,
            background_weight: 0.2,
            smoothness_weight: 1e-4,
            preconvolved_share: 0.3,
            preconvolved_levels: 5,
            unseen_triples_alone: 64,
            planarity_weight: 0.01,
            distortion_weight: 0.01,
            depth_weight: 0.3,
            agreement_groups_alone: 16,
            agreement_weight: 0.001,
            glare_rays: 32,
            glare_weight: 0.003,
            metal_weight: 0.01,
            clipped_radiance: 5.0,
            clipped_weight: 0.1,
            clipped_weight_alone: 0.1,
            roughness_delay: 300,
            bounces: MAX_VERTICES - 1,
            subpixels: true,
            exploration_steps: 1000,
            uniform_share: 0.1,
            gradient_cut_off: CutOff {
                lobes: 0.1,
                pixels: 0.3,
            },
            max_pixels: 12_000_000,
            early_stop: true,
            paper: None,
        }
    }
}

impl TrainConfig {
    /// Settings from TOML; what it does not name keeps the value of the preset that its entry `preset` names, or of
    /// `fast`.
    ///
    /// # Errors
    /// When a field is unknown, has the wrong type or is out of range.
    pub fn from_toml(text: &str) -> Result<Self, TrainError> {
        let damaged = |what: String| TrainError::Config {
            field: "toml",
            what,
        };
        let mut table: toml::Table = toml::from_str(text).map_err(|e| damaged(e.to_string()))?;
        let config: Self = match table.remove("preset") {
            None => toml::from_str(text).map_err(|e| damaged(e.to_string()))?,
            Some(toml::Value::String(name)) => {
                let preset = Self::preset(&name)?.to_toml();
                let preset = toml::from_str(&preset).map_err(|e| damaged(e.to_string()))?;
                let merged = toml::Value::Table(overlaid(preset, table));
                merged
                    .try_into()
                    .map_err(|e: toml::de::Error| damaged(e.to_string()))?
            }
            Some(_) => return Err(damaged("`preset` is not a name".to_owned())),
        };
        config.validate()?;
        Ok(config)
    }

    /// Pixels that a validation measures: few enough to be cheap beside the training between two of them.
    pub(super) fn validation_pixels(&self) -> usize {
        if self.paper.is_some() {
            PAPER_VALIDATION_PIXELS
        } else {
            VALIDATION_PIXELS
        }
    }

    /// All settings as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("plain numbers serialise")
    }

    /// Refuses settings that cannot train.
    ///
    /// # Errors
    /// Naming the first field that is out of range.
    pub fn validate(&self) -> Result<(), TrainError> {
        let positive = |v: f32| v.is_finite() && v > 0.0;
        let not_negative = |v: f32| v.is_finite() && v >= 0.0;
        let checks: [(&'static str, bool); 22] = [
            ("threads", self.threads <= 1024),
            ("object_pixels", (1..=1 << 16).contains(&self.object_pixels)),
            (
                "background_pixels",
                (1..=1 << 16).contains(&self.background_pixels),
            ),
            ("batch_growth", (0.0..=100.0).contains(&self.batch_growth)),
            ("samples_per_ray", (2..=256).contains(&self.samples_per_ray)),
            (
                "samples_per_ray_alone",
                (2..=256).contains(&self.samples_per_ray_alone),
            ),
            ("render_samples", (2..=256).contains(&self.render_samples)),
            ("inner_box_scale", positive(self.inner_box_scale)),
            ("field.grid", self.field.grid.is_sane()),
            ("material.grid", self.material.grid.is_sane()),
            ("field.n_hidden", self.field.is_sane()),
            ("material.n_hidden", self.material.is_sane()),
            (
                "grid_rate or network_rate",
                positive(self.grid_rate) && positive(self.network_rate),
            ),
            (
                "gamma_rate or grid_decay",
                not_negative(self.gamma_rate) && not_negative(self.grid_decay),
            ),
            (
                "final_rate",
                positive(self.final_rate) && self.final_rate <= 1.0,
            ),
            (
                "background_weight, smoothness_weight, distortion_weight or depth_weight",
                positive(self.background_weight)
                    && not_negative(self.smoothness_weight)
                    && not_negative(self.distortion_weight)
                    && not_negative(self.depth_weight),
            ),
            (
                "unseen_triples_alone, planarity_weight, glare_rays or glare_weight",
                self.unseen_triples_alone <= 1 << 16
                    && not_negative(self.planarity_weight)
                    && self.glare_rays <= 1 << 16
                    && not_negative(self.glare_weight),
            ),
            (
                "agreement_groups_alone or agreement_weight",
                self.agreement_groups_alone <= 1 << 14 && not_negative(self.agreement_weight),
            ),
            (
                "gradient_cut_off",
                (0.0..1.0).contains(&self.gradient_cut_off.lobes)
                    && (0.0..1.0).contains(&self.gradient_cut_off.pixels),
            ),
            ("bounces", self.bounces < MAX_VERTICES),
            (
                "preconvolved_levels",
                self.preconvolved_levels <= 5 && (0.0..1.0).contains(&self.preconvolved_share),
            ),
            (
                "paper (one path a pixel: bounces = 0, subpixels = false, uniform_share up to 1; no exposures or poses)",
                self.paper.is_none_or(|paper| {
                    let has_one_path = self.bounces == 0 && !self.subpixels;
                    let is_plain = [self.photo_exposures, self.refine_poses] == [PhotoFit::Off; 2];
                    let is_share = (0.0..=1.0).contains(&self.uniform_share);
                    paper.is_sane() && has_one_path && is_plain && is_share
                }),
            ),
        ];
        match checks.iter().find(|(_, ok)| !ok) {
            Some((field, _)) => Err(TrainError::Config {
                field,
                what: "is out of range".to_owned(),
            }),
            None => Ok(()),
        }
    }
}

/// `base` with the entries of `over`, tables entry by entry.
fn overlaid(mut base: toml::Table, over: toml::Table) -> toml::Table {
    for (key, value) in over {
        let value = match (base.remove(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => {
                toml::Value::Table(overlaid(base, over))
            }
            (_, value) => value,
        };
        base.insert(key, value);
    }
    base
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_survive_toml() {
        let config = TrainConfig {
            seed: 7,
            background_weight: 0.25,
            ..TrainConfig::default()
        };
        assert_eq!(TrainConfig::from_toml(&config.to_toml()).unwrap(), config);
    }

    #[test]
    fn the_paper_s_settings_survive_toml_and_can_be_changed_one_by_one() {
        let paper = TrainConfig::preset("paper").unwrap();
        assert_eq!(TrainConfig::from_toml(&paper.to_toml()).unwrap(), paper);
        let text = "preset = \"paper\"\nseed = 3\n[paper.field]\nwidth = 64\n";
        let changed = TrainConfig::from_toml(text).unwrap();
        let mut expected = TrainConfig { seed: 3, ..paper };
        expected.paper.as_mut().unwrap().field.width = 64;
        assert_eq!(changed, expected);
    }

    #[test]
    fn unknown_and_absurd_fields_are_named() {
        assert!(
            TrainConfig::from_toml("speed = 9")
                .unwrap_err()
                .to_string()
                .contains("speed")
        );
        assert!(
            TrainConfig::from_toml("samples_per_ray = 0")
                .unwrap_err()
                .to_string()
                .contains("samples_per_ray")
        );
    }
}
