//! What a camera sees of the mesh, with antialiased edges; independent of material and light.

use std::ops::Range;

use glam::Vec3;

use super::trace::{MAX_VERTICES, PathStore, PixelHit, Seen, trace_path, trace_pixel};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::light::light_path::PathVertex;

/// Sub-samples per axis of a silhouette pixel.
const SUBSAMPLES: usize = 4;
/// [`PathOptions::largest_turn`] of pictures; `gpu/gbuffer.wgsl` has its cosine.
const SHOWN_TURN: f32 = 0.25;

/// How finely and how far pixels are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathOptions {
    /// Most vertices of a path, in `1..=MAX_VERTICES`.
    pub max_vertices: usize,
    /// Paths per axis of a pixel whose neighbours see nearly the same: 1, 2 or 4.
    pub smooth: usize,
    /// Paths per axis of a pixel whose mirror image is discontinuous, or that the silhouette passes: 1, 2 or 4.
    pub discontinuous: usize,
    /// Turn of the mirror direction to the next pixel, radians, above which a pixel's mirror image counts as discontinuous.
    pub largest_turn: f32,
}

impl PathOptions {
    /// One path a pixel, four where that is not enough: for pictures in motion.
    pub const PLAIN: Self = Self {
        max_vertices: MAX_VERTICES,
        smooth: 1,
        discontinuous: 2,
        largest_turn: SHOWN_TURN,
    };
    /// Four paths a pixel, sixteen where that is not enough: for pictures that stay. A reflection in a curved mirror is
    /// smaller than the mirror; one path a pixel measured 0.7 dB worse over all object pixels.
    pub const FINE: Self = Self {
        max_vertices: MAX_VERTICES,
        smooth: 2,
        discontinuous: 4,
        largest_turn: SHOWN_TURN,
    };
}

/// Traced pixels of some rows of a camera's image.
#[derive(Clone, Debug, Default)]
pub struct GBuffer {
    eye: Vec3,
    first: u32,
    coverage: Vec<f32>,
    /// `[n + 1]`: where each pixel's paths start.
    starts: Vec<u32>,
    paths: PathStore,
}

impl GBuffer {
    /// Traces `rows` of the camera's image; without a tracer nothing is covered.
    pub fn trace(
        tracer: Option<&SurfaceTracer>,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
    ) -> Self {
        match tracer {
            Some(tracer) => Self::trace_some(tracer, camera, rows, options, |_| true),
            None => Self::uncovered(camera, &rows),
        }
    }

    /// Traces those pixels of `rows` whose index in the whole image is wanted; the others count as not covered.
    pub fn trace_some(
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
        is_wanted: impl Fn(u32) -> bool,
    ) -> Self {
        let mut buffer = Self::uncovered(camera, &rows);
        buffer.fill(tracer, camera, rows, options, is_wanted);
        buffer
    }

    fn uncovered(camera: &Camera, rows: &Range<u32>) -> Self {
        let n = rows.len() * camera.width as usize;
        Self {
            eye: camera.position(),
            first: rows.start * camera.width,
            coverage: vec![0.0; n],
            starts: vec![0; n + 1],
            paths: PathStore::default(),
        }
    }

    /// Where the camera stands.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }

    /// Share of each pixel that the object covers, `[0, 1]`, of the traced rows.
    pub fn coverage(&self) -> &[f32] {
        &self.coverage
    }

    /// The light paths of a pixel (index in the whole image), all of the same weight; none where no object is seen.
    pub fn paths_at(&self, pixel: u32) -> impl Iterator<Item = &[PathVertex]> {
        let i = (pixel - self.first) as usize;
        (self.starts[i]..self.starts[i + 1]).map(|path| self.paths.path(path as usize))
    }

    fn fill(
        &mut self,
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        options: PathOptions,
        is_wanted: impl Fn(u32) -> bool,
    ) {
        let width = camera.width as usize;
        let centers = Centers::trace(tracer, camera, rows.clone(), |i| is_wanted(self.first + i));
        let mut points = Vec::new();
        let mut path = [PathVertex::default(); MAX_VERTICES];
        for i in 0..self.coverage.len() {
            points.clear();
            if is_wanted(self.first + i as u32) {
                let (x, y) = ((i % width) as f32, (rows.start as usize + i / width) as f32);
                self.coverage[i] = match (centers.kind(i, options.largest_turn), options) {
                    (PixelKind::Empty, _) => 0.0,
                    (
                        PixelKind::Edge,
                        PathOptions {
                            discontinuous: n, ..
                        },
                    ) => subsample_edge(tracer, camera, (x, y), n.max(2), &mut points),
                    (
                        PixelKind::Discontinuous,
                        PathOptions {
                            discontinuous: n, ..
                        },
                    )
                    | (PixelKind::Smooth, PathOptions { smooth: n, .. }) => {
                        if n > 1 {
                            subsample(tracer, camera, (x, y), n, &mut points);
                        } else {
                            points.extend(centers.at(i).copied());
                        }
                        1.0
                    }
                };
            }
            // A turn that varies from pixel to pixel spreads the few lobe rays (golden angle).
            // It depends on the place in the picture alone, not on the rows traced together.
            let turn = ((self.first as usize + i) % 4096) as f32 * 2.399_963;
            for (k, point) in points.iter().enumerate() {
                let turn = turn + k as f32;
                let path = trace_path(tracer, point, turn, &mut path, options.max_vertices);
                self.paths.push(path);
            }
            self.starts[i + 1] = self.paths.n_paths() as u32;
        }
    }
}

/// What the rays through the pixels' centres met, and one row more on each side.
struct Centers {
    width: usize,
    /// By pixel, which of `points`; [`NOTHING`] where no object was met or looked for.
    at: Vec<u32>,
    points: Vec<Seen>,
}

/// No point.
const NOTHING: u32 = u32::MAX;

/// How a pixel compares with its four neighbours.
enum PixelKind {
    /// No object here or beside.
    Empty,
    /// The object's silhouette passes here or beside.
    Edge,
    /// Object all around, but what it mirrors here does not hang together with what it mirrors beside.
    Discontinuous,
    /// One ray stands for the pixel.
    Smooth,
}

impl Centers {
    /// Traces the wanted pixels (by index in `rows`) and their neighbours.
    fn trace(
        tracer: &SurfaceTracer,
        camera: &Camera,
        rows: Range<u32>,
        is_wanted: impl Fn(u32) -> bool,
    ) -> Self {
        let width = camera.width as usize;
        let (n, row) = ((rows.len() * width) as i64, width as i64);
        let wanted = |i: i64| (0..n).contains(&i) && is_wanted(i as u32);
        let mut points = Vec::new();
        let at = (-row..n + row).map(|i| {
            let is_near = [0, -1, 1, -row, row].iter().any(|step| wanted(i + step));
            let x = i.rem_euclid(row) as f32 + 0.5;
            let y = (i64::from(rows.start) + i.div_euclid(row)) as f32 + 0.5;
            let seen = is_near.then(|| trace_pixel(tracer, camera, (x, y), 1.0));
            seen.flatten().map_or(NOTHING, |seen| {
                points.push(seen);
                points.len() as u32 - 1
            })
        });
        Self {
            width,
            at: at.collect(),
            points,
        }
    }

    /// The point seen at pixel `i`, from the row before the first.
    fn point(&self, i: usize) -> Option<&Seen> {
        self.points.get(self.at[i] as usize)
    }

    fn at(&self, i: usize) -> Option<&Seen> {
        self.point(i + self.width)
    }

    fn kind(&self, i: usize, largest_turn: f32) -> PixelKind {
        let (at, x) = (i + self.width, i % self.width);
        let beside = [
            at - self.width,
            at + self.width,
            at - usize::from(x > 0),
            at + usize::from(x + 1 < self.width),
        ];
        let center = self.point(at);
        if beside
            .iter()
            .any(|&j| self.point(j).is_some() != center.is_some())
        {
            return PixelKind::Edge;
        }
        let Some(center) = center else {
            return PixelKind::Empty;
        };
        let least_cos = largest_turn.cos();
        let hangs_together =
            |other: &Seen| center.point.reflected().dot(other.point.reflected()) > least_cos;
        let is_smooth = |j: &usize| self.point(*j).is_some_and(hangs_together);
        if beside.iter().all(is_smooth) {
            PixelKind::Smooth
        } else {
            PixelKind::Discontinuous
        }
    }
}

/// The points seen through the `n` by `n` equal squares of pixel `(x, y)`.
fn subsample(
    tracer: &SurfaceTracer,
    camera: &Camera,
    (x, y): (f32, f32),
    n: usize,
    points: &mut Vec<Seen>,
) {
    let side = 1.0 / n as f32;
    for k in 0..n * n {
        let (u, v) = ((k % n) as f32 + 0.5, (k / n) as f32 + 0.5);
        points.extend(trace_pixel(
            tracer,
            camera,
            (x + u * side, y + v * side),
            side,
        ));
    }
}

/// Coverage of pixel `(x, y)`; in each of its `n` by `n` squares the hit nearest to the covered part's centre.
fn subsample_edge(
    tracer: &SurfaceTracer,
    camera: &Camera,
    (x, y): (f32, f32),
    n: usize,
    points: &mut Vec<Seen>,
) -> f32 {
    let n_inside = SUBSAMPLES / n;
    let mut hits = Vec::with_capacity(n_inside * n_inside);
    let mut n_hits = 0;
    for square in 0..n * n {
        hits.clear();
        for k in 0..n_inside * n_inside {
            let offset = |s: usize, i: usize| (s * n_inside + i) as f32 + 0.5;
            let at = (
                x + offset(square % n, k % n_inside) / SUBSAMPLES as f32,
                y + offset(square / n, k / n_inside) / SUBSAMPLES as f32,
            );
            hits.extend(PixelHit::trace(tracer, camera, at).map(|hit| (at, hit)));
        }
        let mean = |f: fn(&((f32, f32), PixelHit)) -> f32| {
            hits.iter().map(f).sum::<f32>() / hits.len().max(1) as f32
        };
        let (u, v) = (mean(|h| h.0.0), mean(|h| h.0.1));
        let distance = |at: (f32, f32)| (at.0 - u).powi(2) + (at.1 - v).powi(2);
        let nearest = hits
            .iter()
            .min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        points.extend(nearest.map(|(at, hit)| hit.seen(tracer, camera, *at, 1.0 / n as f32)));
        n_hits += hits.len();
    }
    n_hits as f32 / (SUBSAMPLES * SUBSAMPLES) as f32
}
