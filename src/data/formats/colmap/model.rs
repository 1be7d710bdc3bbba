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
    /// Numbers that describe a lens.
    pub(super) n_params: usize,
    lens: Option<fn(&[f64]) -> Lens>,
}

/// Focal lengths, principal point and distortion.
#[derive(Clone, Copy)]
struct Lens {
    focal: [f64; 2],
    center: [f64; 2],
    model: LensModel,
    /// `k1, k2, k3, k4`.
    k: [f64; 4],
    /// `p1, p2`.
    p: [f64; 2],
    /// Whether coefficients that [`Distortion`] does not know are used.
    has_more: bool,
}

/// All models by id, as in COLMAP's `sensor/models.h`; those without a function are not expressible.
pub(super) const KINDS: [LensKind; 12] = [
    kind("SIMPLE_PINHOLE", 3, |p| one_focal(p, [0.0; 4])),
    kind("PINHOLE", 4, |p| two_focals(p, [0.0; 4], [0.0; 2])),
    kind("SIMPLE_RADIAL", 4, |p| one_focal(p, [p[3], 0.0, 0.0, 0.0])),
    kind("RADIAL", 5, |p| one_focal(p, [p[3], p[4], 0.0, 0.0])),
    kind("OPENCV", 8, |p| {
        two_focals(p, [p[4], p[5], 0.0, 0.0], [p[6], p[7]])
    }),
    kind("OPENCV_FISHEYE", 8, |p| {
        fisheye(two_focals(p, [p[4], p[5], p[6], p[7]], [0.0; 2]))
    }),
    kind("FULL_OPENCV", 12, |p| Lens {
        has_more: p[9..12].iter().any(|k| *k != 0.0),
        ..two_focals(p, [p[4], p[5], p[8], 0.0], [p[6], p[7]])
    }),
    unknown("FOV", 5),
    kind("SIMPLE_RADIAL_FISHEYE", 4, |p| {
        fisheye(one_focal(p, [p[3], 0.0, 0.0, 0.0]))
    }),
    kind("RADIAL_FISHEYE", 5, |p| {
        fisheye(one_focal(p, [p[3], p[4], 0.0, 0.0]))
    }),
    unknown("THIN_PRISM_FISHEYE", 12),
    unknown("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

const fn kind(name: &'static str, n_params: usize, lens: fn(&[f64]) -> Lens) -> LensKind {
    LensKind {
        name,
        n_params,
        lens: Some(lens),
    }
}

const fn unknown(name: &'static str, n_params: usize) -> LensKind {
    LensKind {
        name,
        n_params,
        lens: None,
    }
}

/// `f, cx, cy, ..`.
fn one_focal(p: &[f64], k: [f64; 4]) -> Lens {
    Lens {
        focal: [p[0], p[0]],
        center: [p[1], p[2]],
        model: LensModel::Perspective,
        k,
        p: [0.0; 2],
        has_more: false,
    }
}

/// `fx, fy, cx, cy, ..`.
fn two_focals(params: &[f64], k: [f64; 4], p: [f64; 2]) -> Lens {
    Lens {
        focal: [params[0], params[1]],
        center: [params[2], params[3]],
        model: LensModel::Perspective,
        k,
        p,
        has_more: false,
    }
}

fn fisheye(lens: Lens) -> Lens {
    Lens {
        model: LensModel::Fisheye,
        ..lens
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
        let Some(lens) = kind.lens.map(|lens| lens(params)) else {
            let problem = format!("{} is not supported; {UNDISTORT}", kind.name);
            return Err(("model", problem));
        };
        if lens.has_more {
            let problem = format!(
                "{} with k4, k5 or k6 is not supported; {UNDISTORT}",
                kind.name
            );
            return Err(("params", problem));
        }
        let [width, height] = size;
        if !(1..=1_000_000).contains(&width) || !(1..=1_000_000).contains(&height) {
            return Err((
                "width, height",
                format!("{width} x {height} is not a picture size"),
            ));
        }
        let is_usable = |v: &f64| (*v as f32).is_finite();
        if !lens.focal.iter().all(|f| *f > 0.0 && is_usable(f)) {
            return Err((
                "params",
                format!("focal length {:?} is not positive", lens.focal),
            ));
        }
        if !params.iter().all(is_usable) {
            return Err(("params", "not finite".to_owned()));
        }
        let [k1, k2, k3, k4] = lens.k.map(|v| v as f32);
        Ok(Self {
            id,
            intrinsics: Intrinsics {
                size: Some((width as u32, height as u32)),
                fl_x: Some(lens.focal[0] as f32),
                fl_y: Some(lens.focal[1] as f32),
                cx: Some(lens.center[0] as f32),
                cy: Some(lens.center[1] as f32),
                distortion: Distortion {
                    model: lens.model,
                    k1,
                    k2,
                    k3,
                    k4,
                    p1: lens.p[0] as f32,
                    p2: lens.p[1] as f32,
                },
                ..Intrinsics::default()
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
