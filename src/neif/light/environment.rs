//! An environment: the radiance field with everything needed to light any object, and its file.

use std::path::Path;

use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

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
use crate::neif::storage::{ParamNames, Storage, read_params};

/// The arrays of the field.
const NAMES: ParamNames = ParamNames {
    params: "field.params",
    grid: "field.grid",
};
/// Marks the metadata of an environment file.
const FORMAT: &str = "neif-environment-1";
/// Metadata entry that names the kind of field; a file without it holds a grid.
pub(in crate::neif) const KIND: &str = "kind";
/// The kinds, in environment and object files.
pub(in crate::neif) const GRID: &str = "grid";
pub(in crate::neif) const PAPER: &str = "paper";
const DISTANT: &str = "distant";
/// Uniform share of the sample placement when rendering: the density cache has settled.
const UNIFORM_SHARE: f32 = 0.05;
/// The same for the paper's second pass, in training too: mip-NeRF adds 0.01 to each of 128 weights of sum 1.
pub const PAPER_UNIFORM_SHARE: f32 = 0.56;

/// What is stored beside the arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header<C> {
    name: String,
    frame: FieldFrame,
    gamma: f32,
    n_samples: usize,
    up: Vec3,
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
    /// A picture of an infinitely far environment.
    Distant(DistantLight),
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
}

/// What an [`Environment`] is made from, beside the field.
#[derive(Clone, Debug, PartialEq)]
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
        let field = EnvironmentField::Grid { field, density };
        Self { place, field }
    }

    /// Puts a network of the paper in its place.
    pub fn of_paper(place: EnvironmentPlace, field: PaperField) -> Self {
        let field = EnvironmentField::Paper(field);
        Self { place, field }
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
        let field = EnvironmentField::Distant(light);
        Self { place, field }
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
            EnvironmentField::Grid { field, .. } => field.config().is_far,
            EnvironmentField::Paper(_) => false,
            EnvironmentField::Distant(_) => true,
        }
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
                batch.radiance.clear();
                let radiance = batch.rays.iter().map(|ray| light.radiance(ray));
                batch.radiance.extend(radiance);
            }
        }
    }

    /// Reads an environment file.
    ///
    /// # Errors
    /// When the file is no environment, lacks an array, or holds values that are not finite.
    pub fn load(path: &Path) -> Result<Self, NeifError> {
        let file = TensorFile::read(path)?;
        if file.text("format")? != FORMAT {
            return Err(metadata(
                path,
                "format",
                format!("is not `{FORMAT}`: no environment file"),
            ));
        }
        match kind(&file) {
            GRID => Self::load_grid(&file, path),
            PAPER => Self::load_paper(&file, path),
            DISTANT => Self::load_distant(&file, path),
            other => Err(unknown_kind(path, other)),
        }
    }

    fn load_grid(file: &TensorFile, path: &Path) -> Result<Self, NeifError> {
        let header: Header<FieldConfig> = read_header(file, path)?;
        let (place, config) = header.split();
        check(path, place_is_sane(&place) && config.is_sane())?;
        let params = read_params(file, path, NAMES)?;
        let found = params.len();
        let field = RadianceField::from_params(config, params).ok_or_else(|| NeifError::Shape {
            file: path.to_owned(),
            tensor: NAMES.params,
            found,
        })?;
        let n_codes = DensityGrid::default().codes().len();
        let mut density = DensityGrid::from_codes(file.u16("density.codes", &[n_codes])?)
            .ok_or_else(|| NeifError::Shape {
                file: path.to_owned(),
                tensor: "density.codes",
                found: n_codes,
            })?;
        density.floor = Floor::stored(file)?;
        density.seen = SeenGrid::stored(file)?;
        Ok(Self::new(place, field, density))
    }

    fn load_paper(file: &TensorFile, path: &Path) -> Result<Self, NeifError> {
        let header: Header<PaperFieldConfig> = read_header(file, path)?;
        let (place, config) = header.split();
        check(path, place_is_sane(&place) && config.is_sane())?;
        let params = read_params(file, path, NAMES)?;
        let found = params.len();
        let field = PaperField::from_params(config, params).ok_or_else(|| NeifError::Shape {
            file: path.to_owned(),
            tensor: NAMES.params,
            found,
        })?;
        Ok(Self::of_paper(place, field))
    }

    fn load_distant(file: &TensorFile, path: &Path) -> Result<Self, NeifError> {
        let header: Header<DistantConfig> = read_header(file, path)?;
        let (place, config) = header.split();
        check(path, place_is_sane(&place) && config.is_sane())?;
        let params = read_params(file, path, NAMES)?;
        check(path, params.iter().all(|v| *v >= 0.0))?;
        let light = DistantLight::new(config, &params).ok_or_else(|| NeifError::Shape {
            file: path.to_owned(),
            tensor: NAMES.params,
            found: params.len(),
        })?;
        let field = EnvironmentField::Distant(light);
        Ok(Self { place, field })
    }

    /// Writes the file whole or not at all, grid values as `storage` says.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path, storage: Storage) -> Result<(), NeifError> {
        let mut file = TensorFile::default();
        let (kind, header, n_networks) = match &self.field {
            EnvironmentField::Grid { field, density } => {
                let codes = density.codes();
                file.insert_u16("density.codes", &[codes.len()], codes);
                density.floor.iter().for_each(|f| f.store(&mut file));
                density.seen.iter().for_each(|s| s.store(&mut file));
                (GRID, self.header(*field.config()), field.n_network_params())
            }
            EnvironmentField::Paper(field) => {
                (PAPER, self.header(*field.config()), field.params.len())
            }
            EnvironmentField::Distant(light) => (DISTANT, self.header(*light.config()), 0),
        };
        storage.insert(&mut file, NAMES, self.params(), n_networks);
        for (key, value) in [("format", FORMAT), (KIND, kind), ("environment", &header)] {
            file.metadata.insert(key.to_owned(), value.to_owned());
        }
        Ok(file.write(path)?)
    }

    fn header<C: Serialize>(&self, field: C) -> String {
        let EnvironmentPlace {
            name,
            frame,
            gamma,
            n_samples,
            up,
        } = self.place.clone();
        serde_json::to_string(&Header {
            name,
            frame,
            gamma,
            n_samples,
            up,
            field,
        })
        .expect("plain numbers and strings serialise")
    }
}

impl<C> Header<C> {
    fn split(self) -> (EnvironmentPlace, C) {
        let place = EnvironmentPlace {
            name: self.name,
            frame: self.frame,
            gamma: self.gamma,
            n_samples: self.n_samples,
            up: self.up,
        };
        (place, self.field)
    }
}

/// Which kind of field a file holds.
pub(in crate::neif) fn kind(file: &TensorFile) -> &str {
    file.metadata.get(KIND).map_or(GRID, String::as_str)
}

pub(in crate::neif) fn unknown_kind(path: &Path, kind: &str) -> NeifError {
    metadata(
        path,
        KIND,
        format!("is `{kind}`, which this version does not know"),
    )
}

fn read_header<C: DeserializeOwned>(
    file: &TensorFile,
    path: &Path,
) -> Result<Header<C>, NeifError> {
    serde_json::from_str(file.text("environment")?)
        .map_err(|e| metadata(path, "environment", e.to_string()))
}

pub(in crate::neif) fn metadata(path: &Path, field: &'static str, what: String) -> NeifError {
    NeifError::Metadata {
        file: path.to_owned(),
        field,
        what,
    }
}

fn check(path: &Path, is_sane: bool) -> Result<(), NeifError> {
    if is_sane {
        return Ok(());
    }
    Err(metadata(
        path,
        "environment",
        "describes a field outside the supported range, or an inner box that is empty or not finite"
            .to_owned(),
    ))
}

fn place_is_sane(place: &EnvironmentPlace) -> bool {
    place.frame.center.is_finite()
        && place.frame.half_side.is_finite()
        && place.frame.half_side > 0.0
        && (1..=1024).contains(&place.n_samples)
        && (0.05..=20.0).contains(&place.gamma)
}

#[cfg(test)]
mod tests;
