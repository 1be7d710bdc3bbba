//! Some rows of a preview pass: what is known of them, and how it is brought up to date.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::request::{PreviewScene, Quality};
use crate::render::highlight::{highlighted, region_share};
use crate::render::path::gbuffer::{GBuffer, PathOptions};
use crate::render::path::more_cones::is_any_uncertain;
use crate::render::path::scratch::{ShadeScratch, TILE};
use crate::render::path::shade::{compose, shade_background, shade_object_once, shade_uncertain};

/// Pixels of a band, about.
const BAND_PIXELS: u32 = 2048;
/// Pixels shaded again between two looks at whether the picture is still wanted.
const UNCERTAIN_TILE: usize = 16;
/// Fewest rows of a band: tracing looks at one more row on each side.
const MIN_BAND_ROWS: u32 = 4;

/// Counters of what the parts depend on: a part of a band is good while its number is the pass's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::render) struct Versions {
    pub(in crate::render) geometry: u64,
    pub(in crate::render) background: u64,
    pub(in crate::render) object: u64,
    pub(in crate::render) highlight: u64,
}

/// Some rows of the picture, with what is known of them; a version of 0 is nothing.
#[derive(Debug, Default)]
pub(in crate::render) struct Band {
    pub(in crate::render) rows: Range<u32>,
    gbuffer: GBuffer,
    geometry_version: u64,
    /// `[rows * width]` linear; behind the object only where `is_background_whole`.
    background: Vec<[f32; 3]>,
    background_version: u64,
    is_background_whole: bool,
    /// `[rows * width]` linear, or the layer's value.
    values: Vec<[f32; 3]>,
    /// Of each pixel where the object is seen, in order: its standard error as the cones of split lobes disagree; 0 once it
    /// was shaded again.
    std_errors: Vec<f32>,
    object_version: u64,
    /// `[rows * width]` share that is highlighted.
    highlight: Vec<f32>,
    highlight_version: u64,
}

/// What all bands of a pass share.
pub(in crate::render) struct Work<'a> {
    pub(in crate::render) request: &'a PreviewScene,
    pub(in crate::render) quality: Quality,
    pub(in crate::render) versions: Versions,
    /// Set when the picture is no longer wanted.
    pub(in crate::render) cancel: &'a AtomicBool,
}

impl Work<'_> {
    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

pub(super) fn band_rows(width: u32) -> u32 {
    (BAND_PIXELS / width.max(1)).max(MIN_BAND_ROWS)
}

pub(in crate::render) fn bands(width: u32, height: u32) -> Vec<Band> {
    let rows = band_rows(width);
    (0..height.div_ceil(rows))
        .map(|i| Band {
            rows: i * rows..((i + 1) * rows).min(height),
            ..Band::default()
        })
        .collect()
}

impl Band {
    /// Computes what is out of date and needed for the layer: pixels of geometry, environment, object.
    pub(in crate::render) fn update(
        &mut self,
        work: &Work<'_>,
        scratch: &mut ShadeScratch,
    ) -> [usize; 3] {
        let layer = work.request.layer;
        let is_traced = self.geometry_version == work.versions.geometry;
        let traced = if is_traced { 0 } else { self.trace(work) };
        let background = if work.request.scene.shows_background(layer) {
            self.update_background(work, scratch)
        } else {
            0
        };
        let mut object = 0;
        if layer.shows_object() && self.object_version != work.versions.object {
            object += self.update_object(work, scratch);
        }
        if work.quality == Quality::Settled && layer.shows_object() {
            object += self.settle_object(work, scratch);
        }
        self.update_highlight(work, scratch);
        [traced, background, object]
    }

    fn trace(&mut self, work: &Work<'_>) -> usize {
        let PreviewScene { scene, camera, .. } = work.request;
        let tracer = scene.object.as_ref().map(|object| &*object.tracer);
        self.gbuffer = GBuffer::trace(tracer, camera, self.rows.clone(), PathOptions::FINE);
        self.geometry_version = work.versions.geometry;
        self.std_errors.clear();
        self.gbuffer.coverage().len()
    }

    fn update_object(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> usize {
        let pixels = self.pixels(work, |coverage| coverage > 0.0);
        let mut out = vec![[0.0; 3]; pixels.len()];
        self.std_errors.clear();
        for (pixels, out) in pixels.chunks(TILE).zip(out.chunks_mut(TILE)) {
            if work.is_cancelled() {
                return 0;
            }
            let (scene, layer) = (&work.request.scene, work.request.layer);
            let errors = shade_object_once(scene, &self.gbuffer, pixels, layer, 1, out, scratch);
            self.std_errors.extend(errors);
        }
        self.values.clear();
        self.values.resize(self.gbuffer.coverage().len(), [0.0; 3]);
        let first = self.first(work);
        scatter(&mut self.values, first, &pixels, &out);
        self.object_version = work.versions.object;
        pixels.len()
    }

    /// Shades the object's uncertain pixels again.
    fn settle_object(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> usize {
        if work.is_cancelled() || self.is_settled() {
            return 0;
        }
        let pixels = self.pixels(work, |coverage| coverage > 0.0);
        let first = self.first(work);
        let known = pixels.iter().map(|pixel| (pixel - first) as usize);
        let mut out: Vec<_> = known.map(|i| self.values[i]).collect();
        let mut n_shaded = 0;
        let errors = self.std_errors.chunks_mut(UNCERTAIN_TILE);
        let tiles = out.chunks_mut(UNCERTAIN_TILE).zip(errors);
        for (pixels, (out, errors)) in pixels.chunks(UNCERTAIN_TILE).zip(tiles) {
            if work.is_cancelled() {
                break;
            }
            let (scene, layer) = (&work.request.scene, work.request.layer);
            let parts = (&mut *out, &*errors);
            n_shaded += shade_uncertain(scene, &self.gbuffer, pixels, layer, parts, scratch);
            errors.fill(0.0);
        }
        scatter(&mut self.values, first, &pixels, &out);
        n_shaded
    }

    /// Whether a pass of [`Quality::Settled`] would show anything else.
    pub(in crate::render) fn is_settled(&self) -> bool {
        !is_any_uncertain(&self.std_errors)
    }

    fn update_highlight(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) {
        let is_fresh = self.highlight_version == work.versions.highlight;
        let Some(region) = work.request.highlight.as_ref().filter(|_| !is_fresh) else {
            return;
        };
        let pixels = self.pixels(work, |coverage| coverage > 0.0);
        let scene = &work.request.scene;
        let shares = region_share(scene, &self.gbuffer, region, &pixels, scratch);
        self.highlight.clear();
        self.highlight.resize(self.gbuffer.coverage().len(), 0.0);
        let first = self.first(work);
        scatter(&mut self.highlight, first, &pixels, &shares);
        self.highlight_version = work.versions.highlight;
    }

    fn update_background(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> usize {
        // With the object hidden, the environment behind it is wanted as well.
        let wants_whole = !work.request.layer.shows_object();
        let is_fresh = self.background_version == work.versions.background;
        if is_fresh && (self.is_background_whole || !wants_whole) {
            return 0;
        }
        let pixels = match (is_fresh, wants_whole) {
            (true, _) => self.pixels(work, |coverage| coverage >= 1.0),
            (false, true) => self.pixels(work, |_| true),
            (false, false) => self.pixels(work, |coverage| coverage < 1.0),
        };
        let mut out = vec![[0.0; 3]; pixels.len()];
        let PreviewScene { scene, camera, .. } = work.request;
        shade_background(scene, camera, &pixels, &mut out, scratch);
        self.background
            .resize(self.gbuffer.coverage().len(), [0.0; 3]);
        let first = self.first(work);
        scatter(&mut self.background, first, &pixels, &out);
        self.background_version = work.versions.background;
        self.is_background_whole = wants_whole;
        pixels.len()
    }

    /// Index of its first pixel in the whole picture.
    fn first(&self, work: &Work<'_>) -> u32 {
        self.rows.start * work.request.camera.width
    }

    /// Indices in the whole picture of the band's pixels whose coverage is as asked.
    fn pixels(&self, work: &Work<'_>, keep: impl Fn(f32) -> bool) -> Vec<u32> {
        let first = self.first(work);
        let coverage = self.gbuffer.coverage().iter().enumerate();
        coverage
            .filter(|(_, coverage)| keep(**coverage))
            .map(|(i, _)| first + i as u32)
            .collect()
    }

    pub(in crate::render) fn compose(&self, work: &Work<'_>, out: &mut [[u8; 4]]) {
        let layer = work.request.layer;
        let value =
            |part: &[[f32; 3]], i: usize, shown: bool| if shown { part[i] } else { [0.0; 3] };
        let shows_background = work.request.scene.shows_background(layer);
        let is_highlighted = work.request.highlight.is_some() && layer.shows_object();
        for (i, (out, &coverage)) in out.iter_mut().zip(self.gbuffer.coverage()).enumerate() {
            let coverage = if layer.shows_object() { coverage } else { 0.0 };
            let object = value(&self.values, i, layer.shows_object());
            let background = value(&self.background, i, shows_background);
            let mut color = compose(&work.request.scene, layer, coverage, object, background);
            if is_highlighted {
                color = highlighted(color, self.highlight[i] * coverage);
            }
            *out = opaque_bytes(color);
        }
    }
}

/// A display colour in 8 bits with alpha 255.
pub(super) fn opaque_bytes(color: [f32; 3]) -> [u8; 4] {
    let [r, g, b] = color.map(|v| (v * 255.0 + 0.5) as u8);
    [r, g, b, 255]
}

fn scatter<T: Copy>(into: &mut [T], first: u32, pixels: &[u32], values: &[T]) {
    for (pixel, value) in pixels.iter().zip(values) {
        into[(pixel - first) as usize] = *value;
    }
}
