//! Real and synthetic captures that lie beside a developer's checkout; skipped where absent.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "tests report what they skip and stop at the first surprise"
)]

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use neif::data::{
    ColmapModel, Dataset, DatasetReport, Frame, Keep, Listing, LoadOptions, Severity, View, check,
    list_capture, read_colmap_model, read_exr_linear, read_mesh,
};

/// A capture under `../shared/data`, or `None` with a message.
fn capture(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/data")
        .join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("SKIPPED: {} is absent", path.display());
        None
    }
}

fn load(path: &Path) -> (Dataset, DatasetReport) {
    let dataset = Dataset::load(path, &LoadOptions::default()).unwrap();
    let report = check(&dataset);
    println!("{report}");
    (dataset, report)
}

#[test]
fn synthetic_captures_are_clean_and_fit_their_mesh() {
    for name in ["balls", "suzanne"] {
        let Some(path) = capture(name) else { continue };
        let (dataset, report) = load(&path);
        assert_eq!(dataset.train.len(), 60, "{name}: training views");
        assert_eq!(dataset.test.len(), 30, "{name}: test views");
        assert!(
            report.problems.iter().all(|p| p.severity == Severity::Note),
            "{name}"
        );
        assert!(
            report.agreement.unwrap().worst_iou > 0.98,
            "{name}: masks fit the mesh"
        );
        let ply = read_mesh(&path.join("mesh.ply")).unwrap();
        let glb = dataset.mesh.unwrap();
        assert_eq!(
            ply.triangles.len(),
            glb.triangles.len(),
            "{name}: PLY as GLB"
        );
        assert!(
            ply.bounds().center().distance(glb.bounds().center()) < 1e-4,
            "{name}: bounds"
        );
    }
}

#[test]
fn relighting_truth_of_the_synthetic_captures_is_read() {
    let Some(path) = capture("balls") else { return };
    let cases = Dataset::relight_cases(&path).unwrap();
    let names: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    let expected = [
        "env_rot90",
        "env_shift",
        "rough_02",
        "rough_04",
        "swap_suzanne",
        "tint_half",
    ];
    assert_eq!(names, expected, "edits");
    for case in &cases {
        assert_eq!(case.views.len(), 8, "{}: views", case.name);
        assert!(
            case.views.iter().all(|view| view.mask.is_some()),
            "{}: masks",
            case.name
        );
        assert!(
            case.apply.unknown.is_empty(),
            "{}: {:?}",
            case.name,
            case.apply.unknown
        );
    }
    assert_eq!(cases[2].apply.roughness, Some(0.2), "rough_02");
    assert_eq!(
        cases[4].apply.environment_of.as_deref(),
        Some("suzanne"),
        "swap"
    );
    assert!(
        cases[1].apply.environment_transform.unwrap().translate.x > 0.29,
        "shift"
    );
}

#[test]
fn environment_only_captures_and_dwa_pictures_are_read() {
    let Some(path) = capture("balls/env_only") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert_eq!(
        dataset.train.len() + dataset.val.len() + dataset.test.len(),
        60,
        "views"
    );
    assert!(
        report.masks.is_none() && dataset.mesh.is_none(),
        "no object"
    );
    let Some(linear) = capture("balls/linear") else {
        return;
    };
    let file = linear.read_dir().unwrap().next().unwrap().unwrap().path();
    let (width, height, _) = read_exr_linear(&file).unwrap();
    assert_eq!((width, height), (320, 320), "{}", file.display());
}

#[test]
fn nerf_synthetic_files_have_masks_by_alpha_and_no_environment() {
    let Some(path) = capture("real/chair_nerf_synthetic") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert_eq!((dataset.train.len(), dataset.test.len()), (34, 10), "views");
    assert!(!dataset.environment_visible, "cut out");
    assert_eq!(report.masks.unwrap().n_views, 54, "alpha masks");
}

#[test]
fn instant_ngp_files_load_complete_or_not() {
    let Some(path) = capture("real/fox_ngp") else {
        return;
    };
    let (clean, report) = load(&path);
    assert!(report.lens.distorted, "phone lens");
    let (shipped, _) = load(&path.join("transforms_as_shipped.json"));
    let missing = shipped
        .problems
        .iter()
        .find(|p| p.what.contains("missing"))
        .unwrap();
    assert!(missing.what.starts_with("17 of 67"), "{missing}");
    assert_eq!(clean.train.len(), shipped.train.len(), "the same photos");
    let (a, b) = (clean.train[0].camera, shipped.train[0].camera);
    assert!(
        (a.fx / b.fx - 1.0).abs() < 2e-3,
        "lens scaled with the photos"
    );
}

/// The distances in pixels between where a COLMAP model saw its points and where the cameras of
/// `frames` see them, sorted.
fn reprojection_errors(model: &ColmapModel, frames: &[Frame]) -> Vec<f32> {
    let points: HashMap<u64, Vec3> = model
        .points
        .iter()
        .map(|point| (point.id, point.position.as_vec3()))
        .collect();
    let mut errors = Vec::new();
    for image in &model.images {
        let stem = Path::new(&image.name).file_stem().unwrap();
        let Some(frame) = frames.iter().find(|f| f.photo.file_stem() == Some(stem)) else {
            continue;
        };
        let (width, height) = frame.intrinsics.size.unwrap();
        let camera = frame.camera(width, height).unwrap().0;
        for seen in &image.observations {
            let Some(point) = seen.point_id.and_then(|id| points.get(&id)) else {
                continue;
            };
            if let Some(p) = camera.project(*point) {
                errors.push(p.distance(Vec2::new(seen.x_px as f32, seen.y_px as f32)));
            }
        }
    }
    errors.sort_by(f32::total_cmp);
    errors
}

fn all_frames(listing: &Listing) -> Vec<Frame> {
    listing.frames().cloned().collect()
}

#[test]
fn colmap_cameras_see_their_points_where_the_photos_did() {
    let Some(path) = capture("real/beer_can_colmap") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert!(
        report.recognised.contains("COLMAP model (binary)"),
        "{}",
        report.recognised
    );
    let n = dataset.views().count();
    assert_eq!(
        (n, report.points.unwrap().n_points),
        (71, 4414),
        "photos, points"
    );
    let model = read_colmap_model(&path.join("sparse/0"), Keep::Observations).unwrap();
    let errors = reprojection_errors(&model, &all_frames(&list_capture(&path).unwrap()));
    let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
    println!(
        "COLMAP: {} observations, median {median:.3} px, p95 {p95:.3} px",
        errors.len()
    );
    assert!(
        errors.len() > 10_000 && median < 1.0 && p95 < 3.0,
        "median {median}, p95 {p95}"
    );
}

#[test]
fn llff_poses_are_those_of_the_model_that_they_were_made_from() {
    let Some(path) = capture("real/beer_can_colmap") else {
        return;
    };
    let model = read_colmap_model(&path.join("sparse/0"), Keep::Observations).unwrap();
    let listing = list_capture(&path.join("poses_bounds.npy")).unwrap();
    assert!(
        listing.recognised.starts_with("LLFF"),
        "{}",
        listing.recognised
    );
    let frames = all_frames(&listing);
    // The format has one lens, without distortion, for all photos; this model has a lens for each.
    // Poses are judged with those.
    let own_lens = reprojection_errors(&model, &frames);
    let lenses = all_frames(&list_capture(&path).unwrap());
    let with_lenses: Vec<Frame> = frames
        .iter()
        .map(|frame| Frame {
            intrinsics: lenses
                .iter()
                .find(|l| l.name == frame.name)
                .unwrap()
                .intrinsics,
            ..frame.clone()
        })
        .collect();
    let errors = reprojection_errors(&model, &with_lenses);
    let median = |errors: &[f32]| errors[errors.len() / 2];
    println!(
        "LLFF: {} observations, median {:.3} px with the model's lenses, {:.3} px with its own",
        errors.len(),
        median(&errors),
        median(&own_lens)
    );
    assert!(errors.len() > 10_000 && median(&errors) < 1.0, "poses");
    assert!(median(&own_lens) < 4.0, "one lens for all");
    let mut n_outside = 0;
    for frame in &frames {
        let [near, far] = frame.depth_range.unwrap();
        let image = model
            .images
            .iter()
            .find(|i| i.name.starts_with(&frame.name))
            .unwrap();
        let camera = frame.camera(720, 1280).unwrap().0;
        for id in image.observations.iter().filter_map(|seen| seen.point_id) {
            let point = model.points.iter().find(|point| point.id == id).unwrap();
            let depth = (point.position.as_vec3() - camera.position()).dot(camera.forward());
            n_outside += usize::from(depth < near || depth > far);
        }
    }
    let share = n_outside as f32 / errors.len() as f32;
    println!(
        "LLFF: {:.2} % of the points outside the declared depths",
        100.0 * share
    );
    // They are the depths' 0.1 and 99.9 percentiles.
    assert!(share < 0.01, "{share}");
}

/// How well the masks agree with each other under the cameras: the median over views of the
/// overlap (intersection over union) between a mask and the silhouette of all masks' visual hull.
fn mask_consistency(dataset: &Dataset, center: Vec3, half_side: f32) -> f32 {
    const N: usize = 80;
    let views: Vec<&View> = dataset.views().collect();
    let is_object = |view: &View, p: Vec3| {
        let mask = view.mask.as_ref().unwrap();
        view.camera.project(p).is_some_and(|pixel| {
            let inside = pixel.min_element() >= 0.0
                && pixel.x < mask.width as f32
                && pixel.y < mask.height as f32;
            inside && mask.is_object(pixel.y as usize * mask.width as usize + pixel.x as usize)
        })
    };
    let cell = 2.0 * half_side / N as f32;
    let corner = center - Vec3::splat(half_side);
    let hull: Vec<bool> = (0..N * N * N)
        .map(|i| {
            let at = [i % N, i / N % N, i / N / N].map(|k| (k as f32 + 0.5) * cell);
            let p = corner + Vec3::from_array(at);
            let n_out = views.iter().filter(|view| !is_object(view, p)).count();
            // A mask or two may be torn.
            20 * n_out <= views.len()
        })
        .collect();
    let meets_hull = |origin: Vec3, direction: Vec3| {
        let middle = (center - origin).dot(direction);
        let n_steps = (4.0 * half_side / cell) as i32;
        (-n_steps..n_steps).any(|k| {
            let p = (origin + direction * (middle + 0.5 * cell * k as f32) - corner) / cell;
            let inside = p.min_element() >= 0.0 && p.max_element() < N as f32;
            inside && hull[(p.z as usize * N + p.y as usize) * N + p.x as usize]
        })
    };
    let mut overlaps: Vec<f32> = views
        .iter()
        .map(|view| {
            let mask = view.mask.as_ref().unwrap();
            let (mut n_both, mut n_either) = (0, 0);
            for y in (0..mask.height).step_by(6) {
                for x in (0..mask.width).step_by(6) {
                    let ray = view.camera.ray(x as f32 + 0.5, y as f32 + 0.5);
                    let hit = meets_hull(ray.origin, ray.direction);
                    let object = mask.is_object((y * mask.width + x) as usize);
                    n_both += usize::from(hit && object);
                    n_either += usize::from(hit || object);
                }
            }
            n_both as f32 / n_either.max(1) as f32
        })
        .collect();
    overlaps.sort_by(f32::total_cmp);
    overlaps[overlaps.len() / 2]
}

#[test]
fn llff_photos_and_masks_agree_with_the_poses() {
    let Some(path) = capture("real/blowtorch_llff") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert!(
        report.recognised.starts_with("LLFF"),
        "{}",
        report.recognised
    );
    assert_eq!(report.masks.unwrap().n_views, 57, "masks");
    assert!(!report.lens.distorted, "the format has no distortion");
    let [near, far] = report.cameras.distance;
    let overlap = mask_consistency(&dataset, report.cameras.look_at.into(), 0.2 * (near + far));
    println!("blowtorch: visual hull over masks, median IoU {overlap:.3}");
    assert!(overlap > 0.75, "{overlap}");
    let Some(other) = capture("real/blowtorch_llff_otherlight") else {
        return;
    };
    let other = list_capture(&other).unwrap();
    assert_eq!(all_frames(&other).len(), 10, "photos under other light");
}

#[test]
fn idr_cameras_see_the_object_in_the_unit_sphere() {
    let Some(path) = capture("real/dtu_scan65_idr") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert!(
        report.recognised.contains("cameras_sphere.npz"),
        "{}",
        report.recognised
    );
    assert_eq!(report.masks.unwrap().n_views, 49, "masks by number");
    for view in dataset.views() {
        assert!(
            (view.camera.fx / 723.0 - 1.0).abs() < 0.01,
            "focal length {}",
            view.camera.fx
        );
        let mask = view.mask.as_ref().unwrap();
        let (mut n_object, mut n_outside) = (0, 0);
        for i in (0..mask.coverage.len()).filter(|i| mask.is_object(*i)) {
            let (x, y) = (i % mask.width as usize, i / mask.width as usize);
            let ray = view.camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            // The ray's distance from the sphere's centre.
            n_outside += usize::from(ray.origin.cross(ray.direction).length() > 1.0);
            n_object += 1;
        }
        let share = n_outside as f32 / n_object as f32;
        assert!(
            share < 0.01,
            "{}: {share} of the mask outside the sphere",
            view.name
        );
    }
    let overlap = mask_consistency(&dataset, Vec3::ZERO, 1.0);
    println!("scan65: visual hull over masks, median IoU {overlap:.3}");
    assert!(overlap > 0.93, "{overlap}");
}
