//! Object pixels of a view that were traced together, and their light paths.

use super::outlines::bands;
use super::packed_path::PackedPaths;
use super::pixel_set::PixelSet;
use crate::geometry::{Camera, SurfaceTracer};
use crate::render::GBuffer;
use crate::render::path::gbuffer::PathOptions;

/// Light paths of some object pixels of a view.
#[derive(Debug)]
pub(super) struct TracedPixels {
    /// Which view.
    pub(super) view: usize,
    /// Its camera as it was when they were traced.
    pub(super) camera: Camera,
    pub(super) paths: PackedPaths,
    /// Which of the photo's pixels they are, ascending.
    pub(super) places: Vec<u32>,
}

impl TracedPixels {
    /// Traces the `wanted` pixels of a view; those that the object does not fill are left out.
    pub(super) fn trace(
        (view, camera): (usize, Camera),
        tracer: &SurfaceTracer,
        options: PathOptions,
        wanted: &PixelSet,
    ) -> Self {
        let (mut paths, mut places) = (PackedPaths::default(), Vec::new());
        for rows in bands(&camera) {
            let first = rows.start * camera.width;
            if !wanted.has_any(first..rows.end * camera.width) {
                continue;
            }
            let is_wanted = |i| wanted.contains(i);
            let gbuffer = GBuffer::trace_some(tracer, &camera, rows, options, is_wanted);
            for (i, coverage) in (first..).zip(gbuffer.coverage()) {
                if *coverage >= 1.0 && paths.push(gbuffer.paths_at(i)) {
                    places.push(i);
                }
            }
        }
        paths.shrink();
        places.shrink_to_fit();
        Self {
            view,
            camera,
            paths,
            places,
        }
    }
}
