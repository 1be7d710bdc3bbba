//! `NeILF` and `NeILF++` captures: `inputs/sfm_scene.json` beside `inputs/images/`.
//!
//! As their `load_cams_from_sfmscene` reads it: `camera_track_map.images.I` holds a camera
//! (`focal`, `ppt`; 4 x 4 from world to camera with x right, y down, z forward) and counts when
//! `flg` is 2; `image_path.file_paths.I` is the photo's path from the scene's folder.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::found::{Found, Layout, Listed};
use super::json_fields::Fields;
use crate::data::files::capture_path::{path_below, read_json, with_extension};
use crate::data::frame::{is_side_px, rotation_and_translation, world_from_opencv};
use crate::data::{DataError, Frame, Intrinsics};

const FILE: &str = "sfm_scene.json";
/// The largest scene read: 10,000 photos take about 20 MB.
const MAX_BYTES: u64 = 128 << 20;
/// Set for cameras that were registered.
const REGISTERED: u64 = 2;

pub(super) const LAYOUT: Layout = Layout {
    name: "NeILF",
    looked_for: "NeILF: inputs/sfm_scene.json or sfm_scene.json",
    find: |root| {
        let folders = [root.join("inputs"), root.to_owned()];
        folders
            .iter()
            .find_map(|inputs| Found::first(inputs, &[FILE]))
    },
    of_file: |file| Found::with_extension(file, "json").filter(|_| file.ends_with(FILE)),
    list,
};

/// Lists the registered photos by index.
fn list(found: &Found) -> Result<Listed, DataError> {
    let json = &found.file;
    let scene: Value = read_json(json, MAX_BYTES)?;
    let top = Fields::new(json, None, &scene);
    let object = |pointer: &str| {
        let value = scene.pointer(pointer).and_then(Value::as_object);
        value.ok_or_else(|| top.error(&pointer[1..].replace('/', "."), "missing"))
    };
    let (cameras, photos) = (
        object("/camera_track_map/images")?,
        object("/image_path/file_paths")?,
    );
    let mut frames = Vec::new();
    for (key, value) in cameras {
        let index: usize = key.parse().map_err(|_unparsed| {
            top.error(
                "camera_track_map.images",
                format!("\"{key}\" is not an index"),
            )
        })?;
        let fields = Fields::new(json, index, value);
        if value.get("flg").and_then(Value::as_u64) == Some(REGISTERED) {
            let photo = photos.get(key).and_then(Value::as_str);
            let photo = photo.ok_or_else(|| fields.error("image_path.file_paths", "missing"))?;
            frames.push(frame(
                &fields,
                index,
                photo_path(&fields, &found.root, photo)?,
            )?);
        }
    }
    frames.sort_by_key(|frame| frame.index);
    Ok(Listed {
        recognised: format!("NeILF: {FILE}, {} registered photos", frames.len()),
        frames,
        ..Listed::default()
    })
}

/// The photo that a scene names: below its folder, else by its file name in `images`, since such
/// files often hold the absolute path of the machine that they were made on.
fn photo_path(fields: &Fields<'_>, root: &Path, declared: &str) -> Result<PathBuf, DataError> {
    if let Ok(path) = path_below(root, declared, 0) {
        let path = with_extension(path);
        if path.is_file() {
            return Ok(path);
        }
    }
    let name = declared.rsplit(['/', '\\']).next().unwrap_or(declared);
    path_below(&root.join("images"), name, 0)
        .map(with_extension)
        .map_err(|problem| fields.error("image_path.file_paths", problem))
}

fn frame(fields: &Fields<'_>, index: usize, photo: PathBuf) -> Result<Frame, DataError> {
    let numbers = |name: &str, pointer: &str, n: usize| {
        let list = fields.value.pointer(pointer).and_then(Value::as_array);
        let list = list.ok_or_else(|| fields.error(name, "missing"))?;
        let mut values = Vec::new();
        flatten(list, &mut values);
        if values.len() != n || !values.iter().all(|v| (*v as f32).is_finite()) {
            return Err(fields.error(name, format!("not {n} finite numbers")));
        }
        Ok(values)
    };
    let focal = numbers("focal", "/camera/intrinsic/focal", 2)?;
    let center = numbers("ppt", "/camera/intrinsic/ppt", 2)?;
    let e = numbers("extrinsic", "/camera/extrinsic", 16)?;
    if focal.iter().any(|f| *f <= 0.0) {
        return Err(fields.error("focal", "not greater than 0"));
    }
    let (rotation, translation) = rotation_and_translation(&e)
        .ok_or_else(|| fields.error("extrinsic", "not a rotation and a position"))?;
    let size = fields.value.get("size");
    let size = size.map(|_| numbers("size", "/size", 2)).transpose()?;
    if size.iter().flatten().any(|side| !is_side_px(*side)) {
        return Err(fields.error("size", "not a picture size"));
    }
    let pose = world_from_opencv(rotation, translation);
    let lens = [focal[0], focal[1], center[0], center[1]];
    let lens = Intrinsics {
        size: size.map(|size| (size[0] as u32, size[1] as u32)),
        ..Intrinsics::pinhole(lens.map(|v| v as f32))
    };
    Ok(Frame::new(index, photo, pose, lens, fields.json))
}

/// The numbers of a list of numbers or of lists of numbers.
fn flatten(list: &[Value], numbers: &mut Vec<f64>) {
    for value in list {
        match value {
            Value::Array(inner) => numbers.extend(inner.iter().filter_map(Value::as_f64)),
            other => numbers.extend(other.as_f64()),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::test_formats::{
        assert_cameras, folder, shifted_cameras, write_neilf, write_photos,
    };
    use super::*;
    use crate::data::list_capture;
    use crate::data::test_asserts::assert_error;

    #[test]
    fn registered_photos_are_listed_wherever_they_were_once() {
        let folder = folder();
        let inputs = write_neilf(folder.path(), &shifted_cameras());
        write_photos(&inputs.join("images"), 9);
        for path in [folder.path(), &inputs, &inputs.join(FILE)] {
            let listing = list_capture(path).unwrap();
            assert_cameras(&listing, &shifted_cameras());
        }
    }

    #[test]
    fn faults_name_the_file_and_the_field() {
        let folder = folder();
        let inputs = write_neilf(folder.path(), &shifted_cameras());
        let path = inputs.join(FILE);
        let scene: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let camera = "/camera_track_map/images/3/camera";
        let missing = "image_path.file_paths: missing";
        for (below, pointer, value, expected) in [
            ("", "/image_path", json!(1), missing),
            (
                camera,
                "/extrinsic",
                json!([1]),
                "frame 3, extrinsic: not 16",
            ),
            (
                camera,
                "/extrinsic",
                json!(vec![0; 16]),
                "extrinsic: not a rotation",
            ),
            (
                camera,
                "/intrinsic/focal",
                json!([0, 1]),
                "focal: not greater",
            ),
            (camera, "/intrinsic/ppt", json!(null), "ppt: missing"),
            (
                "/camera_track_map/images/3",
                "/size",
                json!([-1, 5]),
                "size: not a picture size",
            ),
            ("/image_path", "/file_paths/3", json!(".."), "file_paths"),
        ] {
            let pointer = format!("{below}{pointer}");
            let mut broken = scene.clone();
            *broken.pointer_mut(&pointer).unwrap() = value;
            std::fs::write(&path, broken.to_string()).unwrap();
            assert_error(list_capture(folder.path()), &[expected, FILE]);
        }
    }
}
