//! The checks of how a capture was taken, on captures that were taken wrongly on purpose.

use glam::Vec3;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};

use super::super::test_asserts::assert_contains;
use super::super::test_capture::{CENTER, SIDE, TestCapture};
use super::super::{LoadOptions, Photo, Severity, View};
use super::*;
use crate::data::formats::test_formats::{SIZE, cameras, folder, write_llff};
use crate::data::photos::exif::tests::exif_of;

/// A capture from all around in a textured environment, whose views see `shade` of a pixel's world and camera direction.
fn captured(shade: &dyn Fn(usize, Vec3, Vec3) -> f32) -> Dataset {
    let capture = TestCapture::new(100);
    let mut dataset = Dataset::load(capture.root(), &LoadOptions::default()).unwrap();
    for (i, view) in dataset.train.iter_mut().enumerate() {
        let camera = view.camera;
        let turn = camera.world_from_camera.inverse();
        let pixels = (0..SIDE * SIDE)
            .map(|p| {
                let ray = camera.ray((p % SIDE) as f32 + 0.5, (p / SIDE) as f32 + 0.5);
                let seen = shade(i, ray.direction, turn.transform_vector3(ray.direction));
                [(seen.clamp(0.0, 1.0) * 65535.0) as u16; 3]
            })
            .collect();
        view.photo = Photo::Ldr {
            width: SIDE,
            height: SIDE,
            pixels,
        };
    }
    dataset
}

/// Patches that differ in every direction.
fn texture(d: Vec3) -> f32 {
    0.5 + 0.12 * (11.0 * d.x + 2.0).sin()
        + 0.12 * (13.0 * d.y).sin()
        + 0.12 * (9.0 * d.z + 1.0).sin()
}

fn found(report: &DatasetReport, what: &str) -> bool {
    report.problems.iter().any(|p| p.what.contains(what))
}

#[track_caller]
fn assert_found(report: &DatasetReport, what: &str) {
    assert!(found(report, what), "{:?}", report.problems);
}

#[test]
fn a_good_capture_raises_no_alarm() {
    let dataset = captured(&|_, world, _| texture(world));
    assert!(!exposures_differ(&dataset));
    let report = check(&dataset);
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    let conditions = &report.conditions;
    assert!(conditions.same_background.unwrap() < 0.02, "{conditions:?}");
    assert!(
        conditions.exposure_jitter_ev.unwrap() < 0.1,
        "{conditions:?}"
    );
    assert!(conditions.directions_seen > 0.9, "{conditions:?}");
    assert!(conditions.circle_covered_deg > 300.0, "{conditions:?}");
}

#[test]
fn a_turntable_is_an_error_that_says_what_to_do() {
    let report = check(&captured(&|_, _, in_camera| texture(in_camera)));
    let is_turntable = |p: &&Problem| p.what.contains("turntable");
    let problem = report.problems.iter().find(is_turntable).unwrap();
    assert_eq!(problem.severity, Severity::Error, "{problem}");
    assert_contains(&problem.advice, "walk around");
}

/// Up to half a code of noise, which differs from photo to photo.
fn noise(i: usize, d: Vec3) -> f32 {
    let [x, y, _] = d.to_array().map(|v| (9e4 * v) as i64 as u64);
    let places = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663);
    // Mixed once more: photos' noise would be each other's, or its negative.
    let mixed = places
        .wrapping_add(i as u64)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((mixed >> 40) as f32 / (1_u64 << 24) as f32 - 0.5) / 255.0
}

/// How much of the light a lens lets through.
fn falloff(in_camera: Vec3) -> f32 {
    1.0 - 2.0 * (1.0 - in_camera.z * in_camera.z)
}

#[test]
fn few_faint_things_that_stay_in_place_are_a_turntable() {
    let edge = |d: Vec3| 1.0 / (1.0 + (-40.0 * (d.x + 0.3 * d.y - 0.15)).exp());
    let exposed = |i: usize| 2.0_f32.powf(0.1 * ((i * 7 % 5) as f32 - 2.0));
    let faint = |d: Vec3| 0.6 + 5.0 / 255.0 * edge(d);
    let dataset =
        captured(&|i, _, seen| exposed(i) * (falloff(seen) * faint(seen) + noise(i, seen)));
    assert!(background_stands_still(&dataset), "an edge of five codes");
    // From three heights the same is seen by a third of the pairs.
    let at_height = |i: usize| Vec3::new(0.0, 0.0, 0.7 * (i % 3) as f32);
    let dataset = captured(&|i, _, seen| texture(seen + at_height(i)) + noise(i, seen));
    assert!(background_stands_still(&dataset), "three heights");
}

#[test]
fn what_lenses_and_even_backgrounds_have_alike_is_no_turntable() {
    let mark = |d: Vec3| {
        if d.x > 0.2 && d.y.abs() < 0.04 {
            0.3
        } else {
            0.0
        }
    };
    let room = |i: usize, world: Vec3, seen: Vec3| {
        falloff(seen) * texture(world) + mark(seen) + noise(i, seen)
    };
    assert!(!background_stands_still(&captured(&room)), "a marked room");
    let bands = |i: usize, world: Vec3, seen: Vec3| {
        falloff(seen) * (0.5 + 0.3 * (9.0 * world.z).sin()) + noise(i, seen)
    };
    assert!(!background_stands_still(&captured(&bands)), "a round room");
}

#[test]
fn plain_backgrounds_are_no_turntables() {
    let is_plain = |shade: &dyn Fn(usize, Vec3, Vec3) -> f32| {
        let report = check(&captured(shade));
        let problems = &report.problems;
        assert!(
            problems.iter().all(|p| p.severity != Severity::Error),
            "{problems:?}"
        );
        assert_eq!(
            report.conditions.same_background, None,
            "nothing to compare"
        );
        found(&report, "background is plain")
    };
    assert!(is_plain(&|_, _, _| 0.9), "all alike");
    assert!(
        is_plain(&|i, _, seen| 0.6 * falloff(seen) + noise(i, seen)),
        "darker corners"
    );
}

#[test]
fn jumping_exposure_is_measured() {
    // Evenly within a stop of the mean: 0.58 stops.
    let gain = |i: usize| (((i * 2_654_435_761) >> 7) % 101) as f32 / 50.0 - 1.0;
    let gain = |i: usize| 2.0_f32.powf(gain(i));
    let encoded = crate::color::srgb_from_linear;
    let dataset = captured(&|i, world, _| encoded(0.5 * gain(i) * texture(world)));
    assert!(exposures_differ(&dataset));
    let report = check(&dataset);
    assert_found(&report, "exposure changes");
    let jitter = report.conditions.exposure_jitter_ev.unwrap();
    assert!((jitter - 0.58).abs() < 0.25, "{jitter} stops");
}

#[test]
fn exposures_that_the_camera_noted_are_compared() {
    let folder = folder();
    write_llff(folder.path(), &cameras()[..2]);
    let images = folder.path().join("images");
    std::fs::create_dir(&images).unwrap();
    for (name, seconds) in [("a.jpg", (1, 50)), ("b.jpg", (1, 25))] {
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new(&mut bytes);
        encoder.set_exif_metadata(exif_of(seconds)).unwrap();
        encoder
            .write_image(&[99; 40 * 30 * 3], SIZE.0, SIZE.1, ExtendedColorType::Rgb8)
            .unwrap();
        std::fs::write(images.join(name), bytes).unwrap();
    }
    let dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
    let report = check(&dataset);
    assert_found(&report, "by up to 1.0 stops (EXIF)");
}

#[test]
fn a_shaken_photo_is_named() {
    let noise = |d: Vec3| {
        let [x, y, _] = d.to_array().map(|v| (9e4 * v) as i64);
        (((x * 73_856_093) ^ (y * 19_349_663)) & 255) as f32 / 255.0
    };
    let mut dataset = captured(&|_, world, _| noise(world));
    let shaken = &mut dataset.train[7];
    let pixels = (0..(SIDE * SIDE) as usize)
        .map(|i| {
            let row = i - i % SIDE as usize;
            let near = i.saturating_sub(5).max(row)..(i + 6).min(row + SIDE as usize);
            let n = near.len() as f32;
            let sum: f32 = near.map(|i| shaken.photo.srgb(i)[0]).sum();
            [(sum / n * 65535.0) as u16; 3]
        })
        .collect();
    shaken.photo = Photo::Ldr {
        width: SIDE,
        height: SIDE,
        pixels,
    };
    let report = check(&dataset);
    assert_eq!(
        report.conditions.blurred,
        [dataset.train[7].name.clone()],
        "blurred"
    );
}

#[test]
fn photos_from_one_side_are_named() {
    let mut dataset = captured(&|_, world, _| texture(world));
    let is_in_front = |view: &View| {
        let from = view.camera.position() - CENTER;
        from.x > 0.0 && from.x > 1.5 * from.y.abs()
    };
    dataset.train.retain(is_in_front);
    assert!(dataset.train.len() >= 10, "{} views", dataset.train.len());
    let report = check(&dataset);
    assert_found(&report, "from one side");
}
