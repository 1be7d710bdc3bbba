//! Folders of photos as the formats lay them out, and masks that belong to photos.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::data::files::capture_path::{
    PICTURE_EXTENSIONS, first_extended, first_folder, is_picture, list_folder, trailing_number,
};
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

/// The folders below `root` that hold photos: full size first, then scaled copies (`images_4`),
/// the largest first.
pub(super) fn photo_folders(root: &Path) -> Vec<PathBuf> {
    let full = PHOTO_FOLDERS.iter().map(|name| root.join(name));
    let mut folders: Vec<PathBuf> = full.filter(|folder| folder.is_dir()).collect();
    let factor = |path: &Path| {
        let factor = path.file_name()?.to_str()?.strip_prefix("images_")?;
        factor.parse::<u32>().ok()
    };
    let scaled = list_folder(root, |path| factor(path).is_some() && path.is_dir());
    let mut scaled = scaled.unwrap_or_default();
    scaled.sort_by_key(|path| factor(path));
    folders.extend(scaled);
    folders
}

/// The folder `preferred` of photos, else the first of the usual ones. `there`: what else was found, for the error.
pub(super) fn photo_folder(
    root: &Path,
    preferred: &str,
    there: &str,
) -> Result<PathBuf, DataError> {
    let usual = || photo_folders(root).into_iter().next();
    let found = first_folder(root, &[preferred]).or_else(usual);
    found.ok_or_else(|| {
        let problem = format!("{there} there, but no folder {preferred}/ or images/ with photos");
        DataError::no_capture(root, problem)
    })
}

/// The pictures in a folder, sorted by name; hidden files are passed over.
pub(super) fn list_pictures(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    list_folder(folder, |path| {
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        !name.starts_with(b".") && is_picture(path) && path.is_file()
    })
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
    let by_number = by_number(photos)?;
    if by_number.keys().any(|number| *number >= n as u64) {
        return None;
    }
    let photo = |i| by_number.get(&i).map(|photo| photo.to_path_buf());
    Some((0..n as u64).map(photo).collect())
}

/// Files by the numbers in their names, where each has one of its own.
fn by_number(files: &[PathBuf]) -> Option<HashMap<u64, &Path>> {
    let mut by_number = HashMap::new();
    for file in files {
        if by_number
            .insert(trailing_number(file)?, file.as_path())
            .is_some()
        {
            return None;
        }
    }
    Some(by_number)
}

/// Gives frames without a mask the one from the capture's folder of masks, if it has one.
///
/// A mask belongs to the photo with the same name (`a.png`, `a.jpg.png`, `a_mask.png`), else to
/// that with the same number at the end, else, where there are as many masks as photos, to that
/// at the same position in the order of names.
pub(super) fn assign_masks(root: &Path, frames: &mut [Frame], problems: &mut Vec<Problem>) {
    let Some(folder) = first_folder(root, &MASK_FOLDERS) else {
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
    let how = if assign_by_number(&masks, frames).is_some() {
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

/// Gives frames the masks of a folder that are named as their photos, and no others.
///
/// # Errors
/// When no photo has one there.
pub(super) fn assign_masks_of<'a>(
    folder: &Path,
    frames: impl Iterator<Item = &'a mut Frame>,
) -> Result<(), DataError> {
    let mut n_found = 0;
    for frame in frames {
        frame.mask = mask_by_name(folder, &frame.photo);
        n_found += usize::from(frame.mask.is_some());
    }
    if n_found > 0 {
        return Ok(());
    }
    let problem = "no mask in this folder is named as a photo";
    Err(DataError::unusable(folder, problem))
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
            let mut name = OsString::from(base);
            name.push(ending);
            first_extended(&folder.join(name), &PICTURE_EXTENSIONS)
        })
}

/// Pairs masks and photos by their numbers, where all have one of their own.
fn assign_by_number(masks: &[PathBuf], frames: &mut [Frame]) -> Option<()> {
    let masks_by_number = by_number(masks)?;
    let photos: Vec<PathBuf> = frames.iter().map(|frame| frame.photo.clone()).collect();
    let photos_by_number = by_number(&photos)?;
    // Numbers that run alike but start apart would pair all but one, and all wrongly.
    let paired = |number: &&u64| masks_by_number.contains_key(number);
    let n_paired = photos_by_number.keys().filter(paired).count();
    if n_paired < masks.len().min(frames.len()) {
        return None;
    }
    for frame in frames {
        let mask = masks_by_number.get(&trailing_number(&frame.photo)?);
        frame.mask = mask.map(|mask| mask.to_path_buf());
    }
    Some(())
}
