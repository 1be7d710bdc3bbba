//! COLMAP's binary files, as `src/colmap/scene/reconstruction_io.cc` of COLMAP writes them:
//! little-endian, a count, then the records.

use std::path::Path;

use glam::DVec3;

use super::binary_file::BinaryFile;
use super::model::{ColmapCamera, ColmapImage, ColmapPoint, KINDS, LensKind, Observation};
use super::{Format, Keep};
use crate::data::DataError;

/// Bytes of an observation: x, y, the point's id.
const OBSERVATION_BYTES: u64 = 24;
/// Bytes of a track's element: the image's id, the observation's index.
const TRACK_BYTES: u64 = 8;

pub(super) const FORMAT: Format = Format {
    name: "binary",
    extension: "bin",
    cameras: read_cameras,
    images: read_images,
    points: read_points,
};

fn read_cameras(path: &Path) -> Result<Vec<ColmapCamera>, DataError> {
    let mut file = BinaryFile::open(path)?;
    let n = file.count("number of cameras", 24 + 3 * 8)?;
    let mut cameras = Vec::with_capacity(n);
    for i in 0..n {
        file.begin_record(i);
        let id = file.u32("camera id")?;
        let model = file.u32("model id")?;
        let Some(kind) = KINDS.get(model as usize) else {
            return Err(file.error("model id", format!("{model} is not a camera model")));
        };
        let (width, height) = (file.u64("width")?, file.u64("height")?);
        let params = read_params(&mut file, kind)?;
        let camera = ColmapCamera::new(id, kind, [width, height], &params);
        cameras.push(camera.map_err(|(field, problem)| file.error(field, problem))?);
    }
    Ok(cameras)
}

fn read_params(file: &mut BinaryFile<'_>, kind: &LensKind) -> Result<Vec<f64>, DataError> {
    (0..kind.n_params()).map(|_| file.f64("params")).collect()
}

fn read_images(path: &Path, keep: Keep) -> Result<Vec<ColmapImage>, DataError> {
    let mut file = BinaryFile::open(path)?;
    let n = file.count("number of images", 4 + 7 * 8 + 4 + 1 + 8)?;
    let mut images = Vec::with_capacity(n);
    for i in 0..n {
        file.begin_record(i);
        let id = file.u32("image id")?;
        let quaternion = file.f64s("qvec")?;
        let translation = DVec3::from_array(file.f64s("tvec")?);
        let camera_id = file.u32("camera id")?;
        let name = file.name("name")?;
        let n_observations = file.count("number of points2D", OBSERVATION_BYTES)?;
        let observations = match keep {
            Keep::Observations => read_observations(&mut file, n_observations)?,
            Keep::PosesAndPoints => {
                file.skip("points2D", n_observations, OBSERVATION_BYTES)?;
                Vec::new()
            }
        };
        let image = ColmapImage::new(id, camera_id, name, quaternion, translation);
        let mut image = image.map_err(|(field, problem)| file.error(field, problem))?;
        image.observations = observations;
        images.push(image);
    }
    Ok(images)
}

fn read_observations(file: &mut BinaryFile<'_>, n: usize) -> Result<Vec<Observation>, DataError> {
    let mut observations = Vec::with_capacity(n);
    for _ in 0..n {
        let [x_px, y_px] = file.f64s("points2D")?;
        // Written as -1 where the feature has no point.
        let point_id = file.u64("points2D")?;
        observations.push(Observation {
            x_px,
            y_px,
            point_id: (point_id != u64::MAX).then_some(point_id),
        });
    }
    Ok(observations)
}

fn read_points(path: &Path) -> Result<Vec<ColmapPoint>, DataError> {
    let mut file = BinaryFile::open(path)?;
    let n = file.count("number of points", 8 + 3 * 8 + 3 + 8 + 8)?;
    let mut points = Vec::with_capacity(n);
    for i in 0..n {
        file.begin_record(i);
        let id = file.u64("point id")?;
        let position = DVec3::from_array(file.f64s("xyz")?);
        let color = [file.u8("rgb")?, file.u8("rgb")?, file.u8("rgb")?];
        // COLMAP writes NaN or -1 for points that were never adjusted.
        let error_px = file.any_f64("error")?;
        let n_seen = file.count("track length", TRACK_BYTES)?;
        let mut seen_by = Vec::with_capacity(n_seen);
        for _ in 0..n_seen {
            seen_by.push(file.u32("track")?);
            // The number of the feature in that image.
            file.u32("track")?;
        }
        points.push(ColmapPoint {
            id,
            position,
            color,
            error_px,
            seen_by,
        });
    }
    Ok(points)
}
