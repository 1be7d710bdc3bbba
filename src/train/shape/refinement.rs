//! Refinement of the mesh's normals while everything else is trained.
//!
//! The pixels' light paths are traced once. What is learned of the normals since then is added to those of their
//! vertices, step by step; now and then a corrected mesh is made of it for all to see, one made of outlines moved to where
//! its normals want it, and the paths are traced anew.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::normal_evidence::{NormalEvidence, NormalRow};
use super::normal_offsets::{NormalOffsets, OffsetBatch};
use super::stage_one::{self, KnownNormals, Refit, StageOneError};
use crate::data::Dataset;
use crate::data::files::tensor_file::TensorFile;
use crate::geometry::{Aabb, Camera, Mesh, SurfaceTracer};
use crate::train::TrainError;
use crate::train::config::{Normals, TrainConfig};
use crate::train::statistics::middle_or;
use crate::train::step::now::Now;
use crate::train::step::part::{Part, finite, insert};
use crate::train::step::tasks::Job;

/// Steps before normals are learned: until then the environment has no features to go by.
pub(in crate::train) const DELAY: u64 = 100;
/// Learning rates at the beginning and at the end, radians: what is smooth is to end without noise.
const RATES: [f32; 2] = [1e-3, 1e-4];

/// Pixels that two vertices of a mesh are apart at most, about.
const DETAIL_PX: f32 = 1.6;
/// Triangles that subdividing makes at most.
const MOST_TRIANGLES: usize = 1_500_000;

/// Corrections of the normals, and the mesh that they are of.
#[derive(Debug)]
pub(in crate::train) struct Refinement {
    pub(in crate::train) offsets: NormalOffsets,
    /// The mesh that the pixels were traced on.
    pub(in crate::train) traced: Arc<Mesh>,
    /// How sure its normals are, where it moves to them.
    pub(in crate::train) evidence: Option<NormalEvidence>,
    /// Whether photos show its place by a pattern; looked for where that is not known.
    has_pattern: Option<bool>,
    /// [`Dataset::object_box`].
    object_box: Aabb,
    /// The step that the trainer's mesh is of.
    settled_at: u64,
    /// Pixels that the gathered gradient is of.
    n_pixels: usize,
}

/// Whether a run with these settings refines the normals of the capture's mesh.
pub(in crate::train) fn is_wanted(config: &TrainConfig, dataset: &Dataset) -> bool {
    let is_made = || dataset.mesh.is_some() && dataset.mesh_path.is_none();
    config.paper.is_none()
        && match config.normals {
            Normals::Given => false,
            Normals::Refined => dataset.mesh.is_some(),
            Normals::Auto => is_made(),
        }
}

/// The capture's mesh for a run with these settings: where its normals are refined, with vertices about as near to each other
/// as pixels of the photos.
pub(in crate::train) fn mesh_to_refine(
    config: &TrainConfig,
    dataset: &Dataset,
) -> Option<Arc<Mesh>> {
    let mesh = Arc::clone(dataset.mesh.as_ref()?);
    if is_wanted(config, dataset) {
        return Some(with_detail(mesh, pixel_width(dataset)));
    }
    Some(mesh)
}

/// Width of the photos' pixels at the object, scene units, in the middle; infinite where there is none.
fn pixel_width(dataset: &Dataset) -> f32 {
    let Some(bounds) = dataset.object_box() else {
        return f32::INFINITY;
    };
    let cameras = dataset.train.iter().map(|view| &view.camera);
    let widths = cameras.map(|c| c.position().distance(bounds.center()) * c.pixel_angle());
    middle_or(f32::INFINITY, widths.collect())
}

/// The same surface with vertices as near to each other as asks for a normal a pixel of this width.
fn with_detail(mut mesh: Arc<Mesh>, pixel: f32) -> Arc<Mesh> {
    while mesh.edge_length() > DETAIL_PX * pixel && 4 * mesh.triangles.len() <= MOST_TRIANGLES {
        mesh = Arc::new(mesh.subdivided());
    }
    mesh
}

/// Learning rate where a run is by so large a share, radians.
fn rate(progress: f32) -> f32 {
    let [first, last] = RATES;
    first * (last / first).powf(progress.clamp(0.0, 1.0))
}

impl Refinement {
    /// Nothing is corrected yet; `None` where nothing shall be. The masks' outlines err by `outline_error_px` pixels.
    pub(in crate::train) fn of(
        config: &TrainConfig,
        dataset: &Dataset,
        tracer: Option<&SurfaceTracer>,
        outline_error_px: f32,
    ) -> Option<Self> {
        let mesh = tracer.filter(|_| is_wanted(config, dataset))?.mesh();
        // A given mesh is not made of the outlines.
        let is_made = dataset.mesh_path.is_none();
        let error_px = if is_made { outline_error_px } else { 0.0 };
        let moves = is_made && stage_one::is_of_outlines(dataset);
        let bounds = dataset.object_box()?;
        Some(Self {
            offsets: NormalOffsets::new(&bounds, error_px, pixel_width(dataset)),
            evidence: moves.then(|| NormalEvidence::new(&bounds)),
            has_pattern: None,
            object_box: bounds,
            traced: Arc::clone(mesh),
            settled_at: 0,
            n_pixels: 0,
        })
    }

    /// Takes up what `n_pixels` drawn pixels say of the normals.
    pub(in crate::train) fn gather<'a>(
        &mut self,
        batches: &[&OffsetBatch],
        n_pixels: usize,
        rows: impl Iterator<Item = &'a NormalRow>,
    ) {
        self.offsets.gather(batches);
        self.n_pixels = n_pixels;
        if let Some(evidence) = &mut self.evidence {
            evidence.add(rows);
        }
    }

    /// The mesh with the normals as they are known at `step`; `None` where it has been made.
    pub(in crate::train) fn settled(&mut self, step: u64) -> Option<SurfaceTracer> {
        if self.settled_at >= step {
            return None;
        }
        self.settled_at = step;
        Some(self.with_normals())
    }

    fn with_normals(&self) -> SurfaceTracer {
        SurfaceTracer::new(Arc::new(self.offsets.applied_to(&self.traced)))
    }

    /// Moves `mesh`, its own with settled normals, to where these want it, on the current thread pool, where it was made of
    /// outlines; they err by `error_px` pixels for photos taken by `cameras`. `None` where it stays, as when no surface is left.
    ///
    /// # Errors
    /// When cancelled.
    pub(in crate::train) fn moved(
        &mut self,
        mesh: &Mesh,
        dataset: &Dataset,
        (cameras, error_px): (&[Camera], f32),
        cancel: &AtomicBool,
    ) -> Result<Option<SurfaceTracer>, TrainError> {
        let Some(evidence) = &mut self.evidence else {
            return Ok(None);
        };
        let at_vertices = |of: fn(&NormalEvidence, Vec3) -> f32| -> Vec<f32> {
            let vertices = mesh.positions.par_iter();
            vertices.map(|p| of(evidence, *p)).collect()
        };
        let known = KnownNormals {
            mesh,
            deviations: &at_vertices(NormalEvidence::deviation),
            errors: &at_vertices(NormalEvidence::error),
        };
        let go_on = || !cancel.load(Ordering::Relaxed);
        let asked = (error_px, self.has_pattern.unwrap_or(true));
        match stage_one::refit(dataset, cameras, known, asked, &go_on) {
            Ok(Refit { mesh, has_pattern }) => {
                self.has_pattern = Some(has_pattern);
                evidence.clear();
                self.offsets.restart();
                self.traced = with_detail(Arc::new(mesh), pixel_width(dataset));
                Ok(Some(self.with_normals()))
            }
            Err(StageOneError::Cancelled) => Err(TrainError::Cancelled),
            Err(_no_surface) => Ok(None),
        }
    }

    /// The pixels were traced anew on `mesh`.
    pub(in crate::train) fn was_traced(&mut self, mesh: &Arc<Mesh>) {
        self.traced = Arc::clone(mesh);
        self.offsets.forget_recent();
    }
}

/// Names of the arrays of [`NormalEvidence::state`] and of the object's box, its two corners, in a checkpoint.
const EVIDENCE: [&str; 3] = ["normals.errors", "normals.slopes", "normals.counts"];
const OBJECT_BOX: &str = "normals.object_box";

/// The box of the mesh with which the run of a checkpoint began, where that has moved since.
pub(in crate::train) fn stored_box(file: &TensorFile) -> Option<Aabb> {
    let corners = file.f32(OBJECT_BOX, &[6]).ok()?;
    let stored = Aabb {
        min: Vec3::from_slice(&corners[..3]),
        max: Vec3::from_slice(&corners[3..]),
    };
    let is_sound = corners.iter().all(|v| v.is_finite()) && !stored.is_empty();
    is_sound.then_some(stored)
}

impl Part for Refinement {
    fn update<'a>(&'a mut self, now: &Now<'_>, _jobs: &mut Vec<Job<'a>>) {
        if now.step > DELAY {
            self.offsets.update(rate(now.progress), self.n_pixels);
        }
    }

    fn store(&self, file: &mut TensorFile) {
        self.offsets.store(file);
        let Some(evidence) = &self.evidence else {
            return;
        };
        for (name, sums) in EVIDENCE.into_iter().zip(evidence.state()) {
            insert(file, name, sums);
        }
        let Aabb { min, max } = self.object_box;
        insert(file, OBJECT_BOX, &[min.to_array(), max.to_array()].concat());
    }

    /// With no evidence, where the checkpoint lacks it or it is damaged.
    fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        self.offsets.restore(file)?;
        if let Some(evidence) = &mut self.evidence {
            let n = evidence.state()[0].len();
            let stored = EVIDENCE.map(|name| finite(file, name, n).unwrap_or_default());
            if stored.iter().all(|sums| sums.len() == n) {
                evidence.set_state(stored.each_ref().map(Vec::as_slice));
            }
        }
        Ok(())
    }
}
