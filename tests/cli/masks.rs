//! `neif masks`, and training on a capture without masks.

use std::{fs, path::Path};

use serde_json::Value;

use crate::program::{interrupted_after, neif};
use crate::without_masks::{demo, write_without_masks};

/// The bundled capture, small.
const SMALL: [&str; 2] = ["--max-megapixels", "1.5"];

fn masks(more: &[&str]) -> Vec<String> {
    let demo = demo();
    let args = ["masks", &demo].into_iter().chain(SMALL);
    args.chain(more.iter().copied())
        .map(str::to_owned)
        .collect()
}

#[test]
fn the_object_is_found_without_masks_and_then_trained() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    write_without_masks(&folder.path().join("scene"), 1);
    let settings = "object_pixels = 256\nbackground_pixels = 512\n";
    fs::write(folder.path().join("small.toml"), settings).expect("settings");
    let (scene, run, preset) = (at("scene"), at("run"), at("small.toml"));
    let args = [
        "train", &scene, "--out", &run, "--preset", &preset, "--object", "auto",
    ];
    let args: Vec<&str> = args.into_iter().chain(SMALL).collect();
    let args = [&args[..], &["--steps", "300", "--seed", "1", "--json"]].concat();
    let lines = neif(&args).succeeds().json_lines();
    let loaded = lines.iter().find(|line| line["event"] == "loaded");
    assert_eq!(
        loaded.map(|line| &line["has_object"]),
        Some(&Value::Bool(true))
    );
    // Its masks belong to the run: what reads the run's photos has them, held-out ones too.
    let measured = neif(&["eval", &run, "--json"]).succeeds().json();
    assert!(
        measured["mean"]["psnr_object"].as_f64() > Some(10.0),
        "{measured}"
    );
    let own = format!("{}/test_mask", demo());
    let refused = neif(&["eval", &run, "--masks", &run, "--json"]);
    assert!(
        refused.stderr.contains("no mask in this folder"),
        "{}",
        refused.stderr
    );
    let truly = neif(&["eval", &run, "--masks", &own, "--json"])
        .succeeds()
        .json();
    assert!(
        truly["mean"]["psnr_object"].as_f64() > Some(10.0),
        "{truly}"
    );
}

#[test]
fn masks_are_those_that_the_capture_has_wherever_the_person_points() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("masks").to_string_lossy().into_owned();
    let run = |more: &[&str]| {
        let args = masks(&[&["--out", &out, "--steps", "400", "--json"], more].concat());
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let lines = neif(&args).succeeds().json_lines();
        lines.last().expect("a result").clone()
    };
    let found = run(&["--pixel", "train/r_000,79,79"]);
    assert!(found["in_common_with_own"].as_f64() > Some(0.9), "{found}");
    assert!(
        found["least_in_common_with_own"].as_f64() > Some(0.8),
        "{found}"
    );
    for file in ["train/r_000.png", "val/r_000.png", "test/r_002.png"] {
        assert!(Path::new(&out).join(file).is_file(), "{file}");
    }
}

#[test]
fn a_place_that_is_not_in_the_photos_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("masks").to_string_lossy().into_owned();
    for (pixel, part) in [
        ("r_900,1,1", "no photo is named `r_900`"),
        ("r_000,900,1", "lies outside the photo `r_000`"),
        ("r_000", "expected PHOTO,X,Y"),
    ] {
        let args = masks(&["--out", &out, "--steps", "1", "--pixel", pixel]);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let refused = neif(&args);
        assert_eq!(refused.code, 2, "{}", refused.stderr);
        assert!(refused.stderr.contains(part), "{}", refused.stderr);
        assert!(!Path::new(&out).exists(), "nothing is written");
    }
}

#[test]
fn ctrl_c_ends_it_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("masks").to_string_lossy().into_owned();
    let args = masks(&["--out", &out, "--budget", "10m", "--json"]);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let run = interrupted_after(&args, "progress");
    assert_eq!(run.code, 130, "{}", run.stderr);
    assert!(!Path::new(&out).exists(), "nothing is written");
}
