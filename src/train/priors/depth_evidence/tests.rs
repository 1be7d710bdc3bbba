//! On a sphere in a box with patterned walls, whose distances are known.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::*;
use crate::data::Mask;
use crate::geometry::{Ray, fibonacci_sphere};
use crate::neif::field::cells::cell_index;
use crate::neif::field::density_grid::DensityGrid;
use crate::train::placement::{field_frame, given_cameras};
use crate::train::test_scene::{middle_ray, painted, sphere_in_a_box, to_the_wall};

/// Side of the photos, pixels.
const SIZE: u32 = 96;

/// Never the same twice.
fn pattern(p: Vec3) -> Vec3 {
    let wave = |frequency: f32| {
        let q = frequency * p;
        (q.x + 0.7 * q.y).sin() * (0.8 * q.y - 0.3 * q.z).cos() * (q.z + 0.4 * q.x).cos()
    };
    Vec3::new(0.3, 0.25, 0.2) * (1.0 + 0.4 * wave(5.0) + 0.3 * wave(8.3) + 0.2 * wave(13.7))
}

/// Photos from around the sphere, each with the gain a colour of its index.
fn patterned_box(gain: impl Fn(usize) -> Vec3) -> Dataset {
    let mut dataset = sphere_in_a_box(60, 8);
    let n = dataset.train.len();
    for (index, view) in dataset.train.iter_mut().enumerate() {
        let (x, y) = (TAU * index as f32 / n as f32).sin_cos();
        let eye = Vec3::new(1.8 * x, 1.8 * y, 0.6);
        view.camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 1.0, SIZE, SIZE);
        let ray = |i: u32| middle_ray(&view.camera, i);
        view.photo = painted(SIZE, |i| {
            let ray = ray(i);
            gain(index) * pattern(ray.at(to_the_wall(ray.origin, ray.direction)))
        });
        // A pixel more than the sphere of half a unit.
        let is_object = |ray: Ray| ray.at(-ray.origin.dot(ray.direction)).length() < 0.52;
        let coverage = |i: u32| u8::MAX * u8::from(is_object(ray(i)));
        view.mask = Some(Mask {
            width: SIZE,
            height: SIZE,
            coverage: (0..SIZE * SIZE).map(coverage).collect(),
        });
    }
    dataset
}

fn depths_of(dataset: &Dataset) -> (FieldFrame, SeenDepths) {
    let frame = field_frame(dataset, 1.1);
    let tracer = dataset.mesh.clone().map(SurfaceTracer::new);
    let cameras = given_cameras(dataset);
    let depths = SeenDepths::of(dataset, &cameras, tracer.as_ref(), &frame, &|| true);
    (frame, depths.expect("nobody cancelled"))
}

#[test]
fn distances_of_the_walls_are_found_and_none_of_the_object() {
    let dataset = patterned_box(|_| Vec3::ONE);
    let (_, depths) = depths_of(&dataset);
    assert!(depths.share() > 0.2, "{} known", depths.share());
    let mut errors = Vec::new();
    for (index, view) in dataset.train.iter().enumerate() {
        for pixel in (0..view.photo.n_pixels()).step_by(7) {
            let ray = middle_ray(&view.camera, pixel as u32);
            let Some(nearness) = depths.nearness(index, ray.direction) else {
                continue;
            };
            let mask = view.mask.as_ref().expect("a mask");
            assert!(!mask.is_object(pixel), "pixel {pixel} of {}", view.name);
            errors.push((nearness * to_the_wall(ray.origin, ray.direction) - 1.0).abs());
        }
    }
    errors.sort_by(f32::total_cmp);
    let at = |share: f32| errors[(share * errors.len() as f32) as usize];
    assert!(errors.len() > 1000, "{} known", errors.len());
    let [middle, far] = [0.5, 0.9].map(at);
    assert!(middle < 0.02 && far < 0.06, "{middle} and {far}");
}

#[test]
fn what_photos_see_through_is_air_and_the_object_is_not() {
    let (frame, depths) = depths_of(&patterned_box(|_| Vec3::ONE));
    let mut density = DensityGrid::default();
    clear_air(&mut density, &depths, &frame);
    let is_void = |p: Vec3| density.is_void(cell_index(frame.field_from_world(p).to_array()));
    let around = fibonacci_sphere(64);
    let ring = (0..64).map(|i| Vec2::from_angle(TAU * i as f32 / 64.0).extend(0.0));
    let n_void = ring.filter(|p| is_void(1.2 * *p)).count();
    assert!(n_void > 32, "{n_void} of 64 places around the object");
    assert!(around.iter().all(|p| !is_void(0.3 * *p)), "the object");
}

#[test]
fn exposures_follow_from_what_photos_share() {
    let log_gain = |photo: usize| 0.3 * Vec3::new(1.0, 0.8, 1.2) * (1.7 * photo as f32).sin();
    let dataset = patterned_box(|photo| log_gain(photo).exp());
    let found = depths_of(&dataset).1.log_gains.expect("exposures");
    let n = dataset.train.len();
    let mean = (0..n).map(log_gain).sum::<Vec3>() / n as f32;
    for (photo, found) in found.iter().enumerate() {
        let apart = (*found - (log_gain(photo) - mean)).abs().max_element();
        assert!(apart < 0.02, "photo {photo}: {found}, off by {apart}");
    }
}

#[test]
fn plain_walls_determine_nothing() {
    let (_, depths) = depths_of(&sphere_in_a_box(30, 48));
    assert!(depths.share() < 0.01 && depths.log_gains.is_none());
}

#[test]
fn what_was_measured_goes_before_what_was_found() {
    let dataset = patterned_box(|_| Vec3::ONE);
    let view = &dataset.train[0];
    let photo = background(view, &view.camera, None);
    let mut depths = PhotoDepths::unknown(&photo, 0.1);
    depths.nearness.fill(9.0);
    // The upper half is four units away; of the lower nothing is known.
    let n = photo.grey.len();
    let map = DepthMap {
        camera: view.camera,
        depths: (0..n).map(|i| if i < n / 2 { 4.0 } else { 0.0 }).collect(),
    };
    measure(&mut depths, &photo, &map);
    let (upper, lower) = depths.nearness.split_at(n / 2 - SIZE as usize);
    for (value, grey) in upper.iter().zip(&photo.grey) {
        let expected = if grey.is_nan() { 9.0 } else { 0.25 };
        assert!((value - expected).abs() < 1e-5, "{value}");
    }
    assert!(lower[2 * SIZE as usize..].iter().all(|value| *value == 9.0));
    assert!(photo.grey.iter().any(|grey| grey.is_nan()), "the object");
}

#[test]
fn work_stops_when_asked_to() {
    let dataset = sphere_in_a_box(6, 32);
    let frame = field_frame(&dataset, 1.1);
    let cameras = given_cameras(&dataset);
    assert!(SeenDepths::of(&dataset, &cameras, None, &frame, &|| false).is_none());
}
