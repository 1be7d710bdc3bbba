//! `neif mesh`, and training on a capture that has no mesh.

use std::{fs, path::Path};

use serde_json::Value;

use crate::capture::write_capture;
use crate::program::{interrupted_after, neif};

/// A folder with a capture (`scene`) that lacks its mesh, which lies beside it (`truth.ply`).
fn capture_without_mesh() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = folder.path().join("scene");
    write_capture(&scene);
    fs::rename(scene.join("mesh.ply"), folder.path().join("truth.ply")).expect("a mesh");
    fs::write(folder.path().join("tiny.toml"), crate::SETTINGS).expect("settings");
    folder
}

fn path(folder: &Path, name: &str) -> String {
    folder
        .join(name)
        .to_str()
        .expect("a path of plain letters")
        .to_owned()
}

#[test]
fn masks_alone_give_a_mesh_in_the_frame_of_the_capture() {
    let folder = capture_without_mesh();
    let at = |name: &str| path(folder.path(), name);
    let args = [
        "mesh",
        &at("scene"),
        "--out",
        &at("made.glb"),
        "--cells",
        "40",
        "--compare",
        &at("truth.ply"),
        "--json",
    ];
    let lines = neif(&args).succeeds().json_lines();
    let made = lines.last().expect("a result");
    // Photos of 32 x 32 pixels: one is 0.055 wide on the ball, whose diameter is 1.
    let difference = &made["difference"];
    assert!(difference["chamfer"].as_f64() < Some(0.02), "{made}");
    assert!(
        difference["normal_median_deg"].as_f64() < Some(6.0),
        "{made}"
    );
    assert!(made["silhouette_iou"].as_f64() > Some(0.93), "{made}");
    assert!(
        lines.iter().any(|line| line["event"] == "progress"),
        "{lines:?}"
    );
}

#[test]
fn training_makes_a_missing_mesh_and_goes_on_with_it() {
    let folder = capture_without_mesh();
    let at = |name: &str| path(folder.path(), name);
    let (scene, run, preset) = (at("scene"), at("run"), at("tiny.toml"));
    let args = [
        "train", &scene, "--out", &run, "--preset", &preset, "--steps", "20", "--json",
    ];
    let lines = neif(&args).succeeds().json_lines();
    let is_said = |line: &Value| {
        line["what"]
            .as_str()
            .is_some_and(|what| what.contains("mesh"))
    };
    assert!(lines.iter().any(is_said), "{lines:?}");
    let loaded = lines
        .iter()
        .find(|line| line["event"] == "loaded")
        .expect("it is loaded");
    assert_eq!(loaded["has_object"], true, "{loaded}");
    let mesh = fs::read(folder.path().join("run/mesh.glb")).expect("the run's mesh");
    let args = [
        "train", &scene, "--out", &run, "--resume", "--steps", "30", "--json",
    ];
    let lines = neif(&args).succeeds().json_lines();
    assert!(
        !lines.iter().any(is_said),
        "the run keeps its mesh: {lines:?}"
    );
    let after = fs::read(folder.path().join("run/mesh.glb")).expect("the run's mesh");
    assert!(mesh == after, "the same mesh");
}

#[test]
fn without_masks_it_says_what_is_missing() {
    let folder = capture_without_mesh();
    let scene = folder.path().join("scene");
    for split in ["train", "val", "test"] {
        let file = scene.join(format!("transforms_{split}.json"));
        let text = fs::read_to_string(&file).expect("cameras");
        fs::write(file, text.replace("mask_path", "no_mask_path")).expect("cameras");
    }
    let at = |name: &str| path(folder.path(), name);
    let run = neif(&["mesh", &at("scene"), "--out", &at("made.glb")]);
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(
        run.stderr.contains("only 0 of 12") && run.stderr.contains("scene"),
        "{}",
        run.stderr
    );
    assert!(
        !folder.path().join("made.glb").exists(),
        "nothing is written"
    );
}

#[test]
fn ctrl_c_leaves_no_mesh() {
    let folder = capture_without_mesh();
    let at = |name: &str| path(folder.path(), name);
    let args = [
        "mesh",
        &at("scene"),
        "--out",
        &at("made.glb"),
        "--cells",
        "128",
        "--json",
    ];
    let run = interrupted_after(&args, "progress");
    assert_eq!(run.code, 130, "{}", run.stderr);
    assert!(
        !folder.path().join("made.glb").exists(),
        "nothing is written"
    );
}
