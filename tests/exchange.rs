//! What comes from other programs and goes to them: panoramas in, glTF out, through the built program.

#[path = "cli/program.rs"]
mod program;

use std::fs;
use std::path::{Path, PathBuf};

use neif::data::{ExrSample, read_exr_linear, read_photo, write_exr, write_png_srgb};

use self::program::{neif, neif_in};

fn text(path: &Path) -> &str {
    path.to_str().expect("a path of plain letters")
}

/// A sky with a lamp, 64 x 32.
fn sky() -> Vec<[f32; 3]> {
    let mut pixels: Vec<[f32; 3]> = (0..64 * 32)
        .map(|i| [0.1 + 0.01 * (i % 64) as f32, 0.3, 0.5])
        .collect();
    pixels[9 * 64 + 40] = [900.0, 800.0, 700.0];
    pixels
}

#[test]
fn a_panorama_becomes_an_environment_that_shows_it_exactly() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name);
    write_exr(&file("sky.exr"), 64, 32, &sky(), ExrSample::Float).expect("a picture");
    let (from, env, back) = (
        file("sky.exr"),
        file("new/env.safetensors"),
        file("back.exr"),
    );
    neif(&[
        "env",
        "import",
        text(&from),
        "--out",
        text(&env),
        "--name",
        "noon",
    ])
    .succeeds();
    let info = neif(&["info", text(&env), "--json"]).succeeds().json();
    assert_eq!(
        (&info["kind"], &info["name"]),
        (&"environment".into(), &"noon".into())
    );
    assert_eq!(
        (&info["is_far"], &info["gamma"]),
        (&true.into(), &1.0.into()),
        "{info}"
    );
    // The file, and the picture as it is.
    for source in [&env, &from] {
        let flags = ["--at", "3,-1,0.5", "--width", "64", "--out", text(&back)];
        neif(&[&["env", "panorama", text(source)][..], &flags].concat()).succeeds();
        let (_, _, pixels) = read_exr_linear(&back).expect("a panorama");
        assert!(pixels == sky(), "{}", source.display());
    }
    let again = neif(&["env", "import", text(&from), "--out", text(&env)]);
    assert_eq!(again.code, 2, "nothing is overwritten: {}", again.stderr);
}

#[test]
fn an_encoded_picture_is_imported_with_a_notice() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("sky.png");
    write_png_srgb(&file, 32, 16, &vec![[0.5; 3]; 32 * 16]).expect("a picture");
    let env = folder.path().join("env.safetensors");
    let run = neif(&["env", "import", text(&file), "--out", text(&env)]).succeeds();
    assert!(
        run.stderr.contains("no brighter than white"),
        "{}",
        run.stderr
    );
    assert!(env.is_file(), "the environment is written");
}

#[test]
fn what_is_no_panorama_ends_with_code_2() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("notes.txt"), "hello").expect("a file");
    fs::write(folder.path().join("cut.hdr"), "#?RADIANCE\n").expect("a file");
    fs::write(folder.path().join("cut.exr"), "v/1").expect("a file");
    write_png_srgb(&folder.path().join("square.png"), 8, 8, &[[0.5; 3]; 64]).expect("a picture");
    for (name, expected) in [
        (".", "folder"),
        ("notes.txt", "notes.txt"),
        ("MISSING.hdr", "MISSING.hdr"),
        ("cut.hdr", "cut.hdr"),
        ("cut.exr", "cut.exr"),
        ("square.png", "8 x 8"),
    ] {
        let run = neif_in(
            folder.path(),
            &["env", "import", name, "--out", "NEW.safetensors"],
        );
        assert_eq!(run.code, 2, "{name}: {}", run.stderr);
        assert!(run.stderr.contains(expected), "{name}: {}", run.stderr);
    }
    assert!(
        !folder.path().join("NEW.safetensors").exists(),
        "nothing is written"
    );
}

#[test]
fn real_hdris_come_back_as_they_are() {
    let hdris = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/real/hdri");
    let files: Vec<PathBuf> = fs::read_dir(&hdris)
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "hdr" || e == "exr"))
        .collect();
    if files.is_empty() {
        println!("skipped: {} is not there", hdris.display());
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (i, file) in files.iter().enumerate() {
        let env = folder.path().join(format!("{i}.safetensors"));
        let back = folder.path().join("back.exr");
        neif(&["env", "import", text(file), "--out", text(&env)]).succeeds();
        let flags = ["--at", "0,0,0", "--width", "1024", "--out", text(&back)];
        neif(&[&["env", "panorama", text(&env)][..], &flags].concat()).succeeds();
        let photo = read_photo(file).expect("a picture");
        let (width, height, pixels) = read_exr_linear(&back).expect("a panorama");
        assert_eq!((width, height), (photo.width(), photo.height()), "size");
        let n_other = (0..pixels.len())
            .filter(|&i| pixels[i] != photo.linear(i).map(|v| v.max(0.0)))
            .count();
        assert_eq!(n_other, 0, "{}", file.display());
    }
}
