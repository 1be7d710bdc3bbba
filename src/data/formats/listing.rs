//! Recognises what layout a capture has and lists its photos, without decoding any.
//!
//! Layouts are recognised by the files in them, never by the folder's name. Where a folder holds several
//! (converters leave their sources behind), the first of [`LAYOUTS`] wins and the others are named.

use std::path::{Path, PathBuf};

use super::found::{Found, Listed};
use super::photo_folder::assign_masks;
use super::splits::{self, SplitFrames, split_as_chosen};
use super::{blended_mvs, colmap, idr, llff, neilf, nero, rgbd};
use crate::data::problem::first_names;
use crate::data::{CaptureChoices, DataError, Frame, PointCloud, Problem, Severity};

/// A capture's photos with poses and lenses, by split, before any photo is read.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The capture's folder.
    pub root: PathBuf,
    /// The layout and the files that it was recognised by, for people.
    pub recognised: String,
    /// Photos to learn from.
    pub train: Vec<Frame>,
    /// Photos for early stopping and choosing settings.
    pub val: Vec<Frame>,
    /// Photos for the final measure only.
    pub test: Vec<Frame>,
    /// Why they are split so, for people.
    pub split_rule: String,
    /// The reconstruction's points, where the layout has them.
    pub points: Option<PointCloud>,
    /// What was wrong or assumed.
    pub problems: Vec<Problem>,
}

impl Listing {
    /// All photos: training, validation, test.
    pub fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.train.iter().chain(&self.val).chain(&self.test)
    }
}

/// A layout without splits of its own.
struct Layout {
    name: &'static str,
    looked_for: &'static str,
    find: fn(&Path) -> Option<Found>,
    list: fn(&Found) -> Result<Listed, DataError>,
}

/// In the order of preference: what was made for reconstruction before what it was made from.
const LAYOUTS: [Layout; 8] = [
    Layout {
        name: "IDR or NeuS",
        looked_for: idr::LOOKED_FOR,
        find: idr::find,
        list: idr::list,
    },
    Layout {
        name: "NeILF",
        looked_for: neilf::LOOKED_FOR,
        find: neilf::find,
        list: neilf::list,
    },
    Layout {
        name: "NeRO",
        looked_for: nero::LOOKED_FOR,
        find: nero::find,
        list: nero::list,
    },
    Layout {
        name: "COLMAP",
        looked_for: colmap::LOOKED_FOR,
        find: colmap::find,
        list: colmap::list,
    },
    Layout {
        name: "LLFF",
        looked_for: llff::LOOKED_FOR,
        find: llff::find,
        list: llff::list,
    },
    Layout {
        name: "BlendedMVS",
        looked_for: blended_mvs::LOOKED_FOR,
        find: blended_mvs::find,
        list: blended_mvs::list,
    },
    Layout {
        name: "depth camera",
        looked_for: rgbd::LOOKED_FOR,
        find: rgbd::find,
        list: rgbd::list,
    },
    Layout {
        name: "depth camera, poses in one file",
        looked_for: rgbd::trajectory::LOOKED_FOR,
        find: rgbd::trajectory::find,
        list: rgbd::trajectory::list,
    },
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
pub fn list_capture_as(path: &Path, choices: &CaptureChoices) -> Result<Listing, DataError> {
    let mut listing = list_capture(path)?;
    let frames = SplitFrames {
        train: std::mem::take(&mut listing.train),
        val: std::mem::take(&mut listing.val),
        test: std::mem::take(&mut listing.test),
        rule: std::mem::take(&mut listing.split_rule),
    };
    let frames = split_as_chosen(choices, frames)?;
    Ok(Listing {
        train: frames.train,
        val: frames.val,
        test: frames.test,
        split_rule: frames.rule,
        ..listing
    })
}

/// The listing of the layout that a file belongs to.
fn list_file(path: &Path) -> Result<Listing, DataError> {
    let name = path.file_name().map(|name| name.to_string_lossy());
    let name = name.unwrap_or_default().to_ascii_lowercase();
    let has_extension = |extension: &str| name.ends_with(&format!(".{extension}"));
    if neilf::is_scene(path) {
        let found = neilf::found_at(path);
        return Ok(finish(&found, neilf::list(&found)?));
    }
    if has_extension("json") {
        let root = path.parent().unwrap_or_else(|| Path::new(""));
        return list_transforms(root, path);
    }
    if has_extension("npy") || has_extension("npz") {
        let found = Found::beside(path);
        let list = if has_extension("npy") {
            llff::list
        } else {
            idr::list
        };
        return Ok(finish(&found, list(&found)?));
    }
    if has_extension("pkl") {
        let found = Found::beside(path);
        return Ok(finish(&found, nero::list(&found)?));
    }
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    if (has_extension("bin") || has_extension("txt")) && colmap::model_format(folder).is_some() {
        let found = colmap::found_at(folder);
        return Ok(finish(&found, colmap::list(&found)?));
    }
    if let Some(found) = rgbd::trajectory::found_at(path) {
        return Ok(finish(&found, rgbd::trajectory::list(&found)?));
    }
    Err(DataError::NotADataset {
        path: path.to_owned(),
        problem: "expected a folder, a transforms.json, poses_bounds.npy, cameras_sphere.npz, a \
                  file of a COLMAP model or a depth camera's trajectory"
            .to_owned(),
    })
}

fn list_transforms(root: &Path, json: &Path) -> Result<Listing, DataError> {
    let mut problems = Vec::new();
    let (recognised, frames) = splits::read_transforms(root, json, &mut problems)?;
    Ok(Listing {
        root: root.to_owned(),
        recognised,
        train: frames.train,
        val: frames.val,
        test: frames.test,
        split_rule: frames.rule,
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
    let split = splits::split_listed(&found.root, frames);
    Listing {
        root: found.root.clone(),
        recognised: listed.recognised,
        train: split.train,
        val: split.val,
        test: split.test,
        split_rule: split.rule,
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
    DataError::NotADataset {
        path: path.to_owned(),
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{
        cameras, folder, write_colmap_binary, write_idr, write_llff, write_photos,
    };
    use super::*;

    #[test]
    fn an_unknown_folder_says_what_was_looked_for() {
        let folder = folder();
        std::fs::write(folder.path().join("notes.txt"), "nothing").unwrap();
        let message = list_capture(folder.path()).unwrap_err().to_string();
        for name in [
            "transforms.json",
            "COLMAP",
            "LLFF",
            "NeuS",
            "BlendedMVS",
            "NeILF",
        ] {
            assert!(message.contains(name), "{name}: {message}");
        }
        let message = list_capture(&folder.path().join("notes.txt")).unwrap_err();
        assert!(
            matches!(message, DataError::NotADataset { .. }),
            "{message}"
        );
    }

    #[test]
    fn of_several_layouts_one_wins_and_any_can_be_named() {
        let folder = folder();
        write_llff(folder.path(), &cameras());
        write_colmap_binary(&folder.path().join("sparse/0"), &cameras());
        write_photos(&folder.path().join("images"), 9);
        let listing = list_capture(folder.path()).unwrap();
        assert!(
            listing.recognised.starts_with("COLMAP"),
            "{}",
            listing.recognised
        );
        let note = &listing.problems.last().unwrap().what;
        assert!(note.contains("poses_bounds.npy (LLFF)"), "{note}");
        let llff = list_capture(&folder.path().join("poses_bounds.npy")).unwrap();
        assert!(llff.recognised.starts_with("LLFF"), "{}", llff.recognised);
        write_idr(folder.path(), &cameras());
        let listing = list_capture(folder.path()).unwrap();
        assert!(
            listing.recognised.starts_with("IDR"),
            "{}",
            listing.recognised
        );
        let model = folder.path().join("sparse/0/images.bin");
        let colmap = list_capture(&model).unwrap();
        assert!(
            colmap.recognised.starts_with("COLMAP"),
            "{}",
            colmap.recognised
        );
    }

    #[test]
    fn lists_of_names_split_a_capture() {
        let folder = folder();
        write_colmap_binary(&folder.path().join("sparse/0"), &cameras());
        write_photos(&folder.path().join("images"), 9);
        std::fs::write(folder.path().join("test.txt"), "0003.png\r\nimages/0005\n").unwrap();
        std::fs::write(folder.path().join("val.txt"), "0007.png\n").unwrap();
        let listing = list_capture(folder.path()).unwrap();
        let names = |frames: &[Frame]| -> Vec<String> {
            frames.iter().map(|frame| frame.name.clone()).collect()
        };
        assert_eq!(names(&listing.test), ["0003", "0005"], "test");
        assert_eq!(names(&listing.val), ["0007"], "validation");
        assert_eq!(listing.train.len(), 6, "training");
        std::fs::write(
            folder.path().join("test.txt"),
            "a file about something else",
        )
        .unwrap();
        std::fs::write(folder.path().join("val.txt"), "").unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert_eq!(names(&listing.test), ["0000", "0008"], "by position");
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_are_listed_like_others() {
        use std::os::unix::ffi::OsStrExt as _;

        let folder = folder();
        write_llff(folder.path(), &cameras());
        let images = folder.path().join("images");
        write_photos(&images, 9);
        let name = std::ffi::OsStr::from_bytes(b"zz\xff\xfe.png");
        std::fs::rename(images.join("0008.png"), images.join(name)).unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert!(
            listing.test.last().unwrap().photo.is_file(),
            "{:?}",
            listing.test
        );
    }
}
