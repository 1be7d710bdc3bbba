//! The training pixels of a view: which are the object's and which the background's, and what is kept of them.

use rayon::prelude::*;

use super::block_chroma::{BlockChroma, block_around};
use super::image_gradient::{slopes, smoothness};
use super::outlines::{Sides, bands};
use super::packed_path::PackedPaths;
use super::preconvolution::{BlurredImage, blurred_images};
use super::srgb_codes::SrgbCodes;
use crate::data::{Dataset, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::render::GBuffer;
use crate::render::path::gbuffer::PathOptions;
use crate::train::random::SlotRandom;

/// How pixels are collected.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct PixelOptions {
    /// Seed of the thinning.
    pub seed: u64,
    /// Whether the background is collected.
    pub background: bool,
    /// Pixels to keep, over all views.
    pub max_pixels: usize,
    /// About how many of the object's pixels to trace, over all views: where more cannot be drawn before they are traced anew,
    /// more would be traced in vain. Of each view as many.
    pub most_objects: usize,
    /// Distinguishes one choice of them from another.
    pub choice: u64,
    /// Blurred levels beside the sharp one.
    pub n_blurred: usize,
    /// What clipped pixels count when blurred.
    pub clipped_radiance: f32,
    /// How far object pixels are traced.
    pub paths: PathOptions,
    /// Standard deviation of the error of the masks' outlines, pixels; 0: exact.
    pub outline_error_px: f32,
    /// Whether chroma that pixels have in common is distinguished from what each pixel has.
    pub shared_chroma: bool,
}

/// The training pixels of one view.
#[derive(Debug)]
pub(super) struct ViewPixels {
    pub(super) camera: Camera,
    /// As it was when the object's light paths were traced.
    pub(super) traced: Camera,
    /// Light paths, targets, `exp(-|image gradient|)` in 255ths and slopes in [`super::image_gradient::SLOPE_CODES`] of its object pixels.
    pub(super) paths: PackedPaths,
    pub(super) targets: SrgbCodes,
    pub(super) smoothness: Vec<u8>,
    pub(super) slopes: Vec<[[i8; 2]; 3]>,
    /// Columns and rows of the blocks of pixels that have their chroma in common.
    pub(super) chroma_block: [u32; 2],
    /// Which of the photo's pixels the object's are, ascending, where there are such blocks.
    pub(super) places: Vec<u32>,
    /// By blur level, sharp first.
    pub(super) backgrounds: Vec<BlurredImage>,
    /// Whether [`PixelOptions::most_objects`] has left none out.
    pub(super) has_all_wanted: bool,
}

/// The pixels of all views; backgrounds only of those that `has_backgrounds`. `None` once `on_view` returns false.
pub(super) fn collect_views(
    (dataset, cameras): (&Dataset, &[Camera]),
    tracer: Option<&SurfaceTracer>,
    options: &PixelOptions,
    has_backgrounds: impl Fn(&View) -> bool + Sync,
    on_view: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<ViewPixels>> {
    let n_pixels: usize = dataset.train.iter().map(|v| v.photo.n_pixels()).sum();
    let keep = (options.max_pixels as f32 / n_pixels.max(1) as f32).min(1.0);
    let n_views = dataset.train.len().max(1);
    let collect = |(index, (view, camera)): (usize, (&View, &Camera))| {
        on_view().then(|| {
            let sides = Sides::new(view, camera, tracer, options.outline_error_px);
            let mut pixels = ViewPixels {
                camera: *camera,
                traced: *camera,
                paths: PackedPaths::default(),
                targets: SrgbCodes::like(&view.photo),
                smoothness: Vec::new(),
                slopes: Vec::new(),
                chroma_block: [1, 1],
                places: Vec::new(),
                backgrounds: Vec::new(),
                has_all_wanted: true,
            };
            if let Some(tracer) = tracer {
                let n_objects = sides.object.iter().filter(|is_object| **is_object).count();
                let most = (options.most_objects / n_views).max(1) as f32;
                let share = most / n_objects.max(1) as f32;
                pixels.has_all_wanted = share >= keep;
                let thinning = (index as u64, keep.min(share));
                pixels.trace_objects(view, tracer, options, thinning, &sides.object);
            }
            if has_backgrounds(view) {
                let thinning = (index as u64, keep);
                pixels.collect_backgrounds(view, options, thinning, &sides.background);
            }
            pixels
        })
    };
    let views = dataset.train.par_iter().zip(cameras).enumerate();
    views.map(collect).collect()
}

impl ViewPixels {
    /// Traces the object's pixels; of the `index`-th view a share `keep` is kept.
    fn trace_objects(
        &mut self,
        view: &View,
        tracer: &SurfaceTracer,
        options: &PixelOptions,
        (index, keep): (u64, f32),
        is_object: &[bool],
    ) {
        let seed = (options.seed ^ 0x5bd1).wrapping_add(options.choice);
        let blocks = BlockChroma::of(&view.photo).filter(|_| options.shared_chroma);
        if blocks.is_some() {
            self.chroma_block = view.photo.chroma_block();
        }
        let (camera, size) = (self.camera, self.chroma_block);
        let is_wanted = |i: u32| {
            // Blocks are kept whole.
            let first = block_around(i, camera.width, size).next().unwrap_or(i);
            let mut random = SlotRandom::new(seed, index, u64::from(first));
            is_object[i as usize] && random.uniform() < keep
        };
        for rows in bands(&camera) {
            let first = rows.start * camera.width;
            let gbuffer = GBuffer::trace_some(tracer, &camera, rows, options.paths, is_wanted);
            for (i, coverage) in (first..).zip(gbuffer.coverage()) {
                if *coverage >= 1.0 && self.paths.push(gbuffer.paths_at(i)) {
                    let n = i as usize;
                    let target = match &blocks {
                        Some(blocks) => blocks.srgb(&view.photo, n),
                        None => view.photo.srgb(n),
                    };
                    self.targets.extend([target]);
                    self.smoothness.push(smoothness(view, n));
                    self.slopes.push(slopes(view, n, is_object));
                    if blocks.is_some() {
                        self.places.push(i);
                    }
                }
            }
        }
        self.paths.shrink();
        self.targets.shrink();
        self.smoothness.shrink_to_fit();
        self.slopes.shrink_to_fit();
        self.places.shrink_to_fit();
    }

    fn collect_backgrounds(
        &mut self,
        view: &View,
        options: &PixelOptions,
        (index, keep): (u64, f32),
        is_background: &[bool],
    ) {
        let mut random: Vec<SlotRandom> = (0..=options.n_blurred as u64)
            .map(|level| SlotRandom::new(options.seed ^ 0x1b87, index, level))
            .collect();
        self.backgrounds = blurred_images(
            &view.photo,
            is_background,
            options.n_blurred,
            options.clipped_radiance,
            |level: usize| random[level].uniform() < keep,
        );
    }
}
