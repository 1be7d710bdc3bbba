//! What a capture holds and what is wrong with it, for people and for scripts.
//!
//! [`check`] measures a loaded [`Dataset`]; the report prints as a page ([`std::fmt::Display`])
//! and serialises as JSON. It looks for the faults that ruin training quietly: masks that do not
//! fit the mesh, a mesh in another frame, empty masks, the same photo in training and test.

mod agreement;
mod backdrop;
#[cfg(test)]
mod condition_tests;
mod coverage;
mod exposure;
mod page;
mod pixels;
mod sharpness;
mod statistics;
mod thumb;

use std::path::PathBuf;

use glam::Vec3;
use serde::Serialize;

use self::backdrop::Backdrop;
use super::{Dataset, Problem};

/// What [`check`] found.
#[derive(Clone, Debug, Serialize)]
pub struct DatasetReport {
    /// The capture's name.
    pub name: String,
    /// Its folder.
    pub root: PathBuf,
    /// The layout that was recognised and the files that it was recognised by.
    pub recognised: String,
    /// Views by split.
    pub views: SplitCounts,
    /// Which photos train, validate and test, and why.
    pub split_rule: String,
    /// Picture sizes, most frequent first.
    pub resolutions: Vec<Resolution>,
    /// Whether photos are linear and unclipped (EXR, HDR).
    pub hdr: bool,
    /// Whether photos show the environment.
    #[serde(rename = "surroundings_visible")]
    pub environment_visible: bool,
    /// The lenses.
    pub lens: LensSummary,
    /// Where the cameras are.
    pub cameras: CameraSummary,
    /// The direction that is up in the world.
    pub up: Option<[f32; 3]>,
    /// Whether it was given, not estimated from how the cameras were held.
    pub up_is_given: bool,
    /// The reconstruction's points; `None` where the layout has none.
    pub points: Option<PointSummary>,
    /// Object masks; `None` when no view has one.
    pub masks: Option<MaskSummary>,
    /// The mesh; `None` when there is none.
    pub mesh: Option<MeshSummary>,
    /// How well masks and mesh agree; `None` without either.
    pub agreement: Option<MaskAgreement>,
    /// How the photos were taken.
    pub conditions: Conditions,
    /// Findings of loading and checking, worst first.
    pub problems: Vec<Problem>,
}

/// Views by split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SplitCounts {
    /// Training views.
    pub train: usize,
    /// Validation views.
    pub val: usize,
    /// Test views.
    pub test: usize,
}

/// A picture size and how many views have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Resolution {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Views of this size.
    pub n_views: usize,
}

/// The range of lenses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LensSummary {
    /// Shortest and longest horizontal focal length, pixels.
    pub focal_px: [f32; 2],
    /// Narrowest and widest horizontal field of view, degrees.
    pub fov_x_deg: [f32; 2],
    /// Whether any lens distorts.
    pub distorted: bool,
}

/// Where the cameras are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraSummary {
    /// The point nearest to all optical axes, world.
    pub look_at: [f32; 3],
    /// Nearest and farthest camera from it, scene units.
    pub distance: [f32; 2],
    /// The diagonal of the box around the cameras, scene units.
    pub extent: f32,
}

/// The points of a reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PointSummary {
    /// Points.
    pub n_points: usize,
    /// Median of how far off the photos see them, pixels; `None` where that was never computed.
    pub median_error_px: Option<f32>,
    /// Corners of the box around nine tenths of them along each axis.
    pub min: [f32; 3],
    /// The opposite corner.
    pub max: [f32; 3],
}

/// Object masks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MaskSummary {
    /// Views with a mask.
    pub n_views: usize,
    /// Mean share of the picture that is object.
    pub mean: f32,
    /// Smallest share.
    pub min: f32,
    /// Largest share.
    pub max: f32,
}

/// The mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSummary {
    /// The file.
    pub path: Option<PathBuf>,
    /// Vertices.
    pub n_vertices: usize,
    /// Triangles with an area.
    pub n_triangles: usize,
    /// Triangles without, dropped.
    pub n_degenerate: usize,
    /// Smallest coordinates.
    pub min: [f32; 3],
    /// Largest coordinates.
    pub max: [f32; 3],
    /// Surface area, square scene units.
    pub surface_area: f64,
    /// Edges with a triangle on one side only, vertices at one position taken as one.
    pub n_open_edges: usize,
    /// Edges with more than two triangles.
    pub n_branching_edges: usize,
    /// Whether there are neither.
    pub watertight: bool,
}

/// Overlap of masks with the mesh's silhouettes, as intersection over union.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaskAgreement {
    /// Views compared.
    pub n_views: usize,
    /// Mean over them.
    pub mean_iou: f32,
    /// The lowest.
    pub worst_iou: f32,
    /// The view that has it.
    pub worst_view: String,
}

/// How the photos were taken, as far as training photos and their cameras show.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Conditions {
    /// The part of the circle around the object that they were taken from, degrees.
    pub circle_covered_deg: f32,
    /// The share of all directions that some of them look into.
    pub directions_seen: f32,
    /// The share of pairs from different sides whose backgrounds are the same in the picture, as on a turntable; `None`
    /// where too few are conclusive.
    pub same_background: Option<f32>,
    /// From the least to the most light that they got by what the cameras noted (EXIF), stops.
    pub noted_exposure_range_ev: Option<f32>,
    /// How much photos are brighter or darker than their neighbours, stops; `None` where too few show the same.
    pub exposure_jitter_ev: Option<f32>,
    /// Those that are much more blurred than the others.
    pub blurred: Vec<String>,
}

/// Measures and examines a capture. Runs on the current rayon pool; under a second for a hundred
/// small views.
pub fn check(dataset: &Dataset) -> DatasetReport {
    let mut problems = dataset.problems.clone();
    problems.extend(pixels::find_problems(dataset));
    let mesh = dataset
        .mesh
        .as_deref()
        .map(|mesh| statistics::mesh_summary(mesh, dataset.mesh_path.clone()));
    if let Some(mesh) = &mesh {
        problems.extend(statistics::mesh_problems(mesh));
    }
    let cameras = statistics::camera_summary(dataset);
    problems.extend(statistics::camera_problem(&cameras));
    let points = dataset.origin.points.as_deref();
    let points = points.and_then(statistics::point_summary);
    problems.extend(points.as_ref().and_then(statistics::point_problem));
    let agreement = agreement::compare(dataset, &mut problems);
    let conditions = conditions(dataset, &cameras, &mut problems);
    problems.sort_by_key(|problem| problem.severity);
    DatasetReport {
        name: dataset.name.clone(),
        root: dataset.root.clone(),
        recognised: dataset.origin.recognised.clone(),
        views: SplitCounts {
            train: dataset.train.len(),
            val: dataset.val.len(),
            test: dataset.test.len(),
        },
        split_rule: dataset.origin.split_rule.clone(),
        resolutions: statistics::resolutions(dataset),
        hdr: dataset.views().any(|view| view.photo.is_linear_hdr()),
        environment_visible: dataset.environment_visible,
        lens: statistics::lens_summary(dataset),
        cameras,
        up: dataset.origin.up.map(|up| up.to_array()),
        up_is_given: dataset.origin.up_is_given,
        points,
        masks: statistics::mask_summary(dataset),
        mesh,
        agreement,
        conditions,
        problems,
    }
}

/// Whether the exposures of the training photos differ: by what the cameras noted, else by what neighbouring photos show.
pub fn exposures_differ(dataset: &Dataset) -> bool {
    let center = center(dataset, &statistics::camera_summary(dataset));
    let exposures = exposure::measure(dataset, &thumb::thumbs(dataset), center);
    exposures.problem().is_some()
}

/// Whether the background stands still in the picture while the camera moves, as on a turntable: what it shows is then not
/// what shines on the object.
pub fn background_stands_still(dataset: &Dataset) -> bool {
    Backdrop::of(dataset, &thumb::thumbs(dataset)).stands_still()
}

/// Where the object is.
fn center(dataset: &Dataset, cameras: &CameraSummary) -> Vec3 {
    let mesh = dataset.mesh.as_ref();
    mesh.map_or(Vec3::from(cameras.look_at), |mesh| mesh.bounds().center())
}

fn conditions(
    dataset: &Dataset,
    cameras: &CameraSummary,
    problems: &mut Vec<Problem>,
) -> Conditions {
    let thumbs = thumb::thumbs(dataset);
    let center = center(dataset, cameras);
    let up = dataset.origin.up.unwrap_or(Vec3::Z);
    let exposures = exposure::measure(dataset, &thumbs, center);
    problems.extend(exposures.problem());
    let backdrop = Backdrop::of(dataset, &thumbs);
    problems.extend(backdrop.problem());
    Conditions {
        circle_covered_deg: coverage::circle_covered_deg(dataset, center, up, problems),
        directions_seen: coverage::directions_seen(dataset, problems),
        same_background: backdrop.same_share,
        noted_exposure_range_ev: exposures.noted_range_ev,
        exposure_jitter_ev: exposures.seen_jitter_ev,
        blurred: sharpness::find_blurred(dataset, problems),
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};

    use super::super::test_asserts::assert_contains;
    use super::super::test_capture::{CENTER, SIDE, TestCapture, object};
    use super::super::{LoadOptions, MeshPlacement, Severity, write_glb, write_png_srgb};
    use super::*;

    fn report(capture: &TestCapture) -> DatasetReport {
        check(&Dataset::load(capture.root(), &LoadOptions::default()).unwrap())
    }

    /// The capture with its mesh moved to where it does not belong.
    fn misplaced(file_from_world: Affine3A) -> (TestCapture, DatasetReport) {
        let capture = TestCapture::new(12);
        let mesh = object().transformed(file_from_world);
        write_glb(&capture.path("mesh.glb"), &mesh).unwrap();
        let report = report(&capture);
        (capture, report)
    }

    #[test]
    fn a_good_capture_is_described_and_clean() {
        let report = report(&TestCapture::new(12));
        assert!(report.problems.is_empty(), "{:?}", report.problems);
        let agreement = report.agreement.as_ref().unwrap();
        assert!(agreement.worst_iou > 0.97, "{agreement:?}");
        assert!(report.mesh.as_ref().unwrap().watertight, "mesh");
        let look_at = Vec3::from(report.cameras.look_at);
        assert!(look_at.distance(CENTER) < 0.01, "{look_at}");
        for distance in report.cameras.distance {
            assert!((distance - 5.0).abs() < 0.02, "{distance}");
        }
        let page = report.to_string();
        for part in [
            "12 train, 0 val, 4 test",
            "32 x 32 px",
            "watertight",
            "no problems",
        ] {
            assert_contains(&page, part);
        }
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(json["views"]["train"], 12, "json");
    }

    #[test]
    fn a_y_up_mesh_is_named_with_its_cure_and_the_cure_works() {
        let y_up_from_world = Affine3A::from_rotation_x((-90.0_f32).to_radians());
        let (capture, report) = misplaced(y_up_from_world);
        let problem = &report.problems[0];
        assert_contains(&problem.what, "a y-up file beside a z-up capture");
        assert_contains(&problem.advice, "--mesh-rotate 90,0,0");
        let options = LoadOptions {
            mesh_placement: MeshPlacement {
                rotate_deg_xyz: Vec3::new(90.0, 0.0, 0.0),
                ..MeshPlacement::default()
            },
            ..LoadOptions::default()
        };
        let cured = check(&Dataset::load(capture.root(), &options).unwrap());
        assert!(cured.agreement.unwrap().mean_iou > 0.97, "the cure works");
    }

    #[test]
    fn a_shifted_and_scaled_mesh_is_named_with_its_cure() {
        let file_from_world =
            Affine3A::from_translation(Vec3::X) * Affine3A::from_scale(Vec3::splat(2.0));
        let (_capture, report) = misplaced(file_from_world);
        let problem = &report.problems[0];
        assert_contains(&problem.what, "shifted or scaled");
        let (_, flags) = problem.advice.split_once("--mesh-scale ").unwrap();
        let scale: f32 = flags.split(' ').next().unwrap().parse().unwrap();
        assert!((scale - 0.5).abs() < 0.03, "{problem}");
    }

    #[test]
    fn a_capture_far_from_the_origin_is_named() {
        let capture = TestCapture::new(12);
        let mut dataset = Dataset::load(capture.root(), &LoadOptions::default()).unwrap();
        dataset.mesh = None;
        for (away, is_far) in [(0.0, false), (100.0, false), (1e4, false), (1e5, true)] {
            let mut moved = dataset.clone();
            for view in moved.train.iter_mut().chain(&mut moved.test) {
                view.camera.world_from_camera.translation.x += away;
            }
            let problems = check(&moved).problems;
            let found = problems.iter().any(|p| p.what.contains("from the origin"));
            assert_eq!(found, is_far, "{away} units away: {problems:?}");
        }
    }

    #[test]
    fn a_mesh_of_something_else_is_an_error() {
        let squashed = Affine3A::from_scale(Vec3::new(0.02, 3.0, 0.02));
        let (_capture, report) = misplaced(squashed);
        assert_eq!(report.problems[0].severity, Severity::Error);
        assert_contains(&report.problems[0].what, "does not fit");
    }

    #[test]
    fn black_masks_flat_photos_and_copies_are_found() {
        let capture = TestCapture::new(12);
        let flat = vec![[0.0; 3]; (SIDE * SIDE) as usize];
        write_png_srgb(&capture.path("train_mask/r_3.png"), SIDE, SIDE, &flat).unwrap();
        write_png_srgb(&capture.path("train/r_4.png"), SIDE, SIDE, &flat).unwrap();
        std::fs::copy(capture.path("train/r_0.png"), capture.path("test/r_1.png")).unwrap();
        std::fs::copy(capture.path("train/r_5.png"), capture.path("train/r_6.png")).unwrap();
        let report = report(&capture).to_string();
        for part in [
            "all-black mask: train/r_3",
            "one colour all over: train/r_4",
            "another split has too: train/r_0 = test/r_1",
            "another pose: train/r_5 = train/r_6",
        ] {
            assert_contains(&report, part);
        }
    }

    #[test]
    fn two_pixel_masks_are_checked_without_harm() {
        let capture = TestCapture::new(3);
        for i in 0..3 {
            let mut mask = vec![[0.0; 3]; (SIDE * SIDE) as usize];
            mask[500] = [1.0; 3];
            mask[501] = [1.0; 3];
            let path = capture.path(&format!("train_mask/r_{i}.png"));
            write_png_srgb(&path, SIDE, SIDE, &mask).unwrap();
        }
        let report = report(&capture);
        assert!(report.agreement.unwrap().mean_iou.is_finite(), "agreement");
        assert!(report.masks.unwrap().min > 0.0, "coverage");
    }
}
