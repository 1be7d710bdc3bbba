//! Reads a capture: finds its files, decides the splits, decodes the photos in parallel.
//!
//! Splits are those of `transforms_{train,val,test}.json` where these exist. A single
//! `transforms.json` is split by position among its existing photos: every 8th is for testing,
//! and with 16 or more, those 4 after them for validation. Test views never train.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::image::decode;
use super::mesh_io::{find_mesh, read_mesh};
use super::problem::first_names;
use super::{
    DataError, Dataset, Frame, LoadOptions, Mask, Photo, Problem, Severity, View, read_frames,
    read_mask,
};

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
        let (train, val, test) = decode_splits(path, &frames, options, &mut problems)?;
        let (mesh, mesh_path) = load_mesh(&root, options, &mut problems)?;
        let surroundings_visible = !problems.iter().any(|p| p.what.starts_with(CUT_OUT));
        problems.sort_by_key(|problem| problem.severity);
        Ok(Self {
            name: folder_name(&root),
            root,
            train,
            val,
            test,
            mesh,
            mesh_path,
            surroundings_visible,
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

/// Decodes all splits in one parallel pass.
fn decode_splits(
    path: &Path,
    frames: &SplitFrames,
    options: &LoadOptions<'_>,
    problems: &mut Vec<Problem>,
) -> Result<(Vec<View>, Vec<View>, Vec<View>), DataError> {
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
    Ok((train, val, test))
}

fn load_mesh(
    root: &Path,
    options: &LoadOptions<'_>,
    problems: &mut Vec<Problem>,
) -> Result<(Option<Arc<crate::geometry::Mesh>>, Option<PathBuf>), DataError> {
    let Some(path) = options.mesh.clone().or_else(|| find_mesh(root)) else {
        return Ok((None, None));
    };
    match read_mesh(&path) {
        Ok(mesh) => {
            let placed = if options.mesh_placement == super::MeshPlacement::default() {
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

/// How the finding about cut-out photos begins.
const CUT_OUT: &str = "the surroundings are not visible";

/// Views in the order of their frames, `None` where one could not be read.
pub(super) struct LoadedViews {
    pub(super) views: Vec<Option<View>>,
    pub(super) findings: Findings,
}

/// What was noticed while reading views, by kind, with the views' names.
#[derive(Debug, Default)]
pub(super) struct Findings {
    unreadable: Vec<Problem>,
    rescaled: Vec<String>,
    without_mask_file: Vec<String>,
    cut_out: Vec<String>,
    n_views: usize,
}

impl Findings {
    /// One problem a kind.
    pub(super) fn into_problems(self) -> Vec<Problem> {
        let mut problems = self.unreadable;
        let mut add = |severity, names: &[String], what: &str, advice: &str| {
            if !names.is_empty() {
                let what = format!("{what} ({} views: {})", names.len(), first_names(names));
                problems.push(Problem::new(severity, what, advice));
            }
        };
        add(
            Severity::Warning,
            &self.without_mask_file,
            "mask files are missing",
            "these views are used without a mask",
        );
        add(
            Severity::Note,
            &self.rescaled,
            "photos are smaller or larger than w x h",
            "the lens was scaled with them",
        );
        // A few cut-outs among full photos do not make the surroundings unknown.
        if 2 * self.cut_out.len() > self.n_views {
            add(
                Severity::Note,
                &self.cut_out,
                &format!("{CUT_OUT}: the photos are cut out along the object"),
                "light is learned from reflections alone",
            );
        }
        problems
    }
}

/// What one frame gave.
struct LoadedView {
    view: View,
    rescaled: bool,
    mask_file_missing: bool,
    cut_out: bool,
}

/// Reads the frames in parallel, calling `on_done` after each.
pub(super) fn load_views(frames: &[Frame], on_done: &(dyn Fn() + Sync)) -> LoadedViews {
    let results: Vec<Result<LoadedView, DataError>> = frames
        .par_iter()
        .map(|frame| {
            let result = load_view(frame);
            on_done();
            result
        })
        .collect();
    let mut findings = Findings::default();
    let views = results
        .into_iter()
        .map(|result| match result {
            Ok(loaded) => {
                findings.n_views += 1;
                let name = &loaded.view.name;
                let kinds = [
                    (loaded.rescaled, &mut findings.rescaled),
                    (loaded.mask_file_missing, &mut findings.without_mask_file),
                    (loaded.cut_out, &mut findings.cut_out),
                ];
                for (found, names) in kinds {
                    if found {
                        names.push(name.clone());
                    }
                }
                Some(loaded.view)
            }
            Err(e) => {
                let problem = Problem::new(Severity::Error, e.to_string(), "the view is left out");
                findings.unreadable.push(problem);
                None
            }
        })
        .collect();
    LoadedViews { views, findings }
}

fn load_view(frame: &Frame) -> Result<LoadedView, DataError> {
    let decoded = decode(&frame.photo)?;
    let (width, height) = (decoded.photo.width(), decoded.photo.height());
    let (camera, rescaled) = frame.camera(width, height)?;
    let mask_file = frame.mask.as_deref().filter(|path| path.is_file());
    let cut_out = decoded
        .alpha
        .as_ref()
        .is_some_and(|alpha| hides_one_color(&decoded.photo, alpha));
    let mask = match mask_file {
        Some(path) => Some(read_mask_sized(path, width, height)?),
        None => decoded.alpha,
    };
    Ok(LoadedView {
        view: View {
            name: frame.name.clone(),
            camera,
            photo: decoded.photo,
            mask,
        },
        rescaled,
        mask_file_missing: frame.mask.is_some() && mask_file.is_none(),
        cut_out,
    })
}

/// Reads a mask and brings it to the photo's size; errors where the aspect differs.
fn read_mask_sized(path: &Path, width: u32, height: u32) -> Result<Mask, DataError> {
    let mask = read_mask(path)?;
    if (mask.width, mask.height) == (width, height) {
        return Ok(mask);
    }
    let expected = mask.width as f32 * height as f32 / mask.height as f32;
    if (expected - width as f32).abs() > 0.01 * width as f32 + 1.0 {
        let problem = format!(
            "the mask is {} x {}, its photo {width} x {height}",
            mask.width, mask.height
        );
        return Err(DataError::image(path, problem));
    }
    let coverage = image::GrayImage::from_raw(mask.width, mask.height, mask.coverage)
        .map(|mask| image::imageops::resize(&mask, width, height, image::imageops::Triangle))
        .ok_or_else(|| DataError::image(path, "the mask is incomplete"))?
        .into_raw();
    Ok(Mask {
        width,
        height,
        coverage,
    })
}

/// Whether all fully transparent pixels have one colour, that is, hold no photo.
fn hides_one_color(photo: &Photo, alpha: &Mask) -> bool {
    let mut hidden = (0..photo.n_pixels())
        .filter(|i| alpha.coverage[*i] == 0)
        .map(|i| photo.srgb(i));
    match hidden.next() {
        Some(first) => hidden.all(|color| color == first),
        None => false,
    }
}
