//! Pixels are traced when they are needed, thinned by tiles, drawn with those that share their chroma, and follow their cameras.

use std::collections::HashSet;
use std::sync::Arc;

use glam::Vec2;

use super::block_chroma::block_around;
use super::store::{ChromaSource, ObjectPixel, PixelStore};
use super::traced_pixels::TracedPixels;
use super::view_pixels::PixelOptions;
use crate::data::{Dataset, Photo};
use crate::geometry::SurfaceTracer;
use crate::train::placement::given_cameras;
use crate::train::preparation::pixel_options;
use crate::train::random::SlotRandom;
use crate::train::test_scene::{small_fields, sphere_in_a_box};

/// The pixels of a capture, with options that differ from the usual ones.
fn collected(dataset: &Dataset, change: impl Fn(&mut PixelOptions)) -> PixelStore {
    let tracer = Arc::new(SurfaceTracer::new(Arc::clone(
        dataset.mesh.as_ref().unwrap(),
    )));
    let mut options = pixel_options(&small_fields(), true, 0.0);
    change(&mut options);
    let given = given_cameras(dataset);
    PixelStore::collect(dataset, &given, Some(&tracer), options, &|| true).unwrap()
}

#[test]
fn more_of_the_object_is_traced_once_what_is_traced_was_drawn() {
    let dataset = sphere_in_a_box(5, 96);
    let in_portions = |n_pixels| {
        let mut store = collected(&dataset, |_| ());
        store.objects.clear();
        store.objects_before = vec![0];
        store.portions = store.portions.cut(n_pixels);
        store.trace_more(&|| true);
        store
    };
    let places = |store: &PixelStore| {
        let of_traced = |t: &TracedPixels| {
            t.places
                .iter()
                .map(|place| (t.view, *place))
                .collect::<Vec<_>>()
        };
        let mut places: Vec<_> = store.objects.iter().flat_map(of_traced).collect();
        places.sort_unstable();
        places
    };
    let all = in_portions(1);
    assert!(
        all.n_objects() > 5000 && !all.has_untraced(),
        "{}",
        all.n_objects()
    );
    let mut store = in_portions(250_000);
    let first = store.n_objects();
    assert!(
        (all.n_objects() / 8..all.n_objects() / 3).contains(&first),
        "{first}"
    );
    store.trace_drawn(first as u64 - 1);
    assert_eq!(store.n_objects(), first, "not drawn often enough");
    store.trace_drawn(first as u64);
    assert_eq!(store.n_traced_portions(), 2);
    let of_portion = |i| store.draw_object(&mut SlotRandom::new(1, 0, i)).traced / store.n_views();
    let shown: HashSet<usize> = (0..400).map(of_portion).collect();
    assert_eq!(shown.len(), 2, "both are drawn from");
    store.trace_drawn(u64::MAX);
    assert!(!store.has_untraced());
    assert!(places(&store) == places(&all), "each once");

    // A portion that is stopped leaves all as it was.
    let mut stopped = in_portions(250_000);
    assert!(!stopped.trace_more(&|| false) && stopped.n_objects() == first);
}

#[test]
fn pixels_are_thinned_by_tiles() {
    let dataset = sphere_in_a_box(5, 160);
    let traced = |max_pixels, choice| {
        collected(&dataset, |options| {
            (options.max_pixels, options.choice) = (max_pixels, choice);
        })
    };
    let all = traced(usize::MAX, 0);
    let third = dataset.train.len() * 160 * 160 / 3;
    let some = traced(third, 0);
    let share = some.n_objects() as f32 / all.n_objects() as f32;
    assert!((0.25..0.42).contains(&share), "{share}");
    let places = |store: &PixelStore| store.objects[0].places.clone();
    assert_eq!(places(&some), places(&traced(third, 0)));
    assert!(places(&some) != places(&traced(third, 1)), "another choice");
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
            (options.max_pixels, options.shared_chroma) = (3 * 64 * 64 / 2, shared_chroma);
        })
    };
    let (together, singly) = (store(true), store(false));
    let draw = |store: &PixelStore| store.draw_objects(400, |i| SlotRandom::new(1, 0, i as u64));
    let drawn = draw(&together);
    assert_eq!(drawn.len(), 400);
    let place = |pixel: &ObjectPixel| together.objects[pixel.traced].places[pixel.index];
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
        let mut starts = Vec::new();
        store.unpack_paths(&pixel, &mut vertices, |path| starts.push(path.start));
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
        // Its paths begin around the pixel's centre.
        let seen = |start: &usize| given[pixel.view].project(vertices[*start].point.position);
        let at = starts.iter().filter_map(seen).sum::<Vec2>() / starts.len() as f32;
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
