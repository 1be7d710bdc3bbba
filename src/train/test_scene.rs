//! A capture drawn by formulas: a glossy sphere in a painted box, for tests that need a scene with a known answer.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::config::TrainConfig;
use super::fast::Fast;
use super::step::trainer::Trainer;
use crate::color::srgb_from_linear;
use crate::data::{Dataset, Mask, Photo, Split, View};
use crate::geometry::{Camera, Mesh, Ray, SurfaceTracer, fibonacci_sphere};
use crate::neif::networks::hash_grid::{GridConfig, LEAST_WEIGHT};

/// Half side of the box.
const BOX: f32 = 3.0;
/// Specular tint of the sphere.
pub(super) const TINT: Vec3 = Vec3::new(0.9, 0.7, 0.4);
/// Diffuse radiance of the sphere.
const DIFFUSE: Vec3 = Vec3::new(0.02, 0.05, 0.10);

/// Settings for fields that suit so small a scene.
pub(super) fn small_fields() -> TrainConfig {
    let mut config = TrainConfig {
        object_pixels: 64,
        background_pixels: 64,
        preconvolved_levels: 3,
        // The sphere is a metal with a diffuse part.
        metal_weight: 0.0,
        ..TrainConfig::default()
    };
    config.field.grid = GridConfig {
        n_levels: 8,
        coarsest: 8,
        finest: 96,
        log2_table_size: 13,
        least_weight: LEAST_WEIGHT,
    };
    config.material.grid = GridConfig {
        n_levels: 4,
        coarsest: 4,
        finest: 24,
        log2_table_size: 12,
        least_weight: LEAST_WEIGHT,
    };
    config
}

/// `n_views` photos of `size` x `size` pixels, every fifth for validation.
pub(super) fn sphere_in_a_box(n_views: usize, size: u32) -> Dataset {
    let mesh = Arc::new(sphere(0.5, 24));
    let tracer = SurfaceTracer::new(Arc::clone(&mesh));
    let views: Vec<View> = (0..n_views)
        .map(|i| view(&tracer, i, n_views, size))
        .collect();
    let (val, train): (Vec<_>, Vec<_>) =
        views.into_iter().enumerate().partition(|(i, _)| i % 5 == 4);
    let strip = |views: Vec<(usize, View)>| views.into_iter().map(|(_, v)| v).collect();
    Dataset {
        name: "sphere in a box".to_owned(),
        root: PathBuf::from("formula"),
        val: strip(val),
        mesh: Some(mesh),
        first_box: None,
        mesh_path: Some(PathBuf::from("formula")),
        ..Dataset::of_views(strip(train))
    }
}

/// Height of the floor below [`sphere_on_a_floor`].
pub(super) const FLOOR: f32 = -0.5;

/// The same sphere on a patterned floor under a painted sky, from above, each photo with the gain a colour of its index.
pub(super) fn sphere_on_a_floor(
    n_views: usize,
    size: u32,
    gain: impl Fn(usize) -> Vec3,
) -> Dataset {
    let mut dataset = sphere_in_a_box(n_views, size);
    dataset.origin.up = Some(Vec3::Z);
    dataset.train.retain(|view| view.camera.position().z > 0.2);
    for (index, view) in dataset.train.iter_mut().enumerate() {
        let color = |i: u32| {
            let ray = middle_ray(&view.camera, i);
            let distance = (FLOOR - ray.origin.z) / ray.direction.z;
            let wave = |p: Vec3| 0.15 + 0.05 * (3.0 * p.x).sin() * (2.0 * p.y).cos();
            let mask = view.mask.as_ref();
            let seen = match mask.is_some_and(|mask| mask.is_object(i as usize)) {
                true => 0.1,
                false if distance > 0.0 => wave(ray.at(distance)),
                false => 0.5 + 0.3 * (9.0 * ray.direction.x).sin(),
            };
            seen * gain(index)
        };
        view.photo = painted(size, color);
    }
    dataset
}

/// Traces a trainer's pixels anew.
pub(super) fn retrace(trainer: &mut Trainer<Fast>, dataset: &Dataset) {
    let goes_on = AtomicBool::new(false);
    trainer
        .retrace(dataset, &goes_on, &|_| ())
        .expect("nobody cancels");
}

/// The ray through the middle of a camera's `i`-th pixel.
pub(super) fn middle_ray(camera: &Camera, i: u32) -> Ray {
    let (x, y) = (i % camera.width, i / camera.width);
    camera.ray(x as f32 + 0.5, y as f32 + 0.5)
}

/// A photo of `size` x `size` pixels of these linear colours.
pub(super) fn painted(size: u32, color: impl Fn(u32) -> Vec3) -> Photo {
    let code = |v: f32| (srgb_from_linear(v).clamp(0.0, 1.0) * 65535.0).round() as u16;
    let pixels = (0..size * size).map(|i| color(i).to_array().map(code));
    Photo::Ldr {
        width: size,
        height: size,
        pixels: pixels.collect(),
    }
}

fn view(tracer: &SurfaceTracer, index: usize, n_views: usize, size: u32) -> View {
    let direction = fibonacci_sphere(n_views)[index];
    let camera = Camera::look_at(
        direction * 1.9,
        Vec3::ZERO,
        Vec3::new(0.1, 0.2, 1.0),
        1.0,
        size,
        size,
    );
    let (mut colors, mut coverage) = (Vec::new(), Vec::new());
    for i in 0..size * size {
        let (x, y) = (i % size, i / size);
        let mut sum = Vec3::ZERO;
        let mut covered = 0.0;
        for k in 0..16 {
            let offset = |k: u32| (k as f32 + 0.5) / 4.0;
            let ray = camera.ray(x as f32 + offset(k % 4), y as f32 + offset(k / 4));
            let (color, is_object) = shade(tracer, &ray);
            sum += color / 16.0;
            covered += if is_object { 1.0 / 16.0 } else { 0.0 };
        }
        colors.push(sum);
        coverage.push((covered * 255.0_f32).round() as u8);
    }
    View {
        name: format!("view {index}"),
        file: PathBuf::new(),
        split: Split::Train,
        camera,
        photo: painted(size, |i| colors[i as usize]),
        mask: Some(Mask {
            width: size,
            height: size,
            coverage,
        }),
    }
}

fn shade(tracer: &SurfaceTracer, ray: &Ray) -> (Vec3, bool) {
    match tracer.intersect(ray, 0.0, f32::INFINITY) {
        Some(hit) => {
            let cos = hit.normal.dot(-ray.direction).max(0.0);
            let reflected = ray.direction + 2.0 * cos * hit.normal;
            let fresnel = TINT + (Vec3::ONE - TINT) * (1.0 - cos).powi(5);
            (
                DIFFUSE * (Vec3::ONE - fresnel) + fresnel * wall(hit.position, reflected),
                true,
            )
        }
        None => (wall(ray.origin, ray.direction), false),
    }
}

/// Distance along a ray from inside the box to where it meets it.
pub(super) fn to_the_wall(origin: Vec3, direction: Vec3) -> f32 {
    let distance = |axis: usize| {
        let d = direction[axis];
        if d.abs() < 1e-9 {
            f32::INFINITY
        } else {
            (BOX * d.signum() - origin[axis]) / d
        }
    };
    (0..3).map(distance).fold(f32::INFINITY, f32::min)
}

/// Linear colour of the box where a ray from inside meets it: smooth stripes, another phase on every wall.
fn wall(origin: Vec3, direction: Vec3) -> Vec3 {
    let p = origin + direction * to_the_wall(origin, direction);
    let wave = |a: f32, b: f32| 0.3 + 0.25 * (1.7 * a + 0.9 * b).sin() * (0.8 * b - 0.3 * a).cos();
    Vec3::new(wave(p.x, p.y), wave(p.y, p.z + 1.0), wave(p.z, p.x + 2.0))
}

/// A sphere of that radius with exact normals, `n` rows of `2 n` quads.
fn sphere(radius: f32, n: usize) -> Mesh {
    let columns = 2 * n;
    let mut normals = Vec::new();
    for row in 0..=n {
        let theta = std::f32::consts::PI * row as f32 / n as f32;
        for column in 0..=columns {
            let phi = std::f32::consts::TAU * column as f32 / columns as f32;
            normals.push(Vec3::new(
                theta.sin() * phi.cos(),
                theta.sin() * phi.sin(),
                theta.cos(),
            ));
        }
    }
    let index = |row: usize, column: usize| (row * (columns + 1) + column) as u32;
    let triangles = (0..n)
        .flat_map(|row| (0..columns).map(move |column| (row, column)))
        .flat_map(|(row, column)| {
            let [a, b, c, d] = [
                index(row, column),
                index(row + 1, column),
                index(row + 1, column + 1),
                index(row, column + 1),
            ];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let positions = normals.iter().map(|n| *n * radius).collect();
    Mesh::new(positions, Some(normals), triangles).expect("a sphere is a valid mesh")
}
