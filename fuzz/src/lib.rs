//! A capture around the fuzzed file, made anew for each input in one temporary folder.

use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use neif::data::{Dataset, LoadOptions, check, write_png_srgb};
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> =
    LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

/// A lens of COLMAP, number 7 as in the tests' captures, and one pose of the photo `0000.png` by it.
pub mod colmap {
    const LENS: u32 = 7;
    const PINHOLE: u32 = 1;
    /// `cameras.txt`.
    pub const CAMERAS: &str = "7 PINHOLE 40 30 50 50 20 15\n";
    /// `images.txt`.
    pub const IMAGES: &str = "1 1 0 0 0 0 0 0 7 0000.png\n\n";

    /// `cameras.bin`.
    pub fn cameras_bin() -> Vec<u8> {
        let mut bytes = 1_u64.to_le_bytes().to_vec();
        bytes.extend([LENS, PINHOLE].map(u32::to_le_bytes).as_flattened());
        bytes.extend([40_u64, 30].map(u64::to_le_bytes).as_flattened());
        let lens = [50.0_f64, 50.0, 20.0, 15.0];
        bytes.extend(lens.map(f64::to_le_bytes).as_flattened());
        bytes
    }

    /// `images.bin`, without features.
    pub fn images_bin() -> Vec<u8> {
        let mut bytes = 1_u64.to_le_bytes().to_vec();
        bytes.extend(1_u32.to_le_bytes());
        let pose = [1.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        bytes.extend(pose.map(f64::to_le_bytes).as_flattened());
        bytes.extend(LENS.to_le_bytes());
        bytes.extend(b"0000.png\0");
        bytes.extend(0_u64.to_le_bytes());
        bytes
    }
}

/// Loads the capture in which `name` has the content `bytes`, its depth maps too; `beside` are other files of it.
pub fn load_with(name: &str, bytes: &[u8], beside: &[(&str, &[u8])]) {
    let root = root_of(name);
    if !root.exists() {
        write_photos(&root);
        for (name, bytes) in beside {
            write(&root, name, bytes);
        }
    }
    write(&root, name, bytes);
    match Dataset::load(&root, &LoadOptions::default()) {
        Ok(dataset) => {
            drop(check(&dataset).to_string());
            for depth in &dataset.origin.depths {
                let view = dataset.views().find(|view| view.name == depth.name);
                if let Some(Err(error)) = view.map(|view| depth.read(&view.camera)) {
                    assert_names(&error, &root);
                }
            }
        }
        Err(error) => assert_names(&error, &root),
    }
}

/// The same for a file beside a capture whose cameras are whole.
pub fn load_beside_cameras(name: &str, bytes: &[u8]) {
    let images = match name.strip_prefix("images/") {
        Some(photo) => colmap::IMAGES.replace("0000.png", photo),
        None => colmap::IMAGES.to_owned(),
    };
    load_with(
        name,
        bytes,
        &[
            ("sparse/cameras.txt", colmap::CAMERAS.as_bytes()),
            ("sparse/images.txt", images.as_bytes()),
        ],
    );
}

/// The same for a depth map of this ending, of a depth camera.
pub fn load_depth(ending: &str, bytes: &[u8]) {
    let pose = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    load_with(
        &format!("depth/0000.{ending}"),
        bytes,
        &[
            ("pose/0000.txt", pose.as_bytes()),
            ("intrinsics.txt", b"50 0 20 0 50 15 0 0 1"),
        ],
    );
}

/// Reads the single file `name` with the content `bytes`, which is no part of a capture.
pub fn read_with<T, E: Display>(name: &str, bytes: &[u8], read: impl Fn(&Path) -> Result<T, E>) {
    let root = root_of(name);
    write(&root, name, bytes);
    if let Err(error) = read(&root.join(name)) {
        assert_names(&error, &root);
    }
}

/// The folder in which `name` is fuzzed.
fn root_of(name: &str) -> PathBuf {
    FOLDER.path().join(name.replace(['/', '.'], "_"))
}

fn write(root: &Path, name: &str, bytes: &[u8]) {
    let path = root.join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    fs::write(path, bytes).expect("a file");
}

/// An error names a file.
fn assert_names(error: &impl Display, root: &Path) {
    let message = error.to_string();
    assert!(message.contains(&*root.to_string_lossy()), "{message}");
}

/// The photos of every layout: as many as the tests' captures have where the fuzzed file speaks of them all, and one
/// where it speaks of one.
fn write_photos(root: &Path) {
    let folders = ["images", "image", "inputs/images", "color"];
    let names = folders.map(|folder| (0..9).map(move |i| format!("{folder}/{i:04}.png")));
    let others = ["blended_images/0000.png", "0.png"].map(str::to_owned);
    for name in names.into_iter().flatten().chain(others) {
        let path = root.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        write_png_srgb(&path, 40, 30, &[[0.5; 3]; 1200]).expect("a photo");
    }
}
