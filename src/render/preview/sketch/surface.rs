//! The object in a sketch: its outline pixel by pixel, smooth unless in motion, its light at every second pixel of each axis.

use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;

use super::{Job, Purpose};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::light::light_path::PathVertex;
use crate::neif::light::lobe_cones::PathOfPixel;
use crate::render::highlight::cover_values;
use crate::render::path::gbuffer::{SUBSAMPLES, beside, subsample_edge};
use crate::render::path::scratch::TILE;
use crate::render::path::shade::{PathView, shade_paths};
use crate::render::path::trace::{MAX_VERTICES, PathStore, Seen, trace_path, trace_pixel};
use crate::render::preview::request::same;

/// Pixels between two samples, per axis.
const STEP: u32 = 2;
/// Cosine between normals up to which two samples lie on one surface.
const LEAST_COS: f32 = 0.9;
/// Height of one sample over the plane of another, as a share of their distance, up to which they lie on one surface.
const LARGEST_RISE: f32 = 0.5;

/// What a pixel shows of the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cover {
    /// Nothing: the environment.
    Open,
    /// The sample with this index.
    Sample(u32),
    /// The mean of the samples beside it.
    Between,
}

/// What a camera sees of the object.
#[derive(Debug, Default)]
pub(super) struct Surface {
    width: u32,
    /// What each pixel shows of the object.
    covers: Vec<Cover>,
    /// Share of each pixel that the object covers, `[0, 1]`; in motion all or nothing.
    pub(super) coverage: Vec<f32>,
    /// Those of the lattice first, row by row, then what the lattice misses.
    samples: Vec<Seen>,
    lattice: Lattice,
    /// The light paths of each [`TILE`] samples.
    paths: Vec<PathStore>,
    /// Rays against the mesh that it took.
    pub(super) n_traced: usize,
}

/// What a surface depends on.
#[derive(Clone, Debug)]
pub(super) struct SurfaceKey {
    camera: Camera,
    tracer: Option<Arc<SurfaceTracer>>,
    max_vertices: usize,
}

impl SurfaceKey {
    pub(super) fn of(job: &Job<'_>) -> Self {
        let object = job.request.scene.object.as_ref();
        let object = object.filter(|_| job.request.layer.shows_object());
        Self {
            camera: job.camera,
            tracer: object.map(|object| Arc::clone(&object.tracer)),
            max_vertices: job.max_vertices(),
        }
    }

    /// Whether both see the same.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.camera == other.camera
            && self.max_vertices == other.max_vertices
            && same(self.tracer.as_ref(), other.tracer.as_ref())
    }
}

/// What a row of pixels shows.
struct Row {
    covers: Vec<Cover>,
    /// Pixels that no sample of the lattice stands for.
    own: Vec<(u32, Seen)>,
    n_traced: usize,
}

/// A pixel that the outline passes.
struct OutlinePixel {
    index: usize,
    coverage: f32,
    /// A point within it, if any of it is covered.
    seen: Option<Seen>,
}

/// Every second pixel of each axis.
#[derive(Debug, Default)]
struct Lattice {
    width: u32,
    height: u32,
    /// Index of the sample at each point.
    samples: Vec<Option<u32>>,
}

impl Lattice {
    /// The samples around a pixel: at its place, or at both sides of it.
    fn around(&self, x: u32, y: u32) -> [Option<u32>; 4] {
        let (x0, y0) = (x / STEP, y / STEP);
        let x1 = (x0 + x % STEP).min(self.width - 1);
        let y1 = (y0 + y % STEP).min(self.height - 1);
        [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
            .map(|(x, y)| self.samples[(y * self.width + x) as usize])
    }
}

impl Surface {
    /// Traces what is needed to know where the object is and what it mirrors.
    pub(super) fn trace(job: &Job<'_>, key: &SurfaceKey) -> Self {
        let Camera { width, height, .. } = job.camera;
        let n = (width * height) as usize;
        let Some(tracer) = &key.tracer else {
            return Self {
                width,
                covers: vec![Cover::Open; n],
                coverage: vec![0.0; n],
                ..Self::default()
            };
        };
        let mut surface = Self {
            width,
            lattice: Lattice {
                width: width.div_ceil(STEP),
                height: height.div_ceil(STEP),
                samples: Vec::new(),
            },
            ..Self::default()
        };
        surface.trace_lattice(job, tracer);
        surface.trace_between(job, tracer);
        let share = |cover: &Cover| f32::from(u8::from(*cover != Cover::Open));
        surface.coverage = surface.covers.iter().map(share).collect();
        if job.purpose != Purpose::Motion {
            surface.smooth_outline(job, tracer);
        }
        surface.trace_paths(job, key, tracer);
        surface
    }

    fn trace_lattice(&mut self, job: &Job<'_>, tracer: &SurfaceTracer) {
        let width = self.lattice.width;
        let reach = Reach::of(tracer, &job.camera);
        let rows: Vec<Vec<Option<Seen>>> = (0..self.lattice.height)
            .into_par_iter()
            .map(|y| {
                let at = |x: u32| {
                    let (x, y) = (x * STEP, y * STEP);
                    let trace = || trace_at(tracer, &job.camera, x, y, STEP);
                    reach.holds(x, y).then(trace).flatten()
                };
                job.meter.time(|| (0..width).map(at).collect())
            })
            .collect();
        for seen in rows.iter().flatten() {
            let index = self.samples.len() as u32;
            self.lattice.samples.push(seen.map(|_| index));
            self.samples.extend(seen);
        }
        self.n_traced = self.lattice.samples.len();
    }

    fn trace_between(&mut self, job: &Job<'_>, tracer: &SurfaceTracer) {
        let rows: Vec<Row> = (0..job.camera.height)
            .into_par_iter()
            .map(|y| job.meter.time(|| self.row(job, tracer, y)))
            .collect();
        for row in rows {
            let first = self.covers.len();
            self.covers.extend(row.covers);
            for (x, seen) in row.own {
                self.covers[first + x as usize] = Cover::Sample(self.samples.len() as u32);
                self.samples.push(seen);
            }
            self.n_traced += row.n_traced;
        }
    }

    fn row(&self, job: &Job<'_>, tracer: &SurfaceTracer, y: u32) -> Row {
        let (mut own, mut n_traced) = (Vec::new(), 0);
        let covers = (0..self.width)
            .map(|x| {
                let around = self.lattice.around(x, y);
                if let Some(cover) = self.known(around, x, y) {
                    return cover;
                }
                n_traced += 1;
                let Some(seen) = trace_at(tracer, &job.camera, x, y, 1) else {
                    return Cover::Open;
                };
                let is_same = |i: &u32| is_one_surface(&self.samples[*i as usize], &seen);
                let Some(sample) = around.into_iter().flatten().find(is_same) else {
                    own.push((x, seen));
                    return Cover::Open;
                };
                Cover::Sample(sample)
            })
            .collect();
        Row {
            covers,
            own,
            n_traced,
        }
    }

    /// What a pixel shows where that needs no ray.
    fn known(&self, around: [Option<u32>; 4], x: u32, y: u32) -> Option<Cover> {
        if x.is_multiple_of(STEP) && y.is_multiple_of(STEP) {
            return Some(around[0].map_or(Cover::Open, Cover::Sample));
        }
        let [Some(a), Some(b), Some(c), Some(d)] = around else {
            return around.iter().all(Option::is_none).then_some(Cover::Open);
        };
        let first = &self.samples[a as usize];
        [b, c, d]
            .iter()
            .all(|i| is_one_surface(first, &self.samples[*i as usize]))
            .then_some(Cover::Between)
    }

    /// Finds how much of the pixels on both sides of the outline the object covers.
    fn smooth_outline(&mut self, job: &Job<'_>, tracer: &SurfaceTracer) {
        let rows: Vec<Vec<OutlinePixel>> = (0..job.camera.height)
            .into_par_iter()
            .map(|y| job.meter.time(|| self.outline_of_row(job, tracer, y)))
            .collect();
        for pixel in rows.into_iter().flatten() {
            self.n_traced += SUBSAMPLES * SUBSAMPLES;
            self.coverage[pixel.index] = pixel.coverage;
            if self.covers[pixel.index] == Cover::Open
                && let Some(seen) = pixel.seen
            {
                self.covers[pixel.index] = Cover::Sample(self.samples.len() as u32);
                self.samples.push(seen);
            }
        }
    }

    fn outline_of_row(&self, job: &Job<'_>, tracer: &SurfaceTracer, y: u32) -> Vec<OutlinePixel> {
        let size = [self.width, job.camera.height].map(|n| n as usize);
        let is_open = |i: usize| self.covers[i] == Cover::Open;
        let mut points = Vec::new();
        let mut outline = Vec::new();
        for x in 0..size[0] {
            let index = y as usize * size[0] + x;
            let is_other = |i: usize| is_open(i) != is_open(index);
            if beside(index, size).into_iter().any(is_other) {
                points.clear();
                let corner = (x as f32, y as f32);
                outline.push(OutlinePixel {
                    index,
                    coverage: subsample_edge(tracer, &job.camera, corner, 1, &mut points),
                    seen: points.pop(),
                });
            }
        }
        outline
    }

    fn trace_paths(&mut self, job: &Job<'_>, key: &SurfaceKey, tracer: &SurfaceTracer) {
        self.paths = self
            .samples
            .par_chunks(TILE)
            .enumerate()
            .map(|(tile, samples)| {
                job.meter.time(|| {
                    let mut store = PathStore::default();
                    let mut path = [PathVertex::default(); MAX_VERTICES];
                    for (i, seen) in samples.iter().enumerate() {
                        // A turn that varies from sample to sample spreads the few lobe rays (golden angle).
                        let turn = ((tile * TILE + i) % 4096) as f32 * 2.399_963;
                        let n = key.max_vertices;
                        store.push(trace_path(tracer, seen, turn, &mut path, n));
                    }
                    store
                })
            })
            .collect();
    }

    /// The layer's value at each sample.
    pub(super) fn shade(&self, job: &Job<'_>) -> Vec<[f32; 3]> {
        let scene = &job.request.scene;
        let mut values = vec![[0.0; 3]; self.samples.len()];
        let Some(object) = &scene.object else {
            return values;
        };
        self.paths
            .par_iter()
            .zip(values.par_chunks_mut(TILE))
            .for_each_init(
                || job.scratch(),
                |scratch, (store, out)| {
                    if job.is_cancelled() {
                        return;
                    }
                    job.meter.time(|| {
                        let paths: Vec<_> = (0..store.n_paths()).map(|i| store.path(i)).collect();
                        let one = |_| PathOfPixel::ALONE;
                        let view = PathView {
                            layer: job.request.layer,
                            eye: job.camera.position(),
                        };
                        let lit = shade_paths(scene, object, &paths, one, view, scratch);
                        for (out, light) in out.iter_mut().zip(lit) {
                            *out = light.value.to_array();
                        }
                        if let Some(region) = &job.request.highlight {
                            let firsts = paths.iter().map(|path| &path[0].point);
                            let points = firsts.map(|point| (point.position, point.normal));
                            cover_values(object, region, points, out, scratch);
                        }
                    });
                },
            );
        values
    }

    /// A pixel's value from those of the samples; none where the object is not seen.
    pub(super) fn value(&self, pixel: usize, values: &[[f32; 3]]) -> Option<[f32; 3]> {
        match self.covers[pixel] {
            Cover::Open => None,
            Cover::Sample(i) => Some(values[i as usize]),
            Cover::Between => {
                let (x, y) = (pixel as u32 % self.width, pixel as u32 / self.width);
                let mut sum = [0.0; 3];
                for i in self.lattice.around(x, y).into_iter().flatten() {
                    let value = values[i as usize];
                    for c in 0..3 {
                        sum[c] += 0.25 * value[c];
                    }
                }
                Some(sum)
            }
        }
    }
}

fn trace_at(tracer: &SurfaceTracer, camera: &Camera, x: u32, y: u32, size: u32) -> Option<Seen> {
    let center = (x as f32 + 0.5, y as f32 + 0.5);
    trace_pixel(tracer, camera, center, size as f32)
}

/// The rectangle of pixels that the object's bounds appear in.
struct Reach {
    min: Vec2,
    max: Vec2,
}

impl Reach {
    /// The whole picture where the bounds are not all in front of an ideal lens.
    fn of(tracer: &SurfaceTracer, camera: &Camera) -> Self {
        let everything = Self {
            min: Vec2::NEG_INFINITY,
            max: Vec2::INFINITY,
        };
        let corners = tracer.mesh().bounds().corners();
        let seen: Option<Vec<Vec2>> = corners.iter().map(|p| camera.project(*p)).collect();
        let Some(seen) = seen.filter(|_| camera.distortion.is_none()) else {
            return everything;
        };
        let margin = Vec2::splat(2.0);
        Self {
            min: seen.iter().copied().fold(Vec2::INFINITY, Vec2::min) - margin,
            max: seen.iter().copied().fold(Vec2::NEG_INFINITY, Vec2::max) + margin,
        }
    }

    fn holds(&self, x: u32, y: u32) -> bool {
        let p = Vec2::new(x as f32, y as f32);
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }
}

/// Whether what lies between two samples is like both.
fn is_one_surface(a: &Seen, b: &Seen) -> bool {
    let apart = b.point.position - a.point.position;
    a.point.normal.dot(b.point.normal) > LEAST_COS
        && apart.dot(a.face_normal).abs() <= LARGEST_RISE * apart.length()
}
