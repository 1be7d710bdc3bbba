//! Quick pictures for a view that changes: what is known is used again, and light is asked for at every second pixel.
//!
//! The environment is kept as points in space and projected into the next picture, and rays are followed only where no
//! point falls (the render cache of Walter, Drettakis and Parker 1999). The object's outline is traced at every pixel; it
//! is lit at every second one of each axis, and between where the surface bends. No part is ever coarser than that.

mod points;
mod surface;
mod tone;

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use rayon::prelude::*;

use self::points::PointCloud;
use self::surface::{Surface, SurfaceKey};
use self::tone::Tone;
use super::band::opaque_bytes;
use super::progressive::{PassOutput, Recomputed};
use super::request::PreviewScene;
use super::thread_clock::thread_cpu;
use crate::geometry::Camera;
use crate::render::diagnostic::diagnostic_color;
use crate::render::path::gbuffer::PathOptions;
use crate::render::path::scratch::{SeenLight, ShadeScratch, TILE};
use crate::render::path::shade::{MOTION_SAMPLES, see_background};

/// Processor time of a picture in motion that each thread may take, in seconds.
const MOTION_SECS: f64 = 0.03;
/// The same at full resolution, below which motion is shown in it.
const SWIFT_SECS: f64 = 0.025;
/// Processor time that each thread may spend between neighbours that differ, in seconds, before the view is shown at rest.
const REST_SECS: f64 = 0.35;
/// Seconds of a ray until one was measured.
const USUAL_RAY_SECS: f64 = 5e-6;
/// Vertices of a path in motion.
const MOTION_VERTICES: usize = 2;
/// In motion, each point is renewed after so many pictures.
const RENEWAL: u32 = 64;
/// Share of a new cost in the running mean.
const LEARNING: f64 = 0.3;

/// What a sketch is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Something is dragged: in time, whatever is left out.
    Motion,
    /// A view at rest: rays wherever neighbours differ.
    Rest,
    /// The model has changed: nothing old may stay, rays at every second pixel of each axis.
    Refresh,
    /// The same, with rays wherever neighbours differ.
    SharpRefresh,
}

/// What sketches keep from one to the next.
#[derive(Debug, Default)]
pub struct Sketch {
    points: PointCloud,
    /// The object as it was last seen in motion and at rest.
    surfaces: [Option<(SurfaceKey, Surface)>; 2],
    number: u32,
    /// Processor seconds of a picture in motion at half resolution without rays that it could do without.
    floor_secs: Option<f64>,
    /// Of one ray into the environment.
    ray_secs: Option<f64>,
}

/// Processor time of all threads, added up.
#[derive(Debug, Default)]
struct Meter(AtomicU64);

impl Meter {
    fn time<T>(&self, work: impl FnOnce() -> T) -> T {
        let start = thread_cpu();
        let result = work();
        let nanos = thread_cpu().saturating_sub(start).as_nanos();
        self.0.fetch_add(nanos as u64, Ordering::Relaxed);
        result
    }

    fn secs(&self) -> f64 {
        self.0.load(Ordering::Relaxed) as f64 * 1e-9
    }
}

/// What all parts of one sketch share.
struct Job<'a> {
    request: &'a PreviewScene,
    camera: Camera,
    purpose: Purpose,
    cancel: &'a AtomicBool,
    meter: Meter,
    ray_meter: Meter,
    n_rays: AtomicUsize,
}

impl Job<'_> {
    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    fn scratch(&self) -> ShadeScratch {
        match self.purpose {
            Purpose::Motion => ShadeScratch::with_most_samples(MOTION_SAMPLES),
            _ => ShadeScratch::default(),
        }
    }

    fn max_vertices(&self) -> usize {
        match self.purpose {
            Purpose::Motion => MOTION_VERTICES,
            _ => PathOptions::PLAIN.max_vertices,
        }
    }

    /// Light of the environment through pixels; those of a cancelled job stay dark.
    fn follow(&self, pixels: &[u32]) -> Vec<SeenLight> {
        let mut seen = vec![SeenLight::default(); pixels.len()];
        pixels
            .par_chunks(TILE)
            .zip(seen.par_chunks_mut(TILE))
            .for_each_init(
                || self.scratch(),
                |scratch, (pixels, out)| {
                    if !self.is_cancelled() {
                        self.ray_meter.time(|| {
                            let scene = &self.request.scene;
                            see_background(scene, &self.camera, pixels, out, scratch);
                        });
                    }
                },
            );
        self.n_rays.fetch_add(pixels.len(), Ordering::Relaxed);
        seen
    }
}

impl Sketch {
    /// The finest resolution divisor at which motion is fluent, 1 or 2.
    pub fn motion_scale(&self) -> u32 {
        let n_threads = rayon::current_num_threads() as f64;
        let is_swift = |secs: f64| 4.0 * secs / n_threads <= SWIFT_SECS;
        if self.floor_secs.is_some_and(is_swift) {
            1
        } else {
            2
        }
    }

    /// A picture at a resolution divisor; `None` when cancelled.
    pub fn picture(
        &mut self,
        request: &PreviewScene,
        scale: u32,
        purpose: Purpose,
        cancel: &AtomicBool,
    ) -> Option<PassOutput> {
        self.number = self.number.wrapping_add(1);
        let job = Job {
            request,
            camera: scaled(&request.camera, scale),
            purpose,
            cancel,
            meter: Meter::default(),
            ray_meter: Meter::default(),
            n_rays: AtomicUsize::new(0),
        };
        // What a cancelled picture leaves half done must not be taken for seen.
        let before = (purpose != Purpose::Motion).then(|| self.points.clone());
        let (key, surface) = self.take_surface(&job);
        let values = surface.shade(&job);
        self.background(&job, &surface);
        if job.is_cancelled() {
            self.points = before.unwrap_or_default();
            return None;
        }
        let pixels = self.compose(&job, &surface, &values);
        let n_traced = surface.n_traced;
        self.surfaces[usize::from(purpose == Purpose::Motion)] = Some((key, surface));
        self.learn(&job, scale);
        let Camera { width, height, .. } = job.camera;
        Some(PassOutput {
            width,
            height,
            pixels,
            recomputed: Recomputed {
                traced: n_traced,
                background: job.n_rays.into_inner(),
                object: values.len(),
            },
            is_settled: false,
            cpu_secs: job.meter.secs() + job.ray_meter.secs(),
        })
    }

    /// The object as the job sees it: traced, unless it was seen so before.
    fn take_surface(&mut self, job: &Job<'_>) -> (SurfaceKey, Surface) {
        let key = SurfaceKey::of(job);
        let kept = self.surfaces[usize::from(job.purpose == Purpose::Motion)].take();
        let surface = match kept {
            Some((old, mut surface)) if old.is_same(&key) => {
                surface.n_traced = 0;
                surface
            }
            _ => Surface::trace(job, &key),
        };
        (key, surface)
    }

    /// Brings the points up to date.
    fn background(&mut self, job: &Job<'_>, surface: &Surface) {
        let layer = job.request.layer;
        if !job.request.scene.shows_background(layer) {
            return;
        }
        self.points.project(job);
        // With the object hidden, the environment behind it is wanted as well.
        let is_open = |i: usize| !layer.shows_object() || surface.coverage[i] < 1.0;
        let missing = self.points.missing(&job.camera, is_open);
        let light = job.follow(&missing);
        self.points.add(&missing, &light);
        if job.is_cancelled() {
            return;
        }
        let hidden = self.points.drop_hidden(job, &missing);
        if job.purpose == Purpose::Rest {
            let hidden = every_nth(&hidden, self.n_rays_in(REST_SECS), 0);
            let light = job.follow(&hidden);
            self.points.add(&hidden, &light);
        }
        let spare = match job.purpose {
            Purpose::Refresh => Vec::new(),
            Purpose::SharpRefresh => self.points.uneven(&job.camera, is_open),
            Purpose::Rest => {
                let uneven = self.points.uneven(&job.camera, is_open);
                every_nth(&uneven, self.n_rays_in(REST_SECS), 0)
            }
            Purpose::Motion => match self.n_spare(missing.len()) {
                0 => Vec::new(),
                n => {
                    let renewal = self.number % RENEWAL;
                    let spare = self.points.spare(is_open, (RENEWAL, renewal));
                    every_nth(&spare, n, self.number)
                }
            },
        };
        let light = job.follow(&spare);
        self.points.add(&spare, &light);
    }

    /// How many rays there is time for beside `n_missing` that must be.
    fn n_spare(&self, n_missing: usize) -> usize {
        let Some(floor) = self.floor_secs else {
            return 0;
        };
        let secs = MOTION_SECS - floor / rayon::current_num_threads() as f64;
        self.n_rays_in(secs).saturating_sub(n_missing)
    }

    /// How many rays all threads follow in a time.
    fn n_rays_in(&self, secs: f64) -> usize {
        let ray = self.ray_secs.unwrap_or(USUAL_RAY_SECS).max(1e-9);
        (secs.max(0.0) * rayon::current_num_threads() as f64 / ray) as usize
    }

    fn learn(&mut self, job: &Job<'_>, scale: u32) {
        if job.purpose != Purpose::Motion {
            return;
        }
        let mix = |mean: &mut Option<f64>, new: f64| {
            *mean = Some(mean.map_or(new, |mean| mean + LEARNING * (new - mean)));
        };
        let n_rays = job.n_rays.load(Ordering::Relaxed);
        // A few rays say more about the clock than about the work.
        if n_rays >= 4 * TILE {
            mix(&mut self.ray_secs, job.ray_meter.secs() / n_rays as f64);
        }
        mix(
            &mut self.floor_secs,
            job.meter.secs() * f64::from(scale * scale) / 4.0,
        );
    }

    fn compose(&self, job: &Job<'_>, surface: &Surface, values: &[[f32; 3]]) -> Vec<[u8; 4]> {
        let scene = &job.request.scene;
        let layer = job.request.layer;
        let tone = Tone::new(scene, layer);
        let shows_background = scene.shows_background(layer);
        let gain = scene.transform.environment_from_world().gain.to_array();
        let width = job.camera.width as usize;
        let mut pixels = vec![[0, 0, 0, 255]; width * job.camera.height as usize];
        pixels
            .par_chunks_mut(4 * width)
            .enumerate()
            .for_each(|(band, out)| {
                job.meter.time(|| {
                    for (i, out) in out.iter_mut().enumerate() {
                        let at = band * 4 * width + i;
                        let object = surface.value(at, values).filter(|_| layer.shows_object());
                        let coverage = object.map_or(0.0, |_| surface.coverage[at]);
                        let object = object.unwrap_or_default();
                        if let Some(color) = diagnostic_color(scene, layer, coverage, object[0]) {
                            *out = opaque_bytes(color);
                            continue;
                        }
                        let mut value = object.map(|value| coverage * value);
                        if shows_background && coverage < 1.0 {
                            let light = self.points.light(at, width);
                            for c in 0..3 {
                                value[c] += (1.0 - coverage) * light[c] * gain[c];
                            }
                        }
                        let [r, g, b] = tone.bytes(value);
                        *out = [r, g, b, 255];
                    }
                });
            });
        pixels
    }
}

/// The camera of a picture at a resolution divisor.
fn scaled(camera: &Camera, scale: u32) -> Camera {
    if scale == 1 {
        return *camera;
    }
    camera.resized(
        camera.width.div_ceil(scale).max(1),
        camera.height.div_ceil(scale).max(1),
    )
}

/// At most `n` of a list, spread evenly over it; `turn` says which.
fn every_nth(list: &[u32], n: usize, turn: u32) -> Vec<u32> {
    if n == 0 {
        return Vec::new();
    }
    let step = list.len().div_ceil(n).max(1);
    list.iter()
        .skip(turn as usize % step)
        .step_by(step)
        .copied()
        .collect()
}

#[cfg(test)]
mod tests;
