//! The environment as points in space: seen once, projected into every picture that follows.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

use glam::{Affine3A, Mat3, Vec3};
use rayon::prelude::*;

use super::{Job, Purpose};
use crate::geometry::Camera;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::{Environment, EnvironmentTransform};
use crate::render::background::Background;
use crate::render::ground::Ground;
use crate::render::path::scratch::SeenLight;
use crate::render::preview::request::same;

/// No point.
const NONE: u32 = u32::MAX;
/// Points projected by one task.
const GRAIN: usize = 4096;
/// Ratio of the distances of two points from which one of them does not belong to the other's surface.
const NEARER: f32 = 0.87;
/// Neighbours from which a point is expected to have company, and how many of them it needs.
const NEIGHBOURS: usize = 4;
const COMPANY: usize = 2;
/// Neighbours that may be nearer than a point at rest; more of them would hide it if they were all there. In motion as many
/// as belong to it.
const MOST_NEARER: usize = 1;
/// Cosine of the turn from which a view has next to nothing in common with the one before: what was seen at a flat angle
/// would stand far apart, and what lies behind it would shine through.
const LEAST_TURN_COS: f32 = 0.94;
/// Pixels around one that has just been seen in which farther points are suspected of being hidden.
const SUSPECT_REACH: usize = 2;
/// Rays just followed nearby that must meet something nearer to prove a suspected point hidden.
const PROOF: u8 = 2;
/// Difference of two neighbours' values from which a ray is followed between them, as square roots of radiance: about
/// five of 255 codes.
const LARGEST_STEP: f32 = 0.02;

/// Points, and which of them each pixel of the current picture shows.
#[derive(Clone, Debug, Default)]
pub(super) struct PointCloud {
    points: Vec<SeenLight>,
    /// Index of each pixel's point, or [`NONE`].
    shown: Vec<u32>,
    source: Option<Source>,
    /// Whether they are seen again as they were.
    is_still: bool,
}

/// What the points were seen in.
#[derive(Clone, Debug)]
struct Source {
    environment: Arc<Environment>,
    ground: Option<Arc<Ground>>,
    camera: Camera,
    transform: EnvironmentTransform,
    is_blurred: bool,
    marks_unseen: bool,
    /// Whether some are of an earlier state.
    is_mixed: bool,
}

impl Source {
    fn of(job: &Job<'_>, is_mixed: bool) -> Self {
        let scene = &job.request.scene;
        Self {
            environment: Arc::clone(&scene.environment),
            ground: scene.ground.clone(),
            camera: job.camera,
            transform: scene.transform,
            is_blurred: scene.shown_background() == Background::Blurred,
            marks_unseen: scene.marks_unseen,
            is_mixed,
        }
    }

    fn is_same_light(&self, job: &Job<'_>) -> bool {
        let scene = &job.request.scene;
        Arc::ptr_eq(&self.environment, &scene.environment)
            && same(self.ground.as_ref(), scene.ground.as_ref())
    }

    fn is_seen_from_near_here(&self, job: &Job<'_>) -> bool {
        self.camera.forward().dot(job.camera.forward()) >= LEAST_TURN_COS
    }

    fn is_same_view(&self, job: &Job<'_>) -> bool {
        self.camera.world_from_camera == job.camera.world_from_camera
            && self.transform == job.request.scene.transform
    }

    /// Whether its points may be shown until there are better ones: the same environment, trained a little further.
    fn is_kin(&self, job: &Job<'_>) -> bool {
        let (old, new) = (&self.environment, &job.request.scene.environment);
        let is_one_place = Arc::ptr_eq(old, new)
            || old.name() == new.name()
                && old.frame() == new.frame()
                && old.is_far() == new.is_far();
        // It is not known where the light of the paper's field comes from.
        let has_places = !matches!(new.field(), EnvironmentField::Paper(_));
        // What was seen sharp is not blurred, and the other way round.
        let is_as_sharp =
            self.is_blurred == (job.request.scene.shown_background() == Background::Blurred);
        let is_as_marked = self.marks_unseen == job.request.scene.marks_unseen;
        is_as_sharp && is_as_marked && is_one_place && (has_places || self.is_same_view(job))
    }
}

impl PointCloud {
    /// Finds which point each pixel shows; those that none shows are dropped.
    pub(super) fn project(&mut self, job: &Job<'_>) {
        let keeps = |source: &Source| match job.purpose {
            Purpose::Motion => source.is_kin(job),
            Purpose::Rest => source.is_kin(job) && source.is_same_light(job) && !source.is_mixed,
            Purpose::Refresh | Purpose::SharpRefresh => false,
        };
        let near = self.source.as_ref();
        let near = near.filter(|source| source.is_seen_from_near_here(job));
        let is_kept = near.is_some_and(keeps);
        let is_mixed = is_kept
            && self
                .source
                .as_ref()
                .is_some_and(|source| source.is_mixed || !source.is_same_light(job));
        if !is_kept {
            self.points.clear();
        }
        let is_still = |source: &Source| source.is_same_view(job) && source.is_same_light(job);
        self.is_still = self.source.as_ref().is_some_and(is_still);
        self.source = Some(Source::of(job, is_mixed));
        let Camera { width, height, .. } = job.camera;
        let nearest: Vec<AtomicU64> = (0..width * height)
            .map(|_| AtomicU64::new(u64::MAX))
            .collect();
        let projector = job.camera.projector(world_from_field(job));
        self.points
            .par_chunks(GRAIN)
            .enumerate()
            .for_each(|(task, points)| {
                job.meter.time(|| {
                    for (i, point) in points.iter().enumerate() {
                        let Some((at, distance)) = projector.project(point.position) else {
                            continue;
                        };
                        // Written so that what is outside on the left is not rounded to the first column.
                        let is_inside = at.x >= 0.0
                            && at.y >= 0.0
                            && at.x < width as f32
                            && at.y < height as f32;
                        if is_inside {
                            let pixel = at.y as usize * width as usize + at.x as usize;
                            let index = (task * GRAIN + i) as u64;
                            // Bits of positive floats are ordered as the floats are.
                            let key = (u64::from(distance.to_bits()) << 32) | index;
                            nearest[pixel].fetch_min(key, Ordering::Relaxed);
                        }
                    }
                });
            });
        self.keep(job, &nearest);
    }

    /// Keeps the nearest point of each pixel, unless it stands alone: one that shines through a gap between nearer ones, or
    /// whose place was a wrong guess.
    fn keep(&mut self, job: &Job<'_>, nearest: &[AtomicU64]) {
        let width = job.camera.width as usize;
        let key = |i: usize| nearest[i].load(Ordering::Relaxed);
        let distance = |i: usize| f32::from_bits((key(i) >> 32) as u32);
        // At rest, points of a picture in motion stand at every second pixel or so, and rays for uncertain ones are at hand.
        let is_at_rest = job.purpose != Purpose::Motion;
        let steps = steps_around(width, if is_at_rest { 2 } else { 1 });
        let has_company = |i: usize| {
            let (mut n_beside, mut n_company, mut n_nearer) = (0, 0, 0);
            for step in &steps {
                for j in [i.wrapping_sub(*step), i + step] {
                    if j < nearest.len() && key(j) != u64::MAX {
                        let (a, b) = (distance(i), distance(j));
                        n_beside += 1;
                        n_company += usize::from(a.min(b) > NEARER * a.max(b));
                        n_nearer += usize::from(b <= NEARER * a);
                    }
                }
            }
            let most_nearer = if is_at_rest { MOST_NEARER } else { n_company };
            n_beside < NEIGHBOURS || n_company >= COMPANY && n_nearer <= most_nearer
        };
        let stays: Vec<bool> = (0..nearest.len())
            .into_par_iter()
            .with_min_len(GRAIN)
            .map(|i| key(i) != u64::MAX && has_company(i))
            .collect();
        job.meter.time(|| {
            let mut kept = Vec::with_capacity(self.points.len().min(nearest.len()));
            self.shown.clear();
            self.shown.resize(nearest.len(), NONE);
            for (i, _) in stays.iter().enumerate().filter(|(_, stays)| **stays) {
                self.shown[i] = kept.len() as u32;
                kept.push(self.points[(key(i) & u64::from(u32::MAX)) as usize]);
            }
            self.points = kept;
        });
    }

    /// One pixel of each two by two in which the environment is seen and no point falls.
    pub(super) fn missing(&self, camera: &Camera, is_open: impl Fn(usize) -> bool) -> Vec<u32> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut missing = Vec::new();
        for y in (0..height).step_by(2) {
            for x in (0..width).step_by(2) {
                let block = || {
                    let rows = y..(y + 2).min(height);
                    rows.flat_map(move |y| (x..(x + 2).min(width)).map(move |x| y * width + x))
                };
                if block().all(|i| self.shown[i] == NONE) {
                    missing.extend(block().find(|i| is_open(*i)).map(|i| i as u32));
                }
            }
        }
        missing
    }

    /// Pixels without a point between neighbours that differ.
    pub(super) fn uneven(
        &self,
        camera: &Camera,
        is_open: impl Fn(usize) -> bool + Sync,
    ) -> Vec<u32> {
        let width = camera.width as usize;
        let is_uneven = |i: &usize| {
            let (mut low, mut high) = ([f32::INFINITY; 3], [0.0_f32; 3]);
            for (point, _) in self.around(*i, width) {
                for c in 0..3 {
                    let value = point.radiance[c].clamp(0.0, 1.0).sqrt();
                    low[c] = low[c].min(value);
                    high[c] = high[c].max(value);
                }
            }
            (0..3).any(|c| high[c] - low[c] > LARGEST_STEP)
        };
        (0..self.shown.len())
            .into_par_iter()
            .filter(|i| self.shown[*i] == NONE && is_open(*i) && is_uneven(i))
            .map(|i| i as u32)
            .collect()
    }

    /// Pixels that a ray would make better: those without a point, and where something moves one point in `every` (a power
    /// of two), with remainder `turn`.
    pub(super) fn spare(
        &self,
        is_open: impl Fn(usize) -> bool,
        (every, turn): (u32, u32),
    ) -> Vec<u32> {
        let is_due = |i: usize| ((i as u32).wrapping_mul(0x9e37_79b9) >> 16) & (every - 1) == turn;
        (0..self.shown.len())
            .filter(|i| self.shown[*i] == NONE || !self.is_still && is_due(*i))
            .filter(|i| is_open(*i))
            .map(|i| i as u32)
            .collect()
    }

    /// Takes in what was seen through pixels.
    pub(super) fn add(&mut self, pixels: &[u32], light: &[SeenLight]) {
        for (pixel, light) in pixels.iter().zip(light) {
            let shown = &mut self.shown[*pixel as usize];
            if *shown == NONE {
                *shown = self.points.len() as u32;
                self.points.push(*light);
            } else {
                self.points[*shown as usize] = *light;
            }
        }
    }

    /// Drops points that shine through what `seen`, pixels just added, has shown to lie before them; returns their pixels.
    pub(super) fn drop_hidden(&mut self, job: &Job<'_>, seen: &[u32]) -> Vec<u32> {
        let width = job.camera.width as usize;
        let (to_world, eye) = (world_from_field(job), job.camera.position());
        let distance = |pixel: usize| {
            let point = self.points.get(self.shown[pixel] as usize)?;
            Some(to_world.transform_point3(point.position).distance(eye))
        };
        let proofs: Vec<AtomicU8> = (0..self.shown.len()).map(|_| AtomicU8::new(0)).collect();
        let steps = steps_around(width, SUSPECT_REACH);
        seen.par_iter().with_min_len(256).for_each(|&pixel| {
            let pixel = pixel as usize;
            let Some(near) = distance(pixel) else { return };
            for step in &steps {
                for beside in [pixel.wrapping_sub(*step), pixel + step] {
                    let is_far = |far: f32| near <= NEARER * far;
                    if beside < self.shown.len() && distance(beside).is_some_and(is_far) {
                        proofs[beside].fetch_add(1, Ordering::Relaxed);
                    }
                }
            }
        });
        let mut is_new = vec![false; self.shown.len()];
        for &pixel in seen {
            is_new[pixel as usize] = true;
        }
        let is_hidden = |i: &usize| !is_new[*i] && proofs[*i].load(Ordering::Relaxed) >= PROOF;
        let hidden: Vec<usize> = (0..self.shown.len()).filter(is_hidden).collect();
        for &pixel in &hidden {
            self.shown[pixel] = NONE;
        }
        hidden.into_iter().map(|pixel| pixel as u32).collect()
    }

    /// Radiance of a pixel before the transform's gain: its point's, or the mean of those around it.
    pub(super) fn light(&self, pixel: usize, width: usize) -> [f32; 3] {
        let shown = self.shown[pixel];
        if shown != NONE {
            return self.points[shown as usize].radiance;
        }
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for (point, weight) in self.around(pixel, width) {
            weights += weight;
            sum += weight * Vec3::from(point.radiance);
        }
        // Where the object was on all sides there is nothing to take the mean of.
        (sum / f32::max(weights, 1e-9)).to_array()
    }

    /// The points of the eight pixels around, with weights.
    fn around(&self, pixel: usize, width: usize) -> impl Iterator<Item = (&SeenLight, f32)> {
        let (x, y) = ((pixel % width) as i64, (pixel / width) as i64);
        let height = (self.shown.len() / width) as i64;
        let offsets = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
        offsets.filter_map(move |(dx, dy): (i64, i64)| {
            let (x, y) = (x + dx, y + dy);
            if !(0..width as i64).contains(&x) || !(0..height).contains(&y) {
                return None;
            }
            let shown = self.shown[y as usize * width + x as usize];
            let weight = if dx == 0 || dy == 0 { 1.0 } else { 0.5 };
            (shown != NONE).then(|| (&self.points[shown as usize], weight))
        })
    }
}

/// What to add to a pixel's index for those around it in one direction; the others are opposite.
fn steps_around(width: usize, reach: usize) -> Vec<usize> {
    let below = (1..=reach).flat_map(|dy| {
        let row = dy * width;
        (0..=2 * reach).map(move |x| (row + x).saturating_sub(reach))
    });
    (1..=reach).chain(below).collect()
}

/// From the field's coordinates to the world, as the environment stands now.
fn world_from_field(job: &Job<'_>) -> Affine3A {
    let scene = &job.request.scene;
    let motion = scene.transform.environment_from_world();
    let frame = scene.environment.frame();
    let world = |p: Vec3| motion.world_point(frame.world_from_field(p));
    let origin = world(Vec3::ZERO);
    let axis = |axis: Vec3| world(axis) - origin;
    let axes = Mat3::from_cols(axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z));
    Affine3A::from_mat3_translation(axes, origin)
}
