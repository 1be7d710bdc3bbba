//! Small captures of every layout for tests, written from the same cameras.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3, DVec4, Mat4, Vec3};
use serde_json::json;
use tempfile::TempDir;

use crate::data::files::npy::tests::{npy_of, npz_of};
use crate::data::files::pickle::tests::{LENS, POSE, PROTOCOL_4, bytes_of};
use crate::data::{Listing, write_png_srgb};
use crate::geometry::{Camera, Distortion};

/// Size of the photos.
pub(in crate::data) const SIZE: (u32, u32) = (40, 30);

/// Nine cameras around the origin, each looking a little past it.
pub(in crate::data) fn cameras() -> Vec<Camera> {
    (0..9)
        .map(|i| {
            let angle = 0.7 * i as f32;
            let eye = Vec3::new(4.0 * angle.cos(), 4.0 * angle.sin(), 0.3 * i as f32);
            let target = Vec3::new(0.1, -0.2, 0.05 * i as f32);
            Camera::look_at(eye, target, Vec3::Z, 0.9, SIZE.0, SIZE.1)
        })
        .collect()
}

/// The same with the principal point off the middle.
pub(super) fn shifted_cameras() -> Vec<Camera> {
    cameras()
        .into_iter()
        .map(|camera| Camera {
            cx: 21.25,
            cy: 14.5,
            fy: 1.02 * camera.fy,
            ..camera
        })
        .collect()
}

/// A folder that is removed on drop.
pub(in crate::data) fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Writes one photo a camera: `0000.png` and so on.
pub(in crate::data) fn write_photos(folder: &Path, n: usize) {
    std::fs::create_dir_all(folder).unwrap();
    for i in 0..n {
        let shade = [i as f32 / n as f32; 3];
        let pixels = vec![shade; (SIZE.0 * SIZE.1) as usize];
        write_png_srgb(&folder.join(format!("{i:04}.png")), SIZE.0, SIZE.1, &pixels).unwrap();
    }
}

/// A capture of nine photos in the folder `photos`, with what `write` adds.
pub(in crate::data) fn capture(photos: &str, write: impl Fn(&Path)) -> TempDir {
    let folder = folder();
    write_photos(&folder.path().join(photos), 9);
    write(folder.path());
    folder
}

/// From camera to world with x right, y down, z forward.
fn world_from_opencv(camera: &Camera) -> DMat4 {
    let world_from_camera = Mat4::from(camera.world_from_camera).as_dmat4();
    world_from_camera * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0))
}

/// The other way.
fn extrinsic(camera: &Camera) -> DMat4 {
    world_from_opencv(camera).inverse()
}

/// A matrix row by row.
fn rows(m: DMat4) -> [f64; 16] {
    m.transpose().to_cols_array()
}

/// The lens as a matrix whose pixel centres are whole numbers.
fn k_of(camera: &Camera) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(f64::from(camera.fx), 0.0, 0.0),
        DVec3::new(0.0, f64::from(camera.fy), 0.0),
        DVec3::new(f64::from(camera.cx) - 0.5, f64::from(camera.cy) - 0.5, 1.0),
    )
}

/// `w, x, y, z` and translation, as COLMAP has it.
fn colmap_pose(camera: &Camera) -> ([f64; 4], [f64; 3]) {
    let (_, q, translation) = extrinsic(camera).to_scale_rotation_translation();
    ([q.w, q.x, q.y, q.z], translation.to_array())
}

/// The parameters of COLMAP's OPENCV model.
fn colmap_params(camera: &Camera) -> Vec<f64> {
    let d: Distortion = camera.distortion;
    [
        camera.fx, camera.fy, camera.cx, camera.cy, d.k1, d.k2, d.p1, d.p2,
    ]
    .map(f64::from)
    .to_vec()
}

/// Writes `cameras.bin`, `images.bin` and `points3D.bin`, images in reverse order of names.
pub(in crate::data) fn write_colmap_binary(folder: &Path, cameras: &[Camera]) {
    std::fs::create_dir_all(folder).unwrap();
    let f64s =
        |values: &[f64]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let mut bytes = 1_u64.to_le_bytes().to_vec();
    bytes.extend([7_u32, 4].map(u32::to_le_bytes).as_flattened());
    let size = [SIZE.0, SIZE.1].map(u64::from);
    bytes.extend(size.map(u64::to_le_bytes).as_flattened());
    bytes.extend(f64s(&colmap_params(&cameras[0])));
    std::fs::write(folder.join("cameras.bin"), bytes).unwrap();
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (i, camera) in cameras.iter().enumerate().rev() {
        let (q, t) = colmap_pose(camera);
        bytes.extend((i as u32 + 100).to_le_bytes());
        bytes.extend([f64s(&q), f64s(&t)].concat());
        bytes.extend(7_u32.to_le_bytes());
        bytes.extend(format!("{i:04}.png\0").as_bytes());
        bytes.extend(1_u64.to_le_bytes());
        bytes.extend(f64s(&[3.5, 4.5]));
        bytes.extend(5_u64.to_le_bytes());
    }
    std::fs::write(folder.join("images.bin"), bytes).unwrap();
    let mut bytes = [1_u64, 5].map(u64::to_le_bytes).concat();
    bytes.extend(f64s(&[0.1, 0.2, 0.3]));
    bytes.extend([10, 20, 30]);
    bytes.extend(0.5_f64.to_le_bytes());
    bytes.extend(1_u64.to_le_bytes());
    bytes.extend([100_u32, 0].map(u32::to_le_bytes).as_flattened());
    std::fs::write(folder.join("points3D.bin"), bytes).unwrap();
}

/// The same as text.
pub(in crate::data) fn write_colmap_text(folder: &Path, cameras: &[Camera]) {
    std::fs::create_dir_all(folder).unwrap();
    let join = |values: &[f64]| {
        let words: Vec<String> = values.iter().map(ToString::to_string).collect();
        words.join(" ")
    };
    let params = join(&colmap_params(&cameras[0]));
    let text = format!("# Camera list\n7 OPENCV {} {} {params}\n", SIZE.0, SIZE.1);
    std::fs::write(folder.join("cameras.txt"), text).unwrap();
    let mut text = "# Image list with two lines of data per image:\n".to_owned();
    for (i, camera) in cameras.iter().enumerate() {
        let (q, t) = colmap_pose(camera);
        // Every other photo has no feature: its second line is empty.
        let features = if i % 2 == 0 { "3.5 4.5 5 1 2 -1" } else { "" };
        writeln!(
            text,
            "{i} {} {} 7 {i:04}.png\n{features}",
            join(&q),
            join(&t)
        )
        .unwrap();
    }
    std::fs::write(folder.join("images.txt"), text).unwrap();
    let text = "# 3D point list\n5 0.1 0.2 0.3 10 20 30 0.5 0 0\n";
    std::fs::write(folder.join("points3D.txt"), text).unwrap();
}

/// Writes `poses_bounds.npy`.
pub(in crate::data) fn write_llff(root: &Path, cameras: &[Camera]) {
    let mut values = Vec::new();
    for camera in cameras {
        let axes = camera.world_from_camera.matrix3;
        let columns = [
            -Vec3::from(axes.y_axis),
            axes.x_axis.into(),
            axes.z_axis.into(),
            camera.position(),
            Vec3::new(camera.height as f32, camera.width as f32, camera.fx),
        ];
        values.extend((0..3).flat_map(|i| columns.iter().map(move |c| f64::from(c[i]))));
        values.extend([1.5, 9.0]);
    }
    let bytes = npy_of(&[cameras.len(), 17], &values);
    std::fs::write(root.join("poses_bounds.npy"), bytes).unwrap();
}

/// How the unit sphere of [`write_idr`] lies in its world.
pub(super) const SPHERE_SCALE: f64 = 150.0;

/// Writes `cameras_sphere.npz`: cameras in units of the sphere, matrices in those of a world that
/// is larger and elsewhere.
pub(in crate::data) fn write_idr(root: &Path, cameras: &[Camera]) {
    let scale_mat = DMat4::from_cols(
        DVec4::X * SPHERE_SCALE,
        DVec4::Y * SPHERE_SCALE,
        DVec4::Z * SPHERE_SCALE,
        DVec4::new(-28.0, 30.0, 640.0, 1.0),
    );
    let matrix = |m: DMat4| npy_of(&[4, 4], &rows(m));
    let mut arrays = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let k = DMat4::from_mat3(k_of(camera));
        let projection = k * extrinsic(camera) * scale_mat.inverse();
        // A projection is known up to a factor, of either sign.
        let factor = if i % 2 == 0 { 3.0 } else { -0.1 };
        arrays.push((format!("world_mat_{i}"), matrix(projection * factor)));
        arrays.push((format!("scale_mat_{i}"), matrix(scale_mat)));
    }
    std::fs::write(root.join("cameras_sphere.npz"), npz_of(&arrays)).unwrap();
}

/// Writes `cams/*_cam.txt`.
pub(in crate::data) fn write_blended_mvs(root: &Path, cameras: &[Camera]) {
    let folder = root.join("cams");
    std::fs::create_dir_all(&folder).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        let mut text = format!("extrinsic\n{}", lines_of(extrinsic(camera)));
        let k = k_of(camera).transpose();
        writeln!(text, "\nintrinsic").unwrap();
        for row in [k.x_axis, k.y_axis, k.z_axis] {
            writeln!(text, "{} {} {} ", row.x, row.y, row.z).unwrap();
        }
        writeln!(text, "\n1.5 0.05 128 9.0 ").unwrap();
        std::fs::write(folder.join(format!("{i:04}_cam.txt")), text).unwrap();
    }
}

/// A matrix as text, four numbers a line.
fn lines_of(m: DMat4) -> String {
    let rows = rows(m);
    let lines = rows
        .chunks(4)
        .map(|row| format!("{} {} {} {}\n", row[0], row[1], row[2], row[3]));
    lines.collect()
}

/// Writes `pose/*.txt` and `intrinsic/intrinsic_color.txt`.
pub(in crate::data) fn write_rgbd(root: &Path, cameras: &[Camera]) {
    std::fs::create_dir_all(root.join("pose")).unwrap();
    std::fs::create_dir_all(root.join("intrinsic")).unwrap();
    let lens = lines_of(DMat4::from_mat3(k_of(&cameras[0])));
    std::fs::write(root.join("intrinsic/intrinsic_color.txt"), lens).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        let pose = lines_of(world_from_opencv(camera));
        std::fs::write(root.join(format!("pose/{i:04}.txt")), pose).unwrap();
    }
}

/// Writes `trajectory.log`, `traj.txt` or `groundtruth.txt` with what lies beside it: the lens, and for the last
/// `rgb.txt` and `depth.txt`. Photo `i` was taken between two poses, its depth map (`depth/depth0000.png`) a little later.
pub(in crate::data) fn write_trajectory(root: &Path, file: &str, cameras: &[Camera]) {
    let k = k_of(&cameras[0]);
    let (fx, fy, cx, cy) = (k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y);
    let (mut poses, mut photos, mut depths) =
        ("# poses\n".to_owned(), String::new(), String::new());
    for (i, camera) in cameras.iter().enumerate() {
        let pose = world_from_opencv(camera);
        match file {
            "trajectory.log" => writeln!(poses, "{i} {i} {}\n{}", i + 1, lines_of(pose)).unwrap(),
            "traj.txt" => writeln!(poses, "{}", lines_of(pose).replace('\n', " ")).unwrap(),
            _ => {
                let (_, q, p) = pose.to_scale_rotation_translation();
                let secs = 1000.0 + 0.5 * i as f64;
                for at in [secs - 0.004, secs + 0.006] {
                    writeln!(
                        poses,
                        "{at} {} {} {} {} {} {} {}",
                        p.x, p.y, p.z, q.x, q.y, q.z, q.w
                    )
                    .unwrap();
                }
                writeln!(photos, "{secs} rgb/{i:04}.png").unwrap();
                writeln!(depths, "{} depth/depth{i:04}.png", secs + 0.01).unwrap();
            }
        }
    }
    let lens = match file {
        "trajectory.log" => {
            let matrix = k.to_cols_array();
            let lens = json!({"width": SIZE.0, "height": SIZE.1, "intrinsic_matrix": matrix});
            ("camera_intrinsic.json", lens.to_string())
        }
        "traj.txt" => {
            let (w, h) = SIZE;
            let lens =
                json!({"w": w, "h": h, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "scale": 6553.5});
            ("cam_params.json", json!({"camera": lens}).to_string())
        }
        _ => {
            std::fs::write(root.join("rgb.txt"), photos).unwrap();
            std::fs::write(root.join("depth.txt"), depths).unwrap();
            ("calibration.txt", format!("{fx} {fy} {cx} {cy}\n"))
        }
    };
    std::fs::write(root.join(file), poses).unwrap();
    std::fs::write(root.join(lens.0), lens.1).unwrap();
}

/// Writes `0-camera.pkl` and so on.
pub(in crate::data) fn write_nero(root: &Path, cameras: &[Camera]) {
    let whole = bytes_of(PROTOCOL_4);
    let place = |bytes: &[u8]| whole.windows(bytes.len()).position(|w| w == bytes).unwrap();
    let pose_bytes = |pose: &[f64]| -> Vec<u8> {
        let numbers = pose.iter().map(|v| *v as f32);
        numbers.flat_map(f32::to_le_bytes).collect()
    };
    let lens_bytes =
        |lens: &[f64]| -> Vec<u8> { lens.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let (pose_at, lens_at) = (place(&pose_bytes(&POSE)), place(&lens_bytes(&LENS)));
    for (i, camera) in cameras.iter().enumerate() {
        let pose = pose_bytes(&rows(extrinsic(camera))[..12]);
        let lens = lens_bytes(&k_of(camera).transpose().to_cols_array());
        let mut bytes = whole.clone();
        bytes[pose_at..pose_at + pose.len()].copy_from_slice(&pose);
        bytes[lens_at..lens_at + lens.len()].copy_from_slice(&lens);
        std::fs::write(root.join(format!("{i}-camera.pkl")), bytes).unwrap();
    }
}

/// Writes `inputs/sfm_scene.json`.
pub(in crate::data) fn write_neilf(root: &Path, cameras: &[Camera]) -> PathBuf {
    let inputs = root.join("inputs");
    std::fs::create_dir_all(&inputs).unwrap();
    let mut scene = json!({"camera_track_map": {"images": {}}, "image_path": {"file_paths": {}}});
    for (i, camera) in cameras.iter().enumerate() {
        let rows = extrinsic(camera).transpose().to_cols_array_2d();
        scene["camera_track_map"]["images"][i.to_string()] = json!({
            "camera": {
                "intrinsic": {"focal": [camera.fx, camera.fy], "ppt": [camera.cx, camera.cy]},
                "extrinsic": rows,
            },
            "flg": 2,
            "size": [SIZE.0, SIZE.1],
        });
        let photo = format!("/home/someone/data/{i:04}.png");
        scene["image_path"]["file_paths"][i.to_string()] = json!(photo);
    }
    std::fs::write(inputs.join("sfm_scene.json"), scene.to_string()).unwrap();
    inputs
}

/// Fails unless the listed cameras see what `cameras` do, to a hundredth of a pixel. Photos are named by their numbers.
pub(super) fn assert_cameras(listing: &Listing, cameras: &[Camera]) {
    assert_eq!(listing.frames().count(), cameras.len(), "cameras");
    for frame in listing.frames() {
        let name = frame.photo.file_name().unwrap().to_string_lossy();
        let number: usize = name.split('.').next().unwrap().parse().unwrap();
        let (camera, rescaled) = frame.camera(SIZE.0, SIZE.1).unwrap();
        assert!(!rescaled, "{}: the lens fits the photo", frame.name);
        for p in [[0.0, 0.0, 0.0], [0.3, -0.4, 0.5], [-0.5, 0.2, 0.1]].map(Vec3::from) {
            let found = camera.project(p).unwrap();
            let expected = cameras[number].project(p).unwrap();
            let is_near = found.distance(expected) < 0.01;
            assert!(is_near, "{}: {found}, not {expected}", frame.name);
        }
    }
}
