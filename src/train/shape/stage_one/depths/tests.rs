//! Meshes from depth maps that the tracer made of a known mesh.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::{Mat4, Vec3};

use crate::data::{LoadOptions, PointCloud, SeenPoints, write_png_srgb};
use crate::geometry::meshes::test_mesh::ellipsoid;
use crate::geometry::{Camera, Ray, SurfaceTracer, fibonacci_sphere};
use crate::train::placement::given_cameras;
use crate::train::random::SlotRandom;
use crate::train::shape::stage_one::*;
use crate::train::test_scene::middle_ray;

/// Pixels on a side.
const SIDE: u32 = 96;
const CENTER: Vec3 = Vec3::new(3.0, -2.0, 1.0);
/// Rounds of fairing.
const N_ROUNDS: usize = 8;

/// What lies under the object, as far as depth maps show it.
#[derive(Clone, Copy, PartialEq)]
enum Ground {
    None,
    Floor,
}

/// The shape: three radii, so that no turn maps it to itself.
fn shape() -> Arc<Mesh> {
    Arc::new(ellipsoid(CENTER, Vec3::new(0.5, 0.3, 0.4), 48))
}

/// What noisy depth maps err by at most, share of the depth: 1.6 cells.
const NOISE: f32 = 0.015;

/// Writes photos, depth maps that err by up to `noise` of the depth, and masks where they are wanted, with a `transforms.json`.
fn write_capture(root: &Path, ground: Ground, has_masks: bool, noise: f32) {
    let tracer = SurfaceTracer::new(shape());
    let directions = fibonacci_sphere(40);
    let seen = directions
        .iter()
        .filter(|d| ground == Ground::None || d.z > 0.1);
    let mut frames = Vec::new();
    let mut random = SlotRandom::new(7, 0, 0);
    for (i, direction) in seen.enumerate() {
        let camera = Camera::look_at(CENTER + 2.0 * *direction, CENTER, Vec3::Z, 0.7, SIDE, SIDE);
        let (mut depths, mut mask) = (vec![0.0_f32; (SIDE * SIDE) as usize], Vec::new());
        for (i, depth) in (0..SIDE * SIDE).zip(&mut depths) {
            let ray = middle_ray(&camera, i);
            let hit = tracer.intersect(&ray, 0.0, f32::INFINITY).map(|hit| hit.t);
            let floor = (CENTER.z - 0.4 - ray.origin.z) / ray.direction.z;
            let floor = (ground == Ground::Floor && floor > 0.0).then_some(floor);
            let t = hit.or(floor).unwrap_or(0.0);
            let error = noise * (2.0 * random.uniform() - 1.0);
            *depth = (1.0 + error) * t * ray.direction.dot(camera.forward());
            mask.push([if hit.is_some() { 1.0 } else { 0.0 }; 3]);
        }
        write_pfm(&root.join(format!("{i:02}.pfm")), &depths);
        write_png_srgb(&root.join(format!("{i:02}.png")), SIDE, SIDE, &mask).unwrap();
        let mut frame = serde_json::json!({
            "file_path": format!("{i:02}.png"), "depth_file_path": format!("{i:02}.pfm"),
            "fl_x": camera.fx, "w": SIDE, "h": SIDE,
            "transform_matrix": Mat4::from(camera.world_from_camera).transpose().to_cols_array_2d(),
        });
        if has_masks {
            frame["mask_path"] = format!("{i:02}.png").into();
        }
        frames.push(frame);
    }
    let json = serde_json::json!({ "frames": frames });
    std::fs::write(root.join("transforms.json"), json.to_string()).unwrap();
}

fn write_pfm(path: &Path, depths: &[f32]) {
    let header = format!("Pf\n{SIDE} {SIDE}\n-1.0\n");
    let rows = depths.chunks_exact(SIDE as usize).rev();
    let bytes = rows.flatten().flat_map(|depth| depth.to_le_bytes());
    let file: Vec<u8> = header.bytes().chain(bytes).collect();
    std::fs::write(path, file).unwrap();
}

fn made(
    ground: Ground,
    has_masks: bool,
    noise: f32,
    n_rounds: usize,
) -> (Arc<Mesh>, MeshDifference) {
    let folder = tempfile::tempdir().unwrap();
    write_capture(folder.path(), ground, has_masks, noise);
    let dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(is_needed(&dataset), "it makes its mesh itself");
    let options = StageOneOptions {
        n_cells: 64,
        n_rounds,
        deadline: None,
    };
    let mesh = make_mesh(&dataset, &options, &AtomicBool::new(false), &|_| ()).unwrap();
    let seen = dataset.train.iter().step_by(4);
    let cameras: Vec<Camera> = seen.map(|view| view.camera).collect();
    let mesh = Arc::new(mesh);
    let difference = compare(&mesh, &shape(), &cameras);
    (mesh, difference)
}

#[test]
fn depth_maps_of_an_object_give_its_surface() {
    let (_, draft) = made(Ground::None, false, 0.0, 0);
    assert!(
        draft.chamfer < 0.002 && draft.normal_median_deg < 1.0,
        "{draft:?}"
    );
    let (_, faired) = made(Ground::None, false, 0.0, N_ROUNDS);
    assert!(
        faired.chamfer < 0.002 && faired.normal_median_deg < 0.3,
        "{faired:?}"
    );
}

#[test]
fn noise_of_depth_maps_is_evened_out() {
    let (_, draft) = made(Ground::None, false, NOISE, 0);
    let (_, faired) = made(Ground::None, false, NOISE, N_ROUNDS);
    assert!(
        faired.normal_median_deg < 0.5 * draft.normal_median_deg,
        "{draft:?} {faired:?}"
    );
    assert!(faired.chamfer < 0.004, "{faired:?}");
}

#[test]
fn masks_part_the_object_from_what_it_stands_on() {
    let (mesh, difference) = made(Ground::Floor, true, 0.0, N_ROUNDS);
    assert!(
        difference.chamfer_visible < 0.003 && difference.chamfer < 0.004,
        "{difference:?}"
    );
    let extent = mesh.bounds().extent();
    assert!(extent.max_element() < 1.1, "no floor: {extent:?}");
    // Without masks what it stands on belongs to it.
    let (mesh, _) = made(Ground::Floor, false, 0.0, 1);
    let extent = mesh.bounds().extent();
    assert!(extent.x > 1.5, "with the floor: {extent:?}");
}

/// Points of the object and of a floor below it, and which of them each view sees.
fn cloud(dataset: &Dataset) -> PointCloud {
    let mesh = shape();
    let tracer = SurfaceTracer::new(Arc::clone(&mesh));
    let spots = fibonacci_sphere(600).into_iter().map(|d| {
        let from = Ray {
            origin: CENTER + 5.0 * d,
            direction: -d,
        };
        let hit = tracer.intersect(&from, 0.0, f32::INFINITY);
        hit.unwrap().position
    });
    let floor = fibonacci_sphere(100)
        .into_iter()
        .map(|d| CENTER + Vec3::new(1.2 * d.x, 1.2 * d.y, -0.4));
    let positions: Vec<Vec3> = spots.chain(floor).collect();
    let photos = dataset.train.iter().map(|view| {
        let eye = view.camera.position();
        let is_seen = |p: Vec3| {
            let ray = Ray {
                origin: eye,
                direction: (p - eye).normalize_or_zero(),
            };
            !tracer.occluded(&ray, 0.0, 0.999 * p.distance(eye))
        };
        SeenPoints {
            name: view.name.clone(),
            points: (0..positions.len() as u32)
                .filter(|i| is_seen(positions[*i as usize]))
                .collect(),
        }
    });
    PointCloud {
        photos: photos.collect(),
        colors: vec![[0; 3]; positions.len()],
        errors_px: vec![0.5; positions.len()],
        positions,
    }
}

#[test]
fn points_alone_give_a_coarse_surface_without_the_floor() {
    let folder = tempfile::tempdir().unwrap();
    write_capture(folder.path(), Ground::Floor, false, 0.0);
    let mut dataset = Dataset::load(folder.path(), &LoadOptions::default()).unwrap();
    dataset.origin.depths.clear();
    let options = StageOneOptions::default();
    let make = |dataset: &Dataset| make_mesh(dataset, &options, &AtomicBool::new(false), &|_| ());
    let without = make(&dataset);
    assert!(
        matches!(without, Err(StageOneError::TooFewMasks { .. })),
        "{without:?}"
    );
    dataset.origin.points = Some(Arc::new(cloud(&dataset)));
    assert!(!is_needed(&dataset), "so coarse a mesh is made on demand");
    let mesh = Arc::new(make(&dataset).unwrap());
    let difference = compare(&mesh, &shape(), &given_cameras(&dataset));
    assert!(
        difference.chamfer_visible < 0.02 && difference.normal_median_deg < 12.0,
        "{difference:?}"
    );
    let extent = mesh.bounds().extent();
    assert!(extent.max_element() < 1.15, "no floor: {extent:?}");
}
