//! COLMAP sparse models, binary and text: lenses, poses and points.
//!
//! Poses are from world to camera with x right, y down, z forward. Photos are named relative to a
//! folder that the model does not name: `images`, by custom, or a scaled copy of it.

mod binary;
mod binary_file;
mod model;
#[cfg(test)]
mod tests;
mod text;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::found::{Found, Listed};
use super::photo_folder::photo_folders;
use crate::data::files::capture_path::path_below;
use crate::data::problem::first_names;
use crate::data::{DataError, Frame, PointCloud, Problem, SeenPoints, Severity};

pub use model::{ColmapCamera, ColmapImage, ColmapPoint, Observation};

/// Where a model lies below a capture's folder, in the order of preference.
const FOLDERS: [&str; 8] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "dense/sparse",
    "distorted/sparse/0",
    "colmap",
    "",
];
/// The file that makes a folder a model, and its format.
const MARKS: [(&str, &str); 2] = [("images.bin", "binary"), ("images.txt", "text")];

/// Whether to keep features, which are most of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Lenses, poses and points.
    PosesAndPoints,
    /// Those and the features of each photo.
    Observations,
}

/// A whole model.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Lenses.
    pub cameras: Vec<ColmapCamera>,
    /// Registered photos, in the file's order.
    pub images: Vec<ColmapImage>,
    /// Points.
    pub points: Vec<ColmapPoint>,
}

/// What was looked for, for a message that nothing was found.
pub(super) const LOOKED_FOR: &str = "COLMAP: cameras and images (.bin or .txt) in sparse/0, sparse, colmap/sparse/0 or the folder itself";

/// Reads the model in `folder`: binary where there is an `images.bin`, else text.
///
/// Errors name the file, the record and the field.
pub fn read_colmap_model(folder: &Path, keep: Keep) -> Result<Model, DataError> {
    if folder.join("images.bin").is_file() {
        binary::read(folder, keep)
    } else {
        text::read(folder, keep)
    }
}

/// Whether a folder holds a model, and its format.
pub(super) fn model_format(folder: &Path) -> Option<&'static str> {
    MARKS
        .iter()
        .find(|(mark, _)| folder.join(mark).is_file())
        .map(|(_, format)| *format)
}

/// The model of a capture.
pub(in crate::data) fn find(root: &Path) -> Option<Found> {
    let folder = FOLDERS
        .iter()
        .map(|folder| root.join(folder))
        .find(|folder| model_format(folder).is_some())?;
    if folder == root {
        return Some(found_at(root));
    }
    Some(Found {
        root: root.to_owned(),
        file: folder,
    })
}

/// The capture of the model in `folder`: the nearest folder above that holds photos.
pub(super) fn found_at(folder: &Path) -> Found {
    let root = folder
        .ancestors()
        .take(4)
        .find(|root| !photo_folders(root).is_empty())
        .unwrap_or(folder);
    Found {
        root: root.to_owned(),
        file: folder.to_owned(),
    }
}

/// Lists the photos of a model, by name.
pub(in crate::data) fn list(found: &Found) -> Result<Listed, DataError> {
    let format = model_format(&found.file).unwrap_or("text");
    let extension = if format == "binary" { "bin" } else { "txt" };
    let listed_in = found.file.join(format!("images.{extension}"));
    let mut model = read_colmap_model(&found.file, Keep::PosesAndPoints)?;
    if model.images.is_empty() {
        return Err(DataError::Field {
            path: listed_in,
            frame: None,
            field: "images".to_owned(),
            problem: "no photo is registered".to_owned(),
        });
    }
    // Ids follow the order of registration; names follow the camera's walk.
    model.images.sort_by(|a, b| a.name.cmp(&b.name));
    let photos = photos_of(&found.root, &model.images);
    let frames = frames_of(&model, &listed_in, &photos)?;
    let recognised = format!(
        "COLMAP model ({format}) in {}, {} points, photos in {}",
        found.shown(&found.file),
        model.points.len(),
        found.shown(&photos)
    );
    Ok(Listed {
        frames,
        points: Some(point_cloud(&model)),
        recognised,
        problems: other_models(found),
    })
}

/// The folder of photos that holds most of the model's.
fn photos_of(root: &Path, images: &[ColmapImage]) -> PathBuf {
    let n_present = |folder: &PathBuf| {
        let is_there = |image: &&ColmapImage| {
            path_below(folder, &image.name, 0).is_ok_and(|photo| photo.is_file())
        };
        images.iter().filter(is_there).count()
    };
    let mut best = (root.join("images"), 0);
    for folder in photo_folders(root).into_iter().chain([root.to_owned()]) {
        let n = n_present(&folder);
        if n > best.1 {
            best = (folder, n);
        }
    }
    best.0
}

fn frames_of(model: &Model, listed_in: &Path, photos: &Path) -> Result<Vec<Frame>, DataError> {
    let cameras: HashMap<u32, &ColmapCamera> = model
        .cameras
        .iter()
        .map(|camera| (camera.id, camera))
        .collect();
    let frame = |(index, image): (usize, &ColmapImage)| {
        let error = |field: &str, problem: String| DataError::Field {
            path: listed_in.to_owned(),
            frame: None,
            field: format!("image {}, {field}", image.id),
            problem,
        };
        let Some(camera) = cameras.get(&image.camera_id) else {
            let problem = format!("there is no camera {}", image.camera_id);
            return Err(error("camera id", problem));
        };
        let photo = path_below(photos, &image.name, 0).map_err(|problem| error("name", problem))?;
        let (pose, lens) = (image.world_from_camera, camera.intrinsics);
        Ok(Frame {
            name: view_name(&image.name),
            ..Frame::new(index, photo, pose, lens, listed_in)
        })
    };
    model.images.iter().enumerate().map(frame).collect()
}

/// The name of the view of a photo.
fn view_name(image: &str) -> String {
    let name = Path::new(image).with_extension("");
    name.to_string_lossy().replace(['/', '\\'], "_")
}

fn point_cloud(model: &Model) -> PointCloud {
    let mut cloud = PointCloud {
        photos: model
            .images
            .iter()
            .map(|image| SeenPoints {
                name: view_name(&image.name),
                points: Vec::new(),
            })
            .collect(),
        ..PointCloud::default()
    };
    let numbers = model.images.iter().map(|image| image.id).zip(0..);
    let number_of_image: HashMap<u32, usize> = numbers.collect();
    for point in &model.points {
        let position = point.position.as_vec3();
        if !position.is_finite() {
            continue;
        }
        let number = cloud.positions.len() as u32;
        for image in &point.seen_by {
            if let Some(&image) = number_of_image.get(image) {
                cloud.photos[image].points.push(number);
            }
        }
        cloud.positions.push(position);
        cloud.colors.push(point.color);
        cloud.errors_px.push(point.error_px as f32);
    }
    cloud
}

/// COLMAP writes a model for each part that it could not join.
fn other_models(found: &Found) -> Vec<Problem> {
    let Some(parts) = found.file.parent() else {
        return Vec::new();
    };
    if found.file.file_name().is_none_or(|name| name != "0") {
        return Vec::new();
    }
    let others: Vec<String> = (1..100)
        .map(|i| parts.join(i.to_string()))
        .take_while(|folder| model_format(folder).is_some())
        .map(|folder| found.shown(&folder))
        .collect();
    if others.is_empty() {
        return Vec::new();
    }
    let what = format!(
        "COLMAP could not join all photos: also {}",
        first_names(&others)
    );
    let advice = "only the first part is used; name another one's folder to use it";
    vec![Problem::new(Severity::Warning, what, advice)]
}
