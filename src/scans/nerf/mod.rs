//! Neural radiance fields of other programs, one file a format.
//!
//! `classic` is the original network, `ngp` and `nerfacto` fields with grids (`hash_field`); a [`Field`] answers with
//! densities and colours at points, `occupancy` knows where it has anything, `march` makes pictures of it. Everything in
//! here is in the field's own coordinates; [`Nerf`] stands between those and the scene's.

mod checkpoint;
mod classic;
mod field;
mod hash_field;
mod hash_grid;
mod layers;
mod march;
mod nerfacto;
mod ngp;
mod occupancy;
mod sphere;
#[cfg(test)]
mod tests;
mod torch_pickle;

use std::collections::HashSet;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use glam::{IVec3, Mat3, Vec3};
use rayon::prelude::*;

use self::checkpoint::Checkpoint;
use self::field::{Densities, Field, Scratch};
use self::march::{March, Steps};
use self::occupancy::{Cubes, Occupancy};
use super::picture::ScanPicture;
use crate::color::srgb_from_linear;
use crate::data::DataError;
use crate::geometry::{Aabb, Camera, Ray};

/// Bytes that say what a file is.
const HEAD: u64 = 256;
/// Points asked about at once.
const BATCH: usize = 4096;
/// Fraction of light that a cell of a surface takes at least.
const SOLID: f32 = 0.5;

/// A neural radiance field.
#[derive(Clone, Debug)]
pub struct Nerf {
    field: Arc<dyn Field>,
    description: String,
    field_from_scene: Similarity,
    cubes: Cubes,
    /// What is shown of them.
    shown: Aabb,
    /// Made when first looked at.
    occupancy: Arc<OnceLock<Occupancy>>,
    steps: Steps,
    colors: Colors,
}

/// What a field's colours are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Colors {
    Srgb,
    Linear,
}

/// Turned, scaled and moved: `scale * rotation * p + translation`.
#[derive(Clone, Copy, Debug)]
struct Similarity {
    rotation: Mat3,
    scale: f32,
    translation: Vec3,
}

impl Similarity {
    const IDENTITY: Self = Self {
        rotation: Mat3::IDENTITY,
        scale: 1.0,
        translation: Vec3::ZERO,
    };

    fn point(&self, p: Vec3) -> Vec3 {
        self.scale * (self.rotation * p) + self.translation
    }

    fn inverse_point(&self, p: Vec3) -> Vec3 {
        self.rotation.transpose() * (p - self.translation) / self.scale
    }
}

/// Whether the file holds a neural radiance field, by its first bytes.
pub(super) fn is_nerf(path: &Path) -> bool {
    let head = head(path);
    checkpoint::is_checkpoint(&head) || ngp::is_snapshot(&head)
}

/// A file's first bytes, or none.
fn head(path: &Path) -> Vec<u8> {
    let mut head = Vec::new();
    let file = File::open(path);
    match file.and_then(|file| file.take(HEAD).read_to_end(&mut head)) {
        Ok(_) => head,
        Err(_) => Vec::new(),
    }
}

/// Reads a neural radiance field of any supported format.
pub(super) fn read(path: &Path) -> Result<Nerf, DataError> {
    if ngp::is_snapshot(&head(path)) {
        return Ok(Nerf::of_snapshot(ngp::read(path)?));
    }
    let checkpoint = Checkpoint::read(path)?;
    if classic::is_classic(&checkpoint) {
        return Ok(Nerf::of_classic(classic::read(&checkpoint)?));
    }
    if nerfacto::is_nerfacto(&checkpoint) {
        return Ok(Nerf::of_nerfacto(nerfacto::read(&checkpoint)?));
    }
    let problem = "a checkpoint of torch, but of no radiance field that is known";
    Err(DataError::unusable(path, problem))
}

impl Nerf {
    /// In the box of the synthetic scenes.
    fn of_classic(field: classic::ClassicField) -> Self {
        let cubes = Cubes {
            center: Vec3::ZERO,
            half: 1.5,
            n_cascades: 1,
            n: 128,
        };
        Self {
            description: field.describe(),
            field: Arc::new(field),
            field_from_scene: Similarity::IDENTITY,
            cubes,
            shown: cubes.outer(),
            occupancy: Arc::default(),
            steps: Steps {
                min: 3.0 / 512.0,
                cone: 0.0,
                max_cells: 1.0,
                near: 0.0,
                far: f32::INFINITY,
            },
            colors: Colors::Srgb,
        }
    }

    /// In the cube of instant-ngp.
    fn of_snapshot(snapshot: ngp::Snapshot) -> Self {
        let cubes = Cubes {
            center: Vec3::splat(0.5),
            half: 0.5,
            n_cascades: snapshot.aabb_scale.ilog2() + 1,
            n: ngp::GRID,
        };
        let occupancy = OnceLock::new();
        if !snapshot.occupied.is_empty() {
            occupancy.get_or_init(|| {
                let n_cells = ngp::GRID.pow(3) as usize;
                Occupancy::from_cells(&cubes, |cascade, cell| {
                    snapshot.occupied[cascade as usize * n_cells + ngp::cell_index(cell)]
                })
            });
        }
        let [min, max] = snapshot.shown;
        Self {
            description: format!(
                "neural radiance field of instant-ngp ({})",
                snapshot.field.describe()
            ),
            field: Arc::new(snapshot.field),
            field_from_scene: Similarity {
                rotation: snapshot.rotation,
                scale: snapshot.scale,
                translation: snapshot.rotation * snapshot.offset,
            },
            cubes,
            shown: Aabb { min, max },
            occupancy: Arc::new(occupancy),
            steps: Steps {
                min: ngp::MIN_STEP,
                cone: if snapshot.aabb_scale > 1 {
                    1.0 / 256.0
                } else {
                    0.0
                },
                max_cells: 1.0,
                near: 0.0,
                far: f32::INFINITY,
            },
            colors: if snapshot.is_hdr {
                Colors::Linear
            } else {
                Colors::Srgb
            },
        }
    }

    /// In all of space, or a box.
    fn of_nerfacto(nerfacto: nerfacto::Nerfacto) -> Self {
        let (half, n_cascades, n) = match nerfacto.half {
            Some(half) => (half, 1, 128),
            None => (1.0, 11, 64),
        };
        let cubes = Cubes {
            center: Vec3::ZERO,
            half,
            n_cascades,
            n,
        };
        Self {
            description: format!(
                "neural radiance field of nerfacto ({})",
                nerfacto.field.describe()
            ),
            field: Arc::new(nerfacto.field),
            field_from_scene: Similarity {
                rotation: nerfacto.rotation,
                scale: nerfacto.scale,
                translation: nerfacto.scale * nerfacto.translation,
            },
            cubes,
            shown: cubes.outer(),
            occupancy: Arc::default(),
            steps: Steps {
                min: half / 256.0,
                cone: 1.0 / 128.0,
                max_cells: 1.0,
                near: 0.05,
                far: 1000.0,
            },
            colors: Colors::Srgb,
        }
    }

    /// What it is, for people.
    pub(super) fn describe(&self) -> String {
        self.description.clone()
    }

    /// The view of a pinhole camera; `None` when cancelled.
    pub(super) fn picture(&self, camera: &Camera, cancel: &AtomicBool) -> Option<ScanPicture> {
        let (width, height) = (camera.width, camera.height);
        let ray = |i: usize| {
            let (x, y) = (i % width as usize, i / width as usize);
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            Ray {
                origin: self.field_from_scene.point(ray.origin),
                direction: self.field_from_scene.rotation * ray.direction,
            }
        };
        let march = March {
            field: &*self.field,
            occupancy: self.occupancy(),
            steps: self.steps,
            shown: self.shown,
        };
        let seen = march.see(width as usize * height as usize, ray, cancel)?;
        let color = |color: [f32; 3]| match self.colors {
            Colors::Srgb => color,
            Colors::Linear => color.map(srgb_from_linear),
        };
        let scale = self.field_from_scene.scale;
        Some(ScanPicture {
            width,
            height,
            srgb: seen.iter().map(|seen| color(seen.color)).collect(),
            opacity: seen.iter().map(|seen| seen.opacity.min(1.0)).collect(),
            distance: seen.iter().map(|seen| seen.distance / scale).collect(),
        })
    }

    /// Points on what is visible, at most `most`.
    pub(super) fn surface_points(&self, most: usize) -> Vec<Vec3> {
        let occupancy = self.occupancy();
        let mut points = Vec::new();
        // What surrounds the scene says nothing about where it is, unless there is nothing else.
        for cascade in 0..occupancy.n_cascades() {
            if cascade < 2 || points.is_empty() {
                points.extend(self.solid_cells(occupancy, cascade));
            }
        }
        let n = points.len().min(most);
        let evenly = (0..n).map(|i| points[i * points.len() / n.max(1)]);
        evenly
            .map(|p| self.field_from_scene.inverse_point(p))
            .collect()
    }

    /// The middles of cells that take much light and from which not all six neighbours do.
    fn solid_cells(&self, occupancy: &Occupancy, cascade: u32) -> Vec<Vec3> {
        let (centers, width) = occupancy.occupied_cells(cascade);
        let is_solid = |density: f32| 1.0 - (-density * width).exp() > SOLID;
        let batches = centers.par_chunks(BATCH);
        let solid: Vec<Vec3> = batches
            .flat_map_iter(|centers| {
                let mut answers = Densities::default();
                self.field
                    .densities(centers, &mut Scratch::default(), &mut answers);
                let pairs = centers.iter().zip(answers.densities);
                pairs.filter_map(move |(p, density)| is_solid(density).then_some(*p))
            })
            .collect();
        let key = |p: Vec3| ((p - self.cubes.center) / width).floor().as_ivec3();
        let filled: HashSet<IVec3> = solid.iter().map(|p| key(*p)).collect();
        let axes = [IVec3::X, IVec3::Y, IVec3::Z];
        let is_inside = |p: &Vec3| {
            let mut sides = axes
                .iter()
                .flat_map(|axis| [key(*p) + axis, key(*p) - axis]);
            sides.all(|side| filled.contains(&side))
        };
        solid.into_iter().filter(|p| !is_inside(p)).collect()
    }

    fn occupancy(&self) -> &Occupancy {
        self.occupancy
            .get_or_init(|| Occupancy::of_field(&*self.field, &self.cubes))
    }
}
