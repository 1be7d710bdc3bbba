//! Feeds files to the reader that `NEIF_FUZZ_READER` names.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use neif::data::read_key_views;
use neif::neif::{Environment, SurfaceField};
use neif::scans::Scan;
use neif_fuzz::{colmap, load_beside_cameras, load_depth, load_with, read_with};

static READER: LazyLock<String> =
    LazyLock::new(|| std::env::var("NEIF_FUZZ_READER").expect("NEIF_FUZZ_READER"));
const LENS: (&str, &[u8]) = ("intrinsics.txt", b"50 0 20 0 50 15 0 0 1");

fuzz_target!(|bytes: &[u8]| {
    match READER.as_str() {
        "blended_mvs" => load_with("cams/0000_cam.txt", bytes, &[]),
        "idr_npz" => load_with("cameras_sphere.npz", bytes, &[]),
        "llff_npy" => load_with("poses_bounds.npy", bytes, &[]),
        "neilf_json" => load_with("inputs/sfm_scene.json", bytes, &[]),
        "nero_pickle" => load_with("0-camera.pkl", bytes, &[]),
        "transforms_json" => load_with("transforms.json", bytes, &[]),
        "colmap_text" => {
            let lens = ("sparse/cameras.txt", colmap::CAMERAS.as_bytes());
            load_with("sparse/images.txt", bytes, &[lens]);
        }
        "colmap_cameras_bin" => {
            let images = ("sparse/images.bin", &*colmap::images_bin());
            load_with("sparse/cameras.bin", bytes, &[images]);
        }
        "colmap_images_bin" => {
            let cameras = ("sparse/cameras.bin", &*colmap::cameras_bin());
            load_with("sparse/images.bin", bytes, &[cameras]);
        }
        "colmap_points_bin" => {
            let cameras = ("sparse/cameras.bin", &*colmap::cameras_bin());
            let images = ("sparse/images.bin", &*colmap::images_bin());
            load_with("sparse/points3D.bin", bytes, &[cameras, images]);
        }
        "depth_camera" => load_with("pose/0000.txt", bytes, &[LENS]),
        "depth_camera_lens" => {
            let pose: &[u8] = b"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
            load_with("camera_intrinsic.json", bytes, &[("pose/0000.txt", pose)]);
        }
        "depth_camera_log" => load_with("trajectory.log", bytes, &[LENS]),
        "depth_camera_times" => {
            let photos: &[u8] = b"1000 color/0000.png\n1000.5 color/0001.png\n";
            load_with("groundtruth.txt", bytes, &[LENS, ("rgb.txt", photos)]);
        }
        "depth_exr" => load_depth("exr", bytes),
        "depth_npy" => load_depth("npy", bytes),
        "depth_pfm" => load_depth("pfm", bytes),
        "depth_png" => load_depth("png", bytes),
        "mask_png" => load_beside_cameras("masks/0000.png", bytes),
        "mesh_glb" => load_beside_cameras("mesh.glb", bytes),
        "mesh_obj" => load_beside_cameras("mesh.obj", bytes),
        "mesh_ply" => load_beside_cameras("mesh.ply", bytes),
        "photo_exr" => load_beside_cameras("images/0000.exr", bytes),
        "photo_hdr" => load_beside_cameras("images/0000.hdr", bytes),
        "photo_jpg" => load_beside_cameras("images/0000.jpg", bytes),
        "photo_png" => load_beside_cameras("images/0000.png", bytes),
        "environment" => read_with("environment.safetensors", bytes, Environment::load),
        "key_views" => read_with("cameras.json", bytes, read_key_views),
        "object" => read_with("object.safetensors", bytes, SurfaceField::load),
        "scan_ckpt" => read_with("scan.ckpt", bytes, Scan::read),
        "scan_msgpack" => read_with("scan.msgpack", bytes, Scan::read),
        "scan_ply" => read_with("scan.ply", bytes, Scan::read),
        "scan_sog" => read_with("scan.sog", bytes, Scan::read),
        "scan_splat" => read_with("scan.splat", bytes, Scan::read),
        "scan_spz" => read_with("scan.spz", bytes, Scan::read),
        other => panic!("{other} is no reader"),
    }
});
