//! LPIPS with the published weights that lie beside a developer's checkout; skipped where absent.

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "tests report what they skip and stop at the first surprise"
)]

use std::path::{Path, PathBuf};

use neif::data::read_photo;
use neif::train::measure::lpips::Lpips;

/// Columns of the example pictures.
const WIDTH: usize = 64;

/// The folder of weights and example pictures, or `None` with a message.
fn weights_folder() -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/real/lpips");
    if path.is_dir() {
        Some(path)
    } else {
        println!("SKIPPED: {} is absent", path.display());
        None
    }
}

fn picture(path: &Path) -> Vec<[f32; 3]> {
    let photo = read_photo(path).unwrap();
    (0..photo.n_pixels()).map(|i| photo.srgb(i)).collect()
}

/// Expected distances: a forward pass in double precision with `numpy` on the same files.
#[test]
fn published_networks_give_the_known_distances_of_the_example_pictures() {
    let Some(folder) = weights_folder() else {
        return;
    };
    let pictures = ["ex_ref.png", "ex_p0.png", "ex_p1.png"];
    let [reference, p0, p1] = pictures.map(|name| picture(&folder.join(name)));
    for (file, expected) in [
        ("lpips_alex_v0.1.safetensors", [0.721_880_71, 0.137_565_61]),
        (
            "lpips_squeeze_v0.1.safetensors",
            [0.711_047_64, 0.147_901_58],
        ),
    ] {
        let lpips = Lpips::read(&folder.join(file)).unwrap();
        for (other, expected) in [&p0, &p1].into_iter().zip(expected) {
            let distance = lpips.distance(&reference, other, WIDTH).unwrap();
            println!("{file}: {distance:.7}");
            assert!(
                (distance - expected).abs() < 1e-5,
                "{file}: {distance}, expected {expected}"
            );
        }
    }
}
