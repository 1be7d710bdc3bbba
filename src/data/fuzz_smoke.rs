//! Files that are damaged at random: every reader must answer with a capture or an error that names a file, within
//! bounded memory, and never panic. A few seconds by default; `NEIF_FUZZ_SECS` goes on for longer.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::files::npy::tests::npy_of;
use super::formats::test_formats::{
    cameras, capture, write_blended_mvs, write_colmap_binary, write_colmap_text, write_idr,
    write_llff, write_neilf, write_nero, write_photos, write_rgbd, write_trajectory,
};
use super::test_capture::TestCapture;
use super::{Dataset, ExrSample, LoadOptions, check, first_photo, write_exr, write_glb};
use crate::geometry::meshes::test_mesh::ellipsoid;

/// Damages of each file, without more time.
const N_SEEDS: u64 = 24;
/// Most memory that the whole test may take, kilobytes.
const MAX_KB: u64 = 3 << 20;
/// What damaged numbers become.
const NUMBERS: [&str; 8] = [
    "-1",
    "0",
    "1e999",
    "nan",
    "99999999999",
    "1e-300",
    "",
    "[[[[",
];

/// `SplitMix64`: the same damages every time.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `n`, which must not be zero.
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// The file with one to four damages.
fn damaged(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            return bytes;
        }
        let at = random.below(bytes.len());
        let end = (at + 1 + random.below(16)).min(bytes.len());
        match random.below(7) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = [0, 1, 127, 128, 255][random.below(5)],
            2 => bytes[at..end].fill(255),
            3 => bytes.truncate(at),
            4 => drop(bytes.drain(at..end)),
            5 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            _ => change_number(&mut bytes, at, random),
        }
    }
    bytes
}

/// Replaces the first number of a text from `at` on.
fn change_number(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let Some(from) = bytes[at..].iter().position(u8::is_ascii_digit) else {
        return;
    };
    let from = at + from;
    let n = bytes[from..]
        .iter()
        .take_while(|byte| byte.is_ascii_digit() || **byte == b'.')
        .count();
    let number = NUMBERS[random.below(NUMBERS.len())];
    bytes.splice(from..from + n, number.bytes());
}

/// Depth maps of each kind of file.
fn write_depths(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let codes = image::ImageBuffer::from_pixel(40, 30, image::Luma([9000_u16]));
    codes.save(folder.join("0000.png")).unwrap();
    let mut pfm = b"Pf\n40 30\n-1.0\n".to_vec();
    pfm.extend(2.0_f32.to_le_bytes().repeat(1200));
    std::fs::write(folder.join("0001.pfm"), pfm).unwrap();
    let npy = npy_of(&[30, 40], &[2.0; 1200]);
    std::fs::write(folder.join("0002.npy"), npy).unwrap();
}

/// Captures of depth cameras.
fn depth_camera_captures() -> Vec<TempDir> {
    let trajectory =
        |photos: &str, file: &str| capture(photos, |root| write_trajectory(root, file, &cameras()));
    vec![
        capture("color", |root| {
            write_rgbd(root, &cameras());
            write_depths(&root.join("depth"));
        }),
        trajectory("color", "trajectory.log"),
        trajectory("results", "traj.txt"),
        trajectory("rgb", "groundtruth.txt"),
    ]
}

/// One capture of each other layout.
fn captures() -> Vec<TempDir> {
    vec![
        capture("images", |root| {
            write_llff(root, &cameras());
            std::fs::write(root.join("mesh.ply"), PLY).unwrap();
        }),
        capture("images", |root| {
            write_colmap_binary(&root.join("sparse/0"), &cameras());
            std::fs::write(
                root.join("mesh.obj"),
                "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            )
            .unwrap();
        }),
        capture("images", |root| {
            write_colmap_text(&root.join("sparse"), &cameras());
        }),
        capture("image", |root| {
            write_idr(root, &cameras());
            write_photos(&root.join("mask"), 9);
            let mesh = ellipsoid(glam::Vec3::ZERO, glam::Vec3::ONE, 4);
            write_glb(&root.join("mesh.glb"), &mesh).unwrap();
        }),
        capture("blended_images", |root| {
            write_blended_mvs(root, &cameras());
        }),
        capture("unused", |root| {
            write_nero(root, &cameras()[..2]);
            for i in 0..2 {
                let photo = root.join(format!("{i}.png"));
                std::fs::copy(root.join(format!("unused/{i:04}.png")), photo).unwrap();
            }
            let depth = image::ImageBuffer::from_pixel(40, 30, image::Luma([9000_u16]));
            depth.save(root.join("0-depth.png")).unwrap();
        }),
        capture("inputs/images", |root| {
            write_neilf(root, &cameras());
        }),
        capture("images", |root| {
            write_colmap_text(root, &cameras()[..1]);
            let photo = root.join("images/0000.exr");
            write_exr(&photo, 40, 30, &[[0.25; 3]; 40 * 30], ExrSample::Half).unwrap();
            rename_photo(root, "0000.png", "0000.exr");
        }),
        capture("images", |root| {
            write_colmap_text(root, &cameras()[..2]);
            let picture =
                image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, 9]));
            picture.save(root.join("images/0000.jpg")).unwrap();
            let picture = image::Rgb32FImage::from_pixel(40, 30, image::Rgb([0.5; 3]));
            picture.save(root.join("images/0001.hdr")).unwrap();
            rename_photo(root, "0000.png", "0000.jpg");
            rename_photo(root, "0001.png", "0001.hdr");
        }),
    ]
}

/// Lists another photo in a COLMAP model.
fn rename_photo(root: &Path, from: &str, to: &str) {
    let file = root.join("images.txt");
    let list = std::fs::read_to_string(&file).unwrap();
    std::fs::write(file, list.replace(from, to)).unwrap();
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

/// Files worth damaging: of pictures that are alike the first alone.
fn files(root: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        let mut pictures = std::collections::HashSet::new();
        let mut entries: Vec<PathBuf> = folder
            .read_dir()
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect();
        entries.sort();
        for path in entries {
            let kind = path.extension().unwrap_or_default().to_owned();
            let is_one_of_many = kind == "png" || path.to_string_lossy().ends_with("_cam.txt");
            if path.is_dir() {
                folders.push(path);
            } else if !is_one_of_many || pictures.insert(kind) {
                found.push(path);
            }
        }
    }
    found
}

/// Copies what is worth damaging of a capture, as what `fuzz/run` starts from.
fn keep(root: &Path, folder: &Path) {
    for file in files(root) {
        let kept = folder.join(file.strip_prefix(root).unwrap());
        std::fs::create_dir_all(kept.parent().unwrap()).unwrap();
        std::fs::copy(file, kept).unwrap();
    }
}

/// Loads and examines a capture; says what broke, if anything did.
fn fault(root: &Path) -> Option<String> {
    let load = || {
        let loaded = Dataset::load(root, &LoadOptions::default());
        loaded.map(|dataset| check(&dataset).to_string())
    };
    match catch_unwind(AssertUnwindSafe(load)) {
        Ok(Ok(_report)) => None,
        Ok(Err(error)) => {
            let message = error.to_string();
            let names_a_file = message.contains(&*root.to_string_lossy());
            (!names_a_file).then(|| format!("no file is named: {message}"))
        }
        Err(_panic) => Some("a panic".to_owned()),
    }
}

/// The most memory that this process had, kilobytes; 0 where the system does not say.
fn peak_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok())
        .unwrap_or(0)
}

#[test]
fn damaged_files_are_errors_or_captures_and_never_panics() {
    let secs = std::env::var("NEIF_FUZZ_SECS")
        .ok()
        .and_then(|secs| secs.parse().ok());
    let end = Instant::now() + Duration::from_secs(secs.unwrap_or(0));
    let json = TestCapture::new(3);
    let captures = captures().into_iter().chain(depth_camera_captures());
    let captures: Vec<TempDir> = captures.collect();
    let roots: Vec<&Path> = captures
        .iter()
        .map(TempDir::path)
        .chain([json.root()])
        .collect();
    for path in &roots {
        let (root, options) = (path.display(), LoadOptions::default());
        assert_eq!(fault(path), None, "whole: {root}");
        assert!(first_photo(path).is_some(), "first photo: {root}");
        assert!(Dataset::load(path, &options).is_ok(), "whole: {root}");
    }
    if let Ok(seeds) = std::env::var("NEIF_FUZZ_SEEDS") {
        for (i, root) in roots.iter().enumerate() {
            keep(root, &Path::new(&seeds).join(i.to_string()));
        }
    }
    let mut faults = Vec::new();
    let mut seed = 0;
    while seed < N_SEEDS || Instant::now() < end {
        for root in &roots {
            for file in files(root) {
                let whole = std::fs::read(&file).unwrap();
                std::fs::write(&file, damaged(&whole, &mut Random(seed))).unwrap();
                if let Some(fault) = fault(root) {
                    let name = file.strip_prefix(root).unwrap_or(&file).display();
                    faults.push(format!("{name}, seed {seed}: {fault}"));
                    if let Ok(keep) = std::env::var("NEIF_FUZZ_KEEP") {
                        let kept = Path::new(&keep).join(format!("{seed}_{}", faults.len()));
                        std::fs::copy(&file, kept).unwrap();
                    }
                }
                std::fs::write(&file, whole).unwrap();
            }
        }
        seed += 1;
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(peak_kb() < MAX_KB, "{} kB", peak_kb());
}
