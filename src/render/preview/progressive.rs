//! A picture at a resolution and with one or several paths for each of the object's pixels, recomputing only what changed.
//!
//! Each pass keeps, band by band, what its camera sees of the mesh, the environment behind it and
//! the object's own light. A changed material leaves the first two, a changed environment the
//! first; a pass that was interrupted goes on where it stopped.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::band::{Band, Versions, Work, band_rows, bands};
use super::causes::Causes;
use super::request::{PassKind, PreviewScene, Quality, SCALES};
use super::thread_clock::thread_cpu;
use crate::geometry::Camera;
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
#[derive(Clone, Debug)]
pub struct PassOutput {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` sRGB with alpha 255.
    pub pixels: Vec<[u8; 4]>,
    /// What had to be computed.
    pub recomputed: Recomputed,
    /// Whether a pass of [`Quality::Settled`] at this scale would show nothing else.
    pub is_settled: bool,
    /// Processor time of all threads together.
    pub cpu_secs: f64,
}

/// The state of one resolution.
#[derive(Debug, Default)]
struct Pass {
    causes: Option<Causes>,
    versions: Versions,
    bands: Vec<Band>,
}

/// The passes of a picture and what they still know; the last two share a resolution and what is behind the object.
#[derive(Debug, Default)]
pub struct Progressive {
    passes: [Pass; 3],
}

impl Progressive {
    /// Brings a pass up to date; `None` when `cancel` was set
    /// before it was done, which costs at most a tile of a band per thread.
    ///
    /// # Panics
    /// When its scale is not one of [`SCALES`].
    pub fn pass(
        &mut self,
        request: &PreviewScene,
        kind: PassKind,
        cancel: &AtomicBool,
    ) -> Option<PassOutput> {
        let camera = scaled(&request.camera, kind.scale);
        let pass = &mut self.passes[index_of(kind.scale)];
        let output = pass.run(request, camera, kind.quality, cancel);
        (!cancel.load(Ordering::Relaxed)).then_some(output)
    }

    /// Forgets everything, e.g. when another capture is opened.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

fn index_of(scale: u32) -> usize {
    SCALES
        .iter()
        .position(|&s| s == scale)
        .expect("scale is one of SCALES")
}

/// The camera of the pass at `scale`.
pub fn scaled(camera: &Camera, scale: u32) -> Camera {
    if scale == 1 {
        return *camera;
    }
    camera.resized(
        camera.width.div_ceil(scale).max(1),
        camera.height.div_ceil(scale).max(1),
    )
}

impl Pass {
    /// Updates all bands.
    fn run(
        &mut self,
        request: &PreviewScene,
        camera: Camera,
        quality: Quality,
        cancel: &AtomicBool,
    ) -> PassOutput {
        self.invalidate(Causes::of(request, camera));
        let work = Work {
            request,
            camera,
            quality,
            versions: self.versions,
            cancel,
        };
        let (width, height) = (camera.width, camera.height);
        let mut pixels = vec![[0, 0, 0, 255]; (width * height) as usize];
        let counts: [AtomicUsize; 4] = Default::default();
        let is_settled = AtomicBool::new(quality != Quality::Plain);
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
                is_settled.fetch_and(band.is_settled(&work), Ordering::Relaxed);
                let nanos = thread_cpu().saturating_sub(start).as_nanos() as usize;
                for (count, value) in counts.iter().zip(done.iter().chain([&nanos])) {
                    count.fetch_add(*value, Ordering::Relaxed);
                }
            });
        let [traced, background, object, nanos] = counts.map(AtomicUsize::into_inner);
        PassOutput {
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
        }
    }

    /// Raises the numbers of the parts that the new causes change.
    fn invalidate(&mut self, causes: Causes) {
        let (width, height) = (causes.camera.width, causes.camera.height);
        let is_same_size = self
            .causes
            .as_ref()
            .is_some_and(|old| (old.camera.width, old.camera.height) == (width, height));
        if !is_same_size {
            self.bands = bands(width, height);
            self.causes = None;
        }
        let old = self.causes.as_ref();
        let geometry = old.is_some_and(|old| old.same_geometry(&causes));
        let background = old.is_some_and(|old| old.same_background(&causes));
        let object = old.is_some_and(|old| old.same_object(&causes));
        let highlight = old.is_some_and(|old| old.same_highlight(&causes));
        self.versions.geometry += u64::from(!geometry);
        self.versions.background += u64::from(!(geometry && background));
        self.versions.object += u64::from(!(geometry && object));
        self.versions.highlight += u64::from(!(geometry && highlight));
        self.causes = Some(causes);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::neif::{MaterialEdit, Region};
    use crate::render::background::Background;
    use crate::render::output::picture::render_with;
    use crate::render::path::gbuffer::PathOptions;
    use crate::render::scene::{Layer, Scene};
    use crate::render::test_scene::{camera, environment, fog, object, scene};
    use glam::Vec3;

    const SIZE: (u32, u32) = (60, 44);

    fn request() -> PreviewScene {
        PreviewScene {
            scene: scene(),
            camera: camera(SIZE.0, SIZE.1),
            layer: Layer::Final,
            highlight: None,
        }
    }

    fn pass(progressive: &mut Progressive, request: &PreviewScene, scale: u32) -> PassOutput {
        progressive
            .pass(request, PassKind::plain(scale), &AtomicBool::new(false))
            .expect("not cancelled")
    }

    /// Runs a change after a first picture; checks the result against a fresh full render.
    fn recomputed_after(change: impl Fn(&mut PreviewScene)) -> Recomputed {
        let (mut progressive, mut request) = (Progressive::default(), request());
        pass(&mut progressive, &request, 1);
        change(&mut request);
        request.scene = request.scene.lit(&AtomicBool::new(false)).unwrap();
        let output = pass(&mut progressive, &request, 1);
        assert_same_as_render(&output, &request, PathOptions::PLAIN);
        output.recomputed
    }

    fn assert_same_as_render(output: &PassOutput, request: &PreviewScene, options: PathOptions) {
        let camera = Camera {
            ..request.camera.resized(output.width, output.height)
        };
        let full = render_with(
            &request.scene,
            &camera,
            request.layer,
            options,
            &AtomicBool::new(false),
            &|_| (),
        )
        .expect("not cancelled");
        let mut worst = 0.0_f32;
        for (preview, full) in output.pixels.iter().zip(&full.pixels) {
            for c in 0..3 {
                worst = worst.max((f32::from(preview[c]) / 255.0 - full[c]).abs());
            }
        }
        // Bands of other heights turn the few lobe rays of a pixel differently; the rest is rounding.
        assert!(worst < 0.02, "{:?}: off by {worst}", request.layer);
    }

    fn n_pixels() -> usize {
        (SIZE.0 * SIZE.1) as usize
    }

    #[test]
    fn a_region_without_effect_changes_no_picture() {
        let plain = request();
        let mut with_region = plain.clone();
        let mut region = Region {
            seed: Vec3::ZERO,
            extent: crate::neif::Extent::Part,
            edit: MaterialEdit::default(),
        };
        with_region.scene.regions.push(region);
        assert!(plain.is_same(&with_region));
        region.edit.tint_scale = 0.5;
        with_region.scene.regions = crate::neif::Regions::default();
        with_region.scene.regions.push(region);
        assert!(!plain.is_same(&with_region));
    }

    #[test]
    fn the_first_picture_computes_everything_once() {
        let (mut progressive, request) = (Progressive::default(), request());
        let output = pass(&mut progressive, &request, 1);
        assert_same_as_render(&output, &request, PathOptions::PLAIN);
        let done = output.recomputed;
        assert_eq!(done.traced, n_pixels());
        assert!(done.object > 100 && done.background > 100, "{done:?}");
        assert!(
            done.object < n_pixels() && done.object + done.background >= n_pixels(),
            "{done:?}"
        );
    }

    #[test]
    fn when_nothing_changed_nothing_is_computed() {
        assert_eq!(recomputed_after(|_| ()), Recomputed::default());
    }

    #[test]
    fn a_material_edit_leaves_geometry_and_surroundings() {
        let done =
            recomputed_after(|request| request.scene.edit.roughness = RoughnessEdit::Constant(0.9));
        assert!(
            done.traced == 0 && done.background == 0 && done.object > 0,
            "{done:?}"
        );
    }

    #[test]
    fn a_moved_environment_leaves_geometry() {
        let done = recomputed_after(|request| {
            request.scene.transform.rotate_deg = Vec3::new(0.0, 0.0, 40.0);
        });
        assert!(
            done.traced == 0 && done.background > 0 && done.object > 0,
            "{done:?}"
        );
    }

    #[test]
    fn another_environment_leaves_geometry() {
        let done = recomputed_after(|request| request.scene.environment = environment(77));
        assert!(
            done.traced == 0 && done.background > 0 && done.object > 0,
            "{done:?}"
        );
    }

    #[test]
    fn a_new_snapshot_of_the_same_mesh_leaves_geometry() {
        let done = recomputed_after(|request| {
            let mut next = crate::neif::ObjectModel::clone(&object(9));
            next.tracer = Arc::clone(&request.scene.object.as_ref().unwrap().tracer);
            request.scene.object = Some(Arc::new(next));
        });
        assert!(
            done.traced == 0 && done.background == 0 && done.object > 0,
            "{done:?}"
        );
    }

    #[test]
    fn a_moved_camera_changes_all() {
        let done = recomputed_after(|request| {
            request.camera = camera(60, 44).resized(58, 44);
        });
        assert!(
            done.traced == 58 * 44 && done.background > 0 && done.object > 0,
            "{done:?}"
        );
    }

    #[test]
    fn another_layer_leaves_geometry_and_surroundings() {
        for layer in [
            Layer::Diffuse,
            Layer::Specular,
            Layer::Roughness,
            Layer::Tint,
            Layer::Normal,
        ] {
            let done = recomputed_after(|request| request.layer = layer);
            assert!(
                done.traced == 0 && done.background == 0 && done.object > 0,
                "{layer}: {done:?}"
            );
        }
    }

    #[test]
    fn the_background_s_looks_leave_geometry_and_object() {
        let blurred = recomputed_after(|request| request.scene.background = Background::Blurred);
        assert!(
            blurred.traced == 0 && blurred.background > 0 && blurred.object == 0,
            "{blurred:?}"
        );
        let hidden = recomputed_after(|request| request.scene.background = Background::Hidden);
        assert_eq!(hidden, Recomputed::default());
        let exposed = recomputed_after(|request| request.scene.display_ev = 1.5);
        assert_eq!(exposed, Recomputed::default());
    }

    #[test]
    fn hiding_the_object_computes_only_what_was_behind_it() {
        let done = recomputed_after(|request| request.layer = Layer::Environment);
        assert!(done.traced == 0 && done.object == 0, "{done:?}");
        assert!(
            done.background > 0 && done.background < n_pixels() / 2,
            "{done:?}"
        );
    }

    #[test]
    fn an_interrupted_pass_goes_on_where_it_stopped() {
        let (mut progressive, request) = (Progressive::default(), request());
        assert!(
            progressive
                .pass(&request, PassKind::plain(1), &AtomicBool::new(true))
                .is_none(),
            "cancelled before it began"
        );
        assert_same_as_render(
            &pass(&mut progressive, &request, 1),
            &request,
            PathOptions::PLAIN,
        );
    }

    #[test]
    fn coarse_passes_are_small_and_right() {
        let (mut progressive, request) = (Progressive::default(), request());
        for (scale, size) in [(4, (15, 11)), (2, (30, 22)), (1, SIZE)] {
            let output = pass(&mut progressive, &request, scale);
            assert_eq!((output.width, output.height), size);
            assert_same_as_render(&output, &request, PathOptions::PLAIN);
        }
    }

    #[test]
    fn the_fine_pass_is_the_offline_picture_and_leaves_the_surroundings() {
        let (mut progressive, mut request) = (Progressive::default(), request());
        let plain = pass(&mut progressive, &request, 1);
        let fine = |progressive: &mut Progressive, request: &PreviewScene| {
            progressive
                .pass(request, PassKind::FINE, &AtomicBool::new(false))
                .expect("not cancelled")
        };
        let output = fine(&mut progressive, &request);
        assert!(
            output.is_settled,
            "one cone a lobe has nothing to disagree with"
        );
        assert_same_as_render(&output, &request, PathOptions::FINE);
        assert_ne!(output.pixels, plain.pixels, "several paths must show");
        assert_eq!(output.recomputed.background, 0, "known from the plain pass");
        request.scene.edit.tint_scale = 0.5;
        let plain = pass(&mut progressive, &request, 1).recomputed;
        let done = fine(&mut progressive, &request).recomputed;
        assert!(
            plain.traced == 0 && done.traced == 0 && done.object > 0,
            "{plain:?} {done:?}"
        );
    }

    #[test]
    fn the_settled_pass_shades_only_pixels_whose_cones_disagree() {
        let (mut progressive, mut request) = (Progressive::default(), request());
        request.scene = Scene::new(request.scene.object, fog(-3.0, 5.0));
        request.scene.edit.roughness = RoughnessEdit::Constant(0.5);
        let mut run = |kind, request: &PreviewScene| {
            progressive
                .pass(request, kind, &AtomicBool::new(false))
                .expect("not cancelled")
        };
        let fine = run(PassKind::FINE, &request);
        assert!(!fine.is_settled, "cones of this scene disagree");
        let settled = run(PassKind::SETTLED, &request);
        let (again, all) = (settled.recomputed.object, fine.recomputed.object);
        assert!(0 < again && again < all, "{again} of {all} pixels");
        assert!(settled.is_settled && settled.pixels != fine.pixels);
        assert_same_as_render(&settled, &request, PathOptions::FINE);
        let last = run(PassKind::SETTLED, &request);
        assert_eq!(last.recomputed, Recomputed::default());
        assert_eq!(last.pixels, settled.pixels);
    }
}
