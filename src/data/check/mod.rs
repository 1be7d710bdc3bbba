//! What a capture holds and what is wrong with it, for people and for scripts.
//!
//! [`check`] measures a loaded [`Dataset`]; the report prints as a page ([`std::fmt::Display`])
//! and serialises as JSON. It looks for the faults that ruin training quietly: masks that do not
//! fit the mesh, a mesh in another frame, empty masks, the same photo in training and test.

mod agreement;
mod page;
mod pixels;
mod statistics;

use std::path::PathBuf;

use serde::Serialize;

use super::{Dataset, Problem, Severity};

/// What [`check`] found.
#[derive(Clone, Debug, Serialize)]
pub struct DatasetReport {
    /// The capture's name.
    pub name: String,
    /// Its folder.
    pub root: PathBuf,
    /// Views by split.
    pub views: SplitCounts,
    /// Picture sizes, most frequent first.
    pub resolutions: Vec<Resolution>,
    /// Whether photos are linear and unclipped (EXR, HDR).
    pub hdr: bool,
    /// Whether photos show the surroundings.
    pub surroundings_visible: bool,
    /// The lenses.
    pub lens: LensSummary,
    /// Where the cameras are.
    pub cameras: CameraSummary,
    /// Object masks; `None` when no view has one.
    pub masks: Option<MaskSummary>,
    /// The mesh; `None` when there is none.
    pub mesh: Option<MeshSummary>,
    /// How well masks and mesh agree; `None` without either.
    pub agreement: Option<MaskAgreement>,
    /// Findings of loading and checking, worst first.
    pub problems: Vec<Problem>,
}

/// Views by split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SplitCounts {
    /// Training views.
    pub train: usize,
    /// Validation views.
    pub val: usize,
    /// Test views.
    pub test: usize,
}

/// A picture size and how many views have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Resolution {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Views of this size.
    pub n_views: usize,
}

/// The range of lenses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LensSummary {
    /// Shortest and longest horizontal focal length, pixels.
    pub focal_px: [f32; 2],
    /// Narrowest and widest horizontal field of view, degrees.
    pub fov_x_deg: [f32; 2],
    /// Whether any lens distorts.
    pub distorted: bool,
}

/// Where the cameras are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraSummary {
    /// The point nearest to all optical axes, world.
    pub look_at: [f32; 3],
    /// Nearest and farthest camera from it, scene units.
    pub distance: [f32; 2],
    /// The diagonal of the box around the cameras, scene units.
    pub extent: f32,
}

/// Object masks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MaskSummary {
    /// Views with a mask.
    pub n_views: usize,
    /// Mean share of the picture that is object.
    pub mean: f32,
    /// Smallest share.
    pub min: f32,
    /// Largest share.
    pub max: f32,
}

/// The mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSummary {
    /// The file.
    pub path: Option<PathBuf>,
    /// Vertices.
    pub n_vertices: usize,
    /// Triangles with an area.
    pub n_triangles: usize,
    /// Triangles without, dropped.
    pub n_degenerate: usize,
    /// Smallest coordinates.
    pub min: [f32; 3],
    /// Largest coordinates.
    pub max: [f32; 3],
    /// Surface area, square scene units.
    pub surface_area: f64,
    /// Edges with a triangle on one side only, vertices at one position taken as one.
    pub n_open_edges: usize,
    /// Edges with more than two triangles.
    pub n_branching_edges: usize,
    /// Whether there are neither.
    pub watertight: bool,
}

/// Overlap of masks with the mesh's silhouettes, as intersection over union.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaskAgreement {
    /// Views compared.
    pub n_views: usize,
    /// Mean over them.
    pub mean_iou: f32,
    /// The lowest.
    pub worst_iou: f32,
    /// The view that has it.
    pub worst_view: String,
}

impl DatasetReport {
    /// Whether any finding is an error.
    pub fn has_errors(&self) -> bool {
        self.problems.iter().any(|p| p.severity == Severity::Error)
    }
}

/// Measures and examines a capture. Runs on the current rayon pool; under a second for a hundred
/// small views.
pub fn check(dataset: &Dataset) -> DatasetReport {
    let mut problems = dataset.problems.clone();
    problems.extend(pixels::find_problems(dataset));
    let mesh = dataset
        .mesh
        .as_deref()
        .map(|mesh| statistics::mesh_summary(mesh, dataset.mesh_path.clone()));
    if let Some(mesh) = &mesh {
        problems.extend(statistics::mesh_problems(mesh));
    }
    let agreement = agreement::compare(dataset, &mut problems);
    problems.sort_by_key(|problem| problem.severity);
    DatasetReport {
        name: dataset.name.clone(),
        root: dataset.root.clone(),
        views: SplitCounts {
            train: dataset.train.len(),
            val: dataset.val.len(),
            test: dataset.test.len(),
        },
        resolutions: statistics::resolutions(dataset),
        hdr: dataset.views().any(|view| view.photo.is_linear_hdr()),
        surroundings_visible: dataset.surroundings_visible,
        lens: statistics::lens_summary(dataset),
        cameras: statistics::camera_summary(dataset),
        masks: statistics::mask_summary(dataset),
        mesh,
        agreement,
        problems,
    }
}
