//! The picture against a plain one that looks at every Gaussian in every pixel.

use glam::{Mat3, Quat, Vec2, Vec3};

use super::*;
use crate::scans::splats::Splat;

/// Gaussians of all shapes before a camera at the origin that looks along -z.
fn scattered(n: usize, degree: usize) -> Splats {
    let random = |i: usize, salt: u64| {
        let mut x = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            ^ salt.wrapping_mul(0xD1B5_4A32_D192_ED03);
        x = (x ^ (x >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 29)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ (x >> 32)) & 0xFF_FFFF) as f32 / 16_777_216.0
    };
    let splat = |i: usize| Splat {
        center: Vec3::new(
            4.0 * random(i, 1) - 2.0,
            4.0 * random(i, 2) - 2.0,
            -5.0 * random(i, 3),
        ),
        scale: Vec3::new(random(i, 4), random(i, 5), random(i, 6)) * 0.2 + 0.002,
        rotation: Quat::from_scaled_axis(Vec3::new(random(i, 7), random(i, 8), random(i, 9)) * 6.0),
        opacity: random(i, 10),
    };
    let n_coefficients = (degree + 1) * (degree + 1);
    let coefficient = |i: usize| [11, 12, 13].map(|salt| random(i, salt) - 0.4);
    Splats {
        splats: (0..n).map(splat).collect(),
        degree,
        harmonics: (0..n * n_coefficients).map(coefficient).collect(),
        ..Splats::default()
    }
}

fn camera() -> Camera {
    Camera::look_at(Vec3::ZERO, -Vec3::Z, Vec3::Y, 1.0, 70, 50)
}

/// Colour, opacity and mean depth in the middle of a pixel, straight from the definition.
fn plain(splats: &Splats, camera: &Camera, pixel: Vec2) -> ([f32; 3], f32, f32) {
    let mut order: Vec<usize> = (0..splats.splats.len()).collect();
    let depth = |i: usize| -splats.splats[i].center.z;
    order.sort_by(|a, b| depth(*a).total_cmp(&depth(*b)));
    let (mut left, mut color, mut mean) = (1.0, [0.0; 3], 0.0);
    let near = 0.2_f32.min(0.02 * splats.size());
    for i in order {
        let splat = &splats.splats[i];
        if depth(i) <= near {
            continue;
        }
        let p = splat.center * Vec3::new(1.0, -1.0, -1.0);
        let spread = Mat3::from_quat(splat.rotation);
        let own = Mat3::from_diagonal(splat.scale * splat.scale);
        let flip = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let in_camera = flip * spread * own * spread.transpose() * flip.transpose();
        let limit = |v: f32, size: u32, f: f32| {
            let limit = 1.3 * 0.5 * size as f32 / f;
            v.clamp(-limit, limit)
        };
        let (tx, ty) = (
            limit(p.x / p.z, camera.width, camera.fx) * p.z,
            limit(p.y / p.z, camera.height, camera.fy) * p.z,
        );
        let jacobian = Mat3::from_cols(
            Vec3::new(camera.fx / p.z, 0.0, 0.0),
            Vec3::new(0.0, camera.fy / p.z, 0.0),
            Vec3::new(
                -camera.fx * tx / (p.z * p.z),
                -camera.fy * ty / (p.z * p.z),
                0.0,
            ),
        );
        let flat = jacobian * in_camera * jacobian.transpose();
        let sharp = flat.x_axis.x * flat.y_axis.y - flat.x_axis.y * flat.x_axis.y;
        let (xx, yy, xy) = (flat.x_axis.x + 0.3, flat.y_axis.y + 0.3, flat.x_axis.y);
        let area = xx * yy - xy * xy;
        let strength = if splats.is_antialiased {
            splat.opacity * (sharp / area).max(0.0).sqrt()
        } else {
            splat.opacity
        };
        let center = camera.project(splat.center).unwrap();
        let d = pixel - center;
        let q = (yy * d.x * d.x - 2.0 * xy * d.x * d.y + xx * d.y * d.y) / area;
        let alpha = (strength * (-0.5 * q).exp()).min(0.99);
        if alpha < 1.0 / 255.0 {
            continue;
        }
        let n = splats.n_coefficients();
        let own_color = crate::scans::splats::harmonics::color(
            &splats.harmonics[i * n..][..n],
            splat.center.normalize_or_zero(),
        );
        for c in 0..3 {
            color[c] += left * alpha * own_color[c];
        }
        mean += left * alpha * p.z;
        left *= 1.0 - alpha;
    }
    (color, 1.0 - left, mean)
}

#[test]
fn the_picture_is_the_plain_one() {
    for (degree, is_antialiased) in [(0, false), (3, false), (1, true)] {
        let splats = Splats {
            is_antialiased,
            ..scattered(600, degree)
        };
        let camera = camera();
        let picture = picture(&splats, &camera, &AtomicBool::new(false)).unwrap();
        let (mut n_covered, mut worst) = (0, 0.0_f32);
        for (i, srgb) in picture.srgb.iter().enumerate() {
            let pixel = Vec2::new((i % 70) as f32 + 0.5, (i / 70) as f32 + 0.5);
            let (color, opacity, depth) = plain(&splats, &camera, pixel);
            for c in 0..3 {
                worst = worst.max((srgb[c] - color[c]).abs());
            }
            worst = worst.max((picture.opacity[i] - opacity).abs());
            let ray = camera.ray(pixel.x, pixel.y).direction;
            if opacity > 0.01 {
                n_covered += 1;
                let distance = depth / opacity / -ray.z;
                let off = (picture.distance[i] / distance - 1.0).abs();
                assert!(off < 2e-3, "pixel {i}: distance off by {off}");
            }
        }
        assert!(n_covered > 1000, "{n_covered} pixels are covered");
        // Behind the last ten thousandth of the light nothing is drawn; a Gaussian at its edge may be cut a rounding earlier.
        assert!(worst < 5e-3, "degree {degree}: off by {worst}");
    }
}

#[test]
fn nothing_before_the_camera_is_black_and_infinitely_far() {
    let mut splats = scattered(50, 0);
    splats.splats.iter_mut().for_each(|s| s.center.z = 1.0);
    let picture = picture(&splats, &camera(), &AtomicBool::new(false)).unwrap();
    assert!(picture.srgb.iter().all(|c| *c == [0.0; 3]), "black");
    assert!(picture.opacity.iter().all(|o| *o == 0.0), "nothing");
    assert!(picture.distance.iter().all(|d| *d == f32::INFINITY), "far");
}

#[test]
fn absurd_gaussians_leave_the_picture_finite() {
    let mut splats = scattered(60, 3);
    for (i, splat) in splats.splats.iter_mut().enumerate() {
        match i % 6 {
            0 => splat.center = Vec3::splat(f32::NAN),
            1 => splat.scale = Vec3::splat(1e30),
            2 => splat.scale = Vec3::new(1e-30, 1e30, 0.0),
            3 => splat.center.z = -1e-30,
            4 => splat.center = Vec3::new(1e30, -1e30, -1e30),
            _ => splat.opacity = 1.0,
        }
    }
    let picture = picture(&splats, &camera(), &AtomicBool::new(false)).unwrap();
    let values = picture.srgb.iter().flatten().chain(&picture.opacity);
    assert!(values.clone().all(|v| v.is_finite()), "finite");
    assert!(values.into_iter().any(|v| *v > 0.0), "something is drawn");
}

#[test]
fn threads_do_not_change_the_picture_and_cancelling_gives_none() {
    let splats = scattered(3000, 2);
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| picture(&splats, &camera(), &AtomicBool::new(false)).unwrap())
    };
    assert_eq!(draw(1).srgb, draw(3).srgb, "bits");
    let cancelled = picture(&splats, &camera(), &AtomicBool::new(true));
    assert!(cancelled.is_none(), "cancelled");
}
