//! Reads a capture: finds its files, decides the splits, decodes the photos in parallel.
//!
//! Splits are those of `transforms_{train,val,test}.json` where these exist. A single
//! `transforms.json` is split by position among its existing photos: every 8th is for testing,
//! and with 16 or more, those 4 after them for validation. Test views never train.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::mesh_io::{find_mesh, read_mesh};
use super::problem::first_names;
use super::views::load_views;
use super::{
    DataError, Dataset, Frame, LoadOptions, MeshPlacement, Problem, Severity, View, read_frames,
};
use crate::geometry::Mesh;

/// Fewest photos in a single `transforms.json` for any to be set aside for testing.
const MIN_PHOTOS_FOR_TEST: usize = 8;
/// Fewest for some to be set aside for validation too.
const MIN_PHOTOS_FOR_VAL: usize = 16;
/// Fewest training views, where no validation file exists, for some to be set aside.
const MIN_TRAIN_FOR_VAL: usize = 20;

impl Dataset {
    /// Reads the capture at `path`: a folder, or a `transforms*.json` in one.
    ///
    /// Views that cannot be read are left out and reported in [`Dataset::problems`]. Errors when
    /// there is no capture, its JSON is wrong, no view is left, or a mesh that was asked for by
    /// name cannot be read. Decoding runs on the current rayon pool.
    pub fn load(path: &Path, options: &LoadOptions<'_>) -> Result<Self, DataError> {
        let mut problems = Vec::new();
        let (root, mut frames) = find_frames(path, &mut problems)?;
        if !options.splits.train {
            frames.train.clear();
        }
        if !options.splits.val {
            frames.val.clear();
        }
        if !options.splits.test {
            frames.test.clear();
        }
        let decoded = decode_splits(path, &frames, options, &mut problems)?;
        let (mesh, mesh_path) = load_mesh(&root, options, &mut problems)?;
        problems.sort_by_key(|problem| problem.severity);
        Ok(Self {
            name: folder_name(&root),
            root,
            train: decoded.train,
            val: decoded.val,
            test: decoded.test,
            mesh,
            mesh_path,
            surroundings_visible: decoded.surroundings_visible,
            problems,
        })
    }
}

/// The listed frames by split.
#[derive(Debug, Default)]
struct SplitFrames {
    train: Vec<Frame>,
    val: Vec<Frame>,
    test: Vec<Frame>,
}

/// The capture's root folder and its frames.
fn find_frames(
    path: &Path,
    problems: &mut Vec<Problem>,
) -> Result<(PathBuf, SplitFrames), DataError> {
    let is_json = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if !path.exists() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        return Err(DataError::io(path, missing));
    }
    if path.is_file() && !is_json {
        return Err(DataError::NotADataset {
            path: path.to_owned(),
            problem: "expected a folder or a transforms.json".to_owned(),
        });
    }
    let root = if is_json {
        path.parent().unwrap_or_else(|| Path::new("")).to_owned()
    } else {
        path.to_owned()
    };
    let split_file = |split: &str| root.join(format!("transforms_{split}.json"));
    let names_a_split = ["train", "val", "test"]
        .iter()
        .any(|s| path == split_file(s));
    if (names_a_split || !is_json) && split_file("train").is_file() {
        let frames = read_split_files(&split_file, problems)?;
        return Ok((root, frames));
    }
    let single = if is_json {
        path.to_owned()
    } else {
        root.join("transforms.json")
    };
    if !single.is_file() {
        return Err(DataError::NotADataset {
            path: path.to_owned(),
            problem: "neither transforms_train.json nor transforms.json is in it".to_owned(),
        });
    }
    let frames = split_by_position(keep_existing(read_frames(&single)?, problems), problems);
    Ok((root, frames))
}

fn read_split_files(
    split_file: &dyn Fn(&str) -> PathBuf,
    problems: &mut Vec<Problem>,
) -> Result<SplitFrames, DataError> {
    let mut read = |split: &str| {
        let json = split_file(split);
        if json.is_file() {
            Ok(Some(keep_existing(read_frames(&json)?, problems)))
        } else {
            Ok::<_, DataError>(None)
        }
    };
    let mut train = read("train")?.unwrap_or_default();
    let val = read("val")?;
    let test = read("test")?.unwrap_or_default();
    let val = val.unwrap_or_else(|| {
        if train.len() < MIN_TRAIN_FOR_VAL {
            return Vec::new();
        }
        let (val, rest) = std::mem::take(&mut train)
            .into_iter()
            .enumerate()
            .partition::<Vec<_>, _>(|(i, _)| i % 10 == 9);
        train = without_index(rest);
        let what = format!(
            "no transforms_val.json: every 10th training view ({}) is kept for validation",
            val.len()
        );
        problems.push(Problem::new(Severity::Note, what, ""));
        without_index(val)
    });
    Ok(SplitFrames { train, val, test })
}

fn without_index(frames: Vec<(usize, Frame)>) -> Vec<Frame> {
    frames.into_iter().map(|(_, frame)| frame).collect()
}

/// Splits the frames of a single file by position; see the module's header.
fn split_by_position(frames: Vec<Frame>, problems: &mut Vec<Problem>) -> SplitFrames {
    let n = frames.len();
    let mut split = SplitFrames::default();
    for (i, frame) in frames.into_iter().enumerate() {
        if n >= MIN_PHOTOS_FOR_TEST && i % 8 == 0 {
            split.test.push(frame);
        } else if n >= MIN_PHOTOS_FOR_VAL && i % 8 == 4 {
            split.val.push(frame);
        } else {
            split.train.push(frame);
        }
    }
    let what = format!(
        "no split files: of {n} photos {} train, {} validate, {} test (by position, every 8th)",
        split.train.len(),
        split.val.len(),
        split.test.len()
    );
    problems.push(Problem::new(Severity::Note, what, ""));
    split
}

/// The frames whose photo exists; the others become one problem.
fn keep_existing(frames: Vec<Frame>, problems: &mut Vec<Problem>) -> Vec<Frame> {
    let n_listed = frames.len();
    let Some(json) = frames.first().map(|frame| frame.json.clone()) else {
        return frames;
    };
    let (existing, missing): (Vec<_>, Vec<_>) =
        frames.into_iter().partition(|frame| frame.photo.is_file());
    if !missing.is_empty() {
        let names: Vec<String> = missing
            .iter()
            .map(|frame| frame.photo.display().to_string())
            .collect();
        let what = format!(
            "{} of {n_listed} listed photos are missing: {}",
            missing.len(),
            first_names(&names)
        );
        let advice = "they are left out; restore the files or remove the frames";
        problems.push(Problem::new(Severity::Warning, what, advice).in_file(json));
    }
    existing
}

/// The views by split.
struct Decoded {
    train: Vec<View>,
    val: Vec<View>,
    test: Vec<View>,
    surroundings_visible: bool,
}

/// Decodes all splits in one parallel pass.
fn decode_splits(
    path: &Path,
    frames: &SplitFrames,
    options: &LoadOptions<'_>,
    problems: &mut Vec<Problem>,
) -> Result<Decoded, DataError> {
    let (n_train, n_val) = (frames.train.len(), frames.val.len());
    let all: Vec<Frame> = [&frames.train, &frames.val, &frames.test]
        .into_iter()
        .flatten()
        .cloned()
        .collect();
    let n_done = AtomicUsize::new(0);
    let loaded = load_views(&all, &|| {
        let done = n_done.fetch_add(1, Ordering::Relaxed) + 1;
        (options.on_progress)(done, all.len());
    });
    let surroundings_visible = !loaded.findings.are_cut_out();
    problems.extend(loaded.findings.into_problems());
    let mut views = loaded.views;
    let test: Vec<View> = views
        .split_off(n_train + n_val)
        .into_iter()
        .flatten()
        .collect();
    let val: Vec<View> = views.split_off(n_train).into_iter().flatten().collect();
    let train: Vec<View> = views.into_iter().flatten().collect();
    let nothing_to_learn_from = options.splits.train && train.is_empty();
    if nothing_to_learn_from || (train.is_empty() && val.is_empty() && test.is_empty()) {
        return Err(DataError::NoViews {
            path: path.to_owned(),
            problems: std::mem::take(problems),
        });
    }
    Ok(Decoded {
        train,
        val,
        test,
        surroundings_visible,
    })
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

fn folder_name(root: &Path) -> String {
    let absolute = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    absolute.file_name().map_or_else(
        || "capture".to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::test_capture::{SIDE, TestCapture};
    use super::super::{Splits, write_png_srgb};
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
        assert_eq!(
            (dataset.train.len(), dataset.val.len(), dataset.test.len()),
            (12, 0, 4),
            "splits"
        );
        assert_eq!(n_calls.into_inner(), 16, "progress");
        assert!(
            dataset.mesh.is_some() && dataset.surroundings_visible,
            "mesh, surroundings"
        );
        assert!(dataset.problems.is_empty(), "{:?}", dataset.problems);
        assert!(
            dataset.train.iter().all(|view| view.mask.is_some()),
            "masks"
        );
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
        assert!(
            dataset.problems[0].what.contains("transforms_val.json"),
            "it is said"
        );
    }

    #[test]
    fn a_single_file_is_split_by_position_whatever_is_loaded() {
        let capture = TestCapture::new(20);
        std::fs::rename(
            capture.path("transforms_train.json"),
            capture.path("transforms.json"),
        )
        .unwrap();
        std::fs::remove_file(capture.path("transforms_test.json")).unwrap();
        let dataset = load(&capture).unwrap();
        assert_eq!(names(&dataset.test), ["r_0", "r_8", "r_16"], "test");
        assert_eq!(names(&dataset.val), ["r_4", "r_12"], "validation");
        let by_file =
            Dataset::load(&capture.path("transforms.json"), &LoadOptions::default()).unwrap();
        assert_eq!(
            names(&by_file.train),
            names(&dataset.train),
            "by file as by folder"
        );
    }

    #[test]
    fn a_single_photo_trains() {
        let capture = TestCapture::new(1);
        std::fs::rename(
            capture.path("transforms_train.json"),
            capture.path("transforms.json"),
        )
        .unwrap();
        let dataset = load(&capture).unwrap();
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
        assert!(
            text[0].starts_with("error") && text[0].contains("r_8.png"),
            "{text:?}"
        );
        assert!(
            text[1].contains("4 of 12") && text[1].contains("and 1 more"),
            "{text:?}"
        );
        assert!(
            text[2].contains("mask files are missing (1 views: r_9)"),
            "{text:?}"
        );
    }

    #[test]
    fn photos_and_masks_of_the_wrong_size_are_left_out_by_name() {
        let capture = TestCapture::new(4);
        let strip = vec![[0.5; 3]; SIDE as usize * 8];
        write_png_srgb(&capture.path("train/r_1.png"), SIDE, 8, &strip).unwrap();
        write_png_srgb(&capture.path("train_mask/r_2.png"), SIDE, 8, &strip).unwrap();
        let dataset = load(&capture).unwrap();
        assert_eq!(names(&dataset.train), ["r_0", "r_3"], "what is left");
        assert!(
            dataset.problems[0]
                .what
                .contains("32 x 8, but w x h is 32 x 32"),
            "photo"
        );
        assert!(
            dataset.problems[1].what.contains("the mask is 32 x 8"),
            "mask"
        );
    }

    #[test]
    fn nothing_usable_is_an_error_that_says_why() {
        let capture = TestCapture::new(2);
        for i in 0..2 {
            std::fs::write(capture.path(&format!("train/r_{i}.png")), b"").unwrap();
        }
        let message = load(&capture).unwrap_err().to_string();
        assert!(
            message.contains("no usable view") && message.contains("r_1.png"),
            "{message}"
        );
        let empty = tempfile::tempdir().unwrap();
        let message = Dataset::load(empty.path(), &LoadOptions::default()).unwrap_err();
        assert!(
            matches!(message, DataError::NotADataset { .. }),
            "{message}"
        );
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
        assert!(matches!(named, Err(DataError::Mesh { .. })), "{named:?}");
    }

    #[test]
    fn cut_out_photos_are_recognised() {
        let capture = TestCapture::new(3);
        for (split, n) in [("train", 3), ("test", 4)] {
            for i in 0..n {
                let photo = image::RgbaImage::from_fn(SIDE, SIDE, |x, y| {
                    if x > y {
                        image::Rgba([9, 99, 199, 255])
                    } else {
                        image::Rgba([0; 4])
                    }
                });
                photo
                    .save(capture.path(&format!("{split}/r_{i}.png")))
                    .unwrap();
            }
            capture.edit_json(&format!("transforms_{split}.json"), |json| {
                for frame in json["frames"].as_array_mut().unwrap() {
                    frame["mask_path"] = json!(null);
                }
            });
        }
        let dataset = load(&capture).unwrap();
        assert!(!dataset.surroundings_visible, "surroundings");
        let mask = dataset.train[0].mask.as_ref().unwrap();
        assert!(
            mask.is_object(1) && !mask.is_object(SIDE as usize),
            "alpha is the mask"
        );
        assert_eq!(dataset.problems[0].severity, Severity::Note, "it is said");
    }
}
