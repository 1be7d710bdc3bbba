//! `BlendedMVS` and `MVSNet` captures: `cams/00000000_cam.txt` beside `blended_images/` or `images/`.
//!
//! A camera file holds the word `extrinsic` with a 4 x 4 matrix from world to camera (x right, y
//! down, z forward), the word `intrinsic` with a 3 x 3 matrix (pixel centres at whole numbers),
//! and a line that begins with the nearest depth and may end with the farthest.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::found::{Found, Layout, Listed};
use super::photo_folder::{list_pictures, photo_folder};
use crate::data::files::capture_path::{list_folder, read_text};
use crate::data::frame::{rotation_and_translation, world_from_opencv};
use crate::data::{DataError, DepthFile, Frame, Intrinsics};

/// Where rendered depth maps lie, `00000000.pfm`.
const DEPTH_FOLDERS: [&str; 2] = ["rendered_depth_maps", "depths"];
const FOLDERS: [&str; 2] = ["cams", "cams_1"];
const ENDING: &str = "_cam.txt";
/// Such files have about 300 bytes.
const MAX_BYTES: u64 = 64 << 10;

pub(super) const LAYOUT: Layout = Layout {
    name: "BlendedMVS",
    looked_for: "BlendedMVS, MVSNet: cams/*_cam.txt with blended_images/ or images/",
    find: |root| {
        let mut folders = FOLDERS.iter().map(|name| root.join(name));
        let has_cameras = |folder: &PathBuf| camera_files(folder).is_ok_and(|c| !c.is_empty());
        let folder = folders.find(has_cameras)?;
        Some(Found::new(root, &folder))
    },
    of_file: |_| None,
    list,
};

/// Lists the cameras in the order of names, each with the photo of the same name.
fn list(found: &Found) -> Result<Listed, DataError> {
    let folder = &photo_folder(&found.root, "blended_images", "cams/ is")?;
    let photos: HashMap<OsString, PathBuf> = list_pictures(folder)?
        .into_iter()
        .rev()
        .filter_map(|photo| Some((photo.file_stem()?.to_owned(), photo)))
        .collect();
    let frames = camera_files(&found.file)?
        .into_iter()
        .enumerate()
        .map(|(index, file)| read_camera(&file, index, folder, &photos))
        .collect::<Result<Vec<_>, _>>()?;
    let recognised = format!(
        "BlendedMVS or MVSNet: {}/*{ENDING}, photos in {}",
        found.shown(&found.file),
        found.shown(folder)
    );
    Ok(Listed {
        frames,
        recognised,
        ..Listed::default()
    })
}

/// The camera files in a folder, by name.
fn camera_files(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    list_folder(folder, |path| {
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        name.ends_with(ENDING.as_bytes())
    })
}

fn read_camera(
    file: &Path,
    index: usize,
    folder: &Path,
    photos: &HashMap<OsString, PathBuf>,
) -> Result<Frame, DataError> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let name = name.trim_end_matches(ENDING).to_owned();
    let photo = photos.get(OsStr::new(&name)).cloned();
    let fail = |(field, problem): (&str, String)| DataError::field(file, field, problem);
    let camera = parse(&read_text(file, MAX_BYTES)?).map_err(fail)?;
    let [fx, fy, cx, cy] = camera.lens;
    let pose = world_from_opencv(camera.rotation, camera.translation);
    // Ours has the first pixel's centre at one half.
    let lens = Intrinsics::pinhole([fx, fy, cx + 0.5, cy + 0.5].map(|v| v as f32));
    let photo = photo.unwrap_or_else(|| folder.join(format!("{name}.jpg")));
    let depths = DEPTH_FOLDERS.iter().filter_map(|folder| {
        let folder = file.parent()?.parent()?.join(folder);
        DepthFile::find(&folder.join(&name), 1.0)
    });
    Ok(Frame {
        depth: depths.into_iter().next(),
        name,
        depth_range: camera.depth_range,
        ..Frame::new(index, photo, pose, lens, file)
    })
}

#[derive(Debug)]
struct CameraText {
    rotation: DMat3,
    translation: DVec3,
    /// `fx, fy, cx, cy`.
    lens: [f64; 4],
    depth_range: Option<[f32; 2]>,
}

/// The camera, or the faulty field and what is wrong with it.
fn parse(text: &str) -> Result<CameraText, (&'static str, String)> {
    let mut words = text.split_whitespace();
    let mut matrix = |name: &'static str, n: usize| {
        if words.next() != Some(name) {
            return Err((name, format!("the word \"{name}\" is missing")));
        }
        (0..n)
            .map(|i| {
                let word = words
                    .next()
                    .ok_or((name, format!("ends after {i} numbers")))?;
                word.parse::<f64>()
                    .ok()
                    .filter(|v| (*v as f32).is_finite())
                    .ok_or((name, format!("\"{word}\" is not a finite number")))
            })
            .collect::<Result<Vec<f64>, _>>()
    };
    let e = matrix("extrinsic", 16)?;
    let k = matrix("intrinsic", 9)?;
    let (rotation, translation) = rotation_and_translation(&e)
        .ok_or(("extrinsic", "not a rotation and a position".to_owned()))?;
    if k[0] <= 0.0 || k[4] <= 0.0 {
        return Err((
            "intrinsic",
            "a focal length is not greater than 0".to_owned(),
        ));
    }
    // `near interval`, or `near interval count far`.
    let depths: Vec<f32> = words.filter_map(|word| word.parse().ok()).collect();
    let depth_range = match depths.as_slice() {
        [near, _, _, far] => Some([*near, *far]),
        _ => None,
    };
    Ok(CameraText {
        rotation,
        translation,
        lens: [k[0], k[4], k[2], k[5]],
        depth_range,
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{
        assert_cameras, capture, folder, shifted_cameras, write_blended_mvs, write_photos,
    };
    use super::*;
    use crate::data::list_capture;
    use crate::data::test_asserts::{assert_contains, assert_error};

    #[test]
    fn camera_files_go_with_photos_of_the_same_name() {
        let folder = capture("blended_images", |root| {
            write_blended_mvs(root, &shifted_cameras());
        });
        // The same photo with everything but the reconstruction blackened lies beside each.
        let photo = |name: &str| folder.path().join("blended_images").join(name);
        std::fs::copy(photo("0000.png"), photo("0000_masked.png")).unwrap();
        std::fs::remove_file(photo("0004.png")).unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert_contains(&listing.recognised, "BlendedMVS");
        assert_contains(&listing.problems[0].what, "1 of 9");
        assert_contains(&listing.problems[0].what, "0004");
        let first = listing.frames().next().unwrap();
        assert_eq!(first.depth_range, Some([1.5, 9.0]), "depths");
        std::fs::write(photo("0004.png"), "").unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert_cameras(&listing, &shifted_cameras());
    }

    #[test]
    fn a_camera_file_cut_anywhere_is_an_error_or_lacks_depths() {
        let folder = folder();
        write_blended_mvs(folder.path(), &shifted_cameras());
        let text = std::fs::read_to_string(folder.path().join("cams/0002_cam.txt")).unwrap();
        let end = text.find("\n\n1.5").unwrap();
        for n in 0..text.len() {
            match parse(&text[..n]) {
                // The last number may end early and still be one.
                Ok(camera) => assert!(n + 3 >= end, "cut at {n}: {camera:?}"),
                Err((field, problem)) => assert!(n < end, "cut at {n}: {field}: {problem}"),
            }
        }
        for (from, to, expected) in [
            ("extrinsic", "extrinsics", "extrinsic"),
            (
                " 1\n\nintrinsic",
                " one\n\nintrinsic",
                "\"one\" is not a finite number",
            ),
        ] {
            let (field, problem) = parse(&text.replacen(from, to, 1)).unwrap_err();
            assert_contains(format!("{field}: {problem}"), expected);
        }
        let path = folder.path().join("cams/0002_cam.txt");
        write_photos(&folder.path().join("images"), 9);
        std::fs::write(&path, " ".repeat(MAX_BYTES as usize + 1)).unwrap();
        assert_error(list_capture(folder.path()), &["larger than 64 KiB"]);
        let text = "extrinsic\n1 0 0 0 0 2 0 0 0 0 1 0 0 0 0 1 intrinsic 1 0 0 0 1 0 0 0 1";
        std::fs::write(path, text).unwrap();
        let problem = "0002_cam.txt: extrinsic: not a rotation";
        assert_error(list_capture(folder.path()), &[problem]);
    }
}
