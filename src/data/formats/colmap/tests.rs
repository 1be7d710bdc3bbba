//! Models written by hand, whole and broken.

use proptest::prelude::*;

use super::*;
use crate::data::formats::test_formats::{
    assert_cameras, cameras, capture, folder, shifted_cameras, write_colmap_binary,
    write_colmap_text, write_photos,
};
use crate::data::list_capture;
use crate::data::test_asserts::{assert_contains, assert_error};
use crate::geometry::{Camera, Distortion, LensModel};

type Write = fn(&Path, &[Camera]);
const WRITERS: [Write; 2] = [write_colmap_binary, write_colmap_text];

#[test]
fn binary_and_text_models_are_read_wherever_they_lie() {
    let mut cameras = shifted_cameras();
    for camera in &mut cameras {
        camera.distortion.k1 = 0.1;
        camera.distortion.p2 = -0.01;
    }
    for write in WRITERS {
        for below in ["sparse/0", "colmap/sparse/0", "sparse", ""] {
            let folder = folder();
            write(&folder.path().join(below), &cameras);
            write_photos(&folder.path().join("images"), 9);
            let listing = list_capture(folder.path()).unwrap();
            assert_contains(&listing.recognised, "COLMAP");
            let points = listing.points.clone().unwrap();
            assert_eq!(points.colors, [[10, 20, 30]], "points in \"{below}\"");
            let seeing = points.photos.iter().filter(|photo| photo.points == [0]);
            let names: Vec<&str> = seeing.map(|photo| photo.name.as_str()).collect();
            assert_eq!(names, ["0000"], "tracks in \"{below}\"");
            assert_eq!(listing.split.test[0].name, "0000", "sorted by name");
            assert_cameras(&listing, &cameras);
            let by_folder = list_capture(&folder.path().join(below)).unwrap();
            assert_eq!(by_folder.frames().count(), 9, "by the model's folder");
        }
    }
}

#[test]
fn photos_of_scaled_folders_and_masks_are_found() {
    let folder = capture("images_4", |root| {
        write_colmap_binary(&root.join("sparse/0"), &cameras());
        write_photos(&root.join("masks"), 9);
    });
    for i in 0..9 {
        let mask = folder.path().join(format!("masks/{i:04}.png"));
        std::fs::rename(&mask, mask.with_extension("png.png")).unwrap();
    }
    let listing = list_capture(folder.path()).unwrap();
    let first = listing.frames().next().unwrap();
    let photo = &first.photo;
    assert!(photo.ends_with("images_4/0001.png"), "{photo:?}");
    let mask = first.mask.as_ref().unwrap();
    assert!(mask.ends_with("masks/0001.png.png"), "{mask:?}");
}

/// The model of [`cameras`] with another lens, as a line of `cameras.txt`.
fn read_lens(line: &str) -> Result<Model, DataError> {
    let folder = folder();
    write_colmap_text(folder.path(), &cameras());
    std::fs::write(folder.path().join("cameras.txt"), format!("7 {line}\n")).unwrap();
    read_colmap_model(folder.path(), Keep::PosesAndPoints)
}

#[test]
fn every_lens_is_read() {
    let radial = |k1, k2| Distortion {
        k1,
        k2,
        ..Distortion::default()
    };
    let tangential = |k3| Distortion {
        p1: 0.3,
        p2: 0.4,
        k3,
        ..radial(0.1, 0.2)
    };
    let fisheye = |k3, k4| Distortion {
        model: LensModel::Fisheye,
        k3,
        k4,
        ..radial(0.1, 0.2)
    };
    let whole = "50 51 20 15 0.1 0.2 0.3 0.4";
    let longer = &format!("{whole} 0.5 0 0 0");
    for (name, params, distortion) in [
        ("SIMPLE_PINHOLE", "50 20 15", radial(0.0, 0.0)),
        ("PINHOLE", "50 51 20 15", radial(0.0, 0.0)),
        ("SIMPLE_RADIAL", "50 20 15 0.1", radial(0.1, 0.0)),
        ("RADIAL", "50 20 15 0.1 0.2", radial(0.1, 0.2)),
        ("OPENCV", whole, tangential(0.0)),
        ("OPENCV_FISHEYE", whole, fisheye(0.3, 0.4)),
        ("FULL_OPENCV", longer, tangential(0.5)),
        ("RADIAL_FISHEYE", "50 20 15 0.1 0.2", fisheye(0.0, 0.0)),
    ] {
        let model = read_lens(&format!("{name} 40 30 {params}")).unwrap();
        let lens = model.cameras[0].intrinsics;
        let fl_y = if params.contains("51") { 51.0 } else { 50.0 };
        assert_eq!((lens.fl_x, lens.fl_y), (Some(50.0), Some(fl_y)), "{name}");
        assert_eq!((lens.cx, lens.cy), (Some(20.0), Some(15.0)), "{name}");
        assert_eq!(lens.size, Some((40, 30)), "{name}");
        assert_eq!(lens.distortion, distortion, "{name}");
    }
}

#[test]
fn lenses_that_cannot_be_used_are_refused_by_name() {
    for (line, expected) in [
        ("FOV 40 30 50 51 20 15 0.1", "FOV is not supported"),
        (
            "FULL_OPENCV 40 30 5 5 2 1 0 0 0 0 0 1 0 0",
            "with k4, k5 or k6",
        ),
        ("EYE 40 30 50", "\"EYE\" is not a camera model"),
        ("PINHOLE 40 30 -50 51 20 15", "not positive"),
        ("PINHOLE 40 30 50 51 20", "PARAMS: the line ends here"),
        ("PINHOLE 40 30 50 51 20 nan", "NaN is not a finite number"),
        ("PINHOLE 0 30 50 51 20 15", "not a picture size"),
        ("PINHOLE 40 99999999999 50 51 20 15", "not a picture size"),
    ] {
        assert_error(read_lens(line), &[expected, "cameras.txt: line 1"]);
    }
}

#[test]
fn names_that_lead_out_and_lenses_that_are_not_there_are_errors() {
    let folder = folder();
    write_colmap_text(&folder.path().join("sparse/0"), &cameras());
    let path = folder.path().join("sparse/0/images.txt");
    for (line, expected) in [
        (
            "1 1 0 0 0 0 0 0 7 ../../etc/passwd",
            "leads out of the capture",
        ),
        ("1 1 0 0 0 0 0 0 7 /etc/passwd", "is an absolute path"),
        ("1 1 0 0 0 0 0 0 8 a.png", "there is no camera 8"),
        ("1 0 0 0 0 0 0 0 7 a.png", "is not a rotation"),
        ("1 1 0 0 0 0 0 1e300 7 a.png", "too far away"),
        ("1 1 0 0 0 0 0 0 7", "NAME: the line ends here"),
        ("# nothing", "no photo is registered"),
    ] {
        std::fs::write(&path, format!("{line}\n\n")).unwrap();
        assert_error(list_capture(folder.path()), &[expected, "images.txt"]);
    }
}

#[test]
fn counts_that_the_file_cannot_hold_are_refused_before_allocation() {
    let folder = folder();
    write_colmap_binary(folder.path(), &cameras());
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        let huge = [&u64::MAX.to_le_bytes(), &whole[8..]].concat();
        std::fs::write(&path, huge).unwrap();
        let model = read_colmap_model(folder.path(), Keep::Observations);
        assert_error(model, &[name, "has room for"]);
        std::fs::write(&path, whole).unwrap();
    }
    let path = folder.path().join("images.bin");
    let mut bytes = std::fs::read(&path).unwrap();
    let name = bytes.windows(8).position(|w| w == b"0008.png").unwrap();
    bytes[name] = 0xff;
    std::fs::write(&path, bytes).unwrap();
    let model = read_colmap_model(folder.path(), Keep::Observations);
    assert_error(model, &["frame 0, name: not UTF-8"]);
}

#[test]
fn a_model_cut_anywhere_is_an_error_or_shorter() {
    for write in WRITERS {
        let folder = folder();
        write(folder.path(), &cameras()[..2]);
        let is_binary = folder.path().join("images.bin").is_file();
        for entry in folder.path().read_dir().unwrap() {
            let path = entry.unwrap().path();
            let whole = std::fs::read(&path).unwrap();
            for n in 0..whole.len() {
                std::fs::write(&path, &whole[..n]).unwrap();
                for keep in [Keep::Observations, Keep::PosesAndPoints] {
                    let result = read_colmap_model(folder.path(), keep);
                    // A text file may end after any digit; a binary one knows its length.
                    assert!(result.is_err() || !is_binary, "{path:?} cut at {n}");
                }
            }
            std::fs::write(&path, whole).unwrap();
        }
    }
}

proptest! {
    #[test]
    fn a_damaged_model_never_panics(which in 0_usize..3, at in 0_usize..2000, byte in 0_u8..) {
        for write in WRITERS {
            let folder = folder();
            write(folder.path(), &cameras()[..2]);
            let mut files: Vec<_> = folder.path().read_dir().unwrap().flatten().collect();
            files.sort_by_key(std::fs::DirEntry::path);
            let path = files[which].path();
            let mut bytes = std::fs::read(&path).unwrap();
            let at = at % bytes.len();
            bytes[at] = byte;
            std::fs::write(&path, bytes).unwrap();
            if let Ok(listing) = list_capture(folder.path()) {
                prop_assert!(listing.frames().all(|frame| frame.world_from_camera.is_finite()));
            }
        }
    }
}
