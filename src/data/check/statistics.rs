//! The numbers of a report: sizes, lenses, cameras, masks, mesh.

use std::collections::HashMap;
use std::path::PathBuf;

use glam::Vec3;

use super::{CameraSummary, LensSummary, MaskSummary, MeshSummary, PointSummary, Resolution};
use crate::data::{Dataset, PointCloud, Problem, Severity};
use crate::geometry::{Aabb, Mesh, nearest_point};

/// Distance from the origin, in sizes of the capture, from which single precision is too coarse for it: positions are
/// rounded to a four-thousandth of that size (the stability benchmark loses nothing at 1,800 sizes).
const FAR_AWAY: f32 = 2000.0;

/// Error of a reconstruction's points from which its cameras are off, pixels: a good one leaves half of it.
const FAIR_ERROR_PX: f32 = 1.0;

/// Picture sizes, most frequent first.
pub(super) fn resolutions(dataset: &Dataset) -> Vec<Resolution> {
    let mut list: Vec<Resolution> = Vec::new();
    for view in dataset.views() {
        let (width, height) = (view.photo.width(), view.photo.height());
        match list
            .iter_mut()
            .find(|r| (r.width, r.height) == (width, height))
        {
            Some(resolution) => resolution.n_views += 1,
            None => list.push(Resolution {
                width,
                height,
                n_views: 1,
            }),
        }
    }
    list.sort_by_key(|r| std::cmp::Reverse(r.n_views));
    list
}

pub(super) fn lens_summary(dataset: &Dataset) -> LensSummary {
    let cameras = || dataset.views().map(|view| view.camera);
    let fov =
        |c: crate::geometry::Camera| (2.0 * (0.5 * c.width as f32 / c.fx).atan()).to_degrees();
    LensSummary {
        focal_px: range(cameras().map(|camera| camera.fx)),
        fov_x_deg: range(cameras().map(fov)),
        distorted: cameras().any(|camera| !camera.distortion.is_none()),
    }
}

pub(super) fn camera_summary(dataset: &Dataset) -> CameraSummary {
    let axes: Vec<(Vec3, Vec3)> = dataset
        .views()
        .map(|view| (view.camera.position(), view.camera.forward()))
        .collect();
    let look_at = nearest_point(&axes);
    CameraSummary {
        look_at: look_at.to_array(),
        distance: range(axes.iter().map(|(p, _)| p.distance(look_at))),
        extent: Aabb::from_points(axes.iter().map(|(p, _)| *p)).diagonal(),
    }
}

/// `None` for a cloud without points.
pub(super) fn point_summary(cloud: &PointCloud) -> Option<PointSummary> {
    let sorted = |values: &mut dyn Iterator<Item = f32>| {
        let mut values: Vec<f32> = values.collect();
        values.sort_by(f32::total_cmp);
        values
    };
    let errors = sorted(&mut cloud.errors_px.iter().copied().filter(|e| *e >= 0.0));
    let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
    for axis in 0..3 {
        let along = sorted(&mut cloud.positions.iter().map(|p| p[axis]));
        // Stray points lie anywhere; nine tenths say where the scene is.
        min[axis] = *along.get(along.len() / 20)?;
        max[axis] = *along.get(along.len() - 1 - along.len() / 20)?;
    }
    Some(PointSummary {
        n_points: cloud.positions.len(),
        median_error_px: errors.get(errors.len() / 2).copied(),
        min,
        max,
    })
}

pub(super) fn mask_summary(dataset: &Dataset) -> Option<MaskSummary> {
    let shares: Vec<f32> = dataset
        .views()
        .filter_map(|view| view.mask.as_ref().map(super::super::Mask::mean))
        .collect();
    let [min, max] = range(shares.iter().copied());
    (!shares.is_empty()).then(|| MaskSummary {
        n_views: shares.len(),
        mean: shares.iter().sum::<f32>() / shares.len() as f32,
        min,
        max,
    })
}

/// Smallest and largest; zeros for nothing.
fn range(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values
        .map(|v| [v, v])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
        .unwrap_or_default()
}

pub(super) fn mesh_summary(mesh: &Mesh, path: Option<PathBuf>) -> MeshSummary {
    let bounds = mesh.bounds();
    let (n_open_edges, n_branching_edges) = edge_defects(mesh);
    MeshSummary {
        path,
        n_vertices: mesh.positions.len(),
        n_triangles: mesh.triangles.len(),
        n_degenerate: mesh.n_degenerate,
        min: bounds.min.to_array(),
        max: bounds.max.to_array(),
        surface_area: mesh.surface_area(),
        n_open_edges,
        n_branching_edges,
        watertight: n_open_edges == 0 && n_branching_edges == 0,
    }
}

/// Edges with one triangle, and with more than two; vertices at one position count as one.
fn edge_defects(mesh: &Mesh) -> (usize, usize) {
    let mut slot_of_position: HashMap<[u32; 3], usize> = HashMap::new();
    let slots: Vec<usize> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = slot_of_position.len();
            let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
            *slot_of_position.entry(key).or_insert(next)
        })
        .collect();
    let mut edges: Vec<(usize, usize)> = Vec::with_capacity(3 * mesh.triangles.len());
    for triangle in &mesh.triangles {
        for i in 0..3 {
            let (a, b) = (
                slots[triangle[i] as usize],
                slots[triangle[(i + 1) % 3] as usize],
            );
            edges.push((a.min(b), a.max(b)));
        }
    }
    edges.sort_unstable();
    edges
        .chunk_by(|a, b| a == b)
        .fold((0, 0), |(open, branching), same| match same.len() {
            1 => (open + 1, branching),
            2 => (open, branching),
            _ => (open, branching + 1),
        })
}

/// A finding about where the capture stands, if any.
pub(super) fn camera_problem(cameras: &CameraSummary) -> Option<Problem> {
    let away = Vec3::from(cameras.look_at).length();
    // A single camera has no extent.
    let size = cameras.extent.max(cameras.distance[1]);
    if away <= FAR_AWAY * size {
        return None;
    }
    let step = away * f32::EPSILON;
    let what = format!(
        "the capture is {size:.3} units across and stands {away:.0} units from the origin, where positions are rounded to {step:.1e} units"
    );
    let advice = "move cameras and mesh together, so that the origin is near the object";
    Some(Problem::new(Severity::Warning, what, advice))
}

/// A finding about the cameras by what the reconstruction says of its points, if any.
pub(super) fn point_problem(points: &PointSummary) -> Option<Problem> {
    let error = points.median_error_px.filter(|e| *e > FAIR_ERROR_PX)?;
    let what = format!(
        "the reconstruction's points are {error:.1} pixels off in the median: so are the cameras"
    );
    let advice = "reflections will blur: training corrects them in part; a reconstruction from sharper photos is surer";
    Some(Problem::new(Severity::Warning, what, advice))
}

/// Findings about the mesh alone.
pub(super) fn mesh_problems(mesh: &MeshSummary) -> Vec<Problem> {
    let mut problems = Vec::new();
    let path = || mesh.path.clone().unwrap_or_default();
    if mesh.n_degenerate > 0 {
        let what = format!(
            "{} triangles without an area were dropped",
            mesh.n_degenerate
        );
        problems.push(Problem::new(Severity::Note, what, "").in_file(path()));
    }
    if mesh.n_open_edges > 0 {
        let what = format!("the mesh has holes: {} open edges", mesh.n_open_edges);
        let advice = "harmless where no camera sees them";
        problems.push(Problem::new(Severity::Note, what, advice).in_file(path()));
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::test_asserts::assert_contains;
    use crate::geometry::meshes::test_mesh::ellipsoid;

    #[test]
    fn cameras_are_suspected_where_points_are_a_pixel_off() {
        let finding = |error: f32| {
            let cloud = PointCloud {
                positions: vec![Vec3::ZERO; 3],
                errors_px: vec![0.1, error, 9.0],
                ..PointCloud::default()
            };
            point_problem(&point_summary(&cloud).unwrap())
        };
        let text = finding(1.3).expect("off").to_string();
        assert_contains(&text, "1.3 pixels");
        assert_contains(&text, "training corrects them");
        assert!(finding(0.6).is_none());
    }

    #[test]
    fn a_closed_mesh_is_watertight_and_an_open_one_is_not() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::ONE, 8);
        assert!(mesh_summary(&mesh, None).watertight, "closed");
        let mut open = mesh;
        open.triangles.pop();
        let summary = mesh_summary(&open, None);
        assert_eq!(
            (summary.watertight, summary.n_open_edges),
            (false, 3),
            "open"
        );
    }
}
