//! Which photos train, validate and test.
//!
//! Splits are those of `transforms_{train,val,test}.json` where these exist, or of nerfstudio's
//! lists of file names, or of `train.txt`, `val.txt` and `test.txt` with a photo's name a line.
//! Anything else is split by position among its existing photos: every 8th is for testing, and
//! with 16 or more, those 4 after them for validation. [`CaptureChoices`] overrule all of it. Test
//! views never train.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::transforms_json::read_value;
use crate::data::files::capture_path::{first_file, read_text};
use crate::data::problem::first_names;
use crate::data::{CaptureChoices, DataError, Frame, Problem, Severity, read_frames};

/// Every how many-th photo is for testing where nothing says so.
const TEST_EVERY: usize = 8;
/// Fewest photos in a single `transforms.json` for any to be set aside for testing.
const MIN_PHOTOS_FOR_TEST: usize = 8;
/// Fewest for some to be set aside for validation too.
const MIN_PHOTOS_FOR_VAL: usize = 16;
/// Fewest training views, where no validation file exists, for some to be set aside.
const MIN_TRAIN_FOR_VAL: usize = 20;

/// The longest list of names that is read.
const MAX_LIST_BYTES: u64 = 16 << 20;

/// The listed frames by split.
#[derive(Clone, Debug, Default)]
pub struct SplitFrames {
    /// Photos to learn from.
    pub train: Vec<Frame>,
    /// Photos for early stopping and choosing settings.
    pub val: Vec<Frame>,
    /// Photos for the final measure only.
    pub test: Vec<Frame>,
    /// Why they are split so, for people.
    pub rule: String,
}

/// The file of the transforms family in a folder.
pub(super) fn find_transforms(root: &Path) -> Option<PathBuf> {
    first_file(root, &["transforms_train.json", "transforms.json"])
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
        Some(lists) => split_by_lists(&lists, frames),
        None => split_listed(root, frames),
    };
    Ok((name.into_owned(), frames))
}

/// Which photos a capture itself assigns to splits, by name.
#[derive(Debug, Default)]
struct SplitLists {
    /// Where the lists stand, for people.
    source: String,
    train: Option<HashSet<String>>,
    val: Option<HashSet<String>>,
    test: Option<HashSet<String>>,
}

impl SplitLists {
    /// Whether a photo is for validation or testing.
    fn hold_out(&self, frame: &Frame) -> bool {
        is_in(self.val.as_ref(), frame) || is_in(self.test.as_ref(), frame)
    }

    fn new(source: &str, list: impl Fn(&str) -> Option<HashSet<String>>) -> Self {
        Self {
            source: source.to_owned(),
            train: list("train"),
            val: list("val"),
            test: list("test"),
        }
    }

    /// The lists in `train.txt`, `val.txt` and `test.txt`.
    fn in_text_files(root: &Path) -> Self {
        Self::new("train.txt, val.txt and test.txt", |split| {
            let file = root.join(format!("{split}.txt"));
            let text = read_text(&file, MAX_LIST_BYTES).ok()?;
            Some(text.lines().map(photo_key).collect())
        })
    }
}

/// Splits by the lists beside the photos, else by position.
pub(super) fn split_listed(root: &Path, frames: Vec<Frame>) -> SplitFrames {
    split_by_lists(&SplitLists::in_text_files(root), frames)
}

/// Splits anew where a person chose so.
///
/// Errors when the chosen lists name no photo for validation or testing.
pub(super) fn split_as_chosen(
    choices: &CaptureChoices,
    listed: SplitFrames,
) -> Result<SplitFrames, DataError> {
    if choices.test_every.is_none() && choices.split_lists.is_none() {
        return Ok(listed);
    }
    let mut frames = [listed.train, listed.val, listed.test].concat();
    // Back into the order of the files that list them; several files stay one after the other.
    let mut files: Vec<PathBuf> = Vec::new();
    for frame in &frames {
        if !files.contains(&frame.listed_in) {
            files.push(frame.listed_in.clone());
        }
    }
    frames.sort_by_key(|frame| {
        let file = files.iter().position(|file| *file == frame.listed_in);
        (file, frame.index)
    });
    if let Some(folder) = &choices.split_lists {
        let lists = SplitLists {
            source: format!("the lists in {}", folder.display()),
            ..SplitLists::in_text_files(folder)
        };
        if !frames.iter().any(|frame| lists.hold_out(frame)) {
            let problem = "no val.txt or test.txt there names a photo of the capture";
            return Err(DataError::no_capture(folder, problem));
        }
        return Ok(split_by_lists(&lists, frames));
    }
    let every = choices.test_every.map_or(TEST_EVERY, |n| n as usize);
    Ok(split_every(every, "as chosen", 1, frames))
}

/// Splits by lists that name at least one photo for validation or testing, else by position.
fn split_by_lists(lists: &SplitLists, frames: Vec<Frame>) -> SplitFrames {
    if !frames.iter().any(|frame| lists.hold_out(frame)) {
        return split_every(TEST_EVERY, "no split files", MIN_PHOTOS_FOR_TEST, frames);
    }
    let mut split = SplitFrames::default();
    let mut n_left_out = 0;
    for frame in frames {
        if is_in(lists.test.as_ref(), &frame) {
            split.test.push(frame);
        } else if is_in(lists.val.as_ref(), &frame) {
            split.val.push(frame);
        } else if lists.train.is_none() || is_in(lists.train.as_ref(), &frame) {
            split.train.push(frame);
        } else {
            n_left_out += 1;
        }
    }
    split.rule = match n_left_out {
        0 => format!("by {}", lists.source),
        n => format!(
            "by {}; {n} photos are in no list and left out",
            lists.source
        ),
    };
    split
}

fn is_in(names: Option<&HashSet<String>>, frame: &Frame) -> bool {
    names.is_some_and(|names| names_photo(names, &frame.photo))
}

/// What a photo is called in lists: its path without extension, folders parted by slashes.
fn photo_key(path: &str) -> String {
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
        let frames = json.is_file().then(|| read_frames(&json)).transpose()?;
        Ok::<_, DataError>(frames.map(|frames| keep_existing(frames, problems)))
    };
    let (train, val, test) = (read("train")?, read("val")?, read("test")?);
    let mut split = SplitFrames {
        train: train.unwrap_or_default(),
        val: Vec::new(),
        test: test.unwrap_or_default(),
        rule: String::new(),
    };
    let mut rule = "by transforms_train.json, _val and _test";
    if let Some(val) = val {
        split.val = val;
    } else if split.train.len() >= MIN_TRAIN_FOR_VAL {
        for (i, frame) in std::mem::take(&mut split.train).into_iter().enumerate() {
            let validates = i % 10 == 9;
            let part = if validates {
                &mut split.val
            } else {
                &mut split.train
            };
            part.push(frame);
        }
        rule = "by transforms_train.json and _test; there is no transforms_val.json, so every 10th training photo \
                validates";
    }
    Ok(SplitFrames {
        rule: rule.to_owned(),
        ..split
    })
}

/// Splits frames by position: every `every`-th tests (0 for none) where there are `at_least` photos, and where there
/// are enough, others validate. `why` explains the rule.
fn split_every(every: usize, why: &str, at_least: usize, frames: Vec<Frame>) -> SplitFrames {
    let n = frames.len();
    let period = every.max(TEST_EVERY);
    // Halfway between tests, but beside them where they are closer.
    let at = if every == period { period / 2 } else { 1 };
    let mut split = SplitFrames::default();
    for (i, frame) in frames.into_iter().enumerate() {
        if every > 0 && n >= at_least && i % every == 0 {
            split.test.push(frame);
        } else if n >= MIN_PHOTOS_FOR_VAL && i % period == at {
            split.val.push(frame);
        } else {
            split.train.push(frame);
        }
    }
    let one_in = |n: usize, is_none: bool| {
        if is_none {
            "none".to_owned()
        } else {
            format!("one photo in {n}")
        }
    };
    let tests = one_in(every, split.test.is_empty());
    let validates = one_in(period, split.val.is_empty());
    split.rule = format!("by position ({why}): {tests} tests, {validates} validates");
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

/// nerfstudio's `train_filenames`, `val_filenames` and `test_filenames`, where a file has them.
fn split_lists(json: &Path) -> Result<Option<SplitLists>, DataError> {
    let value = read_value(json)?;
    let lists = SplitLists::new("the file's own lists", |split| {
        let names = value.get(format!("{split}_filenames"))?.as_array()?;
        let names = names.iter().filter_map(Value::as_str);
        Some(names.map(photo_key).collect())
    });
    Ok((lists.val.is_some() || lists.test.is_some()).then_some(lists))
}
