//! Folders of photos as the formats lay them out, and masks that belong to photos.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::data::files::capture_path::{PICTURE_EXTENSIONS, is_picture, trailing_number};
use crate::data::{DataError, Frame, Problem, Severity};

/// Names of folders of photos in full size, in the order in which they are tried.
const PHOTO_FOLDERS: [&str; 6] = ["images", "image", "rgb", "photos", "imgs", "color"];
/// Names of folders of masks.
const MASK_FOLDERS: [&str; 5] = [
    "masks",
    "mask",
    "object_masks",
    "object_mask",
    "silhouettes",
];
/// Most files looked at in a folder: a capture of 10,000 photos passes, a whole disk does not.
const MAX_FILES: usize = 200_000;

/// The folders below `root` that hold photos: full size first, then scaled copies (`images_4`),
/// the largest first.
pub(super) fn photo_folders(root: &Path) -> Vec<PathBuf> {
    let full = PHOTO_FOLDERS.iter().map(|name| root.join(name));
    let mut folders: Vec<PathBuf> = full.filter(|folder| folder.is_dir()).collect();
    let mut scaled: Vec<(u32, PathBuf)> = root
        .read_dir()
        .into_iter()
        .flatten()
        .take(MAX_FILES)
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let factor = path.file_name()?.to_str()?.strip_prefix("images_")?;
            let factor = factor.parse().ok()?;
            path.is_dir().then_some((factor, path))
        })
        .collect();
    scaled.sort();
    folders.extend(scaled.into_iter().map(|(_, folder)| folder));
    folders
}

/// The pictures in a folder, sorted by name; hidden files are passed over.
pub(super) fn list_pictures(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let io = |e| DataError::io(folder, e);
    let mut pictures = Vec::new();
    for (i, entry) in folder.read_dir().map_err(io)?.enumerate() {
        if i == MAX_FILES {
            let problem = format!("more than {MAX_FILES} files in the folder");
            return Err(DataError::image(folder, problem));
        }
        let path = entry.map_err(io)?.path();
        let is_hidden = path
            .file_name()
            .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if !is_hidden && is_picture(&path) && path.is_file() {
            pictures.push(path);
        }
    }
    pictures.sort();
    Ok(pictures)
}

/// Photos for cameras that are known by their position only.
///
/// Equal counts are matched in the order of names, which is how such formats are read elsewhere.
/// Otherwise the number in the name is the position, where every name has one; positions without
/// a photo get `None`.
pub(super) fn match_by_position(photos: &[PathBuf], n: usize) -> Option<Vec<Option<PathBuf>>> {
    if photos.len() == n {
        return Some(photos.iter().cloned().map(Some).collect());
    }
    let numbers: Option<Vec<u64>> = photos.iter().map(|photo| trailing_number(photo)).collect();
    let mut by_number: HashMap<u64, &PathBuf> = HashMap::new();
    for (number, photo) in numbers?.into_iter().zip(photos) {
        if number >= n as u64 || by_number.insert(number, photo).is_some() {
            return None;
        }
    }
    Some(
        (0..n as u64)
            .map(|i| by_number.get(&i).map(|photo| (*photo).clone()))
            .collect(),
    )
}

/// Gives frames without a mask the one from the capture's folder of masks, if it has one.
///
/// A mask belongs to the photo with the same name (`a.png`, `a.jpg.png`, `a_mask.png`), else to
/// that with the same number at the end, else, where there are as many masks as photos, to that
/// at the same position in the order of names.
pub(super) fn assign_masks(root: &Path, frames: &mut [Frame], problems: &mut Vec<Problem>) {
    let folders = MASK_FOLDERS.iter().map(|name| root.join(name));
    let Some(folder) = folders.into_iter().find(|folder| folder.is_dir()) else {
        return;
    };
    if frames.iter().any(|frame| frame.mask.is_some()) {
        return;
    }
    for frame in frames.iter_mut() {
        frame.mask = mask_by_name(&folder, &frame.photo);
    }
    let n_named = frames.iter().filter(|frame| frame.mask.is_some()).count();
    if n_named > 0 {
        return;
    }
    let masks = match list_pictures(&folder) {
        Ok(masks) => masks,
        Err(e) => {
            let advice = "the capture is used without masks";
            problems.push(Problem::new(Severity::Warning, e.to_string(), advice));
            return;
        }
    };
    let how = if assign_by_number(&masks, frames) {
        "by number"
    } else if masks.len() == frames.len() {
        for (frame, mask) in frames.iter_mut().zip(masks) {
            frame.mask = Some(mask);
        }
        "by order"
    } else {
        let what = format!(
            "{} masks, {} photos, and their names do not show which belong together",
            masks.len(),
            frames.len()
        );
        let advice = "name each mask as its photo; the capture is used without masks";
        problems.push(Problem::new(Severity::Warning, what, advice).in_file(folder));
        return;
    };
    let what = format!("masks are named otherwise than photos: paired {how}");
    problems.push(Problem::new(Severity::Note, what, "").in_file(folder));
}

fn mask_by_name(folder: &Path, photo: &Path) -> Option<PathBuf> {
    let (stem, name) = (photo.file_stem()?, photo.file_name()?);
    // Photos of rigs lie in folders of their own: masks/left/0001.png for images/left/0001.jpg.
    let inner = photo.parent().and_then(Path::file_name);
    let folders = inner.into_iter().map(|inner| folder.join(inner));
    let folders: Vec<PathBuf> = folders.chain([folder.to_owned()]).collect();
    let names = [(stem, ""), (name, ""), (stem, "_mask"), (stem, ".mask")];
    folders
        .iter()
        .flat_map(|folder| names.iter().map(move |name| (folder, name)))
        .find_map(|(folder, (base, ending))| {
            PICTURE_EXTENSIONS.iter().find_map(|extension| {
                let mut name = OsString::from(base);
                name.push(ending);
                name.push(".");
                name.push(extension);
                let path = folder.join(name);
                path.is_file().then_some(path)
            })
        })
}

/// Whether all masks and photos have numbers of their own; then they are paired by them.
fn assign_by_number(masks: &[PathBuf], frames: &mut [Frame]) -> bool {
    let mut by_number: HashMap<u64, &PathBuf> = HashMap::new();
    for mask in masks {
        let Some(number) = trailing_number(mask) else {
            return false;
        };
        if by_number.insert(number, mask).is_some() {
            return false;
        }
    }
    let numbers: Option<Vec<u64>> = frames
        .iter()
        .map(|frame| trailing_number(&frame.photo))
        .collect();
    let Some(numbers) = numbers else {
        return false;
    };
    let mut sorted = numbers.clone();
    sorted.sort_unstable();
    sorted.dedup();
    // Numbers that run alike but start apart would pair all but one, and all wrongly.
    let n_paired = sorted.iter().filter(|n| by_number.contains_key(n)).count();
    if sorted.len() < numbers.len() || n_paired < masks.len().min(frames.len()) {
        return false;
    }
    for (frame, number) in frames.iter_mut().zip(numbers) {
        frame.mask = by_number.get(&number).map(|mask| (*mask).clone());
    }
    true
}
