//! Real and synthetic captures that lie beside a developer's checkout; skipped where absent.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "tests report what they skip and stop at the first surprise"
)]

use std::path::{Path, PathBuf};

use neif::data::{
    Dataset, DatasetReport, LoadOptions, Severity, check, read_exr_linear, read_mesh,
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
fn nerf_synthetic_files_have_masks_by_alpha_and_no_surroundings() {
    let Some(path) = capture("real/chair_nerf_synthetic") else {
        return;
    };
    let (dataset, report) = load(&path);
    assert_eq!((dataset.train.len(), dataset.test.len()), (34, 10), "views");
    assert!(!dataset.surroundings_visible, "cut out");
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
