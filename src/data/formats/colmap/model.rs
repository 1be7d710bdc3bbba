//! What a COLMAP model holds, checked.

use glam::{Affine3A, DMat3, DQuat, DVec3};

use crate::data::Intrinsics;
use crate::data::frame::world_from_opencv;
use crate::geometry::{Distortion, LensModel};

/// A fault: the field's name and what is wrong with it.
pub(super) type Fault = (&'static str, String);

/// A camera model of COLMAP.
#[derive(Debug)]
pub(super) struct LensKind {
    /// As in `cameras.txt`.
    pub(super) name: &'static str,
    /// What the numbers of a lens are.
    params: &'static str,
}

/// All models by id, as in COLMAP's `sensor/models.h`.
pub(super) const KINDS: [LensKind; 12] = [
    kind("SIMPLE_PINHOLE", "f cx cy"),
    kind("PINHOLE", "fx fy cx cy"),
    kind("SIMPLE_RADIAL", "f cx cy k1"),
    kind("RADIAL", "f cx cy k1 k2"),
    kind("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    kind("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    kind("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    kind("FOV", "fx fy cx cy omega"),
    kind("SIMPLE_RADIAL_FISHEYE", "f cx cy k1"),
    kind("RADIAL_FISHEYE", "f cx cy k1 k2"),
    kind(
        "THIN_PRISM_FISHEYE",
        "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    ),
    kind(
        "RAD_TAN_THIN_PRISM_FISHEYE",
        "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
    ),
];
/// Those that [`Distortion`] cannot express.
const UNSUPPORTED: [&str; 3] = ["FOV", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"];

const fn kind(name: &'static str, params: &'static str) -> LensKind {
    LensKind { name, params }
}

impl LensKind {
    /// Numbers that describe a lens.
    pub(super) fn n_params(&self) -> usize {
        self.params.split(' ').count()
    }
}

/// A lens with the size of the photos that it was calibrated for.
#[derive(Clone, Copy, Debug)]
pub struct ColmapCamera {
    /// What images refer to it by.
    pub id: u32,
    /// The lens; COLMAP's pixel centres lie at one half, as ours do.
    pub intrinsics: Intrinsics,
}

impl ColmapCamera {
    pub(super) fn new(
        id: u32,
        kind: &LensKind,
        size: [u64; 2],
        params: &[f64],
    ) -> Result<Self, Fault> {
        const UNDISTORT: &str = "undistort the photos (colmap image_undistorter) first";
        let value = |name: &str| {
            let at = kind.params.split(' ').position(|param| param == name);
            at.map_or(0.0, |i| params[i])
        };
        let name = kind.name;
        if UNSUPPORTED.contains(&name) {
            let problem = format!("{name} is not supported; {UNDISTORT}");
            return Err(("model", problem));
        }
        let is_fisheye = name.ends_with("FISHEYE");
        if !is_fisheye && ["k4", "k5", "k6"].iter().any(|k| value(k) != 0.0) {
            let problem = format!("{name} with k4, k5 or k6 is not supported; {UNDISTORT}");
            return Err(("params", problem));
        }
        if !size.iter().all(|side| (1..=1_000_000).contains(side)) {
            let problem = format!("{} x {} is not a picture size", size[0], size[1]);
            return Err(("width, height", problem));
        }
        let is_usable = |v: &f64| (*v as f32).is_finite();
        // A lens has one focal length or two.
        let focal = ["fx", "fy"].map(|axis| value("f") + value(axis));
        if !focal.iter().all(|f| *f > 0.0 && is_usable(f)) {
            return Err(("params", format!("focal length {focal:?} is not positive")));
        }
        if !params.iter().all(is_usable) {
            return Err(("params", "not finite".to_owned()));
        }
        let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(|k| value(k) as f32);
        let lens = [focal[0], focal[1], value("cx"), value("cy")];
        Ok(Self {
            id,
            intrinsics: Intrinsics {
                size: Some((size[0] as u32, size[1] as u32)),
                distortion: Distortion {
                    model: if is_fisheye {
                        LensModel::Fisheye
                    } else {
                        LensModel::Perspective
                    },
                    k1,
                    k2,
                    k3,
                    k4,
                    p1: value("p1") as f32,
                    p2: value("p2") as f32,
                },
                ..Intrinsics::pinhole(lens.map(|v| v as f32))
            },
        })
    }
}

/// A registered photo.
#[derive(Clone, Debug)]
pub struct ColmapImage {
    /// What tracks refer to it by.
    pub id: u32,
    /// Its lens.
    pub camera_id: u32,
    /// The photo's path within the folder of photos.
    pub name: String,
    /// The pose.
    pub world_from_camera: Affine3A,
    /// Features with their points, where they were asked for.
    pub observations: Vec<Observation>,
}

impl ColmapImage {
    /// `quaternion`: w, x, y, z of the rotation from world to camera.
    pub(super) fn new(
        id: u32,
        camera_id: u32,
        name: String,
        quaternion: [f64; 4],
        translation: DVec3,
    ) -> Result<Self, Fault> {
        let [w, x, y, z] = quaternion;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let length = rotation.length();
        // Text files round to six digits or fewer; anything far from one is no rotation.
        if !(0.5..2.0).contains(&length) {
            return Err(("qvec", format!("{quaternion:?} is not a rotation")));
        }
        let rotation = DMat3::from_quat(rotation * (1.0 / length));
        let world_from_camera = world_from_opencv(rotation, translation);
        if !world_from_camera.is_finite() {
            return Err(("tvec", format!("{translation} is too far away")));
        }
        Ok(Self {
            id,
            camera_id,
            name,
            world_from_camera,
            observations: Vec::new(),
        })
    }
}

/// A feature in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// From the left edge, pixels.
    pub x_px: f64,
    /// From the top edge, pixels.
    pub y_px: f64,
    /// The point that it shows, if it was matched.
    pub point_id: Option<u64>,
}

/// A triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapPoint {
    /// What observations refer to it by.
    pub id: u64,
    /// World coordinates.
    pub position: DVec3,
    /// sRGB.
    pub color: [u8; 3],
    /// Mean reprojection error; may be negative or no number where it was never computed.
    pub error_px: f64,
    /// Ids of the images that see it.
    pub seen_by: Vec<u32>,
}
