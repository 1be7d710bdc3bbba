//! Pictures of a [`NeilfModel`]: the object alone.
//!
//! The model does not explain the environment, which is therefore black, and a pixel on the silhouette shows
//! the object's part of it alone, as `NeILF` does: blended with black it would be worse than the model is.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::output::raster::Picture;
use super::path::gbuffer::{GBuffer, PathOptions};
use crate::geometry::Camera;
use crate::neif::neilf::model::{NeilfModel, NeilfScratch};

/// Rows of a task.
const BAND: u32 = 4;
/// Points shaded together.
const GROUP: usize = 32;
/// What a point receives from the object is part of its incident light, so paths end at once.
const PATHS: PathOptions = PathOptions {
    max_vertices: 1,
    ..PathOptions::FINE
};

/// The display-referred picture (sRGB, `[0, 1]`), black where the object is not seen; `None` when cancelled.
pub fn render_neilf(model: &NeilfModel, camera: &Camera, cancel: &AtomicBool) -> Option<Picture> {
    let size = (camera.width, camera.height);
    Picture::by_rows(
        size,
        BAND,
        cancel,
        |scratch: &mut NeilfScratch, first, out| {
            let rows = first..(first + BAND).min(camera.height);
            render_rows(model, camera, rows, out, scratch);
        },
    )
}

fn render_rows(
    model: &NeilfModel,
    camera: &Camera,
    rows: std::ops::Range<u32>,
    out: &mut [[f32; 3]],
    scratch: &mut NeilfScratch,
) {
    let first = rows.start * camera.width;
    let gbuffer = GBuffer::trace_some(&model.tracer, camera, rows, PATHS, |_| true);
    let (mut points, mut n_points) = (Vec::new(), Vec::with_capacity(out.len()));
    for i in 0..out.len() {
        let before = points.len();
        let paths = gbuffer.paths_at(first + i as u32);
        points.extend(paths.map(|path| path[0].point));
        n_points.push(points.len() - before);
    }
    let mut radiance = Vec::with_capacity(points.len());
    for group in points.chunks(GROUP) {
        model.shade(group, scratch, &mut radiance);
    }
    let mut radiance = radiance.into_iter();
    for (out, n) in out.iter_mut().zip(n_points) {
        if n > 0 {
            let mean = radiance.by_ref().take(n).sum::<Vec3>() / n as f32;
            *out = mean
                .to_array()
                .map(|v| model.display.value(v.max(0.0)).min(1.0));
        }
    }
}
