//! The trained object: its surface and what it is made of.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub use super::material::Material;

use super::material::{MaterialBatch, MaterialConfig};
use super::values::Surface;
use crate::data::files::tensor_file::TensorFile;
use crate::geometry::SurfaceTracer;
use crate::neif::NeifError;
use crate::neif::light::environment::{GRID, KIND, PAPER, kind, metadata, unknown_kind};
use crate::neif::light::lobe::perceptual_roughness;
use crate::neif::paper::{PaperMaterial, PaperMaterialConfig};
use crate::neif::storage::{ParamNames, Storage, read_params};

/// The arrays of the surface.
const NAMES: ParamNames = ParamNames {
    params: "material.params",
    grid: "material.grid",
};
/// Marks the metadata of an object file.
const FORMAT: &str = "neif-object-1";

/// Mesh and material, shared between threads.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    /// The surface.
    pub tracer: Arc<SurfaceTracer>,
    /// What it is made of.
    pub material: Arc<SurfaceField>,
}

/// M(x) of either model.
#[derive(Clone, Debug)]
pub enum SurfaceField {
    /// The fast one.
    Grid(Material),
    /// The paper's network.
    Paper(PaperMaterial),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header<C> {
    corner: Vec3,
    side: f32,
    material: C,
}

impl SurfaceField {
    /// Evaluates the surface at `points`, world coordinates, into `batch.surfaces`.
    pub fn forward(&self, points: &[Vec3], batch: &mut MaterialBatch, scratch: &mut Vec<f32>) {
        match self {
            Self::Grid(material) => material.forward(points, batch, scratch),
            Self::Paper(material) => {
                material.forward(points, &mut batch.paper, &mut batch.surfaces);
            }
        }
    }

    /// A surface with its roughness as renderers mean it ([`perceptual_roughness`]); the paper's network learns that.
    pub fn perceptual(&self, learned: Surface) -> Surface {
        match self {
            Self::Grid(_) => Surface {
                roughness: perceptual_roughness(learned.roughness),
                ..learned
            },
            Self::Paper(_) => learned,
        }
    }

    /// All parameters.
    pub fn params(&self) -> &[f32] {
        match self {
            Self::Grid(material) => &material.params,
            Self::Paper(material) => &material.params,
        }
    }

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
        match kind(&file) {
            GRID => Self::load_grid(&file, path),
            PAPER => Self::load_paper(&file, path),
            other => Err(unknown_kind(path, other)),
        }
    }

    fn load_grid(file: &TensorFile, path: &Path) -> Result<Self, NeifError> {
        let header: Header<MaterialConfig> = read_header(file, path)?;
        let params = header.params(file, path, header.material.is_sane())?;
        let found = params.len();
        Material::from_params(header.material, header.corner, header.side, params)
            .map(Self::Grid)
            .ok_or_else(|| shape_error(path, found))
    }

    fn load_paper(file: &TensorFile, path: &Path) -> Result<Self, NeifError> {
        let header: Header<PaperMaterialConfig> = read_header(file, path)?;
        let params = header.params(file, path, header.material.is_sane())?;
        let found = params.len();
        PaperMaterial::from_params(header.material, header.corner, header.side, params)
            .map(Self::Paper)
            .ok_or_else(|| shape_error(path, found))
    }

    /// Writes the file whole or not at all, grid values as `storage` says.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path, storage: Storage) -> Result<(), NeifError> {
        let mut file = TensorFile::default();
        let (kind, header, n_networks) = match self {
            Self::Grid(m) => {
                let header = header_text(m.corner, m.side, *m.config());
                (GRID, header, m.n_network_params())
            }
            Self::Paper(m) => {
                let header = header_text(m.corner, m.side, *m.config());
                (PAPER, header, m.params.len())
            }
        };
        for (key, value) in [("format", FORMAT), (KIND, kind), ("object", &header)] {
            file.metadata.insert(key.to_owned(), value.to_owned());
        }
        storage.insert(&mut file, NAMES, self.params(), n_networks);
        Ok(file.write(path)?)
    }
}

impl<C> Header<C> {
    /// The stored parameters, unless the header makes no sense.
    fn params(&self, file: &TensorFile, path: &Path, is_sane: bool) -> Result<Vec<f32>, NeifError> {
        let has_cube = self.corner.is_finite() && self.side.is_finite() && self.side > 0.0;
        if !is_sane || !has_cube {
            let what = "describes a field outside the supported range".to_owned();
            return Err(metadata(path, "object", what));
        }
        read_params(file, path, NAMES)
    }
}

fn header_text(corner: Vec3, side: f32, material: impl Serialize) -> String {
    let header = Header {
        corner,
        side,
        material,
    };
    serde_json::to_string(&header).expect("plain numbers serialise")
}

fn read_header<C: DeserializeOwned>(
    file: &TensorFile,
    path: &Path,
) -> Result<Header<C>, NeifError> {
    serde_json::from_str(file.text("object")?).map_err(|e| metadata(path, "object", e.to_string()))
}

fn shape_error(path: &Path, found: usize) -> NeifError {
    NeifError::Shape {
        file: path.to_owned(),
        tensor: NAMES.params,
        found,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};

    #[test]
    fn a_saved_material_comes_back_the_same() {
        let grid = GridConfig {
            n_levels: 4,
            coarsest: 2,
            finest: 8,
            log2_table_size: 8,
            least_weight: LEAST_WEIGHT,
        };
        let grid = Material::new(
            MaterialConfig {
                grid,
                n_hidden: 16,
                rgb_tint: true,
            },
            Vec3::ONE,
            2.0,
            || 0.7,
        );
        let config = PaperMaterialConfig {
            depth: 2,
            width: 16,
            ..PaperMaterialConfig::default()
        };
        let paper = PaperMaterial::new(config, Vec3::ONE, 2.0, || 0.7);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("object.safetensors");
        for material in [SurfaceField::Grid(grid), SurfaceField::Paper(paper)] {
            material.save(&path, Storage::F32).unwrap();
            let back = SurfaceField::load(&path).unwrap();
            assert_eq!(back.params(), material.params());
            match (back, material) {
                (SurfaceField::Grid(a), SurfaceField::Grid(b)) => {
                    assert_eq!((a.corner, a.side), (b.corner, b.side));
                }
                (SurfaceField::Paper(a), SurfaceField::Paper(b)) => {
                    assert_eq!((a.corner, a.side), (b.corner, b.side));
                }
                _ => panic!("another kind came back"),
            }
        }
    }
}
