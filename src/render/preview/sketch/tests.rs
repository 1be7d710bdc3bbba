//! Sketches against full pictures.

use glam::Vec3;
use strum::VariantArray as _;

use super::*;
use crate::geometry::Mesh;
use crate::render::Scene;
use crate::render::output::picture::render_with;
use crate::render::output::raster::Picture;
use crate::render::path::gbuffer::GBuffer;
use crate::render::scene::Layer;
use crate::render::test_scene::{self, NEVER, environment, fog, fog_above, object_of};

fn request(width: u32, height: u32) -> PreviewScene {
    // A fog that grows brighter to one side: smooth, as seen from anywhere.
    let mut request = test_scene::request(width, height);
    request.scene = Scene::new(request.scene.object, fog(-1.0, 0.8));
    request
}

/// A floor under empty space, seen from within the inner box.
fn floor() -> PreviewScene {
    let eye = Vec3::new(1.5, 0.0, 0.0);
    PreviewScene {
        scene: Scene::new(None, fog_above(-1.3)),
        camera: Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.9, 160, 120),
        ..test_scene::request(1, 1)
    }
}

fn sketch(sketch: &mut Sketch, request: &PreviewScene, scale: u32, purpose: Purpose) -> PassOutput {
    sketch
        .picture(request, scale, purpose, &NEVER)
        .expect("not cancelled")
}

/// Checks the mean error against a full picture, in codes.
fn assert_like_full(output: &PassOutput, request: &PreviewScene, limit: f32, what: &str) {
    let camera = request.camera.resized(output.width, output.height);
    let (scene, layer) = (&request.scene, request.layer);
    let full: Picture = render_with(scene, &camera, layer, PathOptions::PLAIN, &NEVER, &|_| ())
        .expect("not cancelled");
    let pairs = output.pixels.iter().zip(&full.pixels);
    let errors = pairs.flat_map(|(a, b)| (0..3).map(|c| (f32::from(a[c]) - 255.0 * b[c]).abs()));
    let error = errors.sum::<f32>() / (3 * full.pixels.len()) as f32;
    assert!(error < limit, "{what}: off by {error} codes");
}

#[test]
fn a_first_sketch_is_like_the_full_picture() {
    for (purpose, limit) in [
        (Purpose::Motion, 4.0),
        (Purpose::Rest, 2.5),
        (Purpose::Refresh, 4.0),
    ] {
        let request = request(121, 87);
        let output = sketch(&mut Sketch::default(), &request, 1, purpose);
        assert_eq!((output.width, output.height), (121, 87));
        assert_like_full(&output, &request, limit, &format!("{purpose:?}"));
    }
}

#[test]
fn what_was_seen_is_used_again_after_a_step_to_the_side() {
    let (mut kept, mut request) = (Sketch::default(), floor());
    let first = sketch(&mut kept, &request, 1, Purpose::Motion).recomputed;
    // Some more pictures of the same fill what was left out.
    for _ in 0..3 {
        sketch(&mut kept, &request, 1, Purpose::Motion);
    }
    request.camera.world_from_camera.translation += glam::Vec3A::new(0.0, 0.02, 0.01);
    kept.floor_secs = None;
    let output = sketch(&mut kept, &request, 1, Purpose::Motion);
    let again = output.recomputed;
    assert!(
        5 * again.background < first.background,
        "{again:?} after {first:?}"
    );
    assert_like_full(&output, &request, 4.0, "after a step");
}

#[test]
fn what_the_camera_sees_of_the_object_is_kept_while_it_stays() {
    let (mut kept, mut request) = (Sketch::default(), request(90, 70));
    let first = sketch(&mut kept, &request, 1, Purpose::Motion).recomputed;
    request.scene.edit.tint_scale = 0.5;
    let output = sketch(&mut kept, &request, 1, Purpose::Motion);
    assert!(
        first.traced > 0 && output.recomputed.traced == 0,
        "{first:?}"
    );
    assert_like_full(&output, &request, 4.0, "after an edit");
}

#[test]
fn a_turned_environment_takes_its_points_along() {
    let (mut kept, mut request) = (Sketch::default(), floor());
    let first = sketch(&mut kept, &request, 1, Purpose::Motion).recomputed;
    request.scene.transform.rotate_deg = Vec3::new(0.0, 0.0, 2.0);
    kept.floor_secs = None;
    let again = sketch(&mut kept, &request, 1, Purpose::Motion).recomputed;
    assert!(
        3 * again.background < first.background,
        "{again:?} after {first:?}"
    );
}

#[test]
fn another_environment_leaves_nothing_of_the_old_one() {
    let (mut kept, mut request) = (Sketch::default(), request(96, 80));
    sketch(&mut kept, &request, 1, Purpose::Rest);
    let bright = (*fog(1.0, 0.0)).clone().renamed("elsewhere");
    request.scene.swap_environment(std::sync::Arc::new(bright));
    request.scene.trained_in = None;
    let output = sketch(&mut kept, &request, 1, Purpose::Motion);
    assert_like_full(&output, &request, 4.0, "elsewhere");
}

#[test]
fn a_refresh_shows_nothing_of_an_earlier_state() {
    let (mut kept, mut request) = (Sketch::default(), request(96, 80));
    sketch(&mut kept, &request, 1, Purpose::Rest);
    // The same place, trained further.
    request.scene.environment = fog(0.5, 0.0);
    request.scene.trained_in = None;
    for purpose in [Purpose::Refresh, Purpose::SharpRefresh, Purpose::Rest] {
        let output = sketch(&mut kept, &request, 1, purpose);
        assert_like_full(&output, &request, 4.0, &format!("{purpose:?}"));
    }
}

#[test]
fn every_layer_is_like_its_full_picture() {
    // What a pixel costs is another thing in a sketch.
    let layers = Layer::VARIANTS.iter().copied();
    for layer in layers.filter(|layer| *layer != Layer::Samples) {
        let mut request = request(80, 64);
        request.layer = layer;
        request.scene = request.scene.lit_for(&[layer], &NEVER).expect("lit");
        let output = sketch(&mut Sketch::default(), &request, 1, Purpose::Rest);
        assert_like_full(&output, &request, 4.0, &layer.to_string());
    }
}

#[test]
fn an_outline_at_rest_is_as_smooth_as_in_the_full_picture() {
    let request = request(80, 64);
    let object = request.scene.object.as_ref().expect("an object");
    let options = PathOptions::PLAIN;
    let full = GBuffer::trace(Some(&object.tracer), &request.camera, 0..64, options);
    let mut kept = Sketch::default();
    sketch(&mut kept, &request, 1, Purpose::Rest);
    let (_, seen) = kept.surfaces[0].as_ref().expect("a surface at rest");
    let pairs = seen.coverage.iter().zip(full.coverage());
    let n_otherwise = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-6).count();
    // What passes between all pixels' centres unseen.
    assert!(
        n_otherwise <= 5,
        "{n_otherwise} pixels are covered otherwise"
    );
}

#[test]
fn a_cancelled_sketch_gives_nothing_and_hurts_nothing() {
    let (mut kept, request) = (Sketch::default(), request(64, 48));
    let cancelled = AtomicBool::new(true);
    assert!(
        kept.picture(&request, 1, Purpose::Rest, &cancelled)
            .is_none()
    );
    let output = sketch(&mut kept, &request, 1, Purpose::Rest);
    assert_like_full(&output, &request, 2.5, "after a cancelled one");
}

#[test]
fn a_coarse_picture_is_small() {
    for (scale, size) in [(4, (15, 11)), (2, (30, 22)), (1, (60, 44))] {
        let camera = scaled(&request(60, 44).camera, scale);
        assert_eq!((camera.width, camera.height), size);
    }
}

#[test]
fn a_scene_without_an_object_and_tiny_pictures_are_drawn() {
    for (width, height) in [(1, 1), (2, 1), (1, 5), (7, 3)] {
        let mut request = request(width, height);
        for purpose in [Purpose::Motion, Purpose::Rest] {
            let output = sketch(&mut Sketch::default(), &request, 1, purpose);
            assert_eq!((output.width, output.height), (width, height));
        }
        request.scene = Scene::new(None, environment(3));
        sketch(&mut Sketch::default(), &request, 2, Purpose::Motion);
    }
}

#[test]
fn a_thin_sheet_keeps_its_outline() {
    let positions = vec![
        Vec3::new(0.0, -1.0, -1.0),
        Vec3::new(0.0, 1.0, -1.0),
        Vec3::new(0.0, 1.0, 1.0),
        Vec3::new(0.0, -1.0, 1.0),
    ];
    let mesh = Mesh::new(positions, None, vec![[0, 1, 2], [0, 2, 3]]).expect("a sound sheet");
    let mut request = request(100, 80);
    request.scene.object = Some(object_of(mesh, 4));
    request.layer = Layer::Normal;
    let output = sketch(&mut Sketch::default(), &request, 1, Purpose::Motion);
    assert_like_full(&output, &request, 1.5, "a sheet");
}
