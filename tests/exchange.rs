//! What comes from other programs and goes to them: panoramas in, glTF out, through the built program.

#![expect(clippy::print_stdout, reason = "tests report what they skip")]

#[path = "cli/capture.rs"]
mod capture;
#[expect(dead_code, reason = "other tests use more of it")]
#[path = "cli/program.rs"]
mod program;
#[path = "cli/splats.rs"]
mod splats;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use neif::data::{ExrSample, read_exr_linear, read_mesh, read_photo, write_exr, write_png_srgb};

use self::capture::write_capture;
use self::program::{neif, neif_in, same_picture};

/// A folder with a run that was trained a little on a ball in a room.
static WORKSHOP: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_capture(&folder.path().join("scene"));
    let settings = "object_pixels = 64\nbackground_pixels = 64\nsamples_per_ray = 8\nrender_samples = 8\n\
                    field = { grid = { n_levels = 4, coarsest = 8, finest = 64, log2_table_size = 12 }, n_hidden = 16, view_dependent = true }\n\
                    material = { grid = { n_levels = 4, coarsest = 4, finest = 16, log2_table_size = 10 }, n_hidden = 16 }\n";
    fs::write(folder.path().join("tiny.toml"), settings).expect("settings");
    let line = "train scene --out run --preset tiny.toml --steps 60 --json";
    let words: Vec<&str> = line.split(' ').collect();
    neif_in(folder.path(), &words).succeeds();
    folder
});

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

#[test]
fn a_matched_environment_does_not_depend_on_its_exposure() {
    let folder = WORKSHOP.path();
    write_exr(&folder.join("sky.exr"), 64, 32, &sky(), ExrSample::Float).expect("a picture");
    let bright = "env import sky.exr --out bright.safetensors --exposure 6";
    neif_in(folder, &bright.split(' ').collect::<Vec<_>>()).succeeds();
    let picture = |name: &str, flags: &str| {
        let line = format!("render run --turntable 1 --size 24x24 --out {name} {flags}");
        neif_in(folder, &line.split(' ').collect::<Vec<_>>()).succeeds();
        folder.join(name).join("turn_000.png")
    };
    let plain = picture("plain", "--env sky.exr");
    let lit = picture("lit", "--env bright.safetensors");
    assert!(
        !same_picture(&plain, &lit),
        "exposure shows unless it is matched"
    );
    let plain = picture("plain_matched", "--env sky.exr --env-match");
    let lit = picture("lit_matched", "--env bright.safetensors --env-match");
    let open = |path: &Path| image::open(path).expect("a picture").to_rgb8();
    // A code at most by rounding.
    for (a, b) in open(&plain).iter().zip(open(&lit).iter()) {
        assert!(a.abs_diff(*b) <= 1, "{a} against {b}");
    }
    let brighter = picture(
        "brighter",
        "--env bright.safetensors --env-match --env-exposure 1",
    );
    assert!(!same_picture(&lit, &brighter), "an exposure comes on top");
    let own = picture("own", "--env-match");
    assert!(
        same_picture(&own, &picture("own_plain", "--env own")),
        "its own need no match"
    );
}

/// Says what Khronos' validator finds in a glTF file; skipped with a message where it is not installed.
fn validate(file: &Path) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gltf_validate.mjs");
    let Ok(output) = Command::new("node").arg(script).arg(file).output() else {
        println!("skipped: no node to run Khronos' glTF validator");
        return;
    };
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    if output.status.code() == Some(77) {
        println!("skipped: {}", out.trim());
    } else {
        assert!(output.status.success(), "{out}{err}");
        println!("{}", out.trim());
    }
}

/// The textures of a file: base colour, metallic-roughness, and the specular colour where there is one.
fn textures(file: &Path) -> Vec<image::RgbImage> {
    let file = gltf::Gltf::open(file).expect("a glTF");
    let blob = file.blob.as_ref().expect("a binary part");
    let decode = |image: gltf::Image<'_>| match image.source() {
        gltf::image::Source::View { view, .. } => {
            let png = &blob[view.offset()..view.offset() + view.length()];
            image::load_from_memory(png).expect("a PNG").to_rgb8()
        }
        gltf::image::Source::Uri { uri, .. } => panic!("{uri} is outside of the file"),
    };
    file.images().map(decode).collect()
}

#[test]
fn an_exported_object_is_valid_and_holds_the_edited_material() {
    let folder = WORKSHOP.path();
    let export = |line: &str| {
        let line = format!("export run --texture-size 128 {line}");
        neif_in(folder, &line.split(' ').collect::<Vec<_>>()).succeeds()
    };
    export("--out out/ball.glb --environment-width 64");
    validate(&folder.join("out/ball.glb"));
    let mesh = read_mesh(&folder.join("out/ball.glb")).expect("a mesh");
    let own = read_mesh(&folder.join("run/mesh.glb")).expect("a mesh");
    // Turning rounds: a sliver may lose what little area it has.
    let n_lost = own.triangles.len().abs_diff(mesh.triangles.len());
    assert!(n_lost < 5, "{n_lost} triangles are missing");
    // The capture's z is up, glTF's y.
    let (found, expected) = (mesh.bounds(), own.bounds());
    assert!((found.max.y - expected.max.z).abs() < 1e-5, "{found:?}");
    assert!((found.min.z + expected.max.y).abs() < 1e-5, "{found:?}");
    let (width, height, panorama) =
        read_exr_linear(&folder.join("out/ball_environment.exr")).expect("a panorama");
    assert_eq!((width, height), (64, 32), "size");
    let center = own.bounds().center();
    let line = format!(
        "env panorama run --at {},{},{} --width 64 --out pano.exr",
        center.x, center.y, center.z
    );
    neif_in(folder, &line.split(' ').collect::<Vec<_>>()).succeeds();
    let (_, _, seen) = read_exr_linear(&folder.join("pano.exr")).expect("a panorama");
    for (a, b) in panorama.iter().flatten().zip(seen.iter().flatten()) {
        assert!((a - b).abs() <= 1e-3 * b.abs().max(1.0), "{a} against {b}");
    }
    let plain = textures(&folder.join("out/ball.glb"));
    assert_eq!(plain[0].dimensions(), (128, 128), "the asked size");
    export("--out matt.glb --roughness 0.8 --tint-scale 0 --no-environment");
    validate(&folder.join("matt.glb"));
    let matt = textures(&folder.join("matt.glb"));
    assert!(
        matt[1].pixels().all(|p| p.0[1] == 204 && p.0[2] < 30),
        "rough, no metal"
    );
    assert!(!folder.join("matt_environment.exr").exists(), "left out");
    export("--out black.glb --diffuse-gain 0 --tint-scale 0 --no-environment");
    let black = textures(&folder.join("black.glb"));
    assert!(black[0].pixels().all(|p| p.0 == [0; 3]), "no colour");
    assert!(
        plain[0].pixels().any(|p| p.0 != [0; 3]),
        "the trained one has some"
    );
}

#[test]
fn exports_that_cannot_be_are_refused() {
    let folder = WORKSHOP.path();
    for (line, expected) in [
        ("export run --out ball.obj", ".glb"),
        ("export scene --out ball.glb", "not a run folder"),
        ("export run --out ball.glb --texture-size 3", "texture-size"),
    ] {
        let run = neif_in(folder, &line.split(' ').collect::<Vec<_>>());
        assert_eq!(run.code, 2, "{line}: {}", run.stderr);
        assert!(run.stderr.contains(expected), "{line}: {}", run.stderr);
    }
}

#[test]
fn a_scan_becomes_an_environment_that_looks_like_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (scan, env) = (
        folder.path().join("room.splat"),
        folder.path().join("env.safetensors"),
    );
    splats::write_room(&scan);
    let info = neif(&["info", text(&scan), "--json"]).succeeds().json();
    assert_eq!(info["kind"], "scan", "{info}");
    let up = info["up"][2].as_f64().expect("a direction");
    assert!(up > 0.99, "across floor and ceiling: {info}");
    let line = [
        "env",
        "import",
        text(&scan),
        "--out",
        text(&env),
        "--steps",
        "300",
    ];
    neif(&[&line[..], &["--seed", "1", "--name", "box"]].concat()).succeeds();
    let about = neif(&["info", text(&env), "--json"]).succeeds().json();
    assert_eq!(
        (&about["name"], &about["is_far"]),
        (&"box".into(), &false.into())
    );
    let view = folder.path().join("all.png");
    let flags = ["--at", "0,0,0", "--width", "32", "--out", text(&view)];
    neif(&[&["env", "panorama", text(&env)][..], &flags].concat()).succeeds();
    let seen = read_photo(&view).expect("a panorama");
    // The picture's centre is +x, and y grows to the left.
    for (column, expected) in [
        (16, [200, 90, 90]),
        (0, [60, 90, 90]),
        (8, [90, 200, 90]),
        (24, [90, 60, 90]),
    ] {
        let pixel = seen.srgb(8 * 32 + column);
        let off = (0..3).map(|c| (pixel[c] - expected[c] as f32 / 255.0).abs());
        let off = off.fold(0.0, f32::max);
        assert!(
            off < 0.08,
            "column {column}: {pixel:?} instead of {expected:?}"
        );
    }
    let again = neif(&[&line[..], &["--at", "nowhere"]].concat());
    assert_eq!(again.code, 2, "{}", again.stderr);
}
