//! The `transforms.json` family: NeRF-synthetic, instant-ngp, nerfstudio, and our `edit.json`.
//!
//! Cameras are camera-to-world 4x4 matrices with OpenGL axes. Intrinsics are `fl_x, fl_y, cx, cy,
//! w, h, k1..k4, p1, p2` or `camera_angle_x`, for the file or for a frame (which wins). Every
//! number is checked here; what leaves this file is finite and usable.

use std::path::{Path, PathBuf};

use glam::{Affine3A, Mat3, Vec3};
use serde_json::Value;

use super::json_fields::Fields;
use crate::data::files::capture_path::{folder_of, path_below, read_json, with_extension};
use crate::data::photos::depth::MILLIMETRE;
use crate::data::{DataError, DepthFile, Frame, Intrinsics};
use crate::geometry::{Distortion, LensModel};

/// How far above its folder `relight/<edit>/edit.json` may climb: it refers to `../../test_mask`.
/// Any other file stays below its own folder, which is the capture's.
const EDIT_CLIMB: usize = 2;
/// The largest file read: 10,000 photos take about 10 MB.
const MAX_BYTES: u64 = 128 << 20;
/// Camera models that [`Distortion`] can express.
const CAMERA_MODELS: [&str; 8] = [
    "OPENCV_FISHEYE",
    "OPENCV",
    "FULL_OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "PERSPECTIVE",
];

/// Reads the frames that `json` lists, in its order; photos are not opened.
///
/// Errors name the frame's index and the field. Paths that are absolute or lead out of the file's folder are refused.
pub fn read_frames(json: &Path) -> Result<Vec<Frame>, DataError> {
    let value = read_value(json)?;
    let top = Fields::new(json, None, &value);
    if value.as_object().is_none() {
        return Err(top.error("(top level)", "not an object"));
    }
    let lens = read_intrinsics(&top, Intrinsics::default())?;
    let frames = match value.get("frames") {
        Some(Value::Array(frames)) if !frames.is_empty() => frames,
        Some(Value::Array(_)) => return Err(top.error("frames", "the list is empty")),
        Some(_) => return Err(top.error("frames", "not a list")),
        None => return Err(top.error("frames", "missing")),
    };
    frames
        .iter()
        .enumerate()
        .map(|(index, value)| {
            let fields = Fields::new(json, index, value);
            read_frame(&fields, index, lens)
        })
        .collect()
}

pub(super) fn read_value(json: &Path) -> Result<Value, DataError> {
    read_json(json, MAX_BYTES)
}

fn read_frame(fields: &Fields<'_>, index: usize, lens: Intrinsics) -> Result<Frame, DataError> {
    let declared = fields
        .string("file_path")?
        .ok_or_else(|| fields.error("file_path", "missing"))?;
    let photo = resolve(fields, "file_path", declared)?;
    let mask = fields.string("mask_path")?;
    let mask = mask.map(|declared| resolve(fields, "mask_path", declared));
    let depth = read_depth(fields)?;
    let (pose, lens) = (read_pose(fields)?, read_intrinsics(fields, lens)?);
    Ok(Frame {
        mask: mask.transpose()?,
        depth,
        time_secs: fields.value.get("time").and_then(Value::as_f64),
        ..Frame::new(index, photo, pose, lens, fields.json)
    })
}

/// nerfstudio's `depth_file_path`, or instant-ngp's `depth_path`: millimetres where the numbers are whole.
fn read_depth(fields: &Fields<'_>) -> Result<Option<DepthFile>, DataError> {
    for field in ["depth_file_path", "depth_path"] {
        if let Some(declared) = fields.string(field)? {
            let path = resolve(fields, field, declared)?;
            return Ok(Some(DepthFile::new(path, MILLIMETRE)));
        }
    }
    Ok(None)
}

/// The lens of a frame or file, where absent that of `outer`.
fn read_intrinsics(fields: &Fields<'_>, outer: Intrinsics) -> Result<Intrinsics, DataError> {
    if let Some(model) = fields.string("camera_model")?
        && !CAMERA_MODELS.contains(&model.to_ascii_uppercase().as_str())
    {
        let problem = format!(
            "\"{model}\" is not supported; undistort the photos to PINHOLE or OPENCV first"
        );
        return Err(fields.error("camera_model", problem));
    }
    let size = match (fields.side("w")?, fields.side("h")?) {
        (Some(w), Some(h)) => Some((w, h)),
        (None, None) => outer.size,
        (Some(_), None) => return Err(fields.error("h", "missing, though w is given")),
        (None, Some(_)) => return Err(fields.error("w", "missing, though h is given")),
    };
    let k = |name: &str, outer: f32| Ok::<f32, DataError>(fields.number(name)?.unwrap_or(outer));
    let d = outer.distortion;
    let named = fields.string("camera_model")?.map(str::to_ascii_uppercase);
    let is_fisheye = fields.value.get("is_fisheye") == Some(&Value::Bool(true));
    let model = match named.as_deref() {
        Some("OPENCV_FISHEYE") => LensModel::Fisheye,
        _ if is_fisheye => LensModel::Fisheye,
        Some(_) => LensModel::Perspective,
        None => d.model,
    };
    Ok(Intrinsics {
        size,
        fl_x: fields.positive("fl_x")?.or(outer.fl_x),
        fl_y: fields.positive("fl_y")?.or(outer.fl_y),
        camera_angle_x: fields.angle("camera_angle_x")?.or(outer.camera_angle_x),
        camera_angle_y: fields.angle("camera_angle_y")?.or(outer.camera_angle_y),
        cx: fields.number("cx")?.or(outer.cx),
        cy: fields.number("cy")?.or(outer.cy),
        distortion: Distortion {
            model,
            k1: k("k1", d.k1)?,
            k2: k("k2", d.k2)?,
            k3: k("k3", d.k3)?,
            k4: k("k4", d.k4)?,
            p1: k("p1", d.p1)?,
            p2: k("p2", d.p2)?,
        },
    })
}

/// `transform_matrix` as a rotation and a position; a uniform scale is taken out.
fn read_pose(fields: &Fields<'_>) -> Result<Affine3A, DataError> {
    const FIELD: &str = "transform_matrix";
    let fail = |problem: &str| fields.error(FIELD, problem);
    let value = fields.value.get(FIELD).ok_or_else(|| fail("missing"))?;
    let rows = value.as_array().ok_or_else(|| fail("not a list of rows"))?;
    if rows.len() != 3 && rows.len() != 4 {
        return Err(fail("not 4 rows of 4 numbers"));
    }
    let mut m = [[0.0_f32; 4]; 4];
    m[3][3] = 1.0;
    for (i, row) in rows.iter().enumerate() {
        let row = row.as_array().filter(|row| row.len() == 4);
        let row = row.ok_or_else(|| fail("not 4 rows of 4 numbers"))?;
        for (j, number) in row.iter().enumerate() {
            let number = number.as_f64().map(|v| v as f32).filter(|v| v.is_finite());
            m[i][j] = number.ok_or_else(|| {
                fields.error(FIELD, format!("row {i}, column {j} is not a finite number"))
            })?;
        }
    }
    let last_is_unit = m[3]
        .iter()
        .zip([0.0, 0.0, 0.0, 1.0])
        .all(|(a, b)| (a - b).abs() < 1e-4);
    if !last_is_unit {
        return Err(fail("the last row is not 0 0 0 1"));
    }
    let column = |j: usize| Vec3::new(m[0][j], m[1][j], m[2][j]);
    let rotation = rotation_of(column(0), column(1), column(2)).map_err(fail)?;
    Ok(Affine3A::from_mat3_translation(rotation, column(3)))
}

/// The rotation nearest to the given axes, which must be so already up to a uniform scale.
fn rotation_of(x: Vec3, y: Vec3, z: Vec3) -> Result<Mat3, &'static str> {
    /// How far lengths and angles may be off: rounded files are within 1e-4.
    const TOLERANCE: f32 = 0.02;
    let scale = (x.length() + y.length() + z.length()) / 3.0;
    if !(scale > 0.0 && scale.is_finite()) {
        return Err("not invertible");
    }
    let axes = [x / scale, y / scale, z / scale];
    let [x, y, z] = axes;
    if x.cross(y).dot(z).abs() < TOLERANCE {
        return Err("not invertible");
    }
    let unit = axes.iter().all(|a| (a.length() - 1.0).abs() < TOLERANCE);
    let square = [x.dot(y), y.dot(z), z.dot(x)]
        .iter()
        .all(|d| d.abs() < TOLERANCE);
    if !(unit && square) {
        return Err("not a rotation: the axes are sheared or scaled unevenly");
    }
    if x.cross(y).dot(z) < 0.0 {
        return Err("left-handed: the pose mirrors the picture");
    }
    let z = z.normalize_or_zero();
    let x = (x - x.dot(z) * z).normalize_or_zero();
    Ok(Mat3::from_cols(x, z.cross(x), z))
}

/// The file that a declared relative path means, without leaving the capture.
fn resolve(fields: &Fields<'_>, field: &str, declared: &str) -> Result<PathBuf, DataError> {
    let is_edit = fields.json.ends_with("edit.json");
    let max_climb = if is_edit { EDIT_CLIMB } else { 0 };
    let path = path_below(folder_of(fields.json), declared, max_climb);
    path.map(with_extension)
        .map_err(|problem| fields.error(field, problem))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::data::test_asserts::assert_error;
    use crate::geometry::Camera;

    fn pose() -> Value {
        json!([[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    }

    fn valid() -> Value {
        json!({
            "w": 320, "h": 240.0, "fl_x": 300.5, "cx": 161, "cy": 119, "k1": 0.01,
            "frames": [
                {"file_path": "./train/r_0", "transform_matrix": pose()},
                {"file_path": "train\\r_1.png", "fl_x": 200, "transform_matrix": pose()},
            ],
        })
    }

    fn read(value: &Value) -> Result<Vec<Frame>, DataError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        std::fs::write(&path, value.to_string()).unwrap();
        read_frames(&path)
    }

    #[test]
    fn a_frames_own_lens_wins_over_the_files() {
        let frames = read(&valid()).unwrap();
        let lens = |i: usize| frames[i].camera(320, 240).unwrap().0;
        let Camera { fx, fy, cx, .. } = lens(0);
        assert_eq!((fx, fy, cx), (300.5, 300.5, 161.0), "file");
        assert_eq!((lens(1).fx, lens(1).distortion.k1), (200.0, 0.01), "frame");
        assert_eq!(lens(0).position(), Vec3::new(5.0, 6.0, 7.0), "position");
        assert_eq!(frames[1].name, "r_1", "name");
        let photo = &frames[1].photo;
        assert!(photo.ends_with("train/r_1.png"), "{photo:?}: backslashes");
    }

    #[test]
    fn an_angle_alone_makes_a_lens_for_the_photos_size() {
        let json = json!({"camera_angle_x": std::f32::consts::FRAC_PI_2,
                          "frames": [{"file_path": "a", "transform_matrix": pose()}]});
        let (camera, rescaled) = read(&json).unwrap()[0].camera(400, 300).unwrap();
        let Camera { fx, fy, cx, cy, .. } = camera;
        assert!((fx - 200.0).abs() < 1e-3 && fx == fy, "{fx}, {fy}");
        assert_eq!((cx, cy, rescaled), (200.0, 150.0, false), "centre");
    }

    #[test]
    fn lenses_shrink_with_their_photos_but_not_to_another_aspect() {
        let frames = read(&valid()).unwrap();
        let (camera, rescaled) = frames[0].camera(160, 120).unwrap();
        assert_eq!((camera.fx, camera.cx), (150.25, 80.5), "half size");
        assert!(rescaled);
        assert_error(frames[0].camera(320, 320), &["320 x 320", "frame 0"]);
    }

    #[test]
    fn every_fault_names_its_field_and_frame() {
        let with = |pointer: &str, value: Value| {
            let mut json = valid();
            *json.pointer_mut(pointer).unwrap() = value;
            read(&json)
        };
        let mut row = pose();
        row[3] = json!([0, 0, 1, 1]);
        let mut mirrored = pose();
        mirrored[0][0] = json!(-1);
        let mut flat = pose();
        flat[2][2] = json!(0);
        let (file, matrix) = ("/frames/1/file_path", "/frames/0/transform_matrix");
        for (pointer, value, expected) in [
            ("/w", json!(-3), "w: -3 is not a picture size"),
            ("/w", json!(null), "w: missing"),
            ("/fl_x", json!(0), "fl_x: 0 is not greater than 0"),
            (
                "/fl_x",
                json!("long"),
                "fl_x: \"long\" is not a finite number",
            ),
            ("/k1", json!(1e300), "k1: 1e+300 is not a finite number"),
            ("/frames", json!([]), "frames: the list is empty"),
            ("/frames/1", json!(7), "frame 1, file_path: missing"),
            (
                file,
                json!("/etc/x"),
                "frame 1, file_path: \"/etc/x\" is an absolute",
            ),
            (file, json!("../x.png"), "leads out of the capture"),
            (file, json!("c:/x.png"), "not a relative file path"),
            (
                matrix,
                json!([[1]]),
                "frame 0, transform_matrix: not 4 rows",
            ),
            (matrix, row, "the last row is not 0 0 0 1"),
            (matrix, mirrored, "left-handed"),
            (matrix, flat, "not invertible"),
        ] {
            assert_error(with(pointer, value), &[expected, "transforms.json"]);
        }
        let mut fisheye = valid();
        fisheye["camera_model"] = json!("EQUIRECTANGULAR");
        assert_error(read(&fisheye), &["camera_model"]);
    }

    #[test]
    fn fisheye_lenses_and_nerfstudio_s_own_splits_are_read() {
        let mut json = valid();
        json["camera_model"] = json!("OPENCV_FISHEYE");
        let lens = |json: &Value| read(json).unwrap()[0].intrinsics.distortion;
        assert_eq!(lens(&json).model, LensModel::Fisheye, "by name");
        assert_eq!(lens(&json).k1, 0.01);
        let mut json = valid();
        json["is_fisheye"] = json!(true);
        assert_eq!(lens(&json).model, LensModel::Fisheye, "by flag");
        json["train_filenames"] = json!(["./train/r_0"]);
        json["test_filenames"] = json!(["train/r_1.png"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        std::fs::write(&path, json.to_string()).unwrap();
        crate::data::formats::test_formats::write_photos(&folder.path().join("train"), 2);
        for i in 0..2 {
            let photo = folder.path().join(format!("train/000{i}.png"));
            std::fs::rename(photo, folder.path().join(format!("train/r_{i}.png"))).unwrap();
        }
        let split = crate::data::list_capture(&path).unwrap().split;
        assert_eq!((split.train[0].index, split.test[0].index), (0, 1));
    }

    #[test]
    fn a_scaled_pose_is_a_pose_and_a_sheared_one_is_not() {
        let mut json = valid();
        json["frames"][0]["transform_matrix"] =
            json!([[0, -3, 0, 5], [3, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]]);
        let frames = read(&json).unwrap();
        let determinant = frames[0].world_from_camera.matrix3.determinant();
        assert!((determinant - 1.0).abs() < 1e-5, "{determinant}");
        json["frames"][0]["transform_matrix"] =
            json!([[1, 0.5, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]);
        assert_error(read(&json), &["sheared"]);
    }

    #[test]
    fn text_that_is_not_json_is_an_error_with_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        for text in ["", "{\"frames\": [", "\u{0}", "{\"fl_x\": NaN}", "[]", "3"] {
            std::fs::write(&path, text).unwrap();
            assert_error(read_frames(&path), &["transforms.json"]);
        }
    }

    proptest::proptest! {
        #[test]
        fn damaged_json_never_panics(at in 0_usize..600, byte in 0_u8..128) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("transforms.json");
            let mut bytes = valid().to_string().into_bytes();
            let at = at % bytes.len();
            bytes[at] = byte;
            std::fs::write(&path, &bytes).unwrap();
            for frame in read_frames(&path).unwrap_or_default() {
                if let Ok((camera, _)) = frame.camera(64, 48) {
                    proptest::prop_assert!(camera.fx > 0.0 && camera.world_from_camera.is_finite());
                }
            }
        }
    }
}
