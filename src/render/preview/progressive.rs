//! The fine picture, several paths for each of the object's pixels, recomputing only what changed.
//!
//! It keeps, band by band, what the camera sees of the mesh, the environment behind it and the object's own light. A
//! changed material leaves the first two, a changed environment the first; a pass that was interrupted goes on where it
//! stopped.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::band::{Band, Versions, Work, band_rows, bands};
use super::request::{PreviewScene, Quality};
use super::thread_clock::thread_cpu;
use crate::render::path::scratch::ShadeScratch;

/// How many pixels a pass computed anew, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recomputed {
    /// Pixels traced against the mesh.
    pub traced: usize,
    /// Pixels of the environment.
    pub background: usize,
    /// Pixels of the object.
    pub object: usize,
}

/// A finished pass.
#[derive(Clone, Debug, Default)]
pub struct PassOutput {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` sRGB with alpha 255.
    pub pixels: Vec<[u8; 4]>,
    /// What had to be computed.
    pub recomputed: Recomputed,
    /// Whether a pass of [`Quality::Settled`] would show nothing else.
    pub is_settled: bool,
    /// Processor time of all threads together.
    pub cpu_secs: f64,
}

/// The picture and what is still known of it.
#[derive(Debug, Default)]
pub struct Progressive {
    shown: Option<PreviewScene>,
    versions: Versions,
    bands: Vec<Band>,
}

impl Progressive {
    /// Brings the picture up to date; `None` when `cancel` was set before it was done, which costs at most a tile of a band
    /// per thread.
    pub fn pass(
        &mut self,
        request: &PreviewScene,
        quality: Quality,
        cancel: &AtomicBool,
    ) -> Option<PassOutput> {
        self.invalidate(request);
        let work = Work {
            request,
            quality,
            versions: self.versions,
            cancel,
        };
        let camera = &request.camera;
        let (width, height) = (camera.width, camera.height);
        let mut pixels = vec![[0, 0, 0, 255]; (width * height) as usize];
        let counts: [AtomicUsize; 4] = Default::default();
        let is_settled = AtomicBool::new(true);
        let chunk = (band_rows(width) * width) as usize;
        self.bands
            .par_iter_mut()
            .zip(pixels.par_chunks_mut(chunk))
            .for_each_init(ShadeScratch::default, |scratch, (band, out)| {
                if cancel.load(Ordering::Relaxed) {
                    return;
                }
                let start = thread_cpu();
                let done = band.update(&work, scratch);
                // What was interrupted has no values to show.
                if cancel.load(Ordering::Relaxed) {
                    return;
                }
                band.compose(&work, out);
                is_settled.fetch_and(band.is_settled(), Ordering::Relaxed);
                let nanos = thread_cpu().saturating_sub(start).as_nanos() as usize;
                for (count, value) in counts.iter().zip(done.iter().chain([&nanos])) {
                    count.fetch_add(*value, Ordering::Relaxed);
                }
            });
        let [traced, background, object, nanos] = counts.map(AtomicUsize::into_inner);
        (!cancel.load(Ordering::Relaxed)).then_some(PassOutput {
            width,
            height,
            pixels,
            recomputed: Recomputed {
                traced,
                background,
                object,
            },
            is_settled: is_settled.into_inner(),
            cpu_secs: nanos as f64 * 1e-9,
        })
    }

    /// Raises the numbers of the parts that change.
    fn invalidate(&mut self, request: &PreviewScene) {
        let size = |of: &PreviewScene| (of.camera.width, of.camera.height);
        let (width, height) = size(request);
        let shown = self.shown.take().filter(|old| size(old) == size(request));
        if shown.is_none() {
            self.bands = bands(width, height);
        }
        let is_same = |part: fn(&PreviewScene, &PreviewScene) -> bool| {
            shown.as_ref().is_some_and(|old| part(old, request))
        };
        let geometry = is_same(PreviewScene::same_geometry);
        let background = geometry && is_same(PreviewScene::same_background);
        let object = geometry && is_same(PreviewScene::same_object);
        let highlight = geometry && is_same(PreviewScene::same_highlight);
        self.versions.geometry += u64::from(!geometry);
        self.versions.background += u64::from(!background);
        self.versions.object += u64::from(!object);
        self.versions.highlight += u64::from(!highlight);
        self.shown = Some(request.clone());
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;

    use super::*;
    use crate::neif::{Extent, MaterialEdit, ObjectModel, Region, Regions, RoughnessEdit};
    use crate::render::background::Background;
    use crate::render::scene::{Layer, Scene};
    use crate::render::test_scene::{self, NEVER, environment, fog, picture, request, worst};

    const SIZE: (u32, u32) = (60, 44);
    const N_PIXELS: usize = 60 * 44;

    fn plain_request() -> PreviewScene {
        request(SIZE.0, SIZE.1)
    }

    fn pass(progressive: &mut Progressive, request: &PreviewScene, quality: Quality) -> PassOutput {
        let output = progressive.pass(request, quality, &NEVER);
        output.expect("not cancelled")
    }

    /// Runs a change after a first picture; checks the result against a fresh full render.
    fn recomputed_after(change: impl Fn(&mut PreviewScene)) -> Recomputed {
        let (mut progressive, mut request) = (Progressive::default(), plain_request());
        pass(&mut progressive, &request, Quality::Fine);
        change(&mut request);
        request.scene = request.scene.lit(&NEVER).unwrap();
        let done = pass(&mut progressive, &request, Quality::Fine).recomputed;
        let settled = pass(&mut progressive, &request, Quality::Settled);
        assert_same_as_render(&settled, &request);
        done
    }

    fn assert_same_as_render(output: &PassOutput, request: &PreviewScene) {
        let full = picture(&request.scene, &request.camera, request.layer);
        let worst = worst(&output.pixels, &full);
        // Bands of other heights turn the few lobe rays of a pixel differently; the rest is rounding.
        assert!(worst < 0.02, "{:?}: off by {worst}", request.layer);
    }

    #[test]
    fn a_region_without_effect_changes_no_picture() {
        let plain = plain_request();
        let mut with_region = plain.clone();
        let mut region = Region {
            seed: Vec3::ZERO,
            extent: Extent::Part,
            edit: MaterialEdit::default(),
        };
        with_region.scene.regions.push(region);
        assert!(plain.is_same(&with_region));
        region.edit.tint_scale = 0.5;
        with_region.scene.regions = Regions::default();
        with_region.scene.regions.push(region);
        assert!(!plain.is_same(&with_region));
    }

    #[test]
    fn the_first_picture_computes_everything_once() {
        let (mut progressive, request) = (Progressive::default(), plain_request());
        let output = pass(&mut progressive, &request, Quality::Fine);
        assert!(
            output.is_settled,
            "one cone a lobe has nothing to disagree with"
        );
        assert_same_as_render(&output, &request);
        let done = output.recomputed;
        assert_eq!(done.traced, N_PIXELS);
        assert!(done.object > 100 && done.background > 100, "{done:?}");
        assert!(
            done.object < N_PIXELS && done.object + done.background >= N_PIXELS,
            "{done:?}"
        );
    }

    #[test]
    fn only_what_a_change_concerns_is_computed_anew() {
        type Change = fn(&mut PreviewScene);
        // Whether pixels of geometry, environment and object are.
        let (none, object, light) = ([false; 3], [false, false, true], [false, true, true]);
        let cases: [(&str, Change, [bool; 3]); 14] = [
            ("nothing", |_| (), none),
            (
                "a material edit",
                |r| r.scene.edit.roughness = RoughnessEdit::Constant(0.9),
                object,
            ),
            (
                "a moved environment",
                |r| r.scene.transform.rotate_deg = Vec3::new(0.0, 0.0, 40.0),
                light,
            ),
            (
                "another environment",
                |r| r.scene.environment = environment(77),
                light,
            ),
            (
                "a new snapshot of the same mesh",
                |r| {
                    let mut next = ObjectModel::clone(&test_scene::object(9));
                    next.tracer = Arc::clone(&r.scene.object.as_ref().unwrap().tracer);
                    r.scene.object = Some(Arc::new(next));
                },
                object,
            ),
            (
                "a moved camera",
                |r| r.camera = r.camera.resized(58, 44),
                [true; 3],
            ),
            ("diffuse", |r| r.layer = Layer::Diffuse, object),
            ("specular", |r| r.layer = Layer::Specular, object),
            ("roughness", |r| r.layer = Layer::Roughness, object),
            ("tint", |r| r.layer = Layer::Tint, object),
            ("normal", |r| r.layer = Layer::Normal, object),
            (
                "a blurred background",
                |r| r.scene.background = Background::Blurred,
                [false, true, false],
            ),
            (
                "a hidden background",
                |r| r.scene.background = Background::Hidden,
                none,
            ),
            (
                "an exposure of the picture",
                |r| r.scene.display_ev = 1.5,
                none,
            ),
        ];
        for (what, change, expected) in cases {
            let done = recomputed_after(change);
            let found = [done.traced, done.background, done.object].map(|n| n > 0);
            assert_eq!(found, expected, "{what}: {done:?}");
            assert!([0, 58 * 44].contains(&done.traced), "{what}: {done:?}");
        }
    }

    #[test]
    fn hiding_the_object_computes_only_what_was_behind_it() {
        let done = recomputed_after(|request| request.layer = Layer::Environment);
        assert!(done.traced == 0 && done.object == 0, "{done:?}");
        assert!(
            done.background > 0 && done.background < N_PIXELS / 2,
            "{done:?}"
        );
    }

    #[test]
    fn an_interrupted_pass_goes_on_where_it_stopped() {
        let (mut progressive, request) = (Progressive::default(), plain_request());
        let cancelled = progressive.pass(&request, Quality::Fine, &AtomicBool::new(true));
        assert!(cancelled.is_none(), "cancelled before it began");
        let output = pass(&mut progressive, &request, Quality::Fine);
        assert_same_as_render(&output, &request);
    }

    #[test]
    fn the_settled_pass_shades_only_pixels_whose_cones_disagree() {
        let (mut progressive, mut request) = (Progressive::default(), plain_request());
        request.scene = Scene::new(request.scene.object, fog(-3.0, 5.0));
        request.scene.edit.roughness = RoughnessEdit::Constant(0.5);
        let fine = pass(&mut progressive, &request, Quality::Fine);
        assert!(!fine.is_settled, "cones of this scene disagree");
        let settled = pass(&mut progressive, &request, Quality::Settled);
        let (again, all) = (settled.recomputed.object, fine.recomputed.object);
        assert!(0 < again && again < all, "{again} of {all} pixels");
        assert!(settled.is_settled && settled.pixels != fine.pixels);
        assert_same_as_render(&settled, &request);
        let last = pass(&mut progressive, &request, Quality::Settled);
        assert_eq!(last.recomputed, Recomputed::default());
        assert_eq!(last.pixels, settled.pixels);
    }
}
