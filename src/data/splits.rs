//! Which photos train, validate and test.
//!
//! Splits are those of `transforms_{train,val,test}.json` where these exist, or of nerfstudio's
//! lists of file names, or of `train.txt`, `val.txt` and `test.txt` with a photo's name a line.
//! Anything else is split by position among its existing photos: every 8th is for testing, and
//! with 16 or more, those 4 after them for validation. Test views never train.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::problem::first_names;
use super::transforms_json::split_lists;
use super::{DataError, Frame, Problem, Severity, read_frames};

/// Fewest photos in a single `transforms.json` for any to be set aside for testing.
const MIN_PHOTOS_FOR_TEST: usize = 8;
/// Fewest for some to be set aside for validation too.
const MIN_PHOTOS_FOR_VAL: usize = 16;
/// Fewest training views, where no validation file exists, for some to be set aside.
const MIN_TRAIN_FOR_VAL: usize = 20;

/// The longest list of names that is read.
const MAX_LIST_BYTES: u64 = 16 << 20;

/// The listed frames by split.
#[derive(Debug, Default)]
pub(super) struct SplitFrames {
    pub(super) train: Vec<Frame>,
    pub(super) val: Vec<Frame>,
    pub(super) test: Vec<Frame>,
}

/// The file of the transforms family in a folder.
pub(super) fn find_transforms(root: &Path) -> Option<PathBuf> {
    ["transforms_train.json", "transforms.json"]
        .iter()
        .map(|name| root.join(name))
        .find(|json| json.is_file())
}

/// What `json` and the files of the other splits beside it list, and what they are, for people.
pub(super) fn read_transforms(
    root: &Path,
    json: &Path,
    problems: &mut Vec<Problem>,
) -> Result<(String, SplitFrames), DataError> {
    let split_file = |split: &str| root.join(format!("transforms_{split}.json"));
    let names_a_split = ["train", "val", "test"]
        .iter()
        .any(|split| json == split_file(split));
    if names_a_split && split_file("train").is_file() {
        let frames = read_split_files(&split_file, problems)?;
        return Ok(("transforms_{train,val,test}.json".to_owned(), frames));
    }
    let name = json.file_name().unwrap_or_default().to_string_lossy();
    let frames = keep_existing(read_frames(json)?, problems);
    let frames = match split_lists(json)? {
        Some(lists) => split_by_lists(&lists, frames, problems),
        None => split_listed(root, frames, problems),
    };
    Ok((name.into_owned(), frames))
}

/// Which photos a capture itself assigns to splits, by name.
#[derive(Debug, Default)]
pub(super) struct SplitLists {
    /// Where the lists stand, for people.
    pub(super) source: &'static str,
    pub(super) train: Option<HashSet<String>>,
    pub(super) val: Option<HashSet<String>>,
    pub(super) test: Option<HashSet<String>>,
}

impl SplitLists {
    /// The lists in `train.txt`, `val.txt` and `test.txt`.
    fn in_text_files(root: &Path) -> Self {
        let list = |name: &str| {
            let path = root.join(name);
            if path.metadata().ok()?.len() > MAX_LIST_BYTES {
                return None;
            }
            let text = std::fs::read_to_string(path).ok()?;
            Some(text.lines().map(photo_key).collect())
        };
        Self {
            source: "train.txt, val.txt and test.txt",
            train: list("train.txt"),
            val: list("val.txt"),
            test: list("test.txt"),
        }
    }
}

/// Splits by the lists beside the photos, else by position.
pub(super) fn split_listed(
    root: &Path,
    frames: Vec<Frame>,
    problems: &mut Vec<Problem>,
) -> SplitFrames {
    split_by_lists(&SplitLists::in_text_files(root), frames, problems)
}

/// Splits by lists that name at least one photo for validation or testing, else by position.
fn split_by_lists(
    lists: &SplitLists,
    frames: Vec<Frame>,
    problems: &mut Vec<Problem>,
) -> SplitFrames {
    let is_in = |names: &Option<HashSet<String>>, frame: &Frame| {
        names
            .as_ref()
            .is_some_and(|names| names_photo(names, &frame.photo))
    };
    let is_held_out = |frame: &Frame| is_in(&lists.val, frame) || is_in(&lists.test, frame);
    if !frames.iter().any(is_held_out) {
        return split_by_position(frames, problems);
    }
    let mut split = SplitFrames::default();
    let mut n_left_out = 0;
    for frame in frames {
        if is_in(&lists.test, &frame) {
            split.test.push(frame);
        } else if is_in(&lists.val, &frame) {
            split.val.push(frame);
        } else if lists.train.is_none() || is_in(&lists.train, &frame) {
            split.train.push(frame);
        } else {
            n_left_out += 1;
        }
    }
    let what = format!(
        "split by {}: {} train, {} validate, {} test, {n_left_out} in no list",
        lists.source,
        split.train.len(),
        split.val.len(),
        split.test.len()
    );
    problems.push(Problem::new(Severity::Note, what, ""));
    split
}

/// What a photo is called in lists: its path without extension, folders parted by slashes.
pub(super) fn photo_key(path: &str) -> String {
    let portable = path.trim().replace('\\', "/");
    let path = portable.trim_start_matches("./");
    let name_at = path.rfind('/').map_or(0, |slash| slash + 1);
    let end = path[name_at..]
        .rfind('.')
        .map_or(path.len(), |dot| name_at + dot);
    path[..end].to_owned()
}

/// Whether a list names a photo: by its file name, or with some of the folders that it lies in.
fn names_photo(names: &HashSet<String>, photo: &Path) -> bool {
    let key = photo_key(&photo.to_string_lossy());
    let starts = key.match_indices('/').map(|(slash, _)| slash + 1);
    starts.chain([0]).any(|start| names.contains(&key[start..]))
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

/// Splits frames by position; see the module's header.
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
pub(super) fn keep_existing(frames: Vec<Frame>, problems: &mut Vec<Problem>) -> Vec<Frame> {
    let n_listed = frames.len();
    let Some(json) = frames.first().map(|frame| frame.listed_in.clone()) else {
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
