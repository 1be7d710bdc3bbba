//! What a camera sees of the mesh, with antialiased silhouettes; independent of material and light.

use std::ops::Range;

use super::trace::{TracedPoint, trace_bounce, trace_pixel};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::shading::SurfacePoint;

/// Sub-samples per axis of a silhouette pixel.
const SUBSAMPLES: usize = 4;
/// No point.
const NONE: u32 = u32::MAX;

/// Traced pixels of some rows of a camera's image.
#[derive(Clone, Debug, Default)]
pub struct GBuffer {
    first: u32,
    coverage: Vec<f32>,
    index: Vec<u32>,
    points: Vec<TracedPoint>,
}

impl GBuffer {
    /// Traces `rows` of the camera's image; without a tracer nothing is covered.
    pub fn trace(tracer: Option<&SurfaceTracer>, camera: &Camera, rows: Range<u32>) -> Self {
        let width = camera.width;
        let n = (rows.len() as u32 * width) as usize;
        let mut buffer = Self {
            first: rows.start * width,
            coverage: vec![0.0; n],
            index: vec![NONE; n],
            points: Vec::new(),
        };
        if let Some(tracer) = tracer {
            buffer.fill(tracer, camera, rows);
        }
        buffer
    }

    /// Share of each pixel that the object covers, `[0, 1]`, of the traced rows.
    pub fn coverage(&self) -> &[f32] {
        &self.coverage
    }

    /// Coverage of a pixel by its index in the whole image.
    pub fn coverage_at(&self, pixel: u32) -> f32 {
        self.coverage[(pixel - self.first) as usize]
    }

    /// The surface a pixel (index in the whole image) sees.
    pub fn point_at(&self, pixel: u32) -> Option<&TracedPoint> {
        self.points
            .get(self.index[(pixel - self.first) as usize] as usize)
    }

    fn fill(&mut self, tracer: &SurfaceTracer, camera: &Camera, rows: Range<u32>) {
        let width = camera.width as usize;
        // One more row on each side tells whether a border pixel lies on a silhouette.
        let centers: Vec<Option<SurfacePoint>> = (i64::from(rows.start) - 1..=i64::from(rows.end))
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| trace_pixel(tracer, camera, x as f32 + 0.5, y as f32 + 0.5))
            .collect();
        for i in 0..self.coverage.len() {
            let at = i + width;
            let x = i % width;
            let hits = [
                at - width,
                at + width,
                at - usize::from(x > 0),
                at + usize::from(x + 1 < width),
            ];
            let inside = centers[at].is_some();
            let (coverage, point) = if hits.iter().all(|&j| centers[j].is_some() == inside) {
                (f32::from(u8::from(inside)), centers[at])
            } else {
                subsample(
                    tracer,
                    camera,
                    x as f32,
                    (rows.start as usize + i / width) as f32,
                )
            };
            self.coverage[i] = coverage;
            if let Some(point) = point {
                self.index[i] = self.points.len() as u32;
                // A turn that varies from pixel to pixel spreads the few lobe rays (golden angle).
                // It depends on the place in the picture alone, not on the rows traced together.
                let turn = ((self.first as usize + i) % 4096) as f32 * 2.399_963;
                let (blocked, second) = trace_bounce(tracer, &point, turn);
                self.points.push(TracedPoint {
                    point,
                    blocked,
                    second,
                });
            }
        }
    }
}

/// Coverage of pixel `(x, y)`, and the hit nearest to the covered part's centre.
fn subsample(
    tracer: &SurfaceTracer,
    camera: &Camera,
    x: f32,
    y: f32,
) -> (f32, Option<SurfacePoint>) {
    let mut hits = [(0.0, 0.0, SurfacePoint::default()); SUBSAMPLES * SUBSAMPLES];
    let mut n = 0;
    for k in 0..SUBSAMPLES * SUBSAMPLES {
        let offset = |i: usize| (i as f32 + 0.5) / SUBSAMPLES as f32;
        let (u, v) = (x + offset(k % SUBSAMPLES), y + offset(k / SUBSAMPLES));
        if let Some(point) = trace_pixel(tracer, camera, u, v) {
            hits[n] = (u, v, point);
            n += 1;
        }
    }
    let hits = &hits[..n];
    let mean =
        |f: fn(&(f32, f32, SurfacePoint)) -> f32| hits.iter().map(f).sum::<f32>() / n.max(1) as f32;
    let (u, v) = (mean(|h| h.0), mean(|h| h.1));
    let distance = |h: &&(f32, f32, SurfacePoint)| (h.0 - u).powi(2) + (h.1 - v).powi(2);
    let nearest = hits
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    (
        n as f32 / (SUBSAMPLES * SUBSAMPLES) as f32,
        nearest.map(|h| h.2),
    )
}
