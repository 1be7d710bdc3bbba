//! The training pixels of a view: which are the object's and which the background's, and what is kept of them.

use rayon::prelude::*;

use super::block_chroma::BlockChroma;
use super::image_gradient::{slopes, smoothness};
use super::outlines::Sides;
use super::pixel_set::PixelSet;
use super::portions::{Photo, Portions};
use super::preconvolution::{BlurredImage, blurred_images};
use super::srgb_codes::SrgbCodes;
use crate::data::{Dataset, View};
use crate::geometry::{Camera, SurfaceTracer};
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
    /// Distinguishes one choice of the object's pixels from another.
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

impl PixelOptions {
    /// The object pixels to keep of all that the photos have.
    pub(super) fn portions(&self, dataset: &Dataset) -> Portions {
        let seed = (self.seed ^ 0x5bd1).wrapping_add(self.choice);
        Portions::whole(seed, self.keep(dataset))
    }

    /// Share of the photos' pixels to keep.
    fn keep(&self, dataset: &Dataset) -> f32 {
        let n_pixels: usize = dataset.train.iter().map(|v| v.photo.n_pixels()).sum();
        (self.max_pixels as f32 / n_pixels.max(1) as f32).min(1.0)
    }
}

/// The training pixels of one view.
#[derive(Debug)]
pub(super) struct ViewPixels {
    pub(super) camera: Camera,
    /// Which of the photo's pixels are the object's, of those that are kept; targets, `exp(-|image gradient|)` in 255ths and
    /// slopes in [`super::image_gradient::SLOPE_CODES`] of each.
    pub(super) objects: PixelSet,
    pub(super) targets: SrgbCodes,
    pub(super) smoothness: Vec<u8>,
    pub(super) slopes: Vec<[[i8; 2]; 3]>,
    /// Columns and rows of the blocks of object pixels that have their chroma in common.
    pub(super) chroma_block: [u32; 2],
    /// By blur level, sharp first.
    pub(super) backgrounds: Vec<BlurredImage>,
}

/// The pixels of all views; backgrounds only of those that `has_backgrounds`. `None` once `on_view` returns false.
pub(super) fn collect_views(
    (dataset, cameras): (&Dataset, &[Camera]),
    tracer: Option<&SurfaceTracer>,
    options: &PixelOptions,
    has_backgrounds: impl Fn(&View) -> bool + Sync,
    on_view: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<ViewPixels>> {
    let (portions, keep) = (options.portions(dataset), options.keep(dataset));
    let collect = |(index, (view, camera)): (usize, (&View, &Camera))| {
        on_view().then(|| {
            let sides = Sides::new(view, camera, tracer, options.outline_error_px);
            let mut pixels = ViewPixels {
                camera: *camera,
                objects: PixelSet::default(),
                targets: SrgbCodes::like(&view.photo),
                smoothness: Vec::new(),
                slopes: Vec::new(),
                chroma_block: [1, 1],
                backgrounds: Vec::new(),
            };
            if tracer.is_some() {
                pixels.objects = portions.all(Photo::of(index, camera), |i| sides.object[i]);
                pixels.collect_objects(view, options, &sides.object);
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
    /// Notes what the photo says of its object pixels.
    fn collect_objects(&mut self, view: &View, options: &PixelOptions, is_object: &[bool]) {
        let blocks = BlockChroma::of(&view.photo).filter(|_| options.shared_chroma);
        if blocks.is_some() {
            self.chroma_block = view.photo.chroma_block();
        }
        let places = || self.objects.iter().map(|i| i as usize);
        let target = |i| match &blocks {
            Some(blocks) => blocks.srgb(&view.photo, i),
            None => view.photo.srgb(i),
        };
        self.targets.extend(places().map(target));
        self.targets.shrink();
        self.smoothness = places().map(|i| smoothness(view, i)).collect();
        self.slopes = places().map(|i| slopes(view, i, is_object)).collect();
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
