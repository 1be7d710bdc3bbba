//! A capture around the fuzzed file, made anew for each input in one temporary folder.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use neif::data::{Dataset, LoadOptions, check, write_png_srgb};
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> =
    LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

/// A lens and one pose in COLMAP's text format, of the photo `0000.png`.
const CAMERAS: &str = "7 PINHOLE 40 30 50 50 20 15\n";
const IMAGES: &str = "1 1 0 0 0 0 0 0 7 0000.png\n\n";

/// Loads the capture in which `name` has the content `bytes`; `beside` are other files of it.
pub fn load_with(name: &str, bytes: &[u8], beside: &[(&str, &str)]) {
    let root = FOLDER.path().join(name.replace(['/', '.'], "_"));
    let write = |name: &str, bytes: &[u8]| {
        let path = root.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, bytes).expect("a file");
    };
    if !root.exists() {
        for folder in [
            "images",
            "image",
            "blended_images",
            "inputs/images",
            "color",
        ] {
            write_photo(&root.join(folder));
        }
        for (name, text) in beside {
            write(name, text.as_bytes());
        }
    }
    write(name, bytes);
    match Dataset::load(&root, &LoadOptions::default()) {
        Ok(dataset) => drop(check(&dataset).to_string()),
        Err(error) => assert!(
            error.to_string().contains(&*root.to_string_lossy()),
            "{error}"
        ),
    }
}

/// The same for a file beside a capture whose cameras are whole.
pub fn load_beside_cameras(name: &str, bytes: &[u8]) {
    let images = match name.strip_prefix("images/") {
        Some(photo) => IMAGES.replace("0000.png", photo),
        None => IMAGES.to_owned(),
    };
    load_with(
        name,
        bytes,
        &[
            ("sparse/cameras.txt", CAMERAS),
            ("sparse/images.txt", &images),
        ],
    );
}

fn write_photo(folder: &Path) {
    fs::create_dir_all(folder).expect("a folder");
    write_png_srgb(&folder.join("0000.png"), 40, 30, &[[0.5; 3]; 1200]).expect("a photo");
}
