//! An environment: the radiance field with everything needed to light any object, and its file.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::estimated_lamps::EstimatedLamps;
use super::lobe::SHARPEST_VARIANCE;
use crate::data::files::tensor_file::TensorFile;
use crate::geometry::Aabb;
use crate::neif::NeifError;
use crate::neif::distant::{DistantConfig, DistantLight};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::field::floor::Floor;
use crate::neif::field::radiance_field::{FieldBatch, FieldConfig, RadianceField};
use crate::neif::field::seen_grid::SeenGrid;
use crate::neif::paper::ray_pass::{PaperPlacement, RayLight};
use crate::neif::paper::{PaperField, PaperFieldConfig};
use crate::neif::storage::{DISTANT, FieldFormat, GRID, PAPER, Storage, StoredField, header_text};

static FORMAT: FieldFormat = FieldFormat {
    name: "neif-environment-1",
    header: "environment",
    out_of_range: "describes a field outside the supported range, or an inner box that is empty or not finite",
    params: "field.params",
    grid: "field.grid",
};
/// The array of the density cache.
const CODES: &str = "density.codes";
/// Uniform share of the sample placement when rendering: the density cache has settled.
const UNIFORM_SHARE: f32 = 0.05;
/// The same for the paper's second pass, in training too: mip-NeRF adds 0.01 to each of 128 weights of sum 1.
pub const PAPER_UNIFORM_SHARE: f32 = 0.56;

/// What is stored beside the arrays.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header<P, C> {
    #[serde(flatten)]
    place: P,
    field: C,
}

/// The radiance field of an environment, with what its sampling needs.
#[derive(Clone, Debug)]
pub enum EnvironmentField {
    /// The fast field, sampled by its density cache.
    Grid {
        /// The radiance field.
        field: RadianceField,
        /// Where its samples go.
        density: DensityGrid,
    },
    /// The paper's network, sampled in two passes.
    Paper(PaperField),
    /// A picture of an infinitely far environment, or of one on a floor.
    Distant(DistantLight),
}

/// What an environment is, without its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum EnvironmentKind {
    /// A fast field, trained on photos.
    Trained,
    /// A network of the paper, trained on photos.
    #[strum(to_string = "paper network")]
    PaperNetwork,
    /// A picture of all directions.
    Panorama,
}

impl EnvironmentKind {
    /// That of an environment file, of which only the beginning is read.
    ///
    /// # Errors
    /// When the file does not begin as an environment's.
    pub fn of_file(path: &Path) -> Result<Self, NeifError> {
        let stored = FORMAT.read_metadata(path)?;
        match stored.kind() {
            GRID => Ok(Self::Trained),
            PAPER => Ok(Self::PaperNetwork),
            DISTANT => Ok(Self::Panorama),
            _ => Err(stored.unknown_kind()),
        }
    }
}

/// Working memory of [`Environment::light`], reused from call to call.
#[derive(Debug, Default)]
pub struct LightScratch {
    encoded: Vec<f32>,
    passes: RayLight,
}

/// A radiance field in its place; immutable and shared.
#[derive(Clone, Debug)]
pub struct Environment {
    place: EnvironmentPlace,
    field: EnvironmentField,
    lamps: Option<Arc<EstimatedLamps>>,
}

/// What an [`Environment`] is made from, beside the field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnvironmentPlace {
    /// Shown in lists.
    pub name: String,
    /// The inner box.
    pub frame: FieldFrame,
    /// Learned exponent of the display transform `srgb(x)^gamma` (Eq. 7); 1 is plain sRGB.
    pub gamma: f32,
    /// Samples a ray when rendering; of the paper's field, in each of its two passes.
    pub n_samples: usize,
    /// Unit up direction of the capture.
    pub up: Vec3,
}

impl Environment {
    /// Puts a field with its density in its place.
    pub fn new(place: EnvironmentPlace, field: RadianceField, density: DensityGrid) -> Self {
        Self::of_field(place, EnvironmentField::Grid { field, density })
    }

    /// Puts a network of the paper in its place.
    pub fn of_paper(place: EnvironmentPlace, field: PaperField) -> Self {
        Self::of_field(place, EnvironmentField::Paper(field))
    }

    fn of_field(place: EnvironmentPlace, field: EnvironmentField) -> Self {
        Self {
            place,
            field,
            lamps: None,
        }
    }

    /// An environment that is infinitely far; its inner box is one for the camera to start in.
    pub fn of_distant(name: String, up: Vec3, light: DistantLight) -> Self {
        let place = EnvironmentPlace {
            name,
            frame: FieldFrame {
                center: Vec3::ZERO,
                half_side: 1.0,
            },
            gamma: 1.0,
            n_samples: 1,
            up,
        };
        Self::of_field(place, EnvironmentField::Distant(light))
    }

    /// The same environment with lamps as bright as they are estimated, or as the field has them.
    pub fn with_lamps(mut self, lamps: Option<EstimatedLamps>) -> Self {
        self.lamps = lamps.map(Arc::new);
        self
    }

    /// How bright its lamps are estimated to be; `None` where nothing is known but the field.
    pub fn estimated_lamps(&self) -> Option<&EstimatedLamps> {
        self.lamps.as_deref()
    }

    /// Whether it is a panorama without a floor.
    pub fn lacks_floor(&self) -> bool {
        matches!(&self.field, EnvironmentField::Distant(light) if !light.config.has_floor)
    }

    /// A panorama put on a level floor, `height` scene units below its camera; its inner box ends there. Any other
    /// environment is returned as it is.
    pub fn on_floor(mut self, height: f32) -> Self {
        if let EnvironmentField::Distant(light) = &mut self.field {
            light.config.has_floor = true;
            self.place.frame.half_side = height;
        }
        self
    }

    /// The same field without what it has where `is_void` (world coordinates) says so; `None` of fields that cannot be cut.
    pub(crate) fn hollowed(&self, is_void: impl Fn(Vec3) -> bool) -> Option<Self> {
        let EnvironmentField::Grid { field, density } = &self.field else {
            return None;
        };
        let mut density = density.clone();
        density.hollow(|p| is_void(self.place.frame.world_from_field(Vec3::from(p))));
        Some(Self {
            lamps: self.lamps.clone(),
            ..Self::new(self.place.clone(), field.clone(), density)
        })
    }

    /// Shown in lists.
    pub fn name(&self) -> &str {
        &self.place.name
    }

    /// The same environment under another name.
    pub fn renamed(mut self, name: &str) -> Self {
        name.clone_into(&mut self.place.name);
        self
    }

    /// The radiance field.
    pub fn field(&self) -> &EnvironmentField {
        &self.field
    }

    /// The floor under it, where one is known.
    pub fn floor(&self) -> Option<Floor> {
        match &self.field {
            EnvironmentField::Grid { density, .. } => density.floor,
            _ => None,
        }
    }

    /// Whether `other` holds the same field in the same place.
    pub fn is_same_light(&self, other: &Self) -> bool {
        let kind = |e: &Self| std::mem::discriminant(&e.field);
        // Asked for every picture: the same value needs no look at millions of numbers.
        std::ptr::eq(self, other)
            || (self.place.frame, self.place.gamma) == (other.place.frame, other.place.gamma)
                && self.is_far() == other.is_far()
                && kind(self) == kind(other)
                && self.params() == other.params()
    }

    /// All parameters of the field.
    pub fn params(&self) -> &[f32] {
        match &self.field {
            EnvironmentField::Grid { field, .. } => &field.params,
            EnvironmentField::Paper(field) => &field.params,
            EnvironmentField::Distant(light) => light.params(),
        }
    }

    /// Whether the environment is infinitely far: then moving or scaling it changes nothing.
    pub fn is_far(&self) -> bool {
        match &self.field {
            EnvironmentField::Grid { field, .. } => field.config.is_far,
            EnvironmentField::Paper(_) => false,
            EnvironmentField::Distant(light) => !light.config.has_floor,
        }
    }

    /// Whether it is known where along a ray its light comes from, so that an object can stand on it. The paper's network does
    /// not determine it.
    pub fn has_surfaces(&self) -> bool {
        !self.is_far() && !matches!(self.field, EnvironmentField::Paper(_))
    }

    /// Variance per transverse axis of the sharpest cone that the field was taught, which every cone of a lobe has on top of
    /// its own; 0 where cones may be as sharp as rays.
    pub fn sharpest_variance(&self) -> f32 {
        match &self.field {
            EnvironmentField::Grid { .. } => SHARPEST_VARIANCE,
            EnvironmentField::Paper(_) | EnvironmentField::Distant(_) => 0.0,
        }
    }

    /// The inner box of the field.
    pub fn frame(&self) -> &FieldFrame {
        &self.place.frame
    }

    /// The inner box in world coordinates.
    pub fn inner_box(&self) -> Aabb {
        let half = Vec3::splat(self.place.frame.half_side);
        Aabb {
            min: self.place.frame.center - half,
            max: self.place.frame.center + half,
        }
    }

    /// Exponent of the display transform; 1 is plain sRGB.
    pub fn gamma(&self) -> f32 {
        self.place.gamma
    }

    /// Samples a ray when rendering.
    pub fn n_samples(&self) -> usize {
        self.place.n_samples
    }

    /// Unit up direction of the capture.
    pub fn up(&self) -> Vec3 {
        self.place.up
    }

    /// How surely photos showed where the light of a ray of an evaluated batch comes from, `[0, 1]`; 1 where nobody knows.
    pub fn seen_share(&self, batch: &FieldBatch, ray: usize) -> f32 {
        let EnvironmentField::Grid { density, .. } = &self.field else {
            return 1.0;
        };
        density.seen.as_ref().map_or(1.0, |seen| {
            batch.mean_over_light(ray, |cell| seen.share(cell))
        })
    }

    /// Whether any photo showed a part of it; true where nobody knows.
    pub fn is_seen(&self) -> bool {
        let EnvironmentField::Grid { density, .. } = &self.field else {
            return true;
        };
        density.seen.as_ref().is_none_or(SeenGrid::is_any)
    }

    /// Linear radiance along `batch.rays`, into `batch.radiance`.
    pub fn light(&self, batch: &mut FieldBatch, scratch: &mut LightScratch) {
        self.light_by(usize::MAX, batch, scratch);
    }

    /// [`Self::light`] with at most so many samples a ray, at least 1.
    pub fn light_by(&self, most: usize, batch: &mut FieldBatch, scratch: &mut LightScratch) {
        let n_samples = self.n_samples().min(most);
        match &self.field {
            EnvironmentField::Grid { field, density } => {
                field.place(batch, density, n_samples, UNIFORM_SHARE, |_| [0.0; 2]);
                field.encode(batch, &mut scratch.encoded);
                field.forward(batch);
            }
            EnvironmentField::Paper(field) => {
                let placement = PaperPlacement {
                    n_samples,
                    uniform_share: PAPER_UNIFORM_SHARE,
                    shifts: [0.0; 2],
                };
                let rays = batch.rays.iter();
                let radiance = rays.map(|ray| field.radiance(ray, placement, &mut scratch.passes));
                batch.radiance.clear();
                batch.radiance.extend(radiance);
            }
            EnvironmentField::Distant(light) => {
                if light.config.has_floor {
                    batch.end_at(|ray| light.radiance_above_floor(ray));
                } else {
                    batch.radiance.clear();
                    let radiance = batch.rays.iter().map(|ray| light.radiance(ray));
                    batch.radiance.extend(radiance);
                }
            }
        }
    }

    /// Reads an environment file.
    ///
    /// # Errors
    /// When the file is no environment, lacks an array, or holds values that are not finite.
    pub fn load(path: &Path) -> Result<Self, NeifError> {
        let stored = FORMAT.read(path)?;
        let (place, field) = match stored.kind() {
            GRID => {
                let (place, config) = placed(&stored, FieldConfig::is_sane)?;
                let field = stored.made(|params| RadianceField::from_params(config, params))?;
                let density = stored_density(&stored.file)?;
                (place, EnvironmentField::Grid { field, density })
            }
            PAPER => {
                let (place, config) = placed(&stored, PaperFieldConfig::is_sane)?;
                let field = stored.made(|params| PaperField::from_params(config, params))?;
                (place, EnvironmentField::Paper(field))
            }
            DISTANT => {
                let (place, config) = placed(&stored, DistantConfig::is_sane)?;
                let mut is_negative = false;
                let light = stored.made(|params| {
                    is_negative = params.iter().any(|v| *v < 0.0);
                    DistantLight::new(config, &params)
                });
                if is_negative {
                    return Err(stored.out_of_range());
                }
                (place, EnvironmentField::Distant(light?))
            }
            _ => return Err(stored.unknown_kind()),
        };
        let lamps = EstimatedLamps::stored(&stored.file)?;
        Ok(Self::of_field(place, field).with_lamps(lamps))
    }

    /// Writes the file whole or not at all, grid values as `storage` says.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path, storage: Storage) -> Result<(), NeifError> {
        let mut file = TensorFile::default();
        self.lamps.iter().for_each(|lamps| lamps.store(&mut file));
        let (kind, header, n_networks) = match &self.field {
            EnvironmentField::Grid { field, density } => {
                let codes = density.codes();
                file.insert_u16(CODES, &[codes.len()], codes);
                density.floor.iter().for_each(|f| f.store(&mut file));
                density.seen.iter().for_each(|s| s.store(&mut file));
                let header = self.place.header(field.config);
                (GRID, header, field.n_network_params())
            }
            EnvironmentField::Paper(field) => {
                let header = self.place.header(field.config);
                (PAPER, header, field.params.len())
            }
            EnvironmentField::Distant(light) => (DISTANT, self.place.header(light.config), 0),
        };
        let params = (storage, self.params(), n_networks);
        FORMAT.write(file, path, (kind, header), params)
    }
}

/// Place and shape of a stored field.
fn placed<C: DeserializeOwned>(
    stored: &StoredField,
    is_sane: impl Fn(&C) -> bool,
) -> Result<(EnvironmentPlace, C), NeifError> {
    let is_sane = |h: &Header<EnvironmentPlace, C>| h.place.is_sane() && is_sane(&h.field);
    let Header { place, field } = stored.header(is_sane)?;
    Ok((place, field))
}

/// The density of a stored grid.
fn stored_density(file: &TensorFile) -> Result<DensityGrid, NeifError> {
    let n_codes = DensityGrid::default().codes().len();
    let mut density =
        DensityGrid::from_codes(file.u16(CODES, &[n_codes])?).expect("as many codes as there are");
    density.floor = Floor::stored(file)?;
    density.seen = SeenGrid::stored(file)?;
    Ok(density)
}

impl EnvironmentPlace {
    fn is_sane(&self) -> bool {
        self.frame.center.is_finite()
            && self.frame.half_side.is_finite()
            && self.frame.half_side > 0.0
            && (1..=1024).contains(&self.n_samples)
            && (0.05..=20.0).contains(&self.gamma)
    }

    fn header(&self, field: impl Serialize) -> String {
        header_text(&Header { place: self, field })
    }
}

#[cfg(test)]
mod tests;
