//! Makes a capture by formula: a ball in a room of coloured walls.

use std::{
    f32::consts::{PI, TAU},
    fmt::Write as _,
    fs,
    path::Path,
};

use glam::{Vec3, Vec4};
use neif::geometry::{Camera, Ray};
use serde_json::{Value, json};

/// Pixels on a side.
const SIDE: u32 = 32;
/// Radius of the ball around the origin.
const BALL: f32 = 0.5;
/// Half the side of the room.
const ROOM: f32 = 2.0;
/// Vertical field of view of the cameras, in radians.
const FOV_Y: f32 = 1.0;

/// Writes photos, masks, cameras and the mesh into `folder`: 12 views to train on, 2 to validate,
/// 3 to test.
pub(crate) fn write_capture(folder: &Path) {
    for (split, prefix, n, turn) in [
        ("train", "r", 12, 0.0),
        ("val", "v", 2, 0.35),
        ("test", "t", 3, 0.2),
    ] {
        fs::create_dir_all(folder.join(split)).expect("a folder");
        let frames: Vec<Value> = (0..n)
            .map(|i| {
                let name = format!("{prefix}_{i:03}");
                let camera = camera(i, n, turn);
                write_view(folder, split, &name, &camera);
                json!({
                    "file_path": format!("{split}/{name}.png"),
                    "mask_path": format!("{split}/{name}_mask.png"),
                    "transform_matrix": matrix(&camera),
                })
            })
            .collect();
        let focal = 0.5 * SIDE as f32 / (0.5 * FOV_Y).tan();
        let json = json!({"w": SIDE, "h": SIDE, "fl_x": focal, "fl_y": focal, "frames": frames});
        let file = folder.join(format!("transforms_{split}.json"));
        fs::write(file, json.to_string()).expect("cameras");
    }
    fs::write(folder.join("mesh.ply"), ball_ply()).expect("a mesh");
}

/// Cameras on a spiral around the ball.
fn camera(i: u32, n: u32, turn: f32) -> Camera {
    let azimuth = TAU * (i as f32 / n as f32 + turn);
    let elevation = 0.2 + 0.8 * ((i * 5) % n) as f32 / n as f32;
    let level = Vec3::new(azimuth.cos(), azimuth.sin(), 0.0);
    let eye = 1.6 * (level * elevation.cos() + Vec3::Z * elevation.sin());
    Camera::look_at(eye, Vec3::ZERO, Vec3::Z, FOV_Y, SIDE, SIDE)
}

fn matrix(camera: &Camera) -> Value {
    let pose = camera.world_from_camera;
    let row = |i: usize| -> Vec4 { glam::Mat4::from(pose).row(i) };
    json!([0, 1, 2, 3].map(|i| row(i).to_array()))
}

fn write_view(folder: &Path, split: &str, name: &str, camera: &Camera) {
    let mut photo = image::RgbImage::new(SIDE, SIDE);
    let mut mask = image::GrayImage::new(SIDE, SIDE);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            let (linear, coverage) = match ball_distance(&ray) {
                Some(t) => (ball_colour(&ray, t), 255),
                None => (wall_colour(ray.origin, ray.direction), 0),
            };
            let code = |v: f32| (neif::color::srgb_from_linear(v.min(1.0)) * 255.0).round() as u8;
            photo.put_pixel(x, y, image::Rgb(linear.to_array().map(code)));
            mask.put_pixel(x, y, image::Luma([coverage]));
        }
    }
    let save = |name: String| folder.join(split).join(name);
    photo.save(save(format!("{name}.png"))).expect("a photo");
    mask.save(save(format!("{name}_mask.png"))).expect("a mask");
}

/// Distance along the ray to the ball.
fn ball_distance(ray: &Ray) -> Option<f32> {
    let b = ray.origin.dot(ray.direction);
    let discriminant = b * b - ray.origin.length_squared() + BALL * BALL;
    (discriminant >= 0.0).then(|| -b - discriminant.sqrt())
}

/// A reddish ball that reflects the room like a half-silvered mirror.
fn ball_colour(ray: &Ray, t: f32) -> Vec3 {
    let hit = ray.origin + t * ray.direction;
    let normal = hit / BALL;
    let reflected = ray.direction - 2.0 * ray.direction.dot(normal) * normal;
    Vec3::new(0.2, 0.05, 0.05) + 0.5 * wall_colour(hit, reflected)
}

/// What the ray sees of the walls: a colour for each, with broad stripes.
fn wall_colour(origin: Vec3, direction: Vec3) -> Vec3 {
    let reach = |o: f32, d: f32| {
        if d.abs() < 1e-6 {
            f32::MAX
        } else {
            (d.signum() * ROOM - o) / d
        }
    };
    let distances = Vec3::new(
        reach(origin.x, direction.x),
        reach(origin.y, direction.y),
        reach(origin.z, direction.z),
    );
    let t = distances.min_element();
    let hit = origin + t * direction;
    let base = if t == distances.x {
        if hit.x > 0.0 {
            Vec3::new(0.8, 0.3, 0.2)
        } else {
            Vec3::new(0.2, 0.6, 0.3)
        }
    } else if t == distances.y {
        if hit.y > 0.0 {
            Vec3::new(0.2, 0.3, 0.8)
        } else {
            Vec3::new(0.7, 0.7, 0.2)
        }
    } else if hit.z > 0.0 {
        Vec3::splat(0.9)
    } else {
        Vec3::splat(0.25)
    };
    let stripes = (3.0 * (hit.x + hit.y + hit.z)).sin();
    base * (0.75 + 0.25 * stripes)
}

/// A ball of quads, split in two, as a text PLY.
fn ball_ply() -> String {
    let (n_rows, n_columns) = (24_u32, 48_u32);
    let mut vertices = String::new();
    for row in 0..=n_rows {
        for column in 0..n_columns {
            let (polar, azimuth) = (
                PI * row as f32 / n_rows as f32,
                TAU * column as f32 / n_columns as f32,
            );
            let (sin, cos) = polar.sin_cos();
            let n = Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
            let p = BALL * n;
            writeln!(vertices, "{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z).expect("text");
        }
    }
    let mut faces = String::new();
    for row in 0..n_rows {
        for column in 0..n_columns {
            let right = (column + 1) % n_columns;
            let at = |row: u32, column: u32| row * n_columns + column;
            let [a, b] = [at(row, column), at(row, right)];
            let [c, d] = [at(row + 1, column), at(row + 1, right)];
            writeln!(faces, "3 {a} {c} {d}\n3 {a} {d} {b}").expect("text");
        }
    }
    let (n_vertices, n_faces) = ((n_rows + 1) * n_columns, 2 * n_rows * n_columns);
    format!(
        "ply\nformat ascii 1.0\nelement vertex {n_vertices}\n\
         property float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         element face {n_faces}\nproperty list uchar int vertex_indices\n\
         end_header\n{vertices}{faces}"
    )
}
