//! Captures of depth cameras: a text file with a 4 x 4 pose for each photo, camera to world, x right, y down, z
//! forward.
//!
//! `ScanNet` and its kin: `pose/12.txt` beside `color/12.jpg`, the lens in `intrinsic/intrinsic_color.txt`.
//! `KinectFusion`, `BundleFusion`, 7-Scenes and `3DMatch`: `frame-000012.pose.txt` beside `frame-000012.color.png`, the
//! lens in `camera-intrinsics.txt`, there or one folder above. Depth maps lie in `depth/` or are called
//! `frame-000012.depth.png`; their lens is the photos' unless `intrinsic/intrinsic_depth.txt` is there. Captures with all
//! poses in one file: [`trajectory`].

mod lens;
mod poses;
pub(in crate::data) mod trajectory;

use std::path::{Path, PathBuf};

use glam::{Affine3A, DMat3, DVec3};

use super::found::{Found, Layout, Listed};
use crate::data::files::capture_path::{first_folder, list_folder, read_text, with_extension};
use crate::data::frame::{rotation_and_translation, world_from_opencv};
use crate::data::photos::depth::MILLIMETRE;
use crate::data::problem::first_names;
use crate::data::{DataError, DepthFile, Frame, Problem, Severity};

/// The largest text file read, but for trajectories.
const MAX_BYTES: u64 = 1 << 20;
const POSE_FOLDERS: [&str; 2] = ["pose", "poses"];
const PHOTO_FOLDERS: [&str; 4] = ["color", "rgb", "images", "image"];
const POSE_ENDING: &str = ".pose.txt";

pub(super) const LAYOUT: Layout = Layout {
    name: "depth camera",
    looked_for: "depth cameras: pose/*.txt with color/ and intrinsic/intrinsic_color.txt, or \
                 frame-*.pose.txt with frame-*.color.* and camera-intrinsics.txt",
    find,
    of_file: |_| None,
    list,
};

/// The folder with the poses, where there is a lens too.
fn find(root: &Path) -> Option<Found> {
    lens::find(root)?;
    let folders = POSE_FOLDERS.iter().map(|name| root.join(name));
    let folder = folders
        .chain([root.to_owned()])
        .find(|folder| pose_files(folder, root).is_ok_and(|poses| !poses.is_empty()))?;
    Some(Found::new(root, &folder))
}

/// The pose files in a folder, sorted by number, with what their photos are called.
fn pose_files(folder: &Path, root: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let ending = if folder == root { POSE_ENDING } else { ".txt" };
    let stem = |path: &Path| {
        let stem = path.file_name()?.to_str()?.strip_suffix(ending)?;
        Some(stem.to_owned())
    };
    let files = list_folder(folder, |path| stem(path).is_some())?.into_iter();
    let mut poses: Vec<_> = files
        .filter_map(|path| Some((stem(&path)?, path)))
        .collect();
    // 10.txt comes after 9.txt.
    poses.sort_by_cached_key(|(stem, _)| (stem.len(), stem.clone()));
    Ok(poses)
}

/// Lists the photos in the order of their numbers.
fn list(found: &Found) -> Result<Listed, DataError> {
    let root = &found.root;
    let lens_file = lens::find(root).ok_or_else(|| {
        DataError::no_capture(root, "poses are there, but no camera-intrinsics.txt")
    })?;
    let lens = lens::read(&lens_file)?;
    let depth_lens = lens::of_depths(root)?;
    let mut n_depths = 0;
    let poses = pose_files(&found.file, root)?;
    let n_poses = poses.len();
    let (mut frames, mut lost) = (Vec::new(), Vec::new());
    for (index, (stem, path)) in poses.into_iter().enumerate() {
        let numbers = numbers_of(&path, &read_text(&path, MAX_BYTES)?)?;
        // Cameras that lost track of where they were write infinities.
        if numbers.iter().any(|v| !v.is_finite()) {
            lost.push(stem);
            continue;
        }
        let pose = (numbers.len() == 16)
            .then(|| rotation_and_translation(&numbers))
            .flatten();
        let (rotation, position) = pose.ok_or_else(|| {
            let problem = "not the 16 numbers of a rotation and a position";
            DataError::field(&path, "pose", problem)
        })?;
        let pose = pose_of(rotation, position);
        let photo = photo_of(root, &found.file, &stem);
        let mut depth = depth_of(root, &found.file, &stem);
        if let Some(file) = &mut depth {
            file.lens = depth_lens.map(|lens| lens.intrinsics);
            file.unit = lens.depth_unit.unwrap_or(file.unit);
            n_depths += 1;
        }
        frames.push(Frame {
            depth,
            ..Frame::new(index, photo, pose, lens.intrinsics, &lens_file)
        });
    }
    let mut problems = Vec::new();
    if !lost.is_empty() {
        let what = format!(
            "{} of {n_poses} poses are not finite: {}",
            lost.len(),
            first_names(&lost)
        );
        let advice = "the camera had lost its place; these photos are left out";
        problems.push(Problem::new(Severity::Note, what, advice));
    }
    Ok(Listed {
        recognised: format!(
            "depth camera: poses in {}, lens in {}{}",
            found.shown(&found.file),
            found.shown(&lens_file),
            match n_depths {
                0 => String::new(),
                n => format!(", {n} depth maps"),
            }
        ),
        frames,
        problems,
        ..Listed::default()
    })
}

/// The depth map of a pose, where there is one.
fn depth_of(root: &Path, poses: &Path, stem: &str) -> Option<DepthFile> {
    let path = if poses == root {
        root.join(format!("{stem}.depth"))
    } else {
        root.join("depth").join(stem)
    };
    DepthFile::find(&path, MILLIMETRE)
}

/// The photo of a pose; the first that would do where there is none.
fn photo_of(root: &Path, poses: &Path, stem: &str) -> PathBuf {
    if poses == root {
        return with_extension(root.join(format!("{stem}.color")));
    }
    let folder = first_folder(root, &PHOTO_FOLDERS);
    let folder = folder.unwrap_or_else(|| root.join(PHOTO_FOLDERS[0]));
    with_extension(folder.join(stem))
}

/// The numbers of a text, which white space parts.
fn numbers_of(path: &Path, text: &str) -> Result<Vec<f64>, DataError> {
    text.split_whitespace()
        .map(|word| {
            let problem = || format!("\"{word}\" is not a number");
            word.parse()
                .map_err(|_unparsed| DataError::field(path, "matrix", problem()))
        })
        .collect()
}

/// The pose of a camera given by its axes (x right, y down, z forward) and position in the world.
fn pose_of(rotation: DMat3, position: DVec3) -> Affine3A {
    let rotation = rotation.transpose();
    world_from_opencv(rotation, -(rotation * position))
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{
        assert_cameras, folder, shifted_cameras, write_photos, write_rgbd,
    };
    use super::*;
    use crate::data::list_capture;
    use crate::data::test_asserts::{assert_contains, assert_error};

    #[test]
    fn poses_beside_their_photos_and_in_folders_are_read() {
        let in_folders = folder();
        write_rgbd(in_folders.path(), &shifted_cameras());
        write_photos(&in_folders.path().join("color"), 9);
        let beside = folder();
        let root = beside.path();
        write_photos(root, 9);
        for i in 0..9 {
            let pose = in_folders.path().join(format!("pose/{i:04}.txt"));
            std::fs::copy(pose, root.join(format!("{i:04}.pose.txt"))).unwrap();
            let photo = root.join(format!("{i:04}.color.png"));
            std::fs::rename(root.join(format!("{i:04}.png")), photo).unwrap();
            std::fs::write(root.join(format!("{i:04}.depth.png")), b"").unwrap();
        }
        let lens = in_folders.path().join("intrinsic/intrinsic_color.txt");
        std::fs::copy(lens, root.join("camera-intrinsics.txt")).unwrap();
        for folder in [in_folders.path(), root] {
            let listing = list_capture(folder).unwrap();
            assert_cameras(&listing, &shifted_cameras());
        }
        let listing = list_capture(root).unwrap();
        assert_contains(&listing.recognised, "9 depth maps");
        let has_its = |frame: &Frame| {
            let depth = frame.depth.as_ref().unwrap();
            let photo = frame.photo.to_string_lossy().replace(".color.", ".depth.");
            depth.path.to_string_lossy() == photo
        };
        assert!(listing.frames().all(has_its), "each has its own");
    }

    #[test]
    fn lost_poses_are_left_out_and_broken_ones_are_errors_that_name_the_file() {
        let folder = folder();
        let root = folder.path();
        write_rgbd(root, &shifted_cameras());
        write_photos(&root.join("color"), 9);
        std::fs::write(root.join("pose/0003.txt"), "-inf ".repeat(16)).unwrap();
        let listing = list_capture(root).unwrap();
        assert_eq!(listing.frames().count(), 8, "what is left");
        assert_contains(&listing.problems[0].what, "0003");
        for (file, text, expected) in [
            (
                "pose/0004.txt",
                "1 2 3",
                "0004.txt: pose: not the 16 numbers",
            ),
            ("pose/0004.txt", "1 x", "\"x\" is not a number"),
            (
                "intrinsic/intrinsic_color.txt",
                "1 2",
                "2 numbers are neither a matrix of 3 x 3",
            ),
        ] {
            let before = std::fs::read(root.join(file)).unwrap();
            std::fs::write(root.join(file), text).unwrap();
            assert_error(list_capture(root), &[expected]);
            std::fs::write(root.join(file), before).unwrap();
        }
    }
}
