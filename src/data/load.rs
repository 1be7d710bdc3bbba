//! Reads a capture: has its photos listed, decodes them in parallel, reads the mesh.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::files::capture_path::leads_out;
use super::formats::listing::{list_capture, list_capture_as};
use super::mesh_io::{find_mesh, read_mesh};
use super::photos::exif::exposure_ev;
use super::photos::photo_budget::Reduction;
use super::photos::views::{load_views, of_split, upright_photo};
use super::problem::first_names;
use super::world_up::world_up;
use super::{
    DataError, Dataset, DepthView, Frame, LoadOptions, MeshPlacement, Origin, Photo, Problem,
    Severity, Split, View,
};
use crate::geometry::Mesh;

impl Dataset {
    /// Reads the capture at `path`: a folder, or the file in one that lists the cameras.
    ///
    /// Views that cannot be read are left out and reported in [`Dataset::problems`]. Errors when
    /// there is no capture, its list of cameras is wrong, no view is left, or a mesh that was
    /// asked for by name cannot be read. Decoding runs on the current rayon pool.
    pub fn load(path: &Path, options: &LoadOptions<'_>) -> Result<Self, DataError> {
        let choices = &options.choices;
        let listing = list_capture_as(path, choices)?;
        // Of all photos, so that every command reduces them alike, whichever it reads.
        let reduction = Reduction::to_fit(
            listing.frames().collect::<Vec<_>>().into_par_iter(),
            choices.max_megapixels,
        );
        let up = choices.up.and_then(Vec3::try_normalize);
        let up_from_cameras = world_up(listing.frames().map(|frame| frame.world_from_camera));
        let mut problems = listing.problems;
        let wanted =
            |is_wanted: bool, frames: Vec<Frame>| if is_wanted { frames } else { Vec::new() };
        let split = listing.split;
        let frames = [
            wanted(options.splits.train, split.train),
            wanted(options.splits.val, split.val),
            wanted(options.splits.test, split.test),
        ];
        let noted_exposure_ev = noted_exposures(&frames[0]);
        let depths = frames[0].iter().filter_map(DepthView::of).collect();
        let ([train, val, test], environment_visible) =
            decode_splits(path, &frames, reduction, options, &mut problems)?;
        let root = listing.root;
        problems.extend(links_out(&root, &frames));
        let (mesh, mesh_path) = load_mesh(&root, options, &mut problems)?;
        problems.sort_by_key(|problem| problem.severity);
        Ok(Self {
            name: folder_name(&root),
            root,
            origin: Origin {
                recognised: listing.recognised,
                points: listing.points.map(Arc::new),
                depths,
                up: Some(up.unwrap_or(up_from_cameras)),
                up_is_given: up.is_some(),
                split_rule: split.rule,
                noted_exposure_ev,
            },
            train,
            val,
            test,
            mesh,
            first_box: None,
            mesh_path,
            environment_visible,
            problems,
        })
    }
}

/// The first photo of a capture that can be read, without reading the capture, held as its camera says; `None` where
/// there is none. Errors are for [`Dataset::load`] to report.
pub fn first_photo(path: &Path) -> Option<Photo> {
    /// Photos that are tried: more would take as long as reading the capture.
    const MAX_TRIED: usize = 5;
    let listing = list_capture(path).ok()?;
    let mut tried = listing.frames().take(MAX_TRIED);
    tried.find_map(|frame| upright_photo(frame).ok())
}

/// The views by split, decoded in one parallel pass, and whether they show the environment.
fn decode_splits(
    path: &Path,
    frames: &[Vec<Frame>; 3],
    reduction: Reduction,
    options: &LoadOptions<'_>,
    problems: &mut Vec<Problem>,
) -> Result<([Vec<View>; 3], bool), DataError> {
    let all = frames.concat();
    let n_done = AtomicUsize::new(0);
    let loaded = load_views(&all, reduction, &|| {
        let done = n_done.fetch_add(1, Ordering::Relaxed) + 1;
        (options.on_progress)(done, all.len());
    });
    let environment_visible = !loaded.findings.are_cut_out();
    problems.extend(loaded.findings.into_problems());
    let mut views = loaded.views.into_iter();
    let mut next = |split, i: usize| of_split(split, views.by_ref().take(frames[i].len()));
    let (train, val) = (next(Split::Train, 0), next(Split::Val, 1));
    let test = next(Split::Test, 2);
    let nothing_to_learn_from = options.splits.train && train.is_empty();
    if nothing_to_learn_from || (train.is_empty() && val.is_empty() && test.is_empty()) {
        return Err(DataError::NoViews {
            path: path.to_owned(),
            problems: std::mem::take(problems),
        });
    }
    Ok(([train, val, test], environment_visible))
}

fn load_mesh(
    root: &Path,
    options: &LoadOptions<'_>,
    problems: &mut Vec<Problem>,
) -> Result<(Option<Arc<Mesh>>, Option<PathBuf>), DataError> {
    let Some(path) = options.mesh.clone().or_else(|| find_mesh(root)) else {
        return Ok((None, None));
    };
    match read_mesh(&path) {
        Ok(mesh) => {
            let placed = if options.mesh_placement == MeshPlacement::default() {
                mesh
            } else {
                mesh.transformed(options.mesh_placement.world_from_mesh())
            };
            Ok((Some(Arc::new(placed)), Some(path)))
        }
        Err(e) if options.mesh.is_some() => Err(e),
        Err(e) => {
            let advice = "the capture is used without a mesh";
            problems.push(Problem::new(Severity::Error, e.to_string(), advice));
            Ok((None, None))
        }
    }
}

/// The least and the most light that the photos got, where at least two of their files say.
fn noted_exposures(frames: &[Frame]) -> Option<[f32; 2]> {
    let noted: Vec<f32> = frames
        .par_iter()
        .filter_map(|frame| exposure_ev(&frame.photo))
        .collect();
    let least = noted.iter().copied().reduce(f32::min)?;
    let most = noted.iter().copied().reduce(f32::max)?;
    (noted.len() > 1).then_some([least, most])
}

/// Says which of the photos links in the capture's folder fetch from elsewhere, if any.
fn links_out(root: &Path, frames: &[Vec<Frame>; 3]) -> Option<Problem> {
    let names: Vec<String> = frames
        .par_iter()
        .flatten()
        .filter(|frame| leads_out(root, &frame.photo))
        .map(|frame| frame.photo.display().to_string())
        .collect();
    (!names.is_empty()).then(|| {
        let what = format!(
            "{} photos lie outside the capture's folder, where links in it lead: {}",
            names.len(),
            first_names(&names)
        );
        Problem::new(Severity::Note, what, "they are used like the others")
    })
}

fn folder_name(root: &Path) -> String {
    let absolute = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    let name = absolute.file_name().unwrap_or(OsStr::new("capture"));
    name.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::test_asserts::{assert_contains, assert_error};
    use super::super::test_capture::{SIDE, TestCapture};
    use super::super::{CaptureChoices, Mask, Splits, write_mask, write_png_srgb};
    use super::*;

    fn load(capture: &TestCapture) -> Result<Dataset, DataError> {
        Dataset::load(capture.root(), &LoadOptions::default())
    }

    fn names(views: &[View]) -> Vec<&str> {
        views.iter().map(|view| view.name.as_str()).collect()
    }

    #[test]
    fn a_whole_capture_loads_without_problems() {
        let capture = TestCapture::new(12);
        let n_calls = AtomicUsize::new(0);
        let options = LoadOptions {
            on_progress: &|_, n_all| {
                assert_eq!(n_all, 16, "views in all");
                n_calls.fetch_add(1, Ordering::Relaxed);
            },
            ..LoadOptions::default()
        };
        let dataset = Dataset::load(capture.root(), &options).unwrap();
        let (train, val, test) = (&dataset.train, &dataset.val, &dataset.test);
        assert_eq!((train.len(), val.len(), test.len()), (12, 0, 4), "splits");
        assert_eq!(n_calls.into_inner(), 16, "progress");
        assert!(dataset.mesh.is_some(), "mesh");
        assert!(dataset.environment_visible, "environment");
        assert!(dataset.problems.is_empty(), "{:?}", dataset.problems);
        assert!(train.iter().all(|view| view.mask.is_some()), "masks");
    }

    #[test]
    fn only_the_wanted_splits_are_decoded() {
        let capture = TestCapture::new(4);
        let options = LoadOptions {
            splits: Splits::TEST,
            ..LoadOptions::default()
        };
        let dataset = Dataset::load(capture.root(), &options).unwrap();
        assert_eq!((dataset.train.len(), dataset.test.len()), (0, 4), "splits");
    }

    #[test]
    fn without_a_validation_file_training_gives_some_up() {
        let dataset = load(&TestCapture::new(20)).unwrap();
        assert_eq!(names(&dataset.val), ["r_9", "r_19"], "validation");
        assert_eq!(dataset.train.len(), 18, "training");
        assert_contains(&dataset.origin.split_rule, "transforms_val.json");
    }

    /// Without splits of its own.
    fn in_a_single_file(n: usize) -> TestCapture {
        let capture = TestCapture::new(n);
        let from = capture.path("transforms_train.json");
        std::fs::rename(from, capture.path("transforms.json")).unwrap();
        capture
    }

    #[test]
    fn a_single_file_is_split_by_position_whatever_is_loaded() {
        let capture = in_a_single_file(20);
        std::fs::remove_file(capture.path("transforms_test.json")).unwrap();
        let dataset = load(&capture).unwrap();
        assert_eq!(names(&dataset.test), ["r_0", "r_8", "r_16"], "test");
        assert_eq!(names(&dataset.val), ["r_4", "r_12"], "validation");
        let file = capture.path("transforms.json");
        let by_file = Dataset::load(&file, &LoadOptions::default()).unwrap();
        assert_eq!(names(&by_file.train), names(&dataset.train), "by file");
    }

    #[test]
    fn a_single_photo_trains() {
        let dataset = load(&in_a_single_file(1)).unwrap();
        assert_eq!((dataset.train.len(), dataset.test.len()), (1, 0), "splits");
    }

    #[test]
    fn missing_photos_are_one_problem_and_broken_ones_one_each() {
        let capture = TestCapture::new(12);
        for i in [2, 3, 5, 7] {
            std::fs::remove_file(capture.path(&format!("train/r_{i}.png"))).unwrap();
        }
        std::fs::write(capture.path("train/r_8.png"), b"\x89PNG\r\n\x1a\n").unwrap();
        std::fs::remove_file(capture.path("train_mask/r_9.png")).unwrap();
        let dataset = load(&capture).unwrap();
        assert_eq!(dataset.train.len(), 7, "what is left");
        let text: Vec<String> = dataset.problems.iter().map(ToString::to_string).collect();
        assert_eq!(text.len(), 3, "{text:?}");
        assert!(text[0].starts_with("error"), "{text:?}");
        for (i, part) in [
            (0, "r_8.png"),
            (1, "4 of 12"),
            (1, "and 1 more"),
            (2, "mask files are missing (1 views: r_9)"),
        ] {
            assert_contains(&text[i], part);
        }
    }

    #[test]
    fn photos_and_masks_of_the_wrong_size_are_left_out_by_name() {
        let capture = TestCapture::new(4);
        let strip = vec![[0.5; 3]; SIDE as usize * 8];
        write_png_srgb(&capture.path("train/r_1.png"), SIDE, 8, &strip).unwrap();
        write_png_srgb(&capture.path("train_mask/r_2.png"), SIDE, 8, &strip).unwrap();
        let dataset = load(&capture).unwrap();
        assert_eq!(names(&dataset.train), ["r_0", "r_3"], "what is left");
        assert_contains(&dataset.problems[0].what, "32 x 8, but w x h is 32 x 32");
        assert_contains(&dataset.problems[1].what, "the mask is 32 x 8");
    }

    #[test]
    fn masks_of_another_folder_count_instead_of_the_capture_s() {
        let capture = TestCapture::new(4);
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("train");
        std::fs::create_dir(&inner).unwrap();
        let (width, height) = (SIDE, SIDE);
        let coverage = vec![255; (width * height) as usize];
        let white = Mask {
            width,
            height,
            coverage,
        };
        write_mask(&inner.join("r_0.png"), &white).unwrap();
        write_mask(&folder.path().join("r_2.png"), &white).unwrap();
        let options = LoadOptions {
            choices: CaptureChoices {
                masks: Some(folder.path().to_owned()),
                ..CaptureChoices::default()
            },
            ..LoadOptions::default()
        };
        let dataset = Dataset::load(capture.root(), &options).unwrap();
        let masks = dataset.train.iter().map(|view| view.mask.as_ref());
        let found: Vec<bool> = masks.map(|mask| mask.is_some()).collect();
        assert_eq!(found, [true, false, true, false]);
        let empty = tempfile::tempdir().unwrap();
        let mut options = options;
        options.choices.masks = Some(empty.path().to_owned());
        let refused = Dataset::load(capture.root(), &options);
        assert_error(refused, &["no mask in this folder is named as a photo"]);
    }

    #[test]
    fn nothing_usable_is_an_error_that_says_why() {
        let capture = TestCapture::new(2);
        for i in 0..2 {
            std::fs::write(capture.path(&format!("train/r_{i}.png")), b"").unwrap();
        }
        assert_error(load(&capture), &["no usable view", "r_1.png"]);
        let empty = tempfile::tempdir().unwrap();
        let error = Dataset::load(empty.path(), &LoadOptions::default()).unwrap_err();
        assert!(matches!(error, DataError::NotADataset { .. }), "{error}");
        let nowhere = Dataset::load(&empty.path().join("x"), &LoadOptions::default());
        assert!(matches!(nowhere, Err(DataError::Io { .. })), "{nowhere:?}");
    }

    #[test]
    fn a_broken_mesh_is_a_problem_when_found_and_an_error_when_named() {
        let capture = TestCapture::new(3);
        std::fs::write(capture.path("mesh.glb"), b"glTF").unwrap();
        let dataset = load(&capture).unwrap();
        assert!(dataset.mesh.is_none(), "no mesh");
        assert_eq!(dataset.problems[0].severity, Severity::Error, "it is said");
        let options = LoadOptions {
            mesh: Some(capture.path("mesh.glb")),
            ..LoadOptions::default()
        };
        let named = Dataset::load(capture.root(), &options);
        assert!(
            matches!(named, Err(DataError::Unusable { .. })),
            "{named:?}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn photos_behind_links_are_used_and_those_outside_are_named() {
        let (capture, elsewhere) = (TestCapture::new(3), tempfile::tempdir().unwrap());
        for (name, target) in [
            ("r_1", elsewhere.path().join("x.png")),
            ("r_2", capture.path("y.png")),
        ] {
            let photo = capture.path(&format!("train/{name}.png"));
            std::fs::rename(&photo, &target).unwrap();
            std::os::unix::fs::symlink(&target, &photo).unwrap();
        }
        let dataset = load(&capture).unwrap();
        assert_eq!(names(&dataset.train), ["r_0", "r_1", "r_2"], "all are used");
        let note = dataset.problems.iter().find(|p| p.what.contains("outside"));
        let note = &note.unwrap().what;
        assert!(note.starts_with("1 photos"), "{note}");
        assert_contains(note, "r_1");
    }

    #[test]
    fn cut_out_photos_are_recognised() {
        let capture = TestCapture::new(3);
        for (split, n) in [("train", 3), ("test", 4)] {
            for i in 0..n {
                let color = |is_object| if is_object { [9, 99, 199, 255] } else { [0; 4] };
                let photo = image::RgbaImage::from_fn(SIDE, SIDE, |x, y| image::Rgba(color(x > y)));
                let path = capture.path(&format!("{split}/r_{i}.png"));
                photo.save(path).unwrap();
            }
            capture.edit_json(&format!("transforms_{split}.json"), |json| {
                for frame in json["frames"].as_array_mut().unwrap() {
                    frame["mask_path"] = json!(null);
                }
            });
        }
        let dataset = load(&capture).unwrap();
        assert!(!dataset.environment_visible, "environment");
        let mask = dataset.train[0].mask.as_ref().unwrap();
        let object = [1, SIDE as usize].map(|i| mask.is_object(i));
        assert_eq!(object, [true, false], "alpha is the mask");
        assert_eq!(dataset.problems[0].severity, Severity::Note, "it is said");
    }
}
