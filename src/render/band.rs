//! Some rows of a preview pass: what is known of them, and how it is brought up to date.

use std::ops::Range;
use std::time::Instant;

use super::gbuffer::GBuffer;
use super::progressive::PreviewScene;
use super::shade::{ShadeScratch, compose, shade_background, shade_object};
use crate::geometry::Camera;

/// Pixels of a band, about: the grain of interruption.
const BAND_PIXELS: u32 = 2048;
/// Fewest rows of a band: tracing looks at one more row on each side.
const MIN_BAND_ROWS: u32 = 4;

/// Counters of the causes: a part of a band is good while its number is the pass's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Versions {
    pub(super) geometry: u64,
    pub(super) background: u64,
    pub(super) object: u64,
}

/// Some rows of one pass, with what is known of them; 0 in `versions` is nothing.
#[derive(Debug)]
pub(super) struct Band {
    pub(super) rows: Range<u32>,
    pub(super) versions: Versions,
    pub(super) gbuffer: GBuffer,
    /// `[rows * width]` linear; behind the object only where `is_background_whole`.
    pub(super) background: Vec<[f32; 3]>,
    pub(super) is_background_whole: bool,
    /// `[rows * width]` linear, or the layer's value.
    pub(super) object: Vec<[f32; 3]>,
}

/// What all bands of a pass share.
pub(super) struct Work<'a> {
    pub(super) request: &'a PreviewScene,
    pub(super) camera: Camera,
    pub(super) versions: Versions,
}

/// What a band computed of one part.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Part {
    pub(super) n_pixels: usize,
    pub(super) nanos: usize,
}

impl Part {
    /// Runs `compute`, which returns a pixel count, if it is `needed`.
    fn measure(needed: bool, compute: impl FnOnce() -> usize) -> Self {
        if !needed {
            return Self::default();
        }
        let start = Instant::now();
        let n_pixels = compute();
        Self {
            n_pixels,
            nanos: start.elapsed().as_nanos() as usize,
        }
    }
}

pub(super) fn band_rows(width: u32) -> u32 {
    (BAND_PIXELS / width.max(1)).max(MIN_BAND_ROWS)
}

pub(super) fn bands(width: u32, height: u32) -> Vec<Band> {
    let rows = band_rows(width);
    (0..height.div_ceil(rows))
        .map(|i| Band {
            rows: i * rows..((i + 1) * rows).min(height),
            versions: Versions::default(),
            gbuffer: GBuffer::default(),
            background: Vec::new(),
            is_background_whole: false,
            object: Vec::new(),
        })
        .collect()
}

impl Band {
    /// Computes what is out of date and needed for the layer: geometry, surroundings, object.
    pub(super) fn update(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> [Part; 3] {
        let layer = work.request.layer;
        [
            Part::measure(self.versions.geometry != work.versions.geometry, || {
                self.trace(work)
            }),
            Part::measure(layer.shows_background(), || {
                self.update_background(work, scratch)
            }),
            Part::measure(
                layer.shows_object() && self.versions.object != work.versions.object,
                || self.update_object(work, scratch),
            ),
        ]
    }

    fn trace(&mut self, work: &Work<'_>) -> usize {
        let tracer = work
            .request
            .scene
            .object
            .as_ref()
            .map(|object| &*object.tracer);
        self.gbuffer = GBuffer::trace(tracer, &work.camera, self.rows.clone());
        self.versions = Versions {
            geometry: work.versions.geometry,
            ..Versions::default()
        };
        self.gbuffer.coverage().len()
    }

    fn update_object(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> usize {
        let pixels = self.pixels(work.camera.width, |coverage| coverage > 0.0);
        let mut out = vec![[0.0; 3]; pixels.len()];
        shade_object(
            &work.request.scene,
            &self.gbuffer,
            &pixels,
            work.request.layer,
            &mut out,
            scratch,
        );
        self.object.clear();
        self.object.resize(self.gbuffer.coverage().len(), [0.0; 3]);
        scatter(
            &mut self.object,
            self.rows.start * work.camera.width,
            &pixels,
            &out,
        );
        self.versions.object = work.versions.object;
        pixels.len()
    }

    fn update_background(&mut self, work: &Work<'_>, scratch: &mut ShadeScratch) -> usize {
        // With the object hidden, the surroundings behind it are wanted as well.
        let wants_whole = !work.request.layer.shows_object();
        let is_fresh = self.versions.background == work.versions.background;
        if is_fresh && (self.is_background_whole || !wants_whole) {
            return 0;
        }
        let width = work.camera.width;
        let pixels = match (is_fresh, wants_whole) {
            (true, _) => self.pixels(width, |coverage| coverage >= 1.0),
            (false, true) => self.pixels(width, |_| true),
            (false, false) => self.pixels(width, |coverage| coverage < 1.0),
        };
        let mut out = vec![[0.0; 3]; pixels.len()];
        shade_background(
            &work.request.scene,
            &work.camera,
            &pixels,
            &mut out,
            scratch,
        );
        self.background
            .resize(self.gbuffer.coverage().len(), [0.0; 3]);
        scatter(&mut self.background, self.rows.start * width, &pixels, &out);
        self.versions.background = work.versions.background;
        self.is_background_whole = wants_whole;
        pixels.len()
    }

    /// Indices in the whole picture of the band's pixels whose coverage is as asked.
    fn pixels(&self, width: u32, keep: impl Fn(f32) -> bool) -> Vec<u32> {
        let first = self.rows.start * width;
        let coverage = self.gbuffer.coverage().iter().enumerate();
        coverage
            .filter(|(_, coverage)| keep(**coverage))
            .map(|(i, _)| first + i as u32)
            .collect()
    }

    pub(super) fn compose(&self, work: &Work<'_>, out: &mut [[u8; 4]]) {
        let layer = work.request.layer;
        let value =
            |part: &[[f32; 3]], i: usize, shown: bool| if shown { part[i] } else { [0.0; 3] };
        for (i, (out, &coverage)) in out.iter_mut().zip(self.gbuffer.coverage()).enumerate() {
            let coverage = if layer.shows_object() { coverage } else { 0.0 };
            let object = value(&self.object, i, layer.shows_object());
            let background = value(&self.background, i, layer.shows_background());
            let [r, g, b] = compose(&work.request.scene, layer, coverage, object, background)
                .map(|v| (v * 255.0 + 0.5) as u8);
            *out = [r, g, b, 255];
        }
    }
}

fn scatter(into: &mut [[f32; 3]], first: u32, pixels: &[u32], values: &[[f32; 3]]) {
    for (pixel, value) in pixels.iter().zip(values) {
        into[(pixel - first) as usize] = *value;
    }
}
