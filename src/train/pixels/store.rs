//! The store of training pixels: each traced once on a mesh, drawn from ever after.

use std::ops::Range;

use glam::Vec3;

use super::block_chroma::block_around;
use super::image_gradient::SLOPE_CODES;
use super::preconvolution::BlurredImage;
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
    index: usize,
    /// sRGB target in `[0, 1]`.
    pub target: [f32; 3],
    /// `exp(-|image gradient|)`: how far the material may be assumed smooth here (Eq. 8).
    pub smoothness: f32,
    /// Slopes of the target's colours to the right and downwards, by pixels; 0 beside the outline.
    slopes: [[f32; 2]; 3],
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
    views: Vec<ViewPixels>,
    /// Object pixels of the views before each view, and of all.
    objects_before: Vec<usize>,
    /// The same of background samples, one list a blur level, sharp first.
    backgrounds_before: Vec<Vec<usize>>,
    /// [`PixelOptions::outline_error_px`] that they were collected with.
    outline_error_px: f32,
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
    /// Traces and sorts the pixels of all training views, as `cameras` took them; `on_view` is called after each and stops
    /// the work by `false`.
    pub(in crate::train) fn collect(
        dataset: &Dataset,
        cameras: &[Camera],
        tracer: Option<&SurfaceTracer>,
        options: PixelOptions,
        on_view: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let photos = (dataset, cameras);
        let views = collect_views(photos, tracer, &options, |_| options.background, on_view)?;
        Some(Self::of(views, &options))
    }

    /// Collects them again, on a mesh and from cameras that have changed a little; what exact masks say of the background
    /// stays.
    /// Returns false, and leaves everything as it was, where `on_view` has stopped the work.
    pub(in crate::train) fn retrace(
        &mut self,
        dataset: &Dataset,
        tracer: Option<&SurfaceTracer>,
        options: PixelOptions,
        on_view: &(dyn Fn() -> bool + Sync),
    ) -> bool {
        let cameras = self.cameras();
        let photos = (dataset, cameras.as_slice());
        let is_uncertain = |view: &View| {
            options.background && (view.mask.is_none() || options.outline_error_px > 0.0)
        };
        let Some(mut views) = collect_views(photos, tracer, &options, is_uncertain, on_view) else {
            return false;
        };
        for (view, former) in views.iter_mut().zip(&mut self.views) {
            if view.backgrounds.is_empty() {
                view.backgrounds = std::mem::take(&mut former.backgrounds);
            }
        }
        *self = Self {
            depths: self.depths.take(),
            ..Self::of(views, &options)
        };
        true
    }

    fn of(views: Vec<ViewPixels>, options: &PixelOptions) -> Self {
        let level_len =
            |view: &ViewPixels, level| view.backgrounds.get(level).map_or(0, BlurredImage::len);
        Self {
            objects_before: running_sums(views.iter().map(|view| view.smoothness.len())),
            outline_error_px: options.outline_error_px,
            depths: None,
            backgrounds_before: (0..=options.n_blurred)
                .map(|level| running_sums(views.iter().map(|view| level_len(view, level))))
                .collect(),
            views,
        }
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
        self.outline_error_px
    }

    /// Whether no object pixels were left out that would not be drawn before they are traced anew.
    pub(in crate::train) fn has_all_wanted(&self) -> bool {
        self.views.iter().all(|view| view.has_all_wanted)
    }

    /// Number of training views.
    pub(in crate::train) fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Number of training views in which object pixels have their chroma in common.
    pub(in crate::train) fn n_sharing_chroma(&self) -> usize {
        let sharing = self.views.iter().filter(|view| !view.places.is_empty());
        sharing.count()
    }

    /// Number of object pixels.
    pub(in crate::train) fn n_objects(&self) -> usize {
        total(&self.objects_before)
    }

    /// Number of sharp background pixels.
    pub(in crate::train) fn n_backgrounds(&self) -> usize {
        total(&self.backgrounds_before[0])
    }

    /// A random object pixel.
    pub(in crate::train) fn draw_object(&self, random: &mut SlotRandom) -> ObjectPixel {
        let (view, index) = locate(&self.objects_before, random.index(self.n_objects()));
        self.object(view, index)
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
            let has_own = self.views[pixel.view].places.is_empty();
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
        let (index, view) = (pixel.view, &self.views[pixel.view]);
        let place = view.places[pixel.index];
        let around = block_around(place, view.camera.width, view.chroma_block);
        let known = around.filter_map(|place| view.places.binary_search(&place).ok());
        known.map(move |place| self.object(index, place))
    }

    /// An object pixel of a view.
    fn object(&self, view: usize, index: usize) -> ObjectPixel {
        let pixels = &self.views[view];
        ObjectPixel {
            view,
            index,
            target: pixels.targets.srgb(index),
            smoothness: f32::from(pixels.smoothness[index]) / f32::from(u8::MAX),
            slopes: pixels.slopes[index].map(|slope| slope.map(|v| f32::from(v) / SLOPE_CODES)),
        }
    }

    /// Takes the target from where the photo's camera, as it is known by now, sees the `point` at which the pixel's light
    /// paths begin: the camera may have been corrected since they were traced.
    pub(in crate::train) fn follow_camera(&self, pixel: &mut ObjectPixel, point: Vec3) {
        let ViewPixels { camera, traced, .. } = &self.views[pixel.view];
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
        let view = &self.views[pixel.view];
        let eye = view.camera.position();
        view.paths.unpack(pixel.index, eye, vertices, on_path);
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::data::Photo;
    use crate::train::placement::given_cameras;
    use crate::train::preparation::pixel_options;
    use crate::train::test_scene::{small_fields, sphere_in_a_box};

    /// The pixels of a capture, with options that differ from the usual ones.
    fn collected(dataset: &Dataset, change: impl Fn(&mut PixelOptions)) -> PixelStore {
        let tracer = SurfaceTracer::new(Arc::clone(dataset.mesh.as_ref().unwrap()));
        let mut options = pixel_options(&small_fields(), true, 0.0);
        change(&mut options);
        let given = given_cameras(dataset);
        PixelStore::collect(dataset, &given, Some(&tracer), options, &|| true).unwrap()
    }

    #[test]
    fn of_the_object_about_as_many_are_traced_as_are_wanted() {
        let dataset = sphere_in_a_box(5, 64);
        let traced = |most_objects, choice| {
            collected(&dataset, |options| {
                (options.most_objects, options.choice) = (most_objects, choice);
            })
        };
        let all = traced(usize::MAX, 0);
        assert!(all.n_objects() > 2500, "{} pixels", all.n_objects());
        let some = traced(1000, 0);
        assert!((900..1100).contains(&some.n_objects()));
        assert_eq!(some.n_backgrounds(), all.n_backgrounds());
        for pair in some.objects_before.windows(2) {
            let n = pair[1] - pair[0];
            assert!((140..260).contains(&n), "{n} of a view");
        }
        let places = |store: &PixelStore| format!("{:?}", store.views[0].paths);
        assert!(all.has_all_wanted() && !some.has_all_wanted());
        assert_eq!(places(&some), places(&traced(1000, 0)));
        assert!(places(&some) != places(&traced(1000, 1)), "another choice");
    }

    #[test]
    fn pixels_that_share_their_chroma_are_traced_and_drawn_together() {
        let mut dataset = sphere_in_a_box(3, 64);
        for view in &mut dataset.train {
            let codes = |i| view.photo.srgb(i).map(|v| (v.min(1.0) * 255.0) as u8);
            view.photo = Photo::Rgb8 {
                width: 64,
                height: 64,
                pixels: (0..64 * 64).map(codes).collect(),
                chroma_block: [2, 2],
            };
        }
        let store = |shared_chroma| {
            collected(&dataset, |options| {
                (options.most_objects, options.shared_chroma) = (1000, shared_chroma);
            })
        };
        let (together, singly) = (store(true), store(false));
        let draw =
            |store: &PixelStore| store.draw_objects(400, |i| SlotRandom::new(1, 0, i as u64));
        let drawn = draw(&together);
        assert_eq!(drawn.len(), 400);
        let place = |pixel: &ObjectPixel| together.views[pixel.view].places[pixel.index];
        let first = |pixel: &ObjectPixel| block_around(place(pixel), 64, [2, 2]).next();
        let (mut n_whole, mut n_blocks, mut n_alone) = (0, 0, 0);
        for group in drawn.chunk_by(|a, b| a.1 == b.1) {
            if group[0].1 == ChromaSource::None {
                n_alone += group.len();
                continue;
            }
            let source = group[0].1;
            assert!(matches!(source, ChromaSource::Mean(_)), "{source:?}");
            let is_same = |pixel: &ObjectPixel| {
                pixel.view == group[0].0.view && first(pixel) == first(&group[0].0)
            };
            assert!(group.iter().all(|(pixel, _)| is_same(pixel)));
            assert!(group.is_sorted_by(|(a, _), (b, _)| place(a) < place(b)));
            n_blocks += 1;
            n_whole += usize::from(group.len() == 4);
        }
        assert!((196..=204).contains(&n_alone), "{n_alone} alone");
        // The others lie at the outline; thinned pixel by pixel hardly any would be whole.
        assert!(4 * n_whole > 3 * n_blocks, "{n_whole} of {n_blocks}");
        let n_sharing = [&together, &singly].map(PixelStore::n_sharing_chroma);
        assert_eq!(n_sharing, [3, 0]);
        let singly = draw(&singly);
        assert!(
            singly
                .iter()
                .all(|(_, source)| *source == ChromaSource::Own)
        );
    }

    #[test]
    fn targets_follow_their_cameras() {
        let dataset = sphere_in_a_box(3, 64);
        let mut store = collected(&dataset, |_| ());
        let given = given_cameras(&dataset);
        let mut moved = given.clone();
        for camera in &mut moved {
            camera.cx += 0.5;
        }
        let mut random = SlotRandom::new(1, 0, 0);
        let (mut vertices, mut n, mut changed) = (Vec::new(), 0, 0.0_f32);
        for _ in 0..300 {
            store.set_cameras(&given);
            let mut pixel = store.draw_object(&mut random);
            vertices.clear();
            store.unpack_paths(&pixel, &mut vertices, |_| ());
            let begin = vertices[0].point.position;
            let before = pixel.target;
            store.follow_camera(&mut pixel, begin);
            assert_eq!(pixel.target, before, "the camera is where it was");
            // Beside the outline the slope is not known.
            if pixel.slopes.iter().all(|[right, _]| *right == 0.0) {
                continue;
            }
            // Half a pixel to the right: a quarter of the difference of the neighbours.
            let view = &dataset.train[pixel.view];
            let at = given[pixel.view].project(begin).unwrap();
            let i = at.y as usize * 64 + at.x as usize;
            let [left, right] = [i - 1, i + 1].map(|i| view.photo.srgb(i));
            store.set_cameras(&moved);
            store.follow_camera(&mut pixel, begin);
            for c in 0..3 {
                let expected = (before[c] + 0.25 * (right[c] - left[c])).clamp(0.0, 1.0);
                assert!((pixel.target[c] - expected).abs() < 0.005, "{pixel:?}");
                changed = changed.max((expected - before[c]).abs());
            }
            // The slope by the direction is that of the grey value by the pixel.
            let slope = store.object_slope(&pixel, begin).unwrap();
            let ray = |x: f32| moved[pixel.view].ray(x, at.y).direction;
            let by_pixel = slope.dot(ray(at.x + 1.0) - ray(at.x));
            let expected = 0.5 * (0..3).map(|c| right[c] - left[c]).sum::<f32>() / 3.0;
            assert!((by_pixel - expected).abs() < 0.01, "{by_pixel}, {expected}");
            n += 1;
        }
        assert!(n > 100 && changed > 0.01, "{n} pixels, {changed}");
    }
}
