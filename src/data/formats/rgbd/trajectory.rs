//! Captures of depth cameras with all poses in one file, camera to world, x right, y down, z forward.
//!
//! `Open3D` and Redwood: `trajectory.log`, for each photo in the order of names a line of three numbers and a 4 x 4 matrix,
//! beside `color/` and `depth/` (millimetres). Replica as rendered for iMAP and NICE-SLAM: `traj.txt`, a matrix a line,
//! beside `results/frame*.jpg` and `results/depth*.png`, the lens in `cam_params.json`. TUM and ETH3D: `groundtruth.txt`,
//! `seconds x y z qx qy qz qw` a line, and `rgb.txt` and `depth.txt`, `seconds file` a line (5000 steps a metre).

use std::path::{Path, PathBuf};

use super::super::photo_folder::list_pictures;
use super::lens;
use super::poses::{Poses, records};
use crate::data::files::capture_path::{first_folder, path_below, read_text, with_extension};
use crate::data::formats::found::{Found, Layout, Listed};
use crate::data::{DataError, DepthFile, Frame, Problem, Severity};

/// Where the poses may stand, from the capture's folder.
const FILES: [&str; 5] = [
    "trajectory.log",
    "scene/trajectory.log",
    "key.log",
    "traj.txt",
    "groundtruth.txt",
];
/// The largest file read: 30,000 poses take about 5 MB.
const MAX_BYTES: u64 = 64 << 20;
const PHOTO_FOLDERS: [&str; 5] = ["color", "rgb", "image", "images", "results"];
const PHOTO_TIMES: &str = "rgb.txt";
const DEPTH_TIMES: &str = "depth.txt";
/// Longest time between a photo and its depth map, seconds.
const MAX_APART_SECS: f64 = 0.02;

pub(in crate::data::formats) const LAYOUT: Layout = Layout {
    name: "depth camera, poses in one file",
    looked_for: "depth cameras: trajectory.log with color/ and depth/, traj.txt with results/, \
                 or groundtruth.txt with rgb.txt and depth.txt",
    find: |root| {
        let has_photos = root.join(PHOTO_TIMES).is_file() || photo_folder(root).is_some();
        Found::first(root, &FILES).filter(|_| has_photos)
    },
    of_file,
    list,
};

fn of_file(file: &Path) -> Option<Found> {
    let (name, mut root) = (file.file_name()?, file.parent()?);
    let is_in_scene = root.ends_with("scene") && name == "trajectory.log";
    if is_in_scene && photo_folder(root).is_none() {
        root = root.parent()?;
    }
    let is_one = FILES.iter().any(|known| name == *known);
    is_one.then(|| Found::new(root, file))
}

fn photo_folder(root: &Path) -> Option<PathBuf> {
    first_folder(root, &PHOTO_FOLDERS)
}

/// Lists the photos in the order in which they were taken.
fn list(found: &Found) -> Result<Listed, DataError> {
    let root = &found.root;
    let poses = Poses::parse(&found.file, &read_text(&found.file, MAX_BYTES)?)?;
    let lens_file = lens::find(root);
    let lens = lens_file.as_deref().map(lens::read).transpose()?;
    let mut problems = Vec::new();
    let lens = lens.unwrap_or_else(|| {
        let what = "no file says what lens the camera has: taken for a PrimeSense's, 525 pixels of 640 x 480";
        let advice =
            "write its matrix of 3 x 3 (pixel centres at whole numbers) to intrinsics.txt";
        problems.push(Problem::new(Severity::Warning, what, advice));
        lens::prime_sense()
    });
    let shots = if root.join(PHOTO_TIMES).is_file() && matches!(poses, Poses::Timed(_)) {
        timed_shots(root)?
    } else {
        ordered_shots(found, poses.len(), &mut problems)?
    };
    let n_shots = shots.len();
    let mut frames = Vec::new();
    for (index, shot) in shots.into_iter().enumerate() {
        let Some(pose) = poses.of(index, shot.secs) else {
            continue;
        };
        let unit = lens.depth_unit.unwrap_or(poses.depth_unit());
        let depth = shot.depth.map(|path| DepthFile::new(path, unit));
        let listed_in = lens_file.as_ref().unwrap_or(&found.file);
        frames.push(Frame {
            depth,
            ..Frame::new(index, shot.photo, pose, lens.intrinsics, listed_in)
        });
    }
    if frames.len() < n_shots {
        let what = format!(
            "{} of {n_shots} photos have no pose",
            n_shots - frames.len()
        );
        let advice =
            "the camera had lost its place, or nothing is known of that time; they are left out";
        problems.push(Problem::new(Severity::Note, what, advice).in_file(found.file.clone()));
    }
    let n_depths = frames.iter().filter(|frame| frame.depth.is_some()).count();
    Ok(Listed {
        recognised: format!(
            "depth camera: {} poses in {}, {}, {n_depths} depth maps",
            poses.len(),
            found.shown(&found.file),
            lens_file.map_or_else(
                || "no lens".to_owned(),
                |file| format!("lens in {}", found.shown(&file))
            ),
        ),
        frames,
        problems,
        ..Listed::default()
    })
}

/// A photo with the time at which it was taken and the depth map taken with it, where they are known.
struct Shot {
    secs: Option<f64>,
    photo: PathBuf,
    depth: Option<PathBuf>,
}

/// The photos that `rgb.txt` lists, each with the depth map nearest in time.
fn timed_shots(root: &Path) -> Result<Vec<Shot>, DataError> {
    let depths = root.join(DEPTH_TIMES);
    let depths = if depths.is_file() {
        timed_files(root, &depths)?
    } else {
        Vec::new()
    };
    let photos = timed_files(root, &root.join(PHOTO_TIMES))?;
    let shot = |(secs, photo): (f64, PathBuf)| {
        let next = depths.partition_point(|(at, _)| *at < secs);
        let around = &depths[next.saturating_sub(1)..(next + 1).min(depths.len())];
        let apart = |(at, _): &&(f64, PathBuf)| (at - secs).abs();
        let nearest = around.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
        let depth = nearest.filter(|depth| apart(depth) < MAX_APART_SECS);
        Shot {
            secs: Some(secs),
            photo: with_extension(photo),
            depth: depth.map(|(_, path)| path.clone()),
        }
    };
    Ok(photos.into_iter().map(shot).collect())
}

/// Times and files of a list, earliest first.
fn timed_files(root: &Path, list: &Path) -> Result<Vec<(f64, PathBuf)>, DataError> {
    let text = read_text(list, MAX_BYTES)?;
    let mut files = Vec::new();
    for (number, line) in records(&text) {
        let fail = |problem: String| DataError::field(list, format!("line {number}"), problem);
        let (secs, name) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let secs = secs.parse().ok().filter(|secs: &f64| secs.is_finite());
        let secs = secs.ok_or_else(|| fail("does not begin with seconds".to_owned()))?;
        files.push((secs, path_below(root, name.trim(), 0).map_err(fail)?));
    }
    files.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(files)
}

/// The photos in the order of their names, and as many depth maps in theirs.
fn ordered_shots(
    found: &Found,
    n_poses: usize,
    problems: &mut Vec<Problem>,
) -> Result<Vec<Shot>, DataError> {
    let root = &found.root;
    let folder = photo_folder(root).ok_or_else(|| {
        DataError::no_capture(root, "poses are there, but no folder color/ with photos")
    })?;
    let is_depth = |path: &PathBuf| {
        path.file_name()
            .is_some_and(|name| name.as_encoded_bytes().starts_with(b"depth"))
    };
    let (beside, photos): (Vec<_>, Vec<_>) = by_length(list_pictures(&folder)?)
        .into_iter()
        .partition(is_depth);
    if photos.len() != n_poses {
        let problem = format!(
            "{n_poses} poses, but {} photos in {}; each pose belongs to the photo at its place in the order of \
             names, so none may be missing",
            photos.len(),
            found.shown(&folder)
        );
        return Err(DataError::field(&found.file, "poses", problem));
    }
    let depth_folder = root.join("depth");
    let depths = if depth_folder.is_dir() {
        by_length(list_pictures(&depth_folder)?)
    } else {
        beside
    };
    if !depths.is_empty() && depths.len() != photos.len() {
        let what = format!(
            "{} depth maps and {} photos: which belong together is not known",
            depths.len(),
            photos.len()
        );
        let advice = "depth maps are left out";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    let has_each = depths.len() == photos.len();
    let mut depths = depths.into_iter().filter(|_| has_each);
    let shot = |photo| Shot {
        secs: None,
        photo,
        depth: depths.next(),
    };
    Ok(photos.into_iter().map(shot).collect())
}

/// 10.png comes after 9.png.
fn by_length(mut pictures: Vec<PathBuf>) -> Vec<PathBuf> {
    pictures.sort_by_key(|path| path.file_stem().map_or(0, std::ffi::OsStr::len));
    pictures
}

#[cfg(test)]
mod tests {
    use super::super::super::test_formats::{
        SIZE, assert_cameras, folder, shifted_cameras, write_photos, write_trajectory,
    };
    use crate::data::list_capture;
    use crate::data::test_asserts::{assert_contains, assert_error};

    /// A capture of nine photos and depth maps in the manner of `file`.
    fn capture(file: &str) -> tempfile::TempDir {
        let folder = folder();
        let root = folder.path();
        let (photos, depths) = match file {
            "traj.txt" => ("results", "results"),
            "groundtruth.txt" => ("rgb", "depth"),
            _ => ("color", "depth"),
        };
        write_photos(&root.join(photos), 9);
        std::fs::create_dir_all(root.join(depths)).unwrap();
        for i in 0..9 {
            let depth = root.join(depths).join(format!("depth{i:04}.png"));
            let codes = image::ImageBuffer::from_pixel(SIZE.0, SIZE.1, image::Luma([2000_u16]));
            codes.save(depth).unwrap();
        }
        write_trajectory(root, file, &shifted_cameras());
        folder
    }

    #[test]
    fn each_manner_gives_the_same_cameras_and_its_depths_in_metres() {
        for (file, depth) in [
            ("trajectory.log", 2.0),
            ("traj.txt", 2000.0 / 6553.5),
            ("groundtruth.txt", 0.4),
        ] {
            let capture = capture(file);
            for path in [capture.path(), &capture.path().join(file)] {
                let listing = list_capture(path).unwrap();
                let problems = &listing.problems;
                assert!(problems.is_empty(), "{file}: {problems:?}");
                assert_contains(&listing.recognised, "9 depth maps");
                assert_cameras(&listing, &shifted_cameras());
                for frame in listing.frames() {
                    let map = frame.depth.as_ref().unwrap();
                    let name = map.path.file_name().unwrap().to_string_lossy();
                    assert_eq!(name, format!("depth{}.png", frame.name), "{file}");
                    let (_, _, depths) = map.read().unwrap();
                    assert!((depths[0] - depth).abs() < 1e-4, "{file}: {}", depths[0]);
                }
            }
        }
    }

    #[test]
    fn photos_without_a_pose_are_left_out_and_a_lens_that_is_missing_is_said() {
        let capture = capture("groundtruth.txt");
        let root = capture.path();
        std::fs::remove_file(root.join("calibration.txt")).unwrap();
        let poses = std::fs::read_to_string(root.join("groundtruth.txt")).unwrap();
        // Two poses a photo: without the last one nothing is known after the last photo but one.
        let poses: Vec<&str> = poses.trim_end().lines().collect();
        std::fs::write(
            root.join("groundtruth.txt"),
            poses[..poses.len() - 1].join("\n"),
        )
        .unwrap();
        let listing = list_capture(root).unwrap();
        assert_contains(&listing.problems[0].what, "PrimeSense");
        assert_contains(&listing.problems[1].what, "1 of 9 photos have no pose");
        assert_eq!(listing.frames().count(), 8, "photos");
    }

    #[test]
    fn faults_name_the_file_and_the_line() {
        let capture = capture("trajectory.log");
        let root = capture.path();
        let whole = std::fs::read_to_string(root.join("trajectory.log")).unwrap();
        let missing_photo = whole + "9 9 10\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
        let (poses, lens) = ("trajectory.log", "camera_intrinsic.json");
        for (file, text, expected) in [
            (poses, "", "poses: none is in it"),
            (poses, "0 0 1\n1 0 0 0\n", "line 1: not a pose"),
            (poses, "0 0 1\n1 x 0 0\n", "\"x\" is not a number"),
            (poses, "0 0 0 0 0 0 0 0", "line 1: qx, qy, qz, qw"),
            (poses, &"2 ".repeat(16), "line 1: not a rotation"),
            (poses, &missing_photo, "10 poses, but 9 photos in color"),
            (
                lens,
                "{\"intrinsic_matrix\": [1]}",
                "intrinsic_matrix: not 9",
            ),
            (lens, "{\"fx\": 0}", "fx: 0 is not greater than 0"),
            (lens, "{\"fx\": 1}", "fy: missing"),
        ] {
            let before = std::fs::read(root.join(file)).unwrap();
            std::fs::write(root.join(file), text).unwrap();
            assert_error(list_capture(root), &[expected, file]);
            std::fs::write(root.join(file), before).unwrap();
        }
    }

    #[test]
    fn lost_poses_keep_their_place_and_depths_need_one_a_photo() {
        let capture = capture("traj.txt");
        let file = capture.path().join("traj.txt");
        let text = std::fs::read_to_string(&file).unwrap();
        let mut lines: Vec<&str> = text.lines().collect();
        let lost = "-inf ".repeat(16);
        // The first line is a comment.
        lines[5] = &lost;
        std::fs::write(&file, lines.join("\n")).unwrap();
        std::fs::remove_file(capture.path().join("results/depth0000.png")).unwrap();
        let listing = list_capture(capture.path()).unwrap();
        let names: Vec<&str> = listing.frames().map(|frame| frame.name.as_str()).collect();
        assert_eq!(names.len(), 8, "{names:?}");
        assert!(!names.contains(&"0004"), "{names:?}");
        assert_contains(&listing.problems[0].what, "8 depth maps and 9 photos");
        assert!(listing.frames().all(|frame| frame.depth.is_none()));
    }
}
