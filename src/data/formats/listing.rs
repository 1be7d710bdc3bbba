//! Recognises what layout a capture has and lists its photos, without decoding any.
//!
//! Layouts are recognised by the files in them, never by the folder's name. Where a folder holds several
//! (converters leave their sources behind), the first of [`LAYOUTS`] wins and the others are named.

use std::path::{Path, PathBuf};

use super::found::{Found, Layout, Listed};
use super::photo_folder::{assign_masks, assign_masks_of};
use super::splits::{self, SplitFrames, split_as_chosen};
use super::{blended_mvs, colmap, idr, llff, neilf, nero, rgbd};
use crate::data::files::capture_path::{folder_of, has_extension};
use crate::data::problem::first_names;
use crate::data::{CaptureChoices, DataError, Frame, PointCloud, Problem, Severity};

/// A capture's photos with poses and lenses, by split, before any photo is read.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The capture's folder.
    pub root: PathBuf,
    /// The layout and the files that it was recognised by, for people.
    pub recognised: String,
    /// The photos by split.
    pub split: SplitFrames,
    /// The reconstruction's points, where the layout has them.
    pub points: Option<PointCloud>,
    /// What was wrong or assumed.
    pub problems: Vec<Problem>,
}

impl Listing {
    /// All photos: training, validation, test.
    pub fn frames(&self) -> impl Iterator<Item = &Frame> {
        let split = &self.split;
        split.train.iter().chain(&split.val).chain(&split.test)
    }
}

/// In the order of preference: what was made for reconstruction before what it was made from.
const LAYOUTS: [Layout; 8] = [
    idr::LAYOUT,
    neilf::LAYOUT,
    nero::LAYOUT,
    colmap::LAYOUT,
    llff::LAYOUT,
    blended_mvs::LAYOUT,
    rgbd::LAYOUT,
    rgbd::trajectory::LAYOUT,
];

/// Lists the capture at `path`: a folder, or the file that lists the cameras.
///
/// Errors when nothing is recognised (saying what was looked for), or when what was recognised
/// cannot be read (naming file and field).
pub fn list_capture(path: &Path) -> Result<Listing, DataError> {
    if !path.exists() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        return Err(DataError::io(path, missing));
    }
    if path.is_file() {
        return list_file(path);
    }
    if let Some(json) = splits::find_transforms(path) {
        let mut listing = list_transforms(path, &json)?;
        note_unused(path, None, &mut listing.problems);
        return Ok(listing);
    }
    for layout in &LAYOUTS {
        if let Some(found) = (layout.find)(path) {
            let mut listing = finish(&found, (layout.list)(&found)?);
            note_unused(path, Some(layout.name), &mut listing.problems);
            return Ok(listing);
        }
    }
    Err(not_recognised(path))
}

/// The same, split as a person chose.
///
/// Errors also when the chosen lists of photos are of no use.
pub(in crate::data) fn list_capture_as(
    path: &Path,
    choices: &CaptureChoices,
) -> Result<Listing, DataError> {
    let mut listing = list_capture(path)?;
    listing.split = split_as_chosen(choices, listing.split)?;
    if let Some(folder) = &choices.masks {
        let SplitFrames {
            train, val, test, ..
        } = &mut listing.split;
        let frames = train.iter_mut().chain(val).chain(test);
        assign_masks_of(folder, frames)?;
    }
    Ok(listing)
}

/// The listing of the layout that a file belongs to.
fn list_file(path: &Path) -> Result<Listing, DataError> {
    for layout in &LAYOUTS {
        if let Some(found) = (layout.of_file)(path) {
            return Ok(finish(&found, (layout.list)(&found)?));
        }
    }
    if has_extension(path, "json") {
        return list_transforms(folder_of(path), path);
    }
    let problem = "expected a folder, a transforms.json, poses_bounds.npy, cameras_sphere.npz, a \
                   file of a COLMAP model or a depth camera's trajectory";
    Err(DataError::no_capture(path, problem))
}

fn list_transforms(root: &Path, json: &Path) -> Result<Listing, DataError> {
    let mut problems = Vec::new();
    let (recognised, split) = splits::read_transforms(root, json, &mut problems)?;
    Ok(Listing {
        root: root.to_owned(),
        recognised,
        split,
        points: None,
        problems,
    })
}

/// Finds masks, drops frames without a photo, and splits what is left.
fn finish(found: &Found, listed: Listed) -> Listing {
    let mut problems = listed.problems;
    let mut frames = listed.frames;
    assign_masks(&found.root, &mut frames, &mut problems);
    let frames = splits::keep_existing(frames, &mut problems);
    Listing {
        root: found.root.clone(),
        recognised: listed.recognised,
        split: splits::split_listed(&found.root, frames),
        points: listed.points,
        problems,
    }
}

/// Says which other layouts the folder holds.
fn note_unused(root: &Path, used: Option<&str>, problems: &mut Vec<Problem>) {
    let others: Vec<String> = LAYOUTS
        .iter()
        .filter(|layout| Some(layout.name) != used)
        .filter_map(|layout| {
            let found = (layout.find)(root)?;
            Some(format!("{} ({})", found.shown(&found.file), layout.name))
        })
        .collect();
    if !others.is_empty() {
        let what = format!("also there, and not used: {}", first_names(&others));
        let advice = "name the file instead of the folder to use it";
        problems.push(Problem::new(Severity::Note, what, advice));
    }
}

fn not_recognised(path: &Path) -> DataError {
    let mut problem = "none of these was found in it:\n  \
        NeRF-synthetic, instant-ngp, nerfstudio: transforms.json or transforms_train.json"
        .to_owned();
    for layout in &LAYOUTS {
        problem.push_str("\n  ");
        problem.push_str(layout.looked_for);
    }
    DataError::no_capture(path, problem)
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{
        cameras, capture, folder, write_colmap_binary, write_idr, write_llff,
    };
    use super::*;
    use crate::data::test_asserts::{assert_contains, assert_error};

    #[test]
    fn an_unknown_folder_says_what_was_looked_for() {
        let folder = folder();
        std::fs::write(folder.path().join("notes.txt"), "nothing").unwrap();
        let names = [
            "transforms.json",
            "COLMAP",
            "LLFF",
            "NeuS",
            "BlendedMVS",
            "NeILF",
        ];
        assert_error(list_capture(folder.path()), &names);
        let error = list_capture(&folder.path().join("notes.txt")).unwrap_err();
        assert!(matches!(error, DataError::NotADataset { .. }), "{error}");
    }

    #[test]
    fn of_several_layouts_one_wins_and_any_can_be_named() {
        let folder = capture("images", |root| {
            write_llff(root, &cameras());
            write_colmap_binary(&root.join("sparse/0"), &cameras());
        });
        let assert_is = |file: &str, layout: &str| {
            let listing = list_capture(&folder.path().join(file)).unwrap();
            let recognised = &listing.recognised;
            assert!(recognised.starts_with(layout), "{recognised}");
            listing
        };
        let listing = assert_is("", "COLMAP");
        let note = &listing.problems.last().unwrap().what;
        assert_contains(note, "poses_bounds.npy (LLFF)");
        assert_is("poses_bounds.npy", "LLFF");
        write_idr(folder.path(), &cameras());
        assert_is("", "IDR");
        assert_is("sparse/0/images.bin", "COLMAP");
    }

    #[test]
    fn lists_of_names_split_a_capture() {
        let folder = capture("images", |root| {
            write_colmap_binary(&root.join("sparse/0"), &cameras());
        });
        std::fs::write(folder.path().join("test.txt"), "0003.png\r\nimages/0005\n").unwrap();
        std::fs::write(folder.path().join("val.txt"), "0007.png\n").unwrap();
        let split = list_capture(folder.path()).unwrap().split;
        let names = |frames: &[Frame]| -> Vec<String> {
            frames.iter().map(|frame| frame.name.clone()).collect()
        };
        assert_eq!(names(&split.test), ["0003", "0005"], "test");
        assert_eq!(names(&split.val), ["0007"], "validation");
        assert_eq!(split.train.len(), 6, "training");
        std::fs::write(folder.path().join("test.txt"), "about something else").unwrap();
        std::fs::write(folder.path().join("val.txt"), "").unwrap();
        let split = list_capture(folder.path()).unwrap().split;
        assert_eq!(names(&split.test), ["0000", "0008"], "by position");
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_are_listed_like_others() {
        use std::os::unix::ffi::OsStrExt as _;

        let folder = capture("images", |root| write_llff(root, &cameras()));
        let images = folder.path().join("images");
        let name = std::ffi::OsStr::from_bytes(b"zz\xff\xfe.png");
        std::fs::rename(images.join("0008.png"), images.join(name)).unwrap();
        let listing = list_capture(folder.path()).unwrap();
        let test = listing.split.test;
        assert!(test.last().unwrap().photo.is_file(), "{test:?}");
    }
}
