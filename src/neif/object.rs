//! The trained object: its surface and what it is made of.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use super::material::Material;

use super::NeifError;
use super::environment::{metadata, read_finite};
use super::material::MaterialConfig;
use crate::data::tensor_file::TensorFile;
use crate::geometry::SurfaceTracer;

/// Marks the metadata of an object file.
const FORMAT: &str = "neif-object-1";

/// Mesh and material, shared between threads.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    /// The surface.
    pub tracer: Arc<SurfaceTracer>,
    /// What it is made of.
    pub material: Arc<Material>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    corner: Vec3,
    side: f32,
    material: MaterialConfig,
}

impl Material {
    /// Reads an object file.
    ///
    /// # Errors
    /// When the file is no object file, lacks an array, or holds values that are not finite.
    pub fn load(path: &Path) -> Result<Self, NeifError> {
        let file = TensorFile::read(path)?;
        if file.text("format")? != FORMAT {
            return Err(metadata(
                path,
                "format",
                format!("is not `{FORMAT}`: no object file"),
            ));
        }
        let header: Header = serde_json::from_str(file.text("object")?)
            .map_err(|e| metadata(path, "object", e.to_string()))?;
        let is_sane = header.corner.is_finite()
            && header.side.is_finite()
            && header.side > 0.0
            && header.material.is_sane();
        if !is_sane {
            return Err(metadata(
                path,
                "object",
                "describes a field outside the supported range".to_owned(),
            ));
        }
        let params = read_finite(&file, path, "material.params")?;
        let found = params.len();
        Self::from_params(header.material, header.corner, header.side, params).ok_or_else(|| {
            NeifError::Shape {
                file: path.to_owned(),
                tensor: "material.params",
                found,
            }
        })
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path) -> Result<(), NeifError> {
        let mut file = TensorFile::default();
        file.metadata.insert("format".to_owned(), FORMAT.to_owned());
        let header = Header {
            corner: self.corner,
            side: self.side,
            material: *self.config(),
        };
        let header = serde_json::to_string(&header).expect("plain numbers serialise");
        file.metadata.insert("object".to_owned(), header);
        file.insert_f32("material.params", &[self.params.len()], self.params.clone());
        Ok(file.write(path)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::hash_grid::{GridConfig, LEAST_WEIGHT};

    #[test]
    fn a_saved_material_comes_back_the_same() {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 2,
            finest: 8,
            log2_table_size: 8,
            least_weight: LEAST_WEIGHT,
        };
        let material = Material::new(
            MaterialConfig {
                grid,
                n_hidden: 16,
                rgb_tint: true,
            },
            Vec3::ONE,
            2.0,
            || 0.7,
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("object.safetensors");
        material.save(&path).unwrap();
        let back = Material::load(&path).unwrap();
        assert_eq!(
            (back.params, back.corner, back.side),
            (material.params, material.corner, material.side)
        );
    }
}
