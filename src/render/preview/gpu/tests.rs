//! The graphics card's path against the processor's, on whatever adapter there is: software ones too.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::*;
use crate::geometry::{Camera, fibonacci_sphere};
use crate::neif::RoughnessEdit;
use crate::neif::field::proposal::ConeRay;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::light::environment::LightScratch;
use crate::neif::light::lobe::Lobe;
use crate::render::output::picture::render_with;
use crate::render::output::raster::Picture;
use crate::render::test_scene::{
    NEVER, camera, environment, environment_over_a_floor, object_of, request, scene,
};
use crate::render::{Background, Layer, Scene, ToneMap};

/// A renderer; none on a machine without any adapter, where there is nothing to test.
fn renderer() -> Option<GpuRenderer> {
    GpuRenderer::new(GpuChoice::On).ok()
}

fn psnr(drawn: &[[u8; 4]], expected: &Picture) -> f64 {
    assert_eq!(drawn.len(), expected.pixels.len(), "sizes");
    let mut sum = 0.0;
    for (drawn, expected) in drawn.iter().zip(&expected.pixels) {
        for c in 0..3 {
            sum += (f64::from(drawn[c]) / 255.0 - f64::from(expected[c])).powi(2);
        }
    }
    -10.0 * (sum / (3.0 * drawn.len() as f64)).max(1e-12).log10()
}

/// Draws a scene both ways.
fn compared(
    renderer: &mut GpuRenderer,
    scene: &Scene,
    camera: Camera,
    layer: Layer,
    options: PathOptions,
) -> f64 {
    let picture = PreviewScene {
        scene: scene.clone(),
        camera,
        layer,
        highlight: None,
    };
    assert_eq!(carries(&picture), Ok(()), "the scene is carried");
    let drawn = renderer
        .picture(&picture, options, &NEVER)
        .expect("the adapter works")
        .expect("not cancelled");
    let expected = render_with(scene, &camera, layer, options, &NEVER, &|_| ());
    psnr(&drawn, &expected.expect("not cancelled"))
}

#[test]
fn rays_bring_what_they_bring_on_the_processor() {
    let Some(mut renderer) = renderer() else {
        return;
    };
    for environment in [environment(5), environment_over_a_floor(5)] {
        compare_rays(&mut renderer, &environment);
    }
}

fn compare_rays(renderer: &mut GpuRenderer, environment: &Arc<Environment>) {
    let rays: Vec<FieldRay> = fibonacci_sphere(500)
        .into_iter()
        .enumerate()
        .map(|(i, direction)| {
            let origin = (0.8 * fibonacci_sphere(500)[(37 * i) % 500]).to_array();
            if i % 3 == 0 {
                return FieldRay::of_pixel(origin, direction.to_array(), 0.001, 0.002);
            }
            let lobe = Lobe::from_roughness(0.05 + 0.9 * i as f32 / 500.0);
            FieldRay {
                cone: ConeRay {
                    origin,
                    direction: (direction * lobe.mean_length).to_array(),
                    base: 0.01,
                    spread: 0.01,
                    lobe_variance: lobe.variance,
                },
                direction: direction.to_array(),
                kappa: lobe.kappa,
            }
        })
        .collect();
    let found = renderer
        .radiance(environment, &rays)
        .expect("the adapter works");
    let mut batch = FieldBatch::default();
    batch.rays.extend(rays);
    environment.light(&mut batch, &mut LightScratch::default());
    for (i, (found, expected)) in found.iter().zip(&batch.radiance).enumerate() {
        for (a, b) in found.iter().zip(expected) {
            // Grid values have eleven bits there.
            assert!(
                (a - b).abs() < 0.01 * b.abs() + 1e-4,
                "ray {i}: {found:?}, not {expected:?}"
            );
        }
    }
}

/// Balls that mirror each other.
fn balls() -> Scene {
    use crate::geometry::meshes::test_mesh::{ellipsoid, together};
    let ball = |x: f32| ellipsoid(Vec3::new(x, 0.0, 0.0), Vec3::splat(0.5), 24);
    let object = object_of(together(&ball(-0.5), &ball(0.5)), 3);
    Scene::new(Some(object), environment(4))
}

#[test]
fn pictures_are_those_of_the_processor() {
    let Some(mut renderer) = renderer() else {
        return;
    };
    let mut check = |what: &str, scene: &Scene, layer: Layer, options: PathOptions| {
        let db = compared(&mut renderer, scene, camera(64, 48), layer, options);
        assert!(db > 40.0, "{what}, {layer}, {options:?}: {db:.1} dB");
    };
    for (name, scene) in [("tetrahedron", scene()), ("balls", balls())] {
        for options in [PathOptions::PLAIN, PathOptions::FINE] {
            check(name, &scene, Layer::Final, options);
        }
    }
    let mut edited = balls();
    edited.edit.tint_scale = 0.6;
    edited.edit.diffuse_gain = Vec3::new(1.5, 0.5, 1.0);
    edited.transform.exposure_ev = 0.5;
    edited.display_ev = -0.3;
    for layer in [Layer::Final, Layer::Diffuse, Layer::Specular] {
        check("edited", &edited, layer, PathOptions::PLAIN);
    }
    for background in [Background::Blurred, Background::Hidden] {
        edited.background = background;
        let what = background.to_string();
        check(&what, &edited, Layer::Final, PathOptions::PLAIN);
    }
    edited.background = Background::Shown;
    (edited.tone_map, edited.display_ev) = (ToneMap::Neutral, 1.5);
    check("neutral", &edited, Layer::Final, PathOptions::PLAIN);
    edited.object = None;
    check("alone", &edited, Layer::Environment, PathOptions::PLAIN);
}

#[test]
fn what_is_not_carried_is_named() {
    let check = |change: fn(&mut PreviewScene), expected| {
        let mut picture = request(16, 16);
        change(&mut picture);
        assert_eq!(carries(&picture), expected);
    };
    let (light, layer, roughness) = (NotCarried::Light, NotCarried::Layer, NotCarried::Roughness);
    check(|_| (), Ok(()));
    check(|p| p.scene.transform.rotate_deg.z = 20.0, Err(light));
    check(|p| p.scene.swap_environment(environment(9)), Err(light));
    check(|p| p.layer = Layer::Normal, Err(layer));
    let rough = |p: &mut PreviewScene| p.scene.edit.roughness = RoughnessEdit::Constant(0.4);
    check(rough, Err(roughness));
}

#[test]
fn a_picture_that_is_not_wanted_any_more_is_given_up() {
    let Some(mut renderer) = renderer() else {
        return;
    };
    let cancelled = AtomicBool::new(true);
    let drawn = renderer.picture(&request(16, 16), PathOptions::PLAIN, &cancelled);
    assert_eq!(drawn, Ok(None));
}

#[test]
fn a_lost_card_is_an_error_and_no_panic() {
    let Some(mut renderer) = renderer() else {
        return;
    };
    let picture = request(16, 16);
    renderer
        .picture(&picture, PathOptions::PLAIN, &NEVER)
        .expect("the adapter works");
    renderer.gpu.device.destroy();
    let error = renderer
        .picture(&picture, PathOptions::PLAIN, &NEVER)
        .expect_err("a lost card draws nothing");
    assert!(error.to_string().contains(renderer.adapter()), "{error}");
}

#[test]
fn a_preview_says_who_draws() {
    use crate::render::{DrawnBy, Passes, Preview};
    if renderer().is_none() {
        return;
    }
    let (sender, news) = crossbeam::channel::bounded(100);
    let wake = move || sender.send(()).expect("the test listens");
    let preview = Preview::new(1, GpuChoice::On, wake).expect("threads");
    let mut picture = request(24, 16);
    let patience = Duration::from_mins(5);
    let last_of = |picture: &PreviewScene| {
        let number = preview.request(picture.clone(), Passes::Refine);
        loop {
            news.recv_timeout(patience).expect("a picture");
            let frame = preview.frame().expect("a picture");
            if frame.request == number && frame.is_last {
                return (preview.drawn_by(), frame.is_fine);
            }
        }
    };
    let (drawn_by, is_fine) = last_of(&picture);
    assert!(
        matches!(drawn_by, DrawnBy::Card(_)) && is_fine,
        "{drawn_by:?}"
    );
    picture.layer = Layer::Normal;
    let (drawn_by, is_fine) = last_of(&picture);
    let by_processor =
        matches!(&drawn_by, DrawnBy::ProcessorFor { what, .. } if what == "this layer");
    assert!(by_processor && is_fine, "{drawn_by:?}");
}
