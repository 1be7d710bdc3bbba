//! IDR and `NeuS` captures: `cameras_sphere.npz` or `cameras.npz` beside `image/` and `mask/`.
//!
//! `world_mat_i` projects the world to the pixels of photo `i` (pixel centres at whole numbers);
//! `scale_mat_i` maps the unit sphere around the object to the world. The capture's frame is that
//! of the unit sphere, as in those programs: cameras are the parts K, R, t of their product.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3};

use super::found::{Found, Layout, Listed};
use super::photo_folder::{list_pictures, match_by_position, photo_folder};
use crate::data::files::npy::{Array, read_npz};
use crate::data::frame::world_from_opencv;
use crate::data::{DataError, Frame, Intrinsics, Problem, Severity};

const FILES: [&str; 3] = ["cameras_sphere.npz", "cameras.npz", "cameras_large.npz"];
/// The most cameras that indices are tried for.
const MAX_CAMERAS: usize = 100_000;
/// Share of the focal length up to which a sheared pixel grid counts as rounding.
const MAX_SKEW: f64 = 0.005;

pub(super) const LAYOUT: Layout = Layout {
    name: "IDR or NeuS",
    looked_for: "IDR, NeuS: cameras_sphere.npz or cameras.npz with image/ and mask/",
    find: |root| Found::first(root, &FILES),
    of_file: |file| Found::with_extension(file, "npz"),
    list,
};

/// Lists the photos in the order of the matrices.
fn list(found: &Found) -> Result<Listed, DataError> {
    let is_wanted = |name: &str| name.starts_with("world_mat_") || name.starts_with("scale_mat_");
    let arrays = read_npz(&found.file, is_wanted)?;
    let fail = |field: String, problem: String| DataError::field(&found.file, field, problem);
    let n = (0..MAX_CAMERAS)
        .take_while(|i| arrays.contains_key(&format!("world_mat_{i}")))
        .count();
    if n == 0 {
        return Err(fail("world_mat_0".to_owned(), "missing".to_owned()));
    }
    let (folder, photos) = photos_of(&found.root)?;
    let n_photos = photos.len();
    let Some(photos) = match_by_position(&photos, n) else {
        let problem = format!(
            "{n} cameras, but {n_photos} photos in {}, and their names do not show which is which",
            found.shown(&folder)
        );
        return Err(fail("world_mat".to_owned(), problem));
    };
    let mut frames = Vec::new();
    for (i, photo) in photos.into_iter().enumerate() {
        let Some(photo) = photo else { continue };
        let matrix = |kind: &str| {
            let name = format!("{kind}_{i}");
            arrays
                .get(&name)
                .map(|array| matrix_of(array).map_err(|problem| fail(name, problem)))
                .transpose()
        };
        let world = matrix("world_mat")?.unwrap_or(DMat4::IDENTITY);
        let scale = matrix("scale_mat")?.unwrap_or(DMat4::IDENTITY);
        let camera = decompose(world * scale)
            .map_err(|problem| fail(format!("world_mat_{i}"), problem.to_owned()))?;
        frames.push(frame(&found.file, i, photo, &camera));
    }
    let name = found.file.file_name().unwrap_or_default().to_string_lossy();
    Ok(Listed {
        recognised: format!(
            "IDR or NeuS: {name}, photos in {}; coordinates are those of the unit sphere \
             (scale_mat)",
            found.shown(&folder)
        ),
        problems: missing_photos(n, frames.len()),
        frames,
        points: None,
    })
}

fn missing_photos(n: usize, n_there: usize) -> Vec<Problem> {
    if n == n_there {
        return Vec::new();
    }
    let what = format!("{} of {n} cameras have no photo", n - n_there);
    let advice = "photos are identified by the number in their name";
    vec![Problem::new(Severity::Warning, what, advice)]
}

fn photos_of(root: &Path) -> Result<(PathBuf, Vec<PathBuf>), DataError> {
    // NeuS's own converter leaves `images` (as taken) beside `image` (as meant).
    let folder = photo_folder(root, "image", "cameras are")?;
    let photos = list_pictures(&folder)?;
    Ok((folder, photos))
}

/// A 4 x 4 or 3 x 4 array as a matrix.
fn matrix_of(array: &Array) -> Result<DMat4, String> {
    if array.shape != [4, 4] && array.shape != [3, 4] {
        return Err(format!("{:?} is not 4 x 4", array.shape));
    }
    if !array.values.iter().all(|v| v.is_finite()) {
        return Err("not finite".to_owned());
    }
    let mut rows = [0.0; 16];
    rows[15] = 1.0;
    rows[..array.values.len()].copy_from_slice(&array.values);
    Ok(DMat4::from_cols_array(&rows).transpose())
}

/// A projection taken apart: `p_pixel ~ K (rotation p_world + translation)`.
#[derive(Debug)]
struct Decomposed {
    /// Upper triangular, last entry 1.
    k: DMat3,
    rotation: DMat3,
    translation: DVec3,
}

/// Takes the projection's upper three rows apart: the RQ decomposition by Gram and Schmidt's
/// method from the last row up.
fn decompose(projection: DMat4) -> Result<Decomposed, &'static str> {
    let m = DMat3::from_mat4(projection);
    let scale = m
        .to_cols_array()
        .iter()
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    let relative = m.determinant() / scale.powi(3);
    if relative.is_nan() || relative.abs() < 1e-12 {
        return Err("not a projection: the matrix is singular");
    }
    // A projection has no sign: take the one that puts the scene in front.
    let sign = relative.signum();
    let rows = (m * sign).transpose();
    let (a, b, c) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let k33 = c.length();
    let r3 = c / k33;
    let k23 = b.dot(r3);
    let b = b - k23 * r3;
    let k22 = b.length();
    let r2 = b / k22;
    let (k13, k12) = (a.dot(r3), a.dot(r2));
    let a = a - k13 * r3 - k12 * r2;
    let k11 = a.length();
    let r1 = a / k11;
    if k12.abs() > MAX_SKEW * k22 {
        return Err("the pixel grid is sheared");
    }
    let k = DMat3::from_cols(
        DVec3::new(k11, 0.0, 0.0),
        DVec3::new(k12, k22, 0.0),
        DVec3::new(k13, k23, k33),
    );
    let translation = k.inverse() * (projection.w_axis.truncate() * sign);
    Ok(Decomposed {
        k: k * (1.0 / k33),
        rotation: DMat3::from_cols(r1, r2, r3).transpose(),
        translation,
    })
}

fn frame(file: &Path, index: usize, photo: PathBuf, camera: &Decomposed) -> Frame {
    let k = &camera.k;
    let pose = world_from_opencv(camera.rotation, camera.translation);
    // Ours has the first pixel's centre at one half.
    let lens = [k.x_axis.x, k.y_axis.y, k.z_axis.x + 0.5, k.z_axis.y + 0.5];
    let lens = Intrinsics::pinhole(lens.map(|v| v as f32));
    Frame::new(index, photo, pose, lens, file)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::super::test_formats::{
        assert_cameras, capture, folder, shifted_cameras, write_idr, write_photos,
    };
    use super::*;
    use crate::data::files::npy::tests::{npy_of, npz_of};
    use crate::data::list_capture;
    use crate::data::test_asserts::{assert_contains, assert_error};

    #[test]
    fn matrices_are_taken_apart_and_masks_are_paired_by_number() {
        let folder = capture("image", |root| write_idr(root, &shifted_cameras()));
        write_photos(&folder.path().join("mask"), 9);
        for i in 0..9 {
            let mask = folder.path().join(format!("mask/{i:04}.png"));
            std::fs::rename(mask, folder.path().join(format!("mask/{i:03}.png"))).unwrap();
        }
        let listing = list_capture(folder.path()).unwrap();
        assert_cameras(&listing, &shifted_cameras());
        let last = listing.frames().find(|frame| frame.name == "0007").unwrap();
        let mask = last.mask.as_ref().unwrap();
        assert!(mask.ends_with("mask/007.png"), "{mask:?}");
    }

    #[test]
    fn missing_photos_are_recognised_by_number() {
        let folder = capture("image", |root| write_idr(root, &shifted_cameras()));
        std::fs::remove_file(folder.path().join("image/0003.png")).unwrap();
        let listing = list_capture(folder.path()).unwrap();
        assert_contains(&listing.problems[0].what, "1 of 9 cameras have no photo");
        let cameras = shifted_cameras();
        assert_eq!(listing.frames().count(), 8, "what is left");
        for frame in listing.frames() {
            assert!(frame.name.ends_with(&frame.index.to_string()), "{frame:?}");
            let expected = cameras[frame.index].position();
            let position = Vec3::from(frame.world_from_camera.translation);
            assert!(position.distance(expected) < 1e-3, "{}", frame.name);
        }
    }

    #[test]
    fn faults_name_the_file_and_the_matrix() {
        let folder = folder();
        let path = folder.path().join(FILES[0]);
        write_photos(&folder.path().join("image"), 1);
        let with = |name: &str, shape: &[usize], values: &[f64]| {
            let array = (name.to_owned(), npy_of(shape, values));
            std::fs::write(&path, npz_of(&[array])).unwrap();
            list_capture(folder.path())
        };
        let mut sheared = [0.0; 16];
        for (at, value) in [(0, 50.0), (1, 20.0), (5, 50.0), (10, 1.0), (15, 1.0)] {
            sheared[at] = value;
        }
        let mut broken = sheared;
        broken[3] = f64::INFINITY;
        for (name, shape, values, expected) in [
            (
                "world_mat_1",
                &[4, 4][..],
                &sheared[..],
                "world_mat_0: missing",
            ),
            (
                "world_mat_0",
                &[4, 4],
                &sheared,
                "the pixel grid is sheared",
            ),
            ("world_mat_0", &[4, 4], &broken, "not finite"),
            ("world_mat_0", &[4, 4], &[0.0; 16], "the matrix is singular"),
            ("world_mat_0", &[2, 8], &[0.0; 16], "is not 4 x 4"),
        ] {
            let result = with(name, shape, values);
            assert_error(result, &[expected, FILES[0], "world_mat_0"]);
        }
    }

    proptest! {
        #[test]
        fn any_camera_is_found_again(
            turn in prop::array::uniform4(-1.0_f64..1.0), t in prop::array::uniform3(-5.0_f64..5.0),
            f in 100.0_f64..3000.0, factor in prop_oneof![-5.0_f64..-0.01, 0.01_f64..5.0]
        ) {
            let rotation = glam::DQuat::from_array(turn);
            prop_assume!(rotation.length() > 0.1);
            let rotation = DMat3::from_quat(rotation.normalize());
            let k = DMat3::from_cols(
                DVec3::new(f, 0.0, 0.0), DVec3::new(0.0, 1.1 * f, 0.0), DVec3::new(320.0, 240.0, 1.0)
            );
            let translation = DVec3::from_array(t);
            let mut extrinsic = DMat4::from_mat3(rotation);
            extrinsic.w_axis = translation.extend(1.0);
            let found = decompose(DMat4::from_mat3(k) * extrinsic * factor).unwrap();
            prop_assert!(found.rotation.abs_diff_eq(rotation, 1e-9), "{found:?}");
            prop_assert!(found.translation.abs_diff_eq(translation, 1e-8), "{found:?}");
            prop_assert!(found.k.abs_diff_eq(k, 1e-6), "{found:?}");
        }
    }
}
