//! Files of cameras with times, as a path of key views is kept: a `transforms.json` whose photos do not exist.

use std::io;
use std::path::Path;

use serde_json::{Value, json};

use crate::data::{DataError, Frame, read_frames, write_atomically};
use crate::geometry::{Camera, LensModel};

/// Time from one key view to the next where a file says none, in seconds.
const STEP_SECS: f64 = 2.0;

/// A camera at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyView {
    /// The camera.
    pub camera: Camera,
    /// When it is reached, seconds.
    pub time_secs: f64,
}

/// Reads the cameras of a `transforms.json`, with their times (`time` of a frame, seconds) where all have one.
///
/// # Errors
/// Names the file and the field. `w` and `h` must be given, as there are no photos to measure.
pub fn read_key_views(path: &Path) -> Result<Vec<KeyView>, DataError> {
    let frames = read_frames(path)?;
    let has_times = frames.iter().all(|frame| frame.time_secs.is_some());
    let key_view = |(i, frame): (usize, &Frame)| {
        let missing = || frame.error("w", "w and h are missing");
        let (width, height) = frame.intrinsics.size.ok_or_else(missing)?;
        let (camera, _) = frame.camera(width, height)?;
        let time = frame.time_secs.filter(|_| has_times);
        Ok(KeyView {
            camera,
            time_secs: time.unwrap_or(i as f64 * STEP_SECS),
        })
    };
    frames.iter().enumerate().map(key_view).collect()
}

/// Writes key views so that [`read_key_views`] and [`read_frames`] read them; whole or not at all.
pub fn write_key_views(path: &Path, keys: &[KeyView]) -> Result<(), DataError> {
    let frame = |(number, key): (usize, &KeyView)| {
        let mut frame = frame(&format!("key_{number:03}.png"), &key.camera);
        frame["time"] = json!(key.time_secs);
        frame
    };
    write_frames(path, keys.iter().enumerate().map(frame))
}

/// Writes the cameras of photos, with their names, so that [`read_key_views`] and [`read_frames`] read them; whole or not at
/// all.
pub fn write_cameras(path: &Path, photos: &[(String, Camera)]) -> Result<(), DataError> {
    let frame = |(name, camera): &(String, Camera)| frame(name, camera);
    write_frames(path, photos.iter().map(frame))
}

fn write_frames(path: &Path, frames: impl Iterator<Item = Value>) -> Result<(), DataError> {
    let content = json!({ "frames": frames.collect::<Vec<_>>() });
    write_atomically(path, |file| {
        serde_json::to_writer_pretty(file, &content).map_err(io::Error::from)
    })
    .map_err(|e| DataError::io(path, e))
}

fn frame(name: &str, camera: &Camera) -> Value {
    let pose = glam::Mat4::from(camera.world_from_camera);
    let rows: Vec<[f32; 4]> = (0..4).map(|row| pose.row(row).to_array()).collect();
    let lens = &camera.distortion;
    json!({
        "file_path": name,
        "w": camera.width, "h": camera.height,
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "k1": lens.k1, "k2": lens.k2, "k3": lens.k3, "k4": lens.k4, "p1": lens.p1, "p2": lens.p2,
        "is_fisheye": lens.model == LensModel::Fisheye,
        "transform_matrix": rows,
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::Distortion;

    fn keys() -> Vec<KeyView> {
        let key = |i: usize| {
            let eye = Vec3::new(3.0, i as f32 - 1.2, 0.7);
            let pinhole = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 320, 200);
            KeyView {
                camera: Camera {
                    distortion: Distortion {
                        k1: 0.01 * i as f32,
                        ..Distortion::default()
                    },
                    ..pinhole
                },
                time_secs: 1.5 * i as f64,
            }
        };
        (0..3).map(key).collect()
    }

    #[test]
    fn written_key_views_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.json");
        write_key_views(&path, &keys()).unwrap();
        let read = read_key_views(&path).unwrap();
        assert_eq!(read.len(), 3);
        for (read, written) in read.iter().zip(keys()) {
            assert_eq!(read.time_secs, written.time_secs);
            let (a, b) = (read.camera.ray(3.0, 7.0), written.camera.ray(3.0, 7.0));
            let off = (a.direction - b.direction).length() + (a.origin - b.origin).length();
            assert!(off < 1e-5, "{a:?} for {b:?}");
        }
        assert_eq!(read_frames(&path).unwrap()[2].name, "key_002");
    }

    #[test]
    fn cameras_without_times_follow_each_other_evenly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.json");
        write_key_views(&path, &keys()).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replacen("\"time\"", "\"other\"", 1)).unwrap();
        let times = read_key_views(&path).unwrap();
        let times: Vec<f64> = times.iter().map(|key| key.time_secs).collect();
        assert_eq!(times, [0.0, STEP_SECS, 2.0 * STEP_SECS]);
    }
}
