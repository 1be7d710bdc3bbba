//! The store of training pixels: each traced once on a mesh, drawn from ever after.

use std::ops::Range;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::block_chroma::block_around;
use super::image_gradient::SLOPE_CODES;
use super::portions::{Photo, Portions};
use super::preconvolution::BlurredImage;
use super::traced_pixels::TracedPixels;
use super::view_pixels::{PixelOptions, ViewPixels, collect_views};
use crate::data::{Dataset, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::neif::light::light_path::PathVertex;
use crate::train::photos::pose_step::slope_by_direction;
use crate::train::priors::depth_evidence::SeenDepths;
use crate::train::random::SlotRandom;

/// A drawn pixel that shows only the object.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct ObjectPixel {
    /// Its training view.
    pub view: usize,
    /// With which it was traced, and its index there.
    pub(super) traced: usize,
    pub(super) index: usize,
    /// sRGB target in `[0, 1]`.
    pub target: [f32; 3],
    /// `exp(-|image gradient|)`: how far the material may be assumed smooth here (Eq. 8).
    pub smoothness: f32,
    /// Slopes of the target's colours to the right and downwards, by pixels; 0 beside the outline.
    pub(super) slopes: [[f32; 2]; 3],
}

/// What a photo determines of the chroma of a drawn pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) enum ChromaSource {
    /// All.
    Own,
    /// The mean of those with the same number.
    Mean(usize),
    /// Nothing without the others that have it in common: the pixel was drawn for its luma.
    None,
}

/// All training pixels.
#[derive(Debug)]
pub(in crate::train) struct PixelStore {
    pub(super) views: Vec<ViewPixels>,
    /// What the object's pixels are traced on.
    tracer: Option<Arc<SurfaceTracer>>,
    options: PixelOptions,
    pub(super) portions: Portions,
    /// Of the object: the portions traced so far, each view by view.
    pub(super) objects: Vec<TracedPixels>,
    /// Object pixels drawn before these were collected.
    drawn_before: u64,
    /// Number of object pixels before each of `objects`, and of all.
    pub(super) objects_before: Vec<usize>,
    /// Number of background pixels before each view, and of all, by blur level.
    backgrounds_before: Vec<Vec<usize>>,
    /// How far away is what the background pixels show, where that is known.
    pub(in crate::train) depths: Option<SeenDepths>,
}

/// A drawn background pixel.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct BackgroundSample {
    /// Its training view.
    pub view: usize,
    /// Camera position, world.
    pub origin: Vec3,
    /// Unit direction, world.
    pub direction: Vec3,
    /// Standard deviation of the pixel's cone, radians.
    pub spread: f32,
    /// sRGB target in `[0, 1]`.
    pub target: [f32; 3],
    /// One over the distance of what it shows, world units, where that is known.
    pub nearness: Option<f32>,
    /// Its blur level and index there.
    place: (usize, usize),
}

impl PixelStore {
    /// Sorts the pixels of all training views, as `cameras` took them, and traces the first portion of the object's; `on_view` is
    /// called for each view and stops the work by `false`.
    pub(in crate::train) fn collect(
        dataset: &Dataset,
        cameras: &[Camera],
        tracer: Option<&Arc<SurfaceTracer>>,
        options: PixelOptions,
        on_view: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let photos = (dataset, cameras);
        let surface = tracer.map(|tracer| &**tracer);
        let views = collect_views(photos, surface, &options, |_| options.background, on_view)?;
        let mut pixels = Self::of(views, tracer, options, dataset);
        pixels.trace_more(on_view).then_some(pixels)
    }

    /// Collects them again, on a mesh and from cameras that have changed a little, after `n_drawn` object pixels were drawn; what
    /// exact masks say of the background stays.
    /// Returns false, and leaves everything as it was, where `on_view` has stopped the work.
    pub(in crate::train) fn retrace(
        &mut self,
        dataset: &Dataset,
        tracer: Option<&Arc<SurfaceTracer>>,
        (options, n_drawn): (PixelOptions, u64),
        on_view: &(dyn Fn() -> bool + Sync),
    ) -> bool {
        let cameras = self.cameras();
        let photos = (dataset, cameras.as_slice());
        let is_uncertain = |view: &View| {
            options.background && (view.mask.is_none() || options.outline_error_px > 0.0)
        };
        let surface = tracer.map(|tracer| &**tracer);
        let Some(views) = collect_views(photos, surface, &options, is_uncertain, on_view) else {
            return false;
        };
        let mut new = Self::of(views, tracer, options, dataset);
        if !new.trace_more(on_view) {
            return false;
        }
        for (view, former) in new.views.iter_mut().zip(&mut self.views) {
            if view.backgrounds.is_empty() {
                view.backgrounds = std::mem::take(&mut former.backgrounds);
            }
        }
        new.drawn_before = n_drawn;
        new.depths = self.depths.take();
        new.count_backgrounds();
        *self = new;
        true
    }

    /// Before any portion is traced.
    fn of(
        views: Vec<ViewPixels>,
        tracer: Option<&Arc<SurfaceTracer>>,
        options: PixelOptions,
        dataset: &Dataset,
    ) -> Self {
        let n_objects = views.iter().map(|view| view.objects.len()).sum();
        let mut pixels = Self {
            views,
            tracer: tracer.map(Arc::clone),
            options,
            portions: options.portions(dataset).cut(n_objects),
            objects: Vec::new(),
            drawn_before: 0,
            objects_before: vec![0],
            backgrounds_before: Vec::new(),
            depths: None,
        };
        pixels.count_backgrounds();
        pixels
    }

    fn count_backgrounds(&mut self) {
        let level_len =
            |view: &ViewPixels, level| view.backgrounds.get(level).map_or(0, BlurredImage::len);
        let of_level = |level| running_sums(self.views.iter().map(|view| level_len(view, level)));
        self.backgrounds_before = (0..=self.options.n_blurred).map(of_level).collect();
    }

    /// Everything that is drawn, to be compared.
    #[cfg(test)]
    pub(in crate::train) fn drawn_from(&self) -> String {
        format!("{:?}", (&self.views, &self.objects))
    }

    /// Traces more of the object's pixels once as many were drawn as are traced: a short run is not spent on tracing what it
    /// would hardly draw. `n_drawn`: object pixels that were drawn since the run began.
    pub(in crate::train) fn trace_drawn(&mut self, n_drawn: u64) {
        let of_these = n_drawn.saturating_sub(self.drawn_before);
        while self.has_untraced() && of_these >= self.n_objects() as u64 {
            self.trace_more(&|| true);
        }
    }

    /// Traces the next portion of the object's pixels from the cameras as they are known by now, if one is left, on the current
    /// thread pool. Returns false, and leaves everything as it was, where `on_view` has stopped the work.
    pub(super) fn trace_more(&mut self, on_view: &(dyn Fn() -> bool + Sync)) -> bool {
        let (Some(tracer), true) = (&self.tracer, self.has_untraced()) else {
            return true;
        };
        let (portion, paths) = (self.n_traced_portions(), self.options.paths);
        let trace = |(index, view): (usize, &ViewPixels)| {
            on_view().then(|| {
                let photo = Photo::of(index, &view.camera);
                let wanted = self.portions.nth(portion, photo, &view.objects);
                TracedPixels::trace((index, view.camera), tracer, paths, &wanted)
            })
        };
        let traced: Option<Vec<_>> = self.views.par_iter().enumerate().map(trace).collect();
        let Some(traced) = traced else {
            return false;
        };
        self.objects.extend(traced);
        let lengths = self.objects.iter().map(|traced| traced.places.len());
        self.objects_before = running_sums(lengths);
        true
    }

    /// Whether light paths of object pixels are still to be traced.
    pub(super) fn has_untraced(&self) -> bool {
        self.tracer.is_some() && self.n_traced_portions() < self.portions.len()
    }

    pub(super) fn n_traced_portions(&self) -> usize {
        self.objects.len() / self.views.len().max(1)
    }

    /// The cameras of the training views.
    pub(in crate::train) fn cameras(&self) -> Vec<Camera> {
        self.views.iter().map(|view| view.camera).collect()
    }

    /// Where the camera of a view is, world.
    pub(in crate::train) fn eye(&self, view: usize) -> Vec3 {
        self.views[view].camera.position()
    }

    /// Draws pixels from corrected cameras. The object's light paths stay as they were traced: [`Self::follow_camera`].
    pub(in crate::train) fn set_cameras(&mut self, cameras: &[Camera]) {
        for (view, camera) in self.views.iter_mut().zip(cameras) {
            view.camera = *camera;
        }
    }

    /// Standard deviation of the error of the masks' outlines, pixels; 0: exact.
    pub(in crate::train) fn outline_error_px(&self) -> f32 {
        self.options.outline_error_px
    }

    /// Number of training views.
    pub(in crate::train) fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Number of training views in which object pixels have their chroma in common.
    pub(in crate::train) fn n_sharing_chroma(&self) -> usize {
        let shares = |view: &&ViewPixels| view.chroma_block != [1, 1] && view.objects.len() > 0;
        self.views.iter().filter(shares).count()
    }

    /// Number of object pixels that are traced by now.
    pub(in crate::train) fn n_objects(&self) -> usize {
        total(&self.objects_before)
    }

    /// Number of sharp background pixels.
    pub(in crate::train) fn n_backgrounds(&self) -> usize {
        total(&self.backgrounds_before[0])
    }

    /// A random object pixel.
    pub(in crate::train) fn draw_object(&self, random: &mut SlotRandom) -> ObjectPixel {
        let (traced, index) = locate(&self.objects_before, random.index(self.n_objects()));
        self.object(traced, index)
    }

    /// `n` random object pixels, of the random numbers that `random` has for each. Where pixels have their chroma in common, half
    /// are drawn by such blocks, one after the other, and as many alone: those of a block are much alike.
    pub(in crate::train) fn draw_objects(
        &self,
        n: usize,
        random: impl Fn(usize) -> SlotRandom,
    ) -> Vec<(ObjectPixel, ChromaSource)> {
        let mut drawn = Vec::with_capacity(n);
        let mut n_alone = 0;
        while drawn.len() < n {
            let slot = drawn.len();
            let pixel = self.draw_object(&mut random(slot));
            let has_own = self.views[pixel.view].chroma_block == [1, 1];
            if has_own || n_alone > 0 {
                n_alone -= n_alone.min(1);
                let source = if has_own {
                    ChromaSource::Own
                } else {
                    ChromaSource::None
                };
                drawn.push((pixel, source));
                continue;
            }
            let block = self.block_of(&pixel).take(n - slot);
            drawn.extend(block.map(|pixel| (pixel, ChromaSource::Mean(slot))));
            n_alone = drawn.len() - slot;
        }
        drawn
    }

    /// The object's pixels that have their chroma in common with one of them, with that, in order.
    fn block_of(&self, pixel: &ObjectPixel) -> impl Iterator<Item = ObjectPixel> {
        let (traced, view) = (pixel.traced, &self.views[pixel.view]);
        let places = &self.objects[traced].places;
        let around = block_around(places[pixel.index], view.camera.width, view.chroma_block);
        let known = around.filter_map(|place| places.binary_search(&place).ok());
        known.map(move |index| self.object(traced, index))
    }

    /// The object pixel at a place of what was traced together.
    fn object(&self, traced: usize, index: usize) -> ObjectPixel {
        let TracedPixels { view, places, .. } = &self.objects[traced];
        let pixels = &self.views[*view];
        let rank = pixels.objects.rank(places[index]).unwrap_or_default();
        ObjectPixel {
            view: *view,
            traced,
            index,
            target: pixels.targets.srgb(rank),
            smoothness: f32::from(pixels.smoothness[rank]) / f32::from(u8::MAX),
            slopes: pixels.slopes[rank].map(|slope| slope.map(|v| f32::from(v) / SLOPE_CODES)),
        }
    }

    /// Takes the target from where the photo's camera, as it is known by now, sees the `point` at which the pixel's light
    /// paths begin: the camera may have been corrected since they were traced.
    pub(in crate::train) fn follow_camera(&self, pixel: &mut ObjectPixel, point: Vec3) {
        let camera = &self.views[pixel.view].camera;
        let traced = &self.objects[pixel.traced].camera;
        if camera == traced {
            return;
        }
        if let (Some(now), Some(then)) = (camera.project(point), traced.project(point)) {
            let moved = now - then;
            for (value, [right, down]) in pixel.target.iter_mut().zip(pixel.slopes) {
                *value = (*value + right * moved.x + down * moved.y).clamp(0.0, 1.0);
            }
        }
    }

    /// The photo's grey value at an object pixel, by the direction of the ray to `point`, where its light paths begin.
    pub(in crate::train) fn object_slope(&self, pixel: &ObjectPixel, point: Vec3) -> Option<Vec3> {
        let camera = &self.views[pixel.view].camera;
        let at = camera.project(point)?;
        let grey = |axis: usize| pixel.slopes.iter().map(|slope| slope[axis]).sum::<f32>() / 3.0;
        Some(slope_by_direction(camera, at.x, at.y, [grey(0), grey(1)]))
    }

    /// Appends the vertices of an object pixel's light paths to `vertices`. The paths, at least one, have the same
    /// weight; `on_path` gets the range of each.
    pub(in crate::train) fn unpack_paths(
        &self,
        pixel: &ObjectPixel,
        vertices: &mut Vec<PathVertex>,
        on_path: impl FnMut(Range<usize>),
    ) {
        let eye = self.eye(pixel.view);
        let paths = &self.objects[pixel.traced].paths;
        paths.unpack(pixel.index, eye, vertices, on_path);
    }

    /// A random background pixel, from a blurred level with probability `blurred_share`.
    pub(in crate::train) fn draw_background(
        &self,
        random: &mut SlotRandom,
        blurred_share: f32,
    ) -> BackgroundSample {
        let mut level = 0;
        if random.uniform() < blurred_share && self.backgrounds_before.len() > 1 {
            level = 1 + random.index(self.backgrounds_before.len() - 1);
            if total(&self.backgrounds_before[level]) == 0 {
                level = 0;
            }
        }
        let before = &self.backgrounds_before[level];
        let (view, index) = locate(before, random.index(total(before)));
        let ViewPixels {
            camera,
            backgrounds,
            ..
        } = &self.views[view];
        let blurred = &backgrounds[level];
        let (x, y) = blurred.position_px(index);
        let ray = camera.ray(x, y);
        let depths = self.depths.as_ref().filter(|_| level == 0);
        BackgroundSample {
            view,
            origin: ray.origin,
            direction: ray.direction,
            spread: camera.pixel_angle() * blurred.std_px(),
            target: blurred.srgb(index),
            nearness: depths.and_then(|depths| depths.nearness(view, ray.direction)),
            place: (level, index),
        }
    }

    /// The photo's grey value at a background pixel by the direction of the ray, where its neighbours are known.
    pub(in crate::train) fn slope(&self, sample: &BackgroundSample) -> Option<Vec3> {
        let view = &self.views[sample.view];
        let (level, index) = sample.place;
        let blurred = &view.backgrounds[level];
        let (x, y) = blurred.position_px(index);
        let by_pixel = blurred.slope(index)?;
        Some(slope_by_direction(&view.camera, x, y, by_pixel))
    }
}

/// Sums of the numbers before each, and of all.
fn running_sums(lengths: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sums = vec![0];
    for (i, length) in lengths.enumerate() {
        sums.push(sums[i] + length);
    }
    sums
}

fn total(before: &[usize]) -> usize {
    before.last().copied().unwrap_or_default()
}

/// The view of the `k`-th pixel of all, and its index there.
fn locate(before: &[usize], k: usize) -> (usize, usize) {
    let view = before.partition_point(|&n| n <= k) - 1;
    (view, k - before[view])
}
