//! A trained environment: the radiance field with everything needed to light any object, and its file.

use std::path::Path;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::NeifError;
use super::contraction::FieldFrame;
use super::proposal::DensityGrid;
use super::radiance_field::{FieldConfig, RadianceField};
use crate::data::tensor_file::TensorFile;
use crate::geometry::Aabb;

/// Marks the metadata of an environment file.
const FORMAT: &str = "neif-environment-1";

/// What is stored beside the arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    name: String,
    frame: FieldFrame,
    gamma: f32,
    n_samples: usize,
    up: Vec3,
    field: FieldConfig,
}

/// A radiance field in its place; immutable and shared.
#[derive(Clone, Debug)]
pub struct Environment {
    header: Header,
    /// The radiance field.
    pub field: RadianceField,
    /// Where its samples go.
    pub density: DensityGrid,
}

/// What an [`Environment`] is made from, beside the field and its density.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentPlace {
    /// Shown in lists.
    pub name: String,
    /// The inner box.
    pub frame: FieldFrame,
    /// Learned exponent of the display transform `srgb(x)^gamma` (Eq. 7); 1 is plain sRGB.
    pub gamma: f32,
    /// Samples a ray when rendering.
    pub n_samples: usize,
    /// Unit up direction of the capture.
    pub up: Vec3,
}

impl Environment {
    /// Puts a field in its place.
    pub fn new(place: EnvironmentPlace, field: RadianceField, density: DensityGrid) -> Self {
        let EnvironmentPlace {
            name,
            frame,
            gamma,
            n_samples,
            up,
        } = place;
        let header = Header {
            name,
            frame,
            gamma,
            n_samples,
            up,
            field: *field.config(),
        };
        Self {
            header,
            field,
            density,
        }
    }

    /// Shown in lists.
    pub fn name(&self) -> &str {
        &self.header.name
    }

    /// The same environment under another name.
    pub fn renamed(mut self, name: &str) -> Self {
        name.clone_into(&mut self.header.name);
        self
    }

    /// The inner box of the field.
    pub fn frame(&self) -> &FieldFrame {
        &self.header.frame
    }

    /// The inner box in world coordinates.
    pub fn inner_box(&self) -> Aabb {
        let half = Vec3::splat(self.header.frame.half_side);
        Aabb {
            min: self.header.frame.center - half,
            max: self.header.frame.center + half,
        }
    }

    /// Exponent of the display transform; 1 is plain sRGB.
    pub fn gamma(&self) -> f32 {
        self.header.gamma
    }

    /// Samples a ray when rendering.
    pub fn n_samples(&self) -> usize {
        self.header.n_samples
    }

    /// Unit up direction of the capture.
    pub fn up(&self) -> Vec3 {
        self.header.up
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
        let header: Header = serde_json::from_str(file.text("environment")?)
            .map_err(|e| metadata(path, "environment", e.to_string()))?;
        check_header(path, &header)?;
        let params = read_finite(&file, path, "field.params")?;
        let found = params.len();
        let field =
            RadianceField::from_params(header.field, params).ok_or_else(|| NeifError::Shape {
                file: path.to_owned(),
                tensor: "field.params",
                found,
            })?;
        let n_codes = DensityGrid::default().codes().len();
        let density =
            DensityGrid::from_codes(file.u16("density.codes", &[n_codes])?).ok_or_else(|| {
                NeifError::Shape {
                    file: path.to_owned(),
                    tensor: "density.codes",
                    found: n_codes,
                }
            })?;
        Ok(Self {
            header,
            field,
            density,
        })
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path) -> Result<(), NeifError> {
        let mut file = TensorFile::default();
        file.metadata.insert("format".to_owned(), FORMAT.to_owned());
        let header =
            serde_json::to_string(&self.header).expect("plain numbers and strings serialise");
        file.metadata.insert("environment".to_owned(), header);
        file.insert_f32(
            "field.params",
            &[self.field.params.len()],
            self.field.params.clone(),
        );
        let codes = self.density.codes();
        file.insert_u16("density.codes", &[codes.len()], codes);
        Ok(file.write(path)?)
    }
}

/// All values of a one-dimensional array, refused when one is not finite.
pub(super) fn read_finite(
    file: &TensorFile,
    path: &Path,
    tensor: &'static str,
) -> Result<Vec<f32>, NeifError> {
    let n = file.tensor(tensor)?.values.len();
    let values = file.f32(tensor, &[n])?.to_vec();
    if values.iter().any(|v| !v.is_finite()) {
        return Err(NeifError::NotFinite {
            file: path.to_owned(),
            tensor,
        });
    }
    Ok(values)
}

pub(super) fn metadata(path: &Path, field: &'static str, what: String) -> NeifError {
    NeifError::Metadata {
        file: path.to_owned(),
        field,
        what,
    }
}

fn check_header(path: &Path, header: &Header) -> Result<(), NeifError> {
    let frame_is_sane = header.frame.center.is_finite()
        && header.frame.half_side.is_finite()
        && header.frame.half_side > 0.0;
    if !frame_is_sane {
        return Err(metadata(
            path,
            "environment",
            "has an inner box that is empty or not finite".to_owned(),
        ));
    }
    if !header.field.is_sane()
        || !(1..=1024).contains(&header.n_samples)
        || !(0.05..=20.0).contains(&header.gamma)
    {
        return Err(metadata(
            path,
            "environment",
            "describes a field outside the supported range".to_owned(),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::hash_grid::{GridConfig, LEAST_WEIGHT};

    fn environment() -> Environment {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 2,
            finest: 8,
            log2_table_size: 8,
            least_weight: LEAST_WEIGHT,
        };
        let field = RadianceField::new(
            FieldConfig {
                grid,
                n_hidden: 16,
                view_dependent: true,
                integrated: true,
                is_far: false,
            },
            || 0.3,
        );
        let frame = FieldFrame {
            center: Vec3::new(1.0, 2.0, 3.0),
            half_side: 4.0,
        };
        let place = EnvironmentPlace {
            name: "room".to_owned(),
            frame,
            gamma: 1.0,
            n_samples: 16,
            up: Vec3::Z,
        };
        Environment::new(place, field, DensityGrid::default())
    }

    #[test]
    fn a_saved_environment_comes_back_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("environment.safetensors");
        environment().save(&path).unwrap();
        let back = Environment::load(&path).unwrap();
        assert_eq!(back.header, environment().header);
        assert_eq!(back.field.params, environment().field.params);
    }

    #[test]
    fn damaged_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("environment.safetensors");
        environment().save(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 5, 100, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let error = Environment::load(&path).unwrap_err().to_string();
            assert!(error.contains("environment.safetensors"), "{error}");
        }
        let mut broken = environment();
        broken.field.params[7] = f32::NAN;
        broken.save(&path).unwrap();
        assert!(
            Environment::load(&path)
                .unwrap_err()
                .to_string()
                .contains("field.params"),
            "the tensor must be named"
        );
    }
}
