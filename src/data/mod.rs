//! Captures: posed photos with masks and a mesh, read from disk into plain values.
//!
//! One file a format. [`Dataset::load`] is the way in: it reads
//! what it can, reports what it could not as [`Problem`]s, and fails only when nothing is left.

mod check;
mod choices;
mod error;
pub mod files;
mod formats;
mod frame;
#[cfg(test)]
mod fuzz_smoke;
mod intrinsics;
mod load;
mod mesh_io;
mod photos;
mod points;
mod problem;
mod relight;
#[cfg(test)]
mod test_asserts;
#[cfg(test)]
mod test_capture;
mod world_up;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use glam::{Affine3A, EulerRot, Quat, Vec3};
use serde::{Deserialize, Serialize};

use crate::geometry::{Aabb, Camera, Mesh};

pub use self::files::atomic::write_atomically;
pub use self::files::bundled::bundled_assets;
pub use self::files::camera_file::{KeyView, read_key_views, write_cameras, write_key_views};
pub use self::files::film::{
    Ending, FilmFormat, MAX_GIF_FPS, NextFrame, find_ffmpeg, write_gif, write_mp4,
};
pub use self::files::staged_folder::StagedFolder;
pub use self::formats::colmap::{
    ColmapCamera, ColmapImage, ColmapPoint, Keep, Model as ColmapModel, Observation,
    read_colmap_model,
};
pub use self::formats::listing::{Listing, list_capture};
pub use self::formats::splits::SplitFrames;
pub use self::formats::transforms_json::read_frames;
pub use self::intrinsics::Intrinsics;
pub use self::photos::depth::{DepthFile, DepthMap};
pub use self::photos::depth_view::DepthView;
pub use self::photos::exr_image::{
    ExrChannel, ExrSample, read_exr_linear, write_exr, write_exr_channels,
};
pub use self::photos::image::{read_mask, read_photo, write_mask, write_png_srgb};
pub use self::photos::photo::{Mask, Photo};
pub use self::photos::rgba8::Rgba8;
pub use check::{
    CameraSummary, Conditions, DatasetReport, LensSummary, MaskAgreement, MaskSummary, MeshSummary,
    PointSummary, Resolution, SplitCounts, background_stands_still, check, exposures_differ,
};
pub use choices::CaptureChoices;
pub use error::DataError;
pub use frame::Frame;
pub use load::first_photo;
pub use mesh_io::{Texture, TexturedMesh, find_mesh, read_mesh, write_glb, write_textured_glb};
pub use points::{PointCloud, SeenPoints};
pub use problem::{Problem, Severity};
pub use relight::{EnvironmentMove, RelightApply, RelightCase};
pub use world_up::world_up;

/// A capture in memory.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder's name.
    pub name: String,
    /// The folder that file paths are relative to.
    pub root: PathBuf,
    /// What the capture was read from.
    pub origin: Origin,
    /// Views to learn from.
    pub train: Vec<View>,
    /// Views for early stopping and choosing settings.
    pub val: Vec<View>,
    /// Views for the final measure only.
    pub test: Vec<View>,
    /// The object's mesh in the capture's world frame.
    pub mesh: Option<Arc<Mesh>>,
    /// The box around the mesh that a run began with, where that has moved since.
    pub first_box: Option<Aabb>,
    /// Where the mesh was read from.
    pub mesh_path: Option<PathBuf>,
    /// Whether the photos show the environment; false for cut-out objects (transparent PNG).
    pub environment_visible: bool,
    /// What was wrong or assumed, worst first.
    pub problems: Vec<Problem>,
}

impl Dataset {
    /// A capture of these training views, and nothing else.
    #[cfg(test)]
    pub(crate) fn of_views(train: Vec<View>) -> Self {
        Self {
            name: "test".to_owned(),
            root: PathBuf::from("test"),
            origin: Origin::default(),
            train,
            val: Vec::new(),
            test: Vec::new(),
            mesh: None,
            first_box: None,
            mesh_path: None,
            environment_visible: true,
            problems: Vec::new(),
        }
    }

    /// The box in which a run's material is, and around which its environment is: that of the mesh that it began with.
    pub fn object_box(&self) -> Option<Aabb> {
        let mesh = self.mesh.as_ref()?;
        Some(self.first_box.unwrap_or_else(|| mesh.bounds()))
    }

    /// All views: training, validation, test.
    pub fn views(&self) -> impl Iterator<Item = &View> {
        self.train.iter().chain(&self.val).chain(&self.test)
    }
}

/// What a capture was read from, beyond its views.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The layout and the files that it was recognised by, for people.
    pub recognised: String,
    /// The reconstruction's points, where the layout has them.
    pub points: Option<Arc<PointCloud>>,
    /// Depth maps of training photos.
    pub depths: Vec<DepthView>,
    /// The direction that is up in the world, unit: as given, else estimated from all listed cameras.
    pub up: Option<Vec3>,
    /// Whether it was given.
    pub up_is_given: bool,
    /// Least and most light that training photos got, by what their cameras noted, stops.
    pub noted_exposure_ev: Option<[f32; 2]>,
    /// Which photos train, validate and test, and why, for people.
    pub split_rule: String,
}

/// Which part of a capture a view belongs to; named as in the files' names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Split {
    /// Trained on.
    Train,
    /// Held out for decisions during training.
    Val,
    /// Held out for the final measure.
    Test,
}

/// One posed photo.
#[derive(Clone, Debug)]
pub struct View {
    /// The photo's file name without extension; photos of other splits may have the same.
    pub name: String,
    /// The photo's file; empty where there is none.
    pub file: PathBuf,
    /// What the photo is for.
    pub split: Split,
    /// The camera, for exactly the photo's size.
    pub camera: Camera,
    /// The pixels.
    pub photo: Photo,
    /// Where the object is, same size as the photo.
    pub mask: Option<Mask>,
}

impl View {
    /// Its name with that of its split, which no other view has, for people.
    pub fn full_name(&self) -> String {
        format!("{} / {}", self.split, self.name)
    }
}

/// Which splits to load; reading test views is pointless (and slow) while training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Splits {
    /// Load training views.
    pub train: bool,
    /// Load validation views.
    pub val: bool,
    /// Load test views.
    pub test: bool,
}

impl Splits {
    /// Everything.
    pub const ALL: Self = Self {
        train: true,
        val: true,
        test: true,
    };
    /// What training may look at.
    pub const TRAIN_VAL: Self = Self {
        train: true,
        val: true,
        test: false,
    };
    /// The test views alone.
    pub const TEST: Self = Self {
        train: false,
        val: false,
        test: true,
    };
}

/// How a mesh file's coordinates become the capture's: scaled, then rotated, then translated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MeshPlacement {
    /// Rotation in degrees about the world's x, then y, then z axis.
    pub rotate_deg_xyz: Vec3,
    /// Uniform scale.
    pub scale: f32,
    /// Translation in scene units.
    pub translate: Vec3,
}

impl Default for MeshPlacement {
    /// As it stands in the file.
    fn default() -> Self {
        Self {
            rotate_deg_xyz: Vec3::ZERO,
            scale: 1.0,
            translate: Vec3::ZERO,
        }
    }
}

impl MeshPlacement {
    /// The transform from the mesh file's coordinates to the capture's.
    pub fn world_from_mesh(&self) -> Affine3A {
        let [x, y, z] = self.rotate_deg_xyz.to_array().map(f32::to_radians);
        Affine3A::from_scale_rotation_translation(
            Vec3::splat(self.scale),
            Quat::from_euler(EulerRot::ZYX, z, y, x),
            self.translate,
        )
    }
}

/// What to load and how.
#[derive(Clone)]
pub struct LoadOptions<'a> {
    /// Which splits.
    pub splits: Splits,
    /// A mesh file to use instead of the one found in the capture's folder.
    pub mesh: Option<PathBuf>,
    /// How the mesh file lies in the capture's world.
    pub mesh_placement: MeshPlacement,
    /// What a person says about the capture.
    pub choices: CaptureChoices,
    /// Called with (views done, views in all) from the decoding threads.
    pub on_progress: &'a (dyn Fn(usize, usize) + Sync),
}

impl Default for LoadOptions<'_> {
    /// All splits, the mesh found in the folder, as it stands, silently.
    fn default() -> Self {
        Self {
            splits: Splits::ALL,
            mesh: None,
            mesh_placement: MeshPlacement::default(),
            choices: CaptureChoices::default(),
            on_progress: &|_, _| (),
        }
    }
}

impl fmt::Debug for LoadOptions<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LoadOptions")
            .field("splits", &self.splits)
            .field("mesh", &self.mesh)
            .field("mesh_placement", &self.mesh_placement)
            .field("choices", &self.choices)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placement_rotates_about_x_first() {
        let placement = MeshPlacement {
            rotate_deg_xyz: Vec3::new(90.0, 0.0, 90.0),
            scale: 2.0,
            translate: Vec3::X,
        };
        // y -> z by the turn about x, which the turn about z leaves alone.
        let p = placement.world_from_mesh().transform_point3(Vec3::Y);
        assert!((p - Vec3::new(1.0, 0.0, 2.0)).length() < 1e-6, "{p}");
    }
}
