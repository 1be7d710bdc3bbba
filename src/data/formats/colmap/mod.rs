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

use super::found::{Found, Layout, Listed};
use super::photo_folder::photo_folders;
use crate::data::files::capture_path::{folder_of, has_extension, path_below};
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
/// How a model is stored.
struct Format {
    name: &'static str,
    extension: &'static str,
    cameras: fn(&Path) -> Result<Vec<ColmapCamera>, DataError>,
    images: fn(&Path, Keep) -> Result<Vec<ColmapImage>, DataError>,
    points: fn(&Path) -> Result<Vec<ColmapPoint>, DataError>,
}

/// In the order of preference.
const FORMATS: [Format; 2] = [binary::FORMAT, text::FORMAT];

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

pub(super) const LAYOUT: Layout = Layout {
    name: "COLMAP",
    looked_for: "COLMAP: cameras and images (.bin or .txt) in sparse/0, sparse, colmap/sparse/0 or the folder itself",
    find,
    of_file: |file| {
        let is_of_model = has_extension(file, "bin") || has_extension(file, "txt");
        let folder = folder_of(file);
        (is_of_model && format_of(folder).is_some()).then(|| found_at(folder))
    },
    list,
};

/// Reads the model in `folder`: binary where there is an `images.bin`, else text. Points may be absent.
///
/// Errors name the file, the record and the field.
pub fn read_colmap_model(folder: &Path, keep: Keep) -> Result<Model, DataError> {
    let format = format_of(folder).unwrap_or(&text::FORMAT);
    let file = |stem: &str| folder.join(format!("{stem}.{}", format.extension));
    let points = file("points3D");
    Ok(Model {
        cameras: (format.cameras)(&file("cameras"))?,
        images: (format.images)(&file("images"), keep)?,
        points: if points.is_file() {
            (format.points)(&points)?
        } else {
            Vec::new()
        },
    })
}

/// The format of the model in a folder, where it holds one.
fn format_of(folder: &Path) -> Option<&'static Format> {
    FORMATS.iter().find(|format| {
        let images = format!("images.{}", format.extension);
        folder.join(images).is_file()
    })
}

/// The model of a capture.
fn find(root: &Path) -> Option<Found> {
    let folder = FOLDERS
        .iter()
        .map(|folder| root.join(folder))
        .find(|folder| format_of(folder).is_some())?;
    Some(if folder == root {
        found_at(root)
    } else {
        Found::new(root, &folder)
    })
}

/// The capture of the model in `folder`: the nearest folder above that holds photos.
fn found_at(folder: &Path) -> Found {
    let root = folder
        .ancestors()
        .take(4)
        .find(|root| !photo_folders(root).is_empty())
        .unwrap_or(folder);
    Found::new(root, folder)
}

/// Lists the photos of a model, by name.
fn list(found: &Found) -> Result<Listed, DataError> {
    let format = format_of(&found.file).unwrap_or(&text::FORMAT);
    let listed_in = found.file.join(format!("images.{}", format.extension));
    let mut model = read_colmap_model(&found.file, Keep::PosesAndPoints)?;
    if model.images.is_empty() {
        let problem = "no photo is registered";
        return Err(DataError::field(&listed_in, "images", problem));
    }
    // Ids follow the order of registration; names follow the camera's walk.
    model.images.sort_by(|a, b| a.name.cmp(&b.name));
    let photos = photos_of(&found.root, &model.images);
    let frames = frames_of(&model, &listed_in, &photos)?;
    let recognised = format!(
        "COLMAP model ({}) in {}, {} points, photos in {}",
        format.name,
        found.shown(&found.file),
        model.points.len(),
        found.shown(&photos)
    );
    Ok(Listed {
        frames,
        points: Some(point_cloud(&model)),
        recognised,
        problems: other_models(found).into_iter().collect(),
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
        let error = |field: &str, problem: String| {
            DataError::field(listed_in, format!("image {}, {field}", image.id), problem)
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
fn other_models(found: &Found) -> Option<Problem> {
    let parts = found.file.parent().filter(|_| found.file.ends_with("0"))?;
    let others: Vec<String> = (1..100)
        .map(|i| parts.join(i.to_string()))
        .take_while(|folder| format_of(folder).is_some())
        .map(|folder| found.shown(&folder))
        .collect();
    let what = format!(
        "COLMAP could not join all photos: also {}",
        first_names(&others)
    );
    let advice = "only the first part is used; name another one's folder to use it";
    (!others.is_empty()).then(|| Problem::new(Severity::Warning, what, advice))
}
