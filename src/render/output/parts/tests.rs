//! Tests of `parts`.

use super::*;
use crate::neif::field::seen_grid::SeenGrid;
use crate::render::Background;
use crate::render::test_scene::{NEVER, camera, environment_seen, scene};

const AOVS: [Layer; 5] = [
    Layer::Final,
    Layer::Diffuse,
    Layer::Specular,
    Layer::Roughness,
    Layer::Normal,
];

fn parts(layers: &[Layer], backdrop: Backdrop) -> Parts {
    parts_of(&scene(), layers, backdrop)
}

fn parts_of(scene: &Scene, layers: &[Layer], backdrop: Backdrop) -> Parts {
    let options = PartsOptions {
        backdrop,
        ..PartsOptions::new(layers)
    };
    parts_with(scene, &options)
}

fn parts_with(scene: &Scene, options: &PartsOptions<'_>) -> Parts {
    render_parts(scene, &camera(40, 30), options, &NEVER, &|_| {}).expect("not cancelled")
}

#[test]
fn a_photo_s_exposure_is_a_gain_of_all_light() {
    let gain = glam::Vec3::new(2.0, 1.0, 0.5);
    let layers = [Layer::Final, Layer::Roughness];
    for trained_in in [scene().trained_in, None] {
        let plain = Scene {
            trained_in,
            ..scene()
        };
        // How many cones a pixel gets once more depends on how bright it is shown.
        let options = PartsOptions {
            settles: false,
            ..PartsOptions::new(&layers)
        };
        let of = |scene: &Scene| parts_with(scene, &options);
        let (before, after) = (of(&plain), of(&plain.exposed(gain)));
        assert_eq!(before.objects[1], after.objects[1], "roughness is no light");
        let check = |before: &[[f32; 3]], after: &[[f32; 3]]| {
            for (before, after) in before.iter().zip(after) {
                let expected = gain * glam::Vec3::from(*before);
                let apart = (expected - glam::Vec3::from(*after)).abs();
                let most = 1e-3 * expected.abs().max(glam::Vec3::splat(1e-3));
                assert!(apart.cmple(most).all(), "{before:?} became {after:?}");
            }
        };
        check(&before.background, &after.background);
        check(&before.objects[0].1, &after.objects[0].1);
    }
}

#[test]
fn alpha_is_coverage_and_colours_are_the_objects_own() {
    let parts = parts(&[Layer::Final], Backdrop::Transparent);
    let picture = parts.to_rgba8(&scene(), Layer::Final);
    let edge = |c: f32| c > 0.0 && c < 1.0;
    assert!(parts.coverage.iter().any(|c| edge(*c)), "has a silhouette");
    for (i, pixel) in picture.pixels.iter().enumerate() {
        let alpha = f32::from(pixel[3]) / 255.0;
        assert!(
            (alpha - parts.coverage[i]).abs() <= 0.501 / 255.0,
            "pixel {i}"
        );
        if pixel[3] == 0 {
            assert_eq!(*pixel, [0; 4], "nothing behind");
        }
    }
    // Over its environment in linear light, it is the picture with the environment.
    let whole = self::parts(&[Layer::Final], Backdrop::Shown);
    assert_eq!(whole.object(Layer::Final), parts.object(Layer::Final));
    assert_eq!(whole.coverage, parts.coverage);
}

#[test]
fn layers_add_up_and_say_where_the_object_is() {
    let parts = parts(&AOVS, Backdrop::Transparent);
    let channel = |name: &str| {
        let channels = parts.exr_channels(&scene());
        let found = channels.into_iter().find(|channel| channel.name == name);
        found.expect("the channel").values
    };
    for c in ["R", "G", "B"] {
        let (all, diffuse) = (channel(c), channel(&format!("diffuse.{c}")));
        let specular = channel(&format!("specular.{c}"));
        for i in 0..all.len() {
            let sum = diffuse[i] + specular[i];
            assert!((all[i] - sum).abs() <= 1e-4 * (1.0 + sum.abs()), "{c}, {i}");
        }
    }
    let (depth, normal) = (
        channel("Z"),
        ["X", "Y", "Z"].map(|c| channel(&format!("normal.{c}"))),
    );
    for (i, &coverage) in parts.coverage.iter().enumerate() {
        let length = normal.iter().map(|n| n[i] * n[i]).sum::<f32>().sqrt();
        if coverage == 1.0 {
            assert!((2.0..6.0).contains(&depth[i]), "depth {} of {i}", depth[i]);
            assert!((0.5..1.01).contains(&length), "normal {length} of {i}");
        } else if coverage == 0.0 {
            assert_eq!((depth[i], length), (FAR, 0.0), "no object at {i}");
        }
    }
}

#[test]
fn light_that_no_photo_showed_is_marked_in_its_own_layer_alone() {
    let seen_by = |seen: Option<SeenGrid>| {
        let scene = Scene {
            background: Background::Shown,
            ..Scene::new(scene().object, environment_seen(2, seen))
        };
        let layers = [Layer::Final, Layer::Seen];
        let parts = parts_of(&scene, &layers, Backdrop::Shown);
        layers.map(|layer| parts.composed(&scene, layer).collect::<Vec<_>>())
    };
    let [plain, unknown] = seen_by(None);
    assert_eq!(plain, unknown, "nothing is known of what was seen");
    let [not_marked, marked] = seen_by(Some(SeenGrid::default()));
    assert_eq!(plain, not_marked, "the final picture has no marks");
    let corner = marked[0];
    assert!(corner[0] > 0.5 && corner[1] < 0.4, "signal: {corner:?}");
    let (centre, was) = (marked[15 * 40 + 20], plain[15 * 40 + 20]);
    assert_ne!(centre, was, "what the object mirrors is marked too");
}

#[test]
fn layers_rendered_together_are_those_rendered_alone() {
    let together = parts(&AOVS, Backdrop::Shown);
    for layer in AOVS {
        let alone = parts(&[layer], Backdrop::Shown);
        let values = together.object(layer).iter().zip(alone.object(layer));
        let off = values.flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()));
        let off = off.fold(0.0, f32::max);
        assert!(off < 1e-4, "{layer}: off by {off}");
    }
}
