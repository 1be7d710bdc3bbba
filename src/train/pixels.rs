//! The store of training pixels: each traced once, drawn from ever after.

use glam::Vec3;
use rayon::prelude::*;

use super::preconvolution::BlurredView;
use super::random::SlotRandom;
use crate::data::{Dataset, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::light_path::PathVertex;
use crate::render::GBuffer;
use crate::render::gbuffer::PathOptions;
use crate::render::trace::PathStore;

/// Coverage from which a pixel counts as all object; below its complement as all background.
const SOLID: u8 = 250;

/// A pixel that shows only the object.
#[derive(Clone, Copy, Debug)]
pub(super) struct ObjectPixel {
    first_path: u32,
    n_paths: u32,
    /// sRGB target in `[0, 1]`.
    pub target: [f32; 3],
    /// `exp(-|image gradient|)`: how far the material may be assumed smooth here (Eq. 8).
    pub smoothness: f32,
}

/// A pixel that shows only the surroundings: where it is.
#[derive(Clone, Copy, Debug)]
struct BackgroundPixel {
    view: u32,
    pixel: u32,
}

/// All training pixels.
#[derive(Debug)]
pub(super) struct PixelStore {
    objects: Vec<ObjectPixel>,
    paths: PathStore,
    /// One pool a blur level, sharp first.
    backgrounds: Vec<Vec<BackgroundPixel>>,
    views: Vec<BlurredView>,
    cameras: Vec<Camera>,
}

/// A drawn background pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct BackgroundSample {
    /// Camera position, world.
    pub origin: Vec3,
    /// Unit direction, world.
    pub direction: Vec3,
    /// Standard deviation of the pixel's cone, radians.
    pub spread: f32,
    /// sRGB target in `[0, 1]`.
    pub target: [f32; 3],
}

/// How pixels are collected.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelOptions {
    /// Seed of the thinning.
    pub seed: u64,
    /// Pixels to keep, over all views.
    pub max_pixels: usize,
    /// Blurred levels beside the sharp one.
    pub n_blurred: usize,
    /// How far object pixels are traced.
    pub paths: PathOptions,
}

impl PixelStore {
    /// Traces and sorts the pixels of all training views; `on_view` is called after each and stops the work by `false`.
    pub(super) fn collect(
        dataset: &Dataset,
        tracer: Option<&SurfaceTracer>,
        options: PixelOptions,
        on_view: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let n_pixels: usize = dataset
            .train
            .iter()
            .map(|v| v.photo.width() as usize * v.photo.height() as usize)
            .sum();
        let keep = (options.max_pixels as f32 / n_pixels.max(1) as f32).min(1.0);
        let parts: Vec<Option<ViewPixels>> = dataset
            .train
            .par_iter()
            .enumerate()
            .map(|(index, view)| {
                on_view().then(|| collect_view(view, index as u32, tracer, &options, keep))
            })
            .collect();
        let mut store = Self {
            objects: Vec::new(),
            paths: PathStore::default(),
            backgrounds: vec![Vec::new(); options.n_blurred + 1],
            views: Vec::new(),
            cameras: dataset.train.iter().map(|v| v.camera).collect(),
        };
        for part in parts {
            store.append(part?);
        }
        Some(store)
    }

    fn append(&mut self, part: ViewPixels) {
        let base = self.paths.n_paths() as u32;
        self.objects
            .extend(part.objects.iter().map(|pixel| ObjectPixel {
                first_path: base + pixel.first_path,
                ..*pixel
            }));
        self.paths.append(&part.paths);
        for (pool, pixels) in self.backgrounds.iter_mut().zip(part.backgrounds) {
            pool.extend(pixels);
        }
        self.views.push(part.blurred);
    }

    /// Number of object pixels.
    pub(super) fn n_objects(&self) -> usize {
        self.objects.len()
    }

    /// Number of sharp background pixels.
    pub(super) fn n_backgrounds(&self) -> usize {
        self.backgrounds[0].len()
    }

    /// A random object pixel.
    pub(super) fn draw_object(&self, random: &mut SlotRandom) -> &ObjectPixel {
        &self.objects[random.index(self.objects.len())]
    }

    /// The light paths of an object pixel, at least one, all of the same weight.
    pub(super) fn paths_of(
        &self,
        pixel: &ObjectPixel,
    ) -> impl ExactSizeIterator<Item = &[PathVertex]> {
        (pixel.first_path..pixel.first_path + pixel.n_paths)
            .map(|path| self.paths.path(path as usize))
    }

    /// A random background pixel, from a blurred level with probability `blurred_share`.
    pub(super) fn draw_background(
        &self,
        random: &mut SlotRandom,
        blurred_share: f32,
    ) -> BackgroundSample {
        let mut level = 0;
        if random.uniform() < blurred_share && self.backgrounds.len() > 1 {
            level = 1 + random.index(self.backgrounds.len() - 1);
            if self.backgrounds[level].is_empty() {
                level = 0;
            }
        }
        let pool = &self.backgrounds[level];
        let at = pool[random.index(pool.len())];
        let (camera, blurred) = (
            &self.cameras[at.view as usize],
            &self.views[at.view as usize].levels[level],
        );
        let (x, y) = blurred.position_px(at.pixel);
        let ray = camera.ray(x, y);
        let spread = camera.pixel_angle() * blurred.std_px();
        BackgroundSample {
            origin: ray.origin,
            direction: ray.direction,
            spread,
            target: blurred.srgb(at.pixel),
        }
    }
}

struct ViewPixels {
    objects: Vec<ObjectPixel>,
    paths: PathStore,
    backgrounds: Vec<Vec<BackgroundPixel>>,
    blurred: BlurredView,
}

fn collect_view(
    view: &View,
    index: u32,
    tracer: Option<&SurfaceTracer>,
    options: &PixelOptions,
    keep: f32,
) -> ViewPixels {
    let n = view.photo.width() as usize * view.photo.height() as usize;
    let mut objects = Vec::new();
    let mut paths = PathStore::default();
    let mut is_background = vec![true; n];
    match (&view.mask, tracer) {
        (Some(mask), _) => {
            for (is_background, coverage) in is_background.iter_mut().zip(&mask.coverage) {
                *is_background = *coverage <= u8::MAX - SOLID;
            }
        }
        (None, Some(tracer)) => {
            let options = PathOptions {
                max_vertices: 1,
                smooth: 1,
                torn: 1,
            };
            let rows = 0..view.photo.height();
            let gbuffer = GBuffer::trace_some(tracer, &view.camera, rows, options, |_| true);
            for (is_background, coverage) in is_background.iter_mut().zip(gbuffer.coverage()) {
                *is_background = *coverage <= 0.0;
            }
        }
        (None, None) => {}
    }
    if let Some(tracer) = tracer {
        let is_wanted = |i: u32| {
            let mut random = SlotRandom::new(options.seed ^ 0x5bd1, u64::from(index), u64::from(i));
            let is_solid = match &view.mask {
                Some(mask) => mask.coverage[i as usize] >= SOLID,
                None => !is_background[i as usize],
            };
            is_solid && random.uniform() < keep
        };
        let rows = 0..view.photo.height();
        let gbuffer = GBuffer::trace_some(tracer, &view.camera, rows, options.paths, is_wanted);
        for i in 0..n {
            let first_path = paths.n_paths() as u32;
            gbuffer.paths_at(i as u32).for_each(|path| paths.push(path));
            let n_paths = paths.n_paths() as u32 - first_path;
            if n_paths > 0 && gbuffer.coverage()[i] >= 1.0 {
                objects.push(object_pixel(view, i, first_path, n_paths));
            }
        }
    }
    let blurred = BlurredView::new(&view.photo, &is_background, options.n_blurred);
    let backgrounds = blurred.levels.iter().enumerate().map(|(level, image)| {
        let mut random = SlotRandom::new(options.seed ^ 0x1b87, u64::from(index), level as u64);
        let valid = image.valid_pixels();
        valid
            .filter(|_| random.uniform() < keep)
            .map(|pixel| BackgroundPixel { view: index, pixel })
            .collect()
    });
    ViewPixels {
        objects,
        paths,
        backgrounds: backgrounds.collect(),
        blurred,
    }
}

fn object_pixel(view: &View, i: usize, first_path: u32, n_paths: u32) -> ObjectPixel {
    ObjectPixel {
        first_path,
        n_paths,
        // Linear photos are cut where a display would cut them, as 8-bit ones were.
        target: view.photo.srgb(i).map(|v| v.min(1.0)),
        smoothness: (-image_gradient(view, i)).exp(),
    }
}

/// Length of the grey image's gradient at pixel `i`, central differences, per pixel.
fn image_gradient(view: &View, i: usize) -> f32 {
    let (width, height) = (view.photo.width() as usize, view.photo.height() as usize);
    let (x, y) = (i % width, i / width);
    let grey = |x: usize, y: usize| view.photo.srgb(y * width + x).iter().sum::<f32>() / 3.0;
    let dx = grey((x + 1).min(width - 1), y) - grey(x.saturating_sub(1), y);
    let dy = grey(x, (y + 1).min(height - 1)) - grey(x, y.saturating_sub(1));
    0.5 * dx.hypot(dy)
}
