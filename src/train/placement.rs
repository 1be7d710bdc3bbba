//! Where the field's inner box stands, and which way is up.

use glam::Vec3;

use super::config::TrainConfig;
use super::priors::camera_space::clear_camera_space;
use super::priors::line_of_sight::clear_lines_of_sight;
use crate::data::Dataset;
use crate::geometry::{Camera, Ray, SurfaceTracer};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;
use crate::neif::light::environment::EnvironmentPlace;

/// Cells of air around the object: ghosts are one or two cells thick.
const AIR_CELLS: f32 = 2.5;
/// Cells over the object's lowest point up to which there may be what it stands on.
const TABLE_CELLS: f32 = 3.0;

/// Where the environment of a run lies, with the plain display transform.
pub(super) fn environment_place(config: &TrainConfig, dataset: &Dataset) -> EnvironmentPlace {
    EnvironmentPlace {
        name: dataset.name.clone(),
        frame: field_frame(dataset, config.inner_box_scale),
        gamma: 1.0,
        n_samples: config.render_samples,
        up: up_direction(dataset),
    }
}

/// The inner box: around the object (or between the cameras), as far as the cameras stand, times `scale`.
pub(super) fn field_frame(dataset: &Dataset, scale: f32) -> FieldFrame {
    let cameras = camera_positions(dataset);
    let mean = cameras.iter().sum::<Vec3>() / cameras.len().max(1) as f32;
    let object = dataset.object_box();
    let center = object.map_or(mean, |object| object.center());
    let reach = cameras
        .iter()
        .map(|c| (*c - center).abs().max_element())
        .fold(0.0, f32::max);
    let object = object.map_or(0.0, |object| 0.75 * object.extent().max_element());
    // One camera at the centre leaves no length to go by: one world unit is as good as any.
    let half_side = scale * reach.max(object);
    FieldFrame {
        center,
        half_side: if half_side > 0.0 { half_side } else { 1.0 },
    }
}

/// A fresh density cache that is void inside the mesh, around it but for what it stands on, and between the mesh and the
/// cameras that see it.
///
/// What hangs right before the surface is a ghost: an error of shape or shading, explained by something that is mirrored
/// there. A mesh of outlines fills hollows, which asks for many.
pub(super) fn clear_density(
    dataset: &Dataset,
    tracer: Option<&SurfaceTracer>,
    frame: &FieldFrame,
    up: Vec3,
) -> DensityGrid {
    let mut density = DensityGrid::default();
    if let Some(tracer) = tracer {
        let bounds = tracer.mesh().bounds();
        density.hollow(|p| {
            let p_world = frame.world_from_field(Vec3::from(p));
            bounds.contains(p_world) && is_inside(tracer, p_world)
        });
        let heights = tracer.mesh().positions.iter().map(|p| p.dot(up));
        let lowest = heights.fold(f32::INFINITY, f32::min);
        let table = lowest + TABLE_CELLS * DensityGrid::inner_cell() * frame.half_side;
        density.widen_void(AIR_CELLS, |p| {
            let p_world = frame.world_from_field(Vec3::from(p));
            p_world.dot(up) > table
        });
        clear_lines_of_sight(&mut density, dataset, frame, tracer);
    }
    clear_camera_space(&mut density, dataset, frame);
    density
}

/// Whether two of three rays along the axes cross the surface an odd number of times: robust to a hole.
fn is_inside(tracer: &SurfaceTracer, p_world: Vec3) -> bool {
    let votes = Vec3::AXES.into_iter().filter(|&direction| {
        let mut ray = Ray {
            origin: p_world,
            direction,
        };
        let mut n_crossings = 0;
        while let Some(hit) = tracer.intersect(&ray, tracer.self_distance(), f32::INFINITY) {
            n_crossings += 1;
            ray.origin = hit.position;
            // A mesh of a thousand sheets is no solid; this also bounds the walk.
            if n_crossings > 1000 {
                break;
            }
        }
        n_crossings % 2 == 1
    });
    votes.count() >= 2
}

/// The capture's up direction; where it says none, the mean of the cameras' snapped to the nearest world axis.
pub(super) fn up_direction(dataset: &Dataset) -> Vec3 {
    if let Some(up) = dataset.origin.up {
        return up;
    }
    let mean: Vec3 = dataset.train.iter().map(|v| v.camera.up()).sum();
    let axis = (0..3)
        .max_by(|&a, &b| mean[a].abs().total_cmp(&mean[b].abs()))
        .unwrap_or(2);
    let mut up = Vec3::ZERO;
    up[axis] = if mean[axis] < 0.0 { -1.0 } else { 1.0 };
    up
}

/// Where the training photos were taken from, world.
pub(super) fn camera_positions(dataset: &Dataset) -> Vec<Vec3> {
    dataset.train.iter().map(|v| v.camera.position()).collect()
}

/// The cameras of the training photos as the capture has them.
pub(super) fn given_cameras(dataset: &Dataset) -> Vec<Camera> {
    dataset.train.iter().map(|view| view.camera).collect()
}
