//! Turntables, films, layers and transparency of `neif render`.

use std::fs::{self, File};
use std::path::Path;

use exr::meta::MetaData;

use super::WORKSHOP;
use super::program::{self, neif, same_picture};

fn render(name: &str, flags: &[&str]) -> program::Run {
    let (run, out) = (WORKSHOP.path("run"), WORKSHOP.path(name));
    neif(&[&["render", &run, "--out", &out][..], flags].concat())
}

fn at(name: &str) -> std::path::PathBuf {
    WORKSHOP.folder.path().join(name)
}

fn n_files(folder: &Path) -> usize {
    fs::read_dir(folder).expect("a folder").count()
}

#[test]
fn an_environment_turns_from_where_it_stands() {
    let small = ["--size", "24x16", "--turntable"];
    render("still", &[&small[..], &["1"]].concat()).succeeds();
    render(
        "spin",
        &[&small[..], &["3", "--spin", "environment"]].concat(),
    )
    .succeeds();
    assert_eq!(n_files(&at("spin")), 3);
    let still = at("still/turn_000.png");
    assert!(same_picture(&still, &at("spin/turn_000.png")), "the first");
    assert!(!same_picture(&still, &at("spin/turn_001.png")), "the next");
}

#[test]
fn a_gif_has_every_picture() {
    let flags = [
        "--turntable",
        "4",
        "--size",
        "24x16",
        "--format",
        "gif",
        "--fps",
        "10",
    ];
    render("gif", &flags).succeeds();
    let file = File::open(at("gif/turntable.gif")).expect("a gif");
    let mut decoder = gif::DecodeOptions::new().read_info(file).expect("a gif");
    assert_eq!((decoder.width(), decoder.height()), (24, 16));
    let mut delays = Vec::new();
    while let Some(frame) = decoder.read_next_frame().expect("a frame") {
        delays.push(frame.delay);
    }
    assert_eq!(delays, [10; 4]);
}

#[test]
fn without_background_pictures_are_transparent_around_the_object() {
    render("alone", &["--no-background"]).succeeds();
    let picture = image::open(at("alone/t_000.png")).expect("a picture");
    let alphas: Vec<u8> = picture.to_rgba8().pixels().map(|p| p.0[3]).collect();
    for alpha in [0, 255] {
        assert!(alphas.contains(&alpha), "no pixel of alpha {alpha}");
    }
}

#[test]
fn an_exr_names_its_layers() {
    let flags = ["--format", "exr", "--layers", "final,diffuse,normal"];
    render("exr", &flags).succeeds();
    let meta = MetaData::read_from_file(at("exr/t_000.exr"), false).expect("an EXR");
    let channels = meta.headers[0].channels.list.iter();
    let names: Vec<String> = channels.map(|c| c.name.to_string()).collect();
    let expected = "A B G R Z diffuse.B diffuse.G diffuse.R normal.X normal.Y normal.Z";
    assert_eq!(names.join(" "), expected);
}

#[test]
fn a_camera_path_passes_from_the_first_camera_to_the_last() {
    let cameras = WORKSHOP.path("scene/transforms_val.json");
    let flags = ["--cameras", &cameras, "--size", "32x32"];
    render("stops", &flags).succeeds();
    render("path", &[&flags[..], &["--frames", "5"]].concat()).succeeds();
    assert_eq!(n_files(&at("path")), 5);
    let mut stops: Vec<_> = fs::read_dir(at("stops")).expect("pictures").collect();
    stops.sort_by_key(|entry| entry.as_ref().expect("a file").file_name());
    let first = stops[0].as_ref().expect("a file").path();
    let read = |path: &Path| image::open(path).expect("a picture").to_rgb8();
    let (a, b) = (read(&first), read(&at("path/path_0000.png")));
    let off = a
        .iter()
        .zip(b.iter())
        .map(|(a, b)| f64::from(a.abs_diff(*b)));
    let mean = off.sum::<f64>() / a.len() as f64;
    assert!(mean < 0.5, "the first picture is off by {mean} of 255");
}

#[cfg(unix)]
#[test]
fn an_mp4_is_made_by_ffmpeg_or_it_is_said_what_is_missing() {
    use std::os::unix::fs::PermissionsExt as _;
    let (run, tools) = (WORKSHOP.path("run"), at("tools"));
    fs::create_dir(&tools).expect("a folder");
    let path = format!("{}:/usr/bin:/bin", tools.display());
    let flags = ["--turntable", "3", "--size", "8x6", "--format", "mp4"];
    let out = WORKSHOP.path("video");
    let args = [&["render", &run, "--out", &out][..], &flags].concat();
    let missing = program::neif_with_path(&WORKSHOP.path("tools"), &args);
    assert_eq!(missing.code, 2, "{}", missing.stderr);
    assert!(missing.stderr.contains("ffmpeg"), "{}", missing.stderr);
    assert!(!at("video").exists(), "nothing was begun");
    let script = "#!/bin/sh\nfor out; do :; done\ncat > \"$out\"\n";
    fs::write(tools.join("ffmpeg"), script).expect("a script");
    let executable = fs::Permissions::from_mode(0o755);
    fs::set_permissions(tools.join("ffmpeg"), executable).expect("a script");
    program::neif_with_path(&path, &args).succeeds();
    let bytes = fs::read(at("video/turntable.mp4")).expect("a film");
    assert_eq!(bytes.len(), 3 * 8 * 6 * 3, "every pixel of every picture");
}

#[test]
fn ctrl_c_leaves_nothing_of_a_series() {
    let run = WORKSHOP.path("run");
    for (format, out) in [("png", "cut"), ("gif", "cut.gif")] {
        let folder = at(&format!("cut_{format}"));
        fs::create_dir(&folder).expect("a folder");
        let out = folder.join(out).display().to_string();
        let flags = ["--turntable", "2000", "--format", format, "--out", &out];
        let cut = program::interrupted_while_noting(
            &[&["render", &run][..], &flags].concat(),
            "Rendering",
        );
        assert_eq!(cut.code, 130, "{}", cut.stderr);
        assert_eq!(n_files(&folder), 0, "{format}: something was left");
    }
}
