//! LLFF captures: `poses_bounds.npy` beside `images/`, as LLFF's `imgs2poses.py` writes them.
//!
//! Row `i` belongs to the `i`-th photo in the order of names: 15 numbers are a 3 x 5 matrix, row
//! by row, and two are the nearest and farthest depth. The matrix's columns are the camera's down,
//! right and backward axes, its position, and (height, width, focal length in pixels).

use std::path::{Path, PathBuf};

use glam::{Affine3A, DMat3, DVec3};

use super::found::{Found, Layout, Listed};
use super::photo_folder::{list_pictures, photo_folders};
use crate::data::files::npy::{Array, read_npy};
use crate::data::frame::{is_rotation, is_side_px};
use crate::data::{DataError, Frame, Intrinsics};

const FILE: &str = "poses_bounds.npy";

pub(super) const LAYOUT: Layout = Layout {
    name: "LLFF",
    looked_for: "LLFF: poses_bounds.npy with images/",
    find: |root| Found::first(root, &[FILE]),
    of_file: |file| Found::with_extension(file, "npy"),
    list,
};

/// Lists the photos in the order of names.
fn list(found: &Found) -> Result<Listed, DataError> {
    let array = read_npy(&found.file)?;
    let fail = |field: &str, problem: String| DataError::field(&found.file, field, problem);
    let &[n, 17] = array.shape.as_slice() else {
        return Err(fail("shape", format!("{:?} is not N x 17", array.shape)));
    };
    if n == 0 {
        return Err(fail("shape", "no pose is in it".to_owned()));
    }
    let (folder, photos) = photos_of(&found.root, n)?;
    if photos.len() != n {
        let problem = format!(
            "{n} poses, but {} photos in {}; each row belongs to the photo at its place in the \
             order of names, so none may be missing",
            photos.len(),
            found.shown(&folder)
        );
        return Err(fail("rows", problem));
    }
    let frames = photos
        .into_iter()
        .enumerate()
        .map(|(i, photo)| frame(&found.file, &array, i, photo))
        .collect::<Result<_, _>>()?;
    let recognised = format!("LLFF: {FILE}, photos in {}", found.shown(&folder));
    Ok(Listed {
        frames,
        recognised,
        ..Listed::default()
    })
}

/// The folder with as many photos as there are poses, else the first one.
fn photos_of(root: &Path, n: usize) -> Result<(PathBuf, Vec<PathBuf>), DataError> {
    let mut first = None;
    for folder in photo_folders(root) {
        let photos = list_pictures(&folder)?;
        if photos.len() == n {
            return Ok((folder, photos));
        }
        first = first.or(Some((folder, photos)));
    }
    let problem = format!("{FILE} is there, but no folder images/ with photos");
    first.ok_or_else(|| DataError::no_capture(root, problem))
}

fn frame(file: &Path, array: &Array, index: usize, photo: PathBuf) -> Result<Frame, DataError> {
    let row = &array.values[17 * index..17 * (index + 1)];
    let fail = |field: &str, problem| DataError::field(file, field, problem).in_frame(index);
    if !row.iter().all(|v| (*v as f32).is_finite()) {
        return Err(fail("row", "not finite"));
    }
    let column = |j: usize| DVec3::new(row[j], row[5 + j], row[10 + j]);
    let (down, right, back, position) = (column(0), column(1), column(2), column(3));
    let [height, width, focal] = column(4).to_array();
    let rotation = DMat3::from_cols(right, -down, back);
    if !is_rotation(rotation) {
        return Err(fail("axes", "not a rotation"));
    }
    if !is_side_px(height) || !is_side_px(width) {
        return Err(fail("height, width", "not a picture size"));
    }
    if focal <= 0.0 {
        return Err(fail("focal length", "not greater than 0"));
    }
    let pose = Affine3A::from_mat3_translation(rotation.as_mat3(), position.as_vec3());
    let lens = Intrinsics {
        // Sizes of photos shrunk after calibration may come with a fraction.
        size: Some((width.round() as u32, height.round() as u32)),
        fl_x: Some(focal as f32),
        ..Intrinsics::default()
    };
    Ok(Frame {
        depth_range: Some([row[15] as f32, row[16] as f32]),
        ..Frame::new(index, photo, pose, lens, file)
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{assert_cameras, cameras, folder, write_llff, write_photos};
    use super::*;
    use crate::data::files::npy::tests::npy_of;
    use crate::data::list_capture;
    use crate::data::test_asserts::{assert_contains, assert_error};

    #[test]
    fn poses_go_with_photos_in_the_order_of_names() {
        let folder = folder();
        write_llff(folder.path(), &cameras());
        write_photos(&folder.path().join("images_4"), 9);
        // A folder with another number of photos is not the one that was measured.
        write_photos(&folder.path().join("images"), 11);
        let listing = list_capture(folder.path()).unwrap();
        assert_contains(&listing.recognised, "images_4");
        assert_cameras(&listing, &cameras());
        let first = listing.frames().next().unwrap();
        assert_eq!(first.depth_range, Some([1.5, 9.0]), "depths");
    }

    #[test]
    fn faults_name_the_file_and_the_field() {
        let folder = folder();
        let path = folder.path().join(FILE);
        let assert_error = |part: &str| assert_error(list_capture(folder.path()), &[part, FILE]);
        write_llff(folder.path(), &cameras());
        assert_error("no folder images/");
        write_photos(&folder.path().join("images"), 8);
        assert_error("rows: 9 poses, but 8 photos in images");
        write_photos(&folder.path().join("images"), 1);
        let mut row = [0.0; 17];
        (row[0], row[6], row[12]) = (1.0, 1.0, 1.0);
        (row[4], row[9], row[14]) = (30.0, 40.0, 50.0);
        for (at, value, expected) in [
            (0, 0.5, "frame 0, axes: not a rotation"),
            (0, f64::NAN, "frame 0, row: not finite"),
            (4, 0.0, "height, width: not a picture size"),
            (14, -1.0, "focal length: not greater than 0"),
        ] {
            let mut row = [row; 9].concat();
            row[at] = value;
            std::fs::write(&path, npy_of(&[9, 17], &row)).unwrap();
            write_photos(&folder.path().join("images"), 9);
            assert_error(expected);
        }
        for shape in [&[9, 15][..], &[0, 17], &[153]] {
            let n = shape.iter().product();
            std::fs::write(&path, npy_of(shape, &vec![0.0; n])).unwrap();
            assert_error("shape");
        }
    }
}
