//! The examples do what they say, on the tests' small capture.

#[path = "cli/capture.rs"]
mod capture;
#[path = "cli/program.rs"]
#[expect(dead_code, reason = "other tests need more of it")]
mod program;
#[path = "../examples/query.rs"]
#[expect(dead_code, reason = "its `main` reads a command line")]
mod query;
#[path = "../examples/relight.rs"]
#[expect(dead_code, reason = "its `main` reads a command line")]
mod relight;
#[path = "../examples/train.rs"]
#[expect(dead_code, reason = "its `main` reads a command line")]
mod train;

use glam::Vec3;
use neif::data::{ExrSample, read_photo, write_exr};
use neif::train::TrainConfig;

use self::capture::write_capture;

#[test]
fn an_environment_is_trained_and_asked_for_its_light() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (capture, out) = (folder.path().join("capture"), folder.path().join("out"));
    write_capture(&capture);
    let config = TrainConfig {
        object_pixels: 64,
        background_pixels: 64,
        ..TrainConfig::default()
    };
    train::train(&capture, &out, &config, 3).expect("trained");
    assert!(out.join("object.safetensors").is_file());
    let file = out.join("environment.safetensors");
    let light = query::query(&file, Vec3::ZERO, Vec3::X).expect("light");
    assert!(light.is_finite() && light.min_element() > 0.0, "{light}");
}

#[test]
fn a_run_is_relit_by_a_panorama() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    write_capture(&path("capture"));
    std::fs::write(
        path("tiny.toml"),
        "object_pixels = 64\nbackground_pixels = 64\n",
    )
    .expect("settings");
    let words = [
        "train",
        "capture",
        "--out",
        "run",
        "--preset",
        "tiny.toml",
        "--steps",
        "3",
    ];
    program::neif_in(folder.path(), &words).succeeds();
    let red = [[1.0, 0.1, 0.1]; 32 * 16];
    write_exr(&path("red.exr"), 32, 16, &red, ExrSample::Float).expect("a panorama");
    relight::relight(&path("run"), &path("red.exr"), &path("relit.png"), 24).expect("a picture");
    let picture = read_photo(&path("relit.png")).expect("a PNG");
    let corner = picture.srgb(0);
    assert!(
        corner[0] > corner[1] + 0.3,
        "behind the object it is red: {corner:?}"
    );
}
