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
use crate::neif::light::lobe::perceptual_roughness;
use crate::neif::paper::{PaperMaterial, PaperMaterialConfig};
use crate::neif::storage::{FieldFormat, GRID, PAPER, Storage, StoredField, header_text};

static FORMAT: FieldFormat = FieldFormat {
    name: "neif-object-1",
    header: "object",
    out_of_range: "describes a field outside the supported range",
    params: "material.params",
    grid: "material.grid",
};

/// Mesh and material, shared between threads.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    /// The surface.
    pub tracer: Arc<SurfaceTracer>,
    /// What it is made of.
    pub material: Arc<SurfaceField>,
}

impl ObjectModel {
    /// Both, where there are both.
    pub fn of(tracer: Option<&Arc<SurfaceTracer>>, material: Option<SurfaceField>) -> Option<Self> {
        Some(Self {
            tracer: Arc::clone(tracer?),
            material: Arc::new(material?),
        })
    }
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
        let stored = FORMAT.read(path)?;
        match stored.kind() {
            GRID => {
                let h = stored_header(&stored, MaterialConfig::is_sane)?;
                let made = |params| Material::from_params(h.material, h.corner, h.side, params);
                stored.made(made).map(Self::Grid)
            }
            PAPER => {
                let h = stored_header(&stored, PaperMaterialConfig::is_sane)?;
                let made =
                    |params| PaperMaterial::from_params(h.material, h.corner, h.side, params);
                stored.made(made).map(Self::Paper)
            }
            _ => Err(stored.unknown_kind()),
        }
    }

    /// Writes the file whole or not at all, grid values as `storage` says.
    ///
    /// # Errors
    /// When the system refuses, e.g. because the disk is full.
    pub fn save(&self, path: &Path, storage: Storage) -> Result<(), NeifError> {
        let (kind, header, n_networks) = match self {
            Self::Grid(m) => {
                let header = header(m.corner, m.side, m.config);
                (GRID, header, m.n_network_params())
            }
            Self::Paper(m) => {
                let header = header(m.corner, m.side, m.config);
                (PAPER, header, m.params.len())
            }
        };
        let params = (storage, self.params(), n_networks);
        FORMAT.write(TensorFile::default(), path, (kind, header), params)
    }
}

fn header(corner: Vec3, side: f32, material: impl Serialize) -> String {
    header_text(&Header {
        corner,
        side,
        material,
    })
}

/// The header of a stored material.
fn stored_header<C: DeserializeOwned>(
    stored: &StoredField,
    is_sane: impl Fn(&C) -> bool,
) -> Result<Header<C>, NeifError> {
    let has_cube = |h: &Header<C>| h.corner.is_finite() && h.side.is_finite() && h.side > 0.0;
    stored.header(|h| has_cube(h) && is_sane(&h.material))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::networks::hash_grid::GridConfig;

    #[test]
    fn a_saved_material_comes_back_the_same() {
        let config = MaterialConfig {
            grid: GridConfig::SMALL,
            n_hidden: 16,
            rgb_tint: true,
        };
        let grid = Material::new(config, Vec3::ONE, 2.0, || 0.7);
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
