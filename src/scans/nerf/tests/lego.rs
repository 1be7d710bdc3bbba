//! A network that was really trained: the toy bulldozer of the synthetic scenes.

use glam::{Affine3A, Mat3};

use super::*;

/// Means over the picture.
const MEAN_SRGB: [f32; 3] = [0.1521, 0.1283, 0.0785];
const MEAN_OPACITY: f32 = 0.3211;
/// Pixels on smooth parts: column, row, colour, distance.
const PIXELS: [(usize, usize, [f32; 3], f32); 5] = [
    (68, 31, [0.426, 0.367, 0.117], 3.252),
    (23, 56, [0.202, 0.226, 0.279], 3.994),
    (45, 59, [0.200, 0.226, 0.284], 3.749),
    (66, 73, [0.333, 0.226, 0.173], 3.515),
    (56, 51, [0.397, 0.279, 0.050], 3.839),
];

/// The camera of the original program's `pose_spherical(-108, -26, 4)`, 100 pixels wide and high.
fn camera() -> Camera {
    let (theta, phi) = ((-108_f32).to_radians(), (-26_f32).to_radians());
    let tilt = Mat3::from_rotation_x(phi);
    let turn = Mat3::from_rotation_y(-theta);
    let swap = Mat3::from_cols(-Vec3::X, Vec3::Z, Vec3::Y);
    let rotation = swap * turn * tilt;
    Camera {
        width: 100,
        height: 100,
        fx: 138.89,
        fy: 138.89,
        cx: 50.0,
        cy: 50.0,
        distortion: crate::geometry::Distortion::default(),
        world_from_camera: Affine3A::from_mat3_translation(rotation, rotation * Vec3::Z * 4.0),
    }
}

/// Means over the picture and over blocks of it, made by an independent program: torch's own layers at 1024 points a ray.
#[test]
fn the_bulldozer_looks_as_torch_shows_it() {
    let path = "../shared/data/real/radiance_fields/nerf_pytorch_lego/checkpoint199999.ckpt";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    if !path.is_file() {
        println!("skipped: {} is not there", path.display());
        return;
    }
    let nerf = read(&path).unwrap();
    assert_eq!(nerf.describe(), "neural radiance field (4 layers of 128)");
    let picture = nerf.picture(&camera(), &AtomicBool::new(false)).unwrap();
    let mean = |values: &mut dyn Iterator<Item = f32>| values.sum::<f32>() / 1e4;
    let means = [0, 1, 2].map(|c| mean(&mut picture.srgb.iter().map(|color| color[c])));
    for (value, there) in means.iter().zip(MEAN_SRGB) {
        assert!(
            (value - there).abs() < 0.002,
            "{means:?} and not {MEAN_SRGB:?}"
        );
    }
    let opacity = mean(&mut picture.opacity.iter().copied());
    assert!((opacity - MEAN_OPACITY).abs() < 0.002, "{opacity}");
    for (x, y, color, distance) in PIXELS {
        let i = y * 100 + x;
        let there = picture.srgb[i];
        let off = (0..3)
            .map(|c| (there[c] - color[c]).abs())
            .fold(0.0, f32::max);
        assert!(off < 0.03, "{there:?} and not {color:?} at {x}, {y}");
        assert!(
            (picture.distance[i] - distance).abs() < 0.02,
            "{} and not {distance}",
            picture.distance[i]
        );
    }
    assert_eq!(picture.distance[0], f32::INFINITY, "nothing in the corner");
    let points = nerf.surface_points(500);
    assert_eq!(points.len(), 500, "as many as asked for");
    let reach = points
        .iter()
        .fold(Vec3::ZERO, |reach, p| reach.max(p.abs()));
    assert!(
        (0.5..0.75).contains(&reach.x) && (1.0..1.3).contains(&reach.y),
        "{reach}"
    );
}
