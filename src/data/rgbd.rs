//! Captures of depth cameras: a text file with a 4 x 4 pose for each photo, camera to world, x right, y down, z
//! forward.
//!
//! `ScanNet` and its kin: `pose/12.txt` beside `color/12.jpg`, the lens in `intrinsic/intrinsic_color.txt`.
//! `KinectFusion`, `BundleFusion`, 7-Scenes and `3DMatch`: `frame-000012.pose.txt` beside `frame-000012.color.png`, the
//! lens in `camera-intrinsics.txt`, there or one folder above. Depth maps lie in `depth/` or are called
//! `frame-000012.depth.png`; their lens is the photos' unless `intrinsic/intrinsic_depth.txt` is there.

use std::path::{Path, PathBuf};

use super::capture_path::{read_text, with_extension};
use super::depth::MILLIMETRE;
use super::frame::{rotation_and_translation, world_from_opencv};
use super::listing::{Found, Listed};
use super::problem::first_names;
use super::{DataError, DepthFile, Frame, Intrinsics, Problem, Severity};

/// The largest text file read.
const MAX_BYTES: u64 = 1 << 20;
/// Most files looked at in a folder.
const MAX_FILES: usize = 200_000;
const POSE_FOLDERS: [&str; 2] = ["pose", "poses"];
const PHOTO_FOLDERS: [&str; 4] = ["color", "rgb", "images", "image"];
/// Where the lens may stand, from the capture's folder.
const LENSES: [&str; 9] = [
    "intrinsic/intrinsic_color.txt",
    "intrinsics/intrinsic_color.txt",
    "intrinsic_color.txt",
    "intrinsic.txt",
    "intrinsics.txt",
    "camera-intrinsics.txt",
    "camera_intrinsics.txt",
    "K.txt",
    "../camera-intrinsics.txt",
];
/// Where the lens of the depth maps may stand, from the capture's folder.
const DEPTH_LENSES: [&str; 3] = [
    "intrinsic/intrinsic_depth.txt",
    "intrinsics/intrinsic_depth.txt",
    "intrinsic_depth.txt",
];
const POSE_ENDING: &str = ".pose.txt";

pub(super) const LOOKED_FOR: &str = "depth cameras: pose/*.txt with color/ and intrinsic/intrinsic_color.txt, or \
     frame-*.pose.txt with frame-*.color.* and camera-intrinsics.txt";

/// The folder with the poses, where there is a lens too.
pub(super) fn find(root: &Path) -> Option<Found> {
    lens_of(root)?;
    let folders = POSE_FOLDERS.iter().map(|name| root.join(name));
    let file = folders
        .chain([root.to_owned()])
        .find(|folder| pose_files(folder, root).is_ok_and(|poses| !poses.is_empty()))?;
    Some(Found {
        root: root.to_owned(),
        file,
    })
}

fn lens_of(root: &Path) -> Option<PathBuf> {
    let files = LENSES.iter().map(|name| root.join(name));
    files.into_iter().find(|file| file.is_file())
}

/// The pose files in a folder, sorted by number, with what their photos are called.
fn pose_files(folder: &Path, root: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let io = |e| DataError::io(folder, e);
    let ending = if folder == root { POSE_ENDING } else { ".txt" };
    let mut poses = Vec::new();
    for entry in folder.read_dir().map_err(io)?.take(MAX_FILES) {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        let stem = name.and_then(|name| name.strip_suffix(ending));
        if let Some(stem) = stem {
            poses.push((stem.to_owned(), path));
        }
    }
    // 10.txt comes after 9.txt.
    poses.sort_by_cached_key(|(stem, _)| (stem.len(), stem.clone()));
    Ok(poses)
}

/// Lists the photos in the order of their numbers.
pub(super) fn list(found: &Found) -> Result<Listed, DataError> {
    let root = &found.root;
    let lens_file = lens_of(root).ok_or_else(|| DataError::NotADataset {
        path: root.clone(),
        problem: "poses are there, but no camera-intrinsics.txt".to_owned(),
    })?;
    let lens = read_lens(&lens_file)?;
    let depth_lens = DEPTH_LENSES.iter().map(|name| root.join(name));
    let depth_lens = depth_lens.into_iter().find(|file| file.is_file());
    let depth_lens = depth_lens.as_deref().map(read_lens).transpose()?;
    let mut n_depths = 0;
    let poses = pose_files(&found.file, root)?;
    let n_poses = poses.len();
    let (mut frames, mut lost) = (Vec::new(), Vec::new());
    for (index, (stem, path)) in poses.into_iter().enumerate() {
        let numbers = read_numbers(&path)?;
        // Cameras that lost track of where they were write infinities.
        if numbers.iter().any(|v| !v.is_finite()) {
            lost.push(stem);
            continue;
        }
        let pose = (numbers.len() == 16)
            .then(|| rotation_and_translation(&numbers))
            .flatten();
        let (rotation, position) = pose.ok_or_else(|| {
            fault(
                &path,
                "pose",
                "not the 16 numbers of a rotation and a position",
            )
        })?;
        let rotation = rotation.transpose();
        let pose = world_from_opencv(rotation, -(rotation * position));
        let photo = photo_of(root, &found.file, &stem);
        let mut depth = depth_of(root, &found.file, &stem);
        if let Some(file) = &mut depth {
            file.lens = depth_lens;
            n_depths += 1;
        }
        frames.push(Frame {
            depth,
            ..Frame::new(index, photo, pose, lens, &lens_file)
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
            if n_depths > 0 {
                format!(", {n_depths} depth maps")
            } else {
                String::new()
            }
        ),
        frames,
        points: None,
        problems,
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
    let folder = PHOTO_FOLDERS
        .iter()
        .map(|name| root.join(name))
        .find(|folder| folder.is_dir())
        .unwrap_or_else(|| root.join(PHOTO_FOLDERS[0]));
    with_extension(folder.join(stem))
}

/// The lens: a 3 x 3 or 4 x 4 matrix, pixel centres at whole numbers.
fn read_lens(path: &Path) -> Result<Intrinsics, DataError> {
    let numbers = read_numbers(path)?;
    let side = match numbers.len() {
        9 => 3,
        16 => 4,
        n => {
            let problem = format!("{n} numbers are not a 3 x 3 or 4 x 4 matrix");
            return Err(fault(path, "matrix", &problem));
        }
    };
    let at = |row: usize, column: usize| numbers[row * side + column] as f32;
    let (fx, fy) = (at(0, 0), at(1, 1));
    let is_usable = [fx, fy, at(0, 2), at(1, 2)].iter().all(|v| v.is_finite());
    if !is_usable || fx <= 0.0 || fy <= 0.0 {
        return Err(fault(
            path,
            "matrix",
            "the focal lengths are not greater than 0",
        ));
    }
    Ok(Intrinsics {
        fl_x: Some(fx),
        fl_y: Some(fy),
        // Ours has the first pixel's centre at one half.
        cx: Some(at(0, 2) + 0.5),
        cy: Some(at(1, 2) + 0.5),
        ..Intrinsics::default()
    })
}

fn read_numbers(path: &Path) -> Result<Vec<f64>, DataError> {
    let text = read_text(path, MAX_BYTES)?;
    text.split_whitespace()
        .map(|word| {
            word.parse()
                .map_err(|_unparsed| fault(path, "matrix", &format!("\"{word}\" is not a number")))
        })
        .collect()
}

fn fault(path: &Path, field: &str, problem: &str) -> DataError {
    DataError::Field {
        path: path.to_owned(),
        frame: None,
        field: field.to_owned(),
        problem: problem.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::list_capture;
    use super::super::test_formats::{
        assert_cameras, folder, shifted_cameras, write_photos, write_rgbd,
    };
    use super::*;

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
            let mut frames: Vec<Frame> = listing.frames().cloned().collect();
            for frame in &mut frames {
                // The check tells cameras by the number in the photo's name.
                let name = frame.photo.to_string_lossy().replace(".color", "");
                frame.photo = name.into();
            }
            assert_cameras(&frames, &shifted_cameras());
        }
        let listing = list_capture(root).unwrap();
        let said = &listing.recognised;
        assert!(said.contains("9 depth maps"), "{said}");
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
        assert!(
            listing.problems[0].what.contains("0003"),
            "{:?}",
            listing.problems
        );
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
                "2 numbers are not a 3 x 3",
            ),
        ] {
            let before = std::fs::read(root.join(file)).unwrap();
            std::fs::write(root.join(file), text).unwrap();
            let message = list_capture(root).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
            std::fs::write(root.join(file), before).unwrap();
        }
    }
}
