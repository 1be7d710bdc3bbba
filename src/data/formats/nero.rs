//! `NeRO`'s synthetic captures: `0-camera.pkl`, `0.png` and `0-depth.png`, `1-camera.pkl` and so on.
//!
//! A camera is a pickled pair: the 3 x 4 pose from world to camera (x right, y down, z forward) and the 3 x 3 lens, pixel
//! centres at whole numbers. Depth maps count 15 units in 65535 steps; from 14.5 on there is nothing, which is the mask
//! (`dataset/database.py` of liuyuan-pal/NeRO). Its real captures hold a COLMAP model.

use std::path::Path;

use super::found::{Found, Layout, Listed};
use crate::data::files::capture_path::read_bytes;
use crate::data::files::pickle;
use crate::data::frame::{rotation_and_translation, world_from_opencv};
use crate::data::{DataError, DepthFile, Frame, Intrinsics};

const FIRST: &str = "0-camera.pkl";
/// Most cameras that are looked for.
const MAX_CAMERAS: usize = 100_000;
/// Scene units of a step of the depth maps, and the depth from which nothing is there.
const DEPTH_UNIT: f32 = 15.0 / 65535.0;
const NOTHING_FROM: f32 = 14.5;

pub(super) const LAYOUT: Layout = Layout {
    name: "NeRO",
    looked_for: "NeRO: 0-camera.pkl with 0.png and 0-depth.png",
    find: |root| Found::first(root, &[FIRST]),
    of_file: |file| Found::with_extension(file, "pkl"),
    list,
};

/// Lists the photos in the order of their numbers.
fn list(found: &Found) -> Result<Listed, DataError> {
    let files = (0..MAX_CAMERAS).map(|i| found.root.join(format!("{i}-camera.pkl")));
    let files = files.take_while(|file| file.is_file()).enumerate();
    let frames = files.map(|(i, file)| read_frame(&found.root, i, &file));
    let frames: Vec<Frame> = frames.collect::<Result<_, _>>()?;
    let n_depths = frames.iter().filter(|frame| frame.depth.is_some()).count();
    Ok(Listed {
        recognised: format!("NeRO: {} cameras, {n_depths} depth maps", frames.len()),
        frames,
        points: None,
        problems: Vec::new(),
    })
}

fn read_frame(root: &Path, index: usize, file: &Path) -> Result<Frame, DataError> {
    let fail = |field: &str, problem: &str| DataError::field(file, field, problem);
    let bytes = read_bytes(file, pickle::MAX_BYTES)?;
    let arrays = pickle::arrays(&bytes).map_err(|problem| fail("pickle", &problem))?;
    let of_shape = |shape: &[usize]| arrays.iter().find(|array| array.shape == shape);
    let (Some(pose), Some(lens)) = (of_shape(&[3, 4]), of_shape(&[3, 3])) else {
        let shapes: Vec<&[usize]> = arrays.iter().map(|array| array.shape.as_slice()).collect();
        let problem = format!("a pose of 3 x 4 and a lens of 3 x 3 were expected, not {shapes:?}");
        return Err(fail("pickle", &problem));
    };
    let pose = rotation_and_translation(&pose.values);
    let (rotation, translation) =
        pose.ok_or_else(|| fail("pose", "not a rotation and a translation"))?;
    let lens = [0, 4, 2, 5].map(|i| lens.values[i] as f32);
    let lens = Intrinsics::pinhole_at_whole_centers(lens);
    let lens = lens.ok_or_else(|| fail("lens", "no focal lengths"))?;
    let photo = root.join(format!("{index}.png"));
    let pose = world_from_opencv(rotation, translation);
    let depth = DepthFile::find(&root.join(format!("{index}-depth")), DEPTH_UNIT);
    Ok(Frame {
        depth: depth.map(|depth| DepthFile {
            nothing_from: NOTHING_FROM,
            ..depth
        }),
        ..Frame::new(index, photo, pose, lens, file)
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_formats::{
        SIZE, assert_cameras, folder, shifted_cameras, write_nero, write_photos,
    };
    use super::*;
    use crate::data::test_asserts::assert_error;
    use crate::data::{Dataset, LoadOptions, list_capture};

    #[test]
    fn cameras_are_those_of_other_formats_and_depths_are_masks() {
        let folder = folder();
        let root = folder.path();
        write_photos(root, 9);
        for i in 0..9 {
            let photo = root.join(format!("{i}.png"));
            std::fs::rename(root.join(format!("{i:04}.png")), photo).unwrap();
            // The left half shows something at 2 units.
            let depth = image::ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| {
                image::Luma([if x < SIZE.0 / 2 { 8738_u16 } else { u16::MAX }])
            });
            depth.save(root.join(format!("{i}-depth.png"))).unwrap();
        }
        write_nero(root, &shifted_cameras());
        let listing = list_capture(root).unwrap();
        assert!(listing.recognised.contains("NeRO: 9 cameras, 9 depth maps"));
        assert_cameras(&listing, &shifted_cameras());
        let first = listing.frames().next().unwrap();
        let (_, _, depths) = first.depth.as_ref().unwrap().read().unwrap();
        assert!((depths[0] - 2.0).abs() < 1e-3, "{}", depths[0]);
        let dataset = Dataset::load(root, &LoadOptions::default()).unwrap();
        let mask = dataset.train[0].mask.as_ref().unwrap();
        assert!(mask.is_object(0) && !mask.is_object(SIZE.0 as usize - 1));
    }

    #[test]
    fn pickles_of_something_else_are_named() {
        let folder = folder();
        write_photos(folder.path(), 1);
        let file = folder.path().join(FIRST);
        for (bytes, expected) in [
            (&b"N."[..], "a pose of 3 x 4 and a lens of 3 x 3"),
            (b"cposix\nsystem\n)R.", "pickle: it calls posix.system"),
            (b"", "ends early"),
        ] {
            std::fs::write(&file, bytes).unwrap();
            assert_error(list_capture(folder.path()), &[expected, "0-camera.pkl"]);
        }
    }
}
