//! `BlendedMVS` and `MVSNet` captures: `cams/00000000_cam.txt` beside `blended_images/` or `images/`.
//!
//! A camera file holds the word `extrinsic` with a 4 x 4 matrix from world to camera (x right, y
//! down, z forward), the word `intrinsic` with a 3 x 3 matrix (pixel centres at whole numbers),
//! and a line that begins with the nearest depth and may end with the farthest.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::found::{Found, Listed};
use super::photo_folder::{list_pictures, photo_folders};
use crate::data::files::capture_path::read_text;
use crate::data::frame::{rotation_and_translation, world_from_opencv};
use crate::data::{DataError, DepthFile, Frame, Intrinsics};

/// Where rendered depth maps lie, `00000000.pfm`.
const DEPTH_FOLDERS: [&str; 2] = ["rendered_depth_maps", "depths"];
const FOLDERS: [&str; 2] = ["cams", "cams_1"];
const ENDING: &str = "_cam.txt";
/// Such files have about 300 bytes.
const MAX_BYTES: u64 = 64 << 10;
/// Most files listed.
const MAX_FILES: usize = 200_000;

pub(super) const LOOKED_FOR: &str =
    "BlendedMVS, MVSNet: cams/*_cam.txt with blended_images/ or images/";

pub(in crate::data) fn find(root: &Path) -> Option<Found> {
    let folder = FOLDERS
        .iter()
        .map(|name| root.join(name))
        .find(|folder| !camera_files(folder).is_empty())?;
    Some(Found {
        root: root.to_owned(),
        file: folder,
    })
}

/// Lists the cameras in the order of names, each with the photo of the same name.
pub(in crate::data) fn list(found: &Found) -> Result<Listed, DataError> {
    let blended = found.root.join("blended_images");
    let folders = [blended].into_iter().chain(photo_folders(&found.root));
    let folders: Vec<PathBuf> = folders.filter(|folder| folder.is_dir()).collect();
    let Some(folder) = folders.first() else {
        return Err(DataError::NotADataset {
            path: found.root.clone(),
            problem: "cams/ is there, but no folder blended_images/ or images/".to_owned(),
        });
    };
    let photos: HashMap<OsString, PathBuf> = list_pictures(folder)?
        .into_iter()
        .rev()
        .filter_map(|photo| Some((photo.file_stem()?.to_owned(), photo)))
        .collect();
    let frames = camera_files(&found.file)
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
        points: None,
        recognised,
        problems: Vec::new(),
    })
}

/// The camera files in a folder, by name.
fn camera_files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().into_iter().flatten().take(MAX_FILES);
    let is_camera = |path: &PathBuf| {
        path.file_name()
            .is_some_and(|name| name.as_encoded_bytes().ends_with(ENDING.as_bytes()))
    };
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(is_camera)
        .collect();
    files.sort();
    files
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
    let fail = |(field, problem): (&str, String)| DataError::Field {
        path: file.to_owned(),
        frame: None,
        field: field.to_owned(),
        problem,
    };
    let camera = parse(&read_text(file, MAX_BYTES)?).map_err(fail)?;
    let [fx, fy, cx, cy] = camera.lens;
    let pose = world_from_opencv(camera.rotation, camera.translation);
    let lens = Intrinsics {
        fl_x: Some(fx as f32),
        fl_y: Some(fy as f32),
        // Ours has the first pixel's centre at one half.
        cx: Some((cx + 0.5) as f32),
        cy: Some((cy + 0.5) as f32),
        ..Intrinsics::default()
    };
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
        assert_cameras, folder, shifted_cameras, write_blended_mvs, write_photos,
    };
    use super::*;
    use crate::data::list_capture;

    #[test]
    fn camera_files_go_with_photos_of_the_same_name() {
        let folder = folder();
        write_blended_mvs(folder.path(), &shifted_cameras());
        write_photos(&folder.path().join("blended_images"), 9);
        // The same photo with everything but the reconstruction blackened lies beside each.
        let photo = |name: &str| folder.path().join("blended_images").join(name);
        std::fs::copy(photo("0000.png"), photo("0000_masked.png")).unwrap();
        std::fs::remove_file(photo("0004.png")).unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert!(
            listing.recognised.contains("BlendedMVS"),
            "{}",
            listing.recognised
        );
        let missing = &listing.problems[0].what;
        assert!(
            missing.contains("1 of 9") && missing.contains("0004"),
            "{missing}"
        );
        let frames = [listing.train, listing.val, listing.test].concat();
        assert_eq!(frames[0].depth_range, Some([1.5, 9.0]), "depths");
        std::fs::write(photo("0004.png"), "").unwrap();
        let listing = list_capture(folder.path()).unwrap();
        let frames = [listing.train, listing.val, listing.test].concat();
        assert_cameras(&frames, &shifted_cameras());
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
            ("0 0 0 1", "0 0 0 one", "\"one\" is not a finite number"),
        ] {
            let (field, problem) = parse(&text.replacen(from, to, 1)).unwrap_err();
            assert!(
                format!("{field}: {problem}").contains(expected),
                "{field}: {problem}"
            );
        }
        let path = folder.path().join("cams/0002_cam.txt");
        write_photos(&folder.path().join("images"), 9);
        std::fs::write(&path, " ".repeat(MAX_BYTES as usize + 1)).unwrap();
        let message = list_capture(folder.path()).unwrap_err().to_string();
        assert!(message.contains("larger than 64 KiB"), "{message}");
        std::fs::write(
            path,
            "extrinsic\n1 0 0 0 0 2 0 0 0 0 1 0 0 0 0 1 intrinsic 1 0 0 0 1 0 0 0 1",
        )
        .unwrap();
        let message = list_capture(folder.path()).unwrap_err().to_string();
        assert!(
            message.contains("0002_cam.txt: extrinsic: not a rotation"),
            "{message}"
        );
    }
}
