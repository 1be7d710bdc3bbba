//! The library of environments: `neif env list`, `add` and `remove`, `--out library`, and its names in place of paths.

use std::fs;
use std::path::Path;

use neif::data::{ExrSample, write_exr};
use serde_json::Value;

use super::WORKSHOP;
use super::program::{Run, neif_with_library};

/// A folder with a panorama (`sky.exr`) and a library that does not exist yet.
struct Desk {
    folder: tempfile::TempDir,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let pixel = |i: usize| if i < 64 { [2.0, 1.0, 0.5] } else { [0.1; 3] };
        let pixels: Vec<[f32; 3]> = (0..128).map(pixel).collect();
        let sky = folder.path().join("sky.exr");
        write_exr(&sky, 16, 8, &pixels, ExrSample::Float).expect("a panorama");
        Self { folder }
    }

    fn neif(&self, args: &[&str]) -> Run {
        let folder = self.folder.path();
        neif_with_library(&folder.join("deep/library"), folder, args)
    }

    fn list(&self) -> Vec<Value> {
        let listed = self.neif(&["env", "list", "--json"]).succeeds().json();
        listed["environments"].as_array().expect("a list").clone()
    }

    fn names(&self) -> Vec<String> {
        let listed = self.list();
        let names = listed.iter().map(|one| one["name"].as_str());
        names.map(|name| name.expect("a name").to_owned()).collect()
    }

    fn is_refused(&self, args: &[&str], expected: &[&str]) {
        let run = self.neif(args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        for word in expected {
            assert!(run.stderr.contains(word), "{args:?}: {}", run.stderr);
        }
    }
}

#[test]
fn environments_are_added_listed_and_removed() {
    let desk = Desk::new();
    let bundled = desk.list();
    assert_eq!(bundled[0]["name"], "gallery");
    assert_eq!(bundled[0]["bundled"], true);
    assert_eq!(bundled[0]["kind"], "trained");
    let licence = bundled[0]["licence"].as_str().expect("a licence");
    assert!(licence.contains("MIT"), "{licence}");

    let flags = ["--licence", "CC0", "--origin", "https://example.org/sky"];
    desk.neif(&[&["env", "add", "sky.exr"][..], &flags].concat())
        .succeeds();
    let again = desk.neif(&["env", "add", "sky.exr"]).succeeds();
    assert!(again.stdout.starts_with("sky 2: "), "{}", again.stdout);
    let run = WORKSHOP.path("run");
    desk.neif(&["env", "add", &run]).succeeds();
    desk.neif(&["env", "add", &run, "--name", "Test/room"])
        .succeeds();
    let expected = ["gallery", "run", "sky", "sky 2", "Test/room"];
    assert_eq!(desk.names(), expected);

    let listed = desk.list();
    let sky = &listed[2];
    assert_eq!(sky["kind"], "panorama", "{sky}");
    assert_eq!(sky["licence"], "CC0", "{sky}");
    assert_eq!(sky["origin"], "https://example.org/sky", "{sky}");
    assert!(sky["bytes"].as_u64().is_some_and(|n| n > 1000), "{sky}");
    assert!(sky["added_unix_secs"].is_u64(), "{sky}");
    let file = Path::new(sky["path"].as_str().expect("a path"));
    for ending in ["safetensors", "toml", "png"] {
        assert!(file.with_extension(ending).is_file(), "{ending}");
    }
    let origin = listed[3]["origin"].as_str().expect("the file");
    assert!(origin.ends_with("sky.exr"), "{origin}");
    let copied = fs::read(listed[1]["path"].as_str().expect("a path")).expect("a file");
    let original = WORKSHOP.bytes("run/environment.safetensors");
    assert!(copied == original, "bit for bit");
    let table = desk.neif(&["env", "list"]).succeeds().stdout;
    for word in ["| gallery | trained |", "bundled", "| Test/room |", "CC0"] {
        assert!(table.contains(word), "{word}: {table}");
    }

    desk.neif(&["env", "remove", "sky"]).succeeds();
    assert_eq!(desk.names(), ["gallery", "run", "sky 2", "Test/room"]);
    assert!(!file.with_extension("png").exists(), "whole");
    desk.is_refused(&["env", "remove", "sky"], &["`sky`", "sky 2", "gallery"]);
    desk.is_refused(&["env", "remove", "gallery"], &["comes with the program"]);
}

#[test]
fn a_name_of_the_library_stands_for_a_path_where_nothing_is_at_it() {
    let desk = Desk::new();
    desk.neif(&["env", "add", "sky.exr", "--name", "evening"])
        .succeeds();
    let panorama = |name: &str, out: &str| {
        let flags = ["--at", "0,0,0", "--width", "16", "--out", out];
        desk.neif(&[&["env", "panorama", name][..], &flags].concat())
    };
    panorama("evening", "named.exr").succeeds();
    panorama("sky.exr", "file.exr").succeeds();
    let bytes = |name: &str| fs::read(desk.folder.path().join(name)).expect("a picture");
    assert!(bytes("named.exr") == bytes("file.exr"), "the same light");
    fs::create_dir(desk.folder.path().join("evening")).expect("a folder");
    let folder_first = panorama("evening", "folder.exr");
    assert_eq!(folder_first.code, 2, "{}", folder_first.stderr);
    assert!(folder_first.stderr.contains("environment.safetensors"));
    fs::remove_dir(desk.folder.path().join("evening")).expect("a folder");

    let run = WORKSHOP.path("run");
    let flags = ["--turntable", "1", "--size", "8x8", "--out", "lit"];
    desk.neif(&[&["render", &run, "--env", "evening"][..], &flags].concat())
        .succeeds();
    let info = desk.neif(&["info", "evening", "--json"]).succeeds().json();
    assert_eq!(info["kind"], "environment", "{info}");
    let both = ["evning: no such file or folder", "library", "evening"];
    for args in [
        &["render", &run, "--env", "evning", "--out", "NEW"][..],
        &["view", "evning"],
        &[
            "env", "panorama", "evning", "--at", "0,0,0", "--out", "x.exr",
        ],
    ] {
        desk.is_refused(args, &both);
    }
}

#[test]
fn what_is_made_goes_into_the_library_by_that_word() {
    let desk = Desk::new();
    let import = ["env", "import", "sky.exr", "--up", "y", "--out", "library"];
    let about = ["--name", "noon", "--licence", "CC BY 4.0"];
    desk.neif(&[&import[..], &about].concat()).succeeds();
    let (scene, preset) = (WORKSHOP.path("scene"), WORKSHOP.path("tiny.toml"));
    let train = [
        "env", "train", &scene, "--out", "library", "--preset", &preset,
    ];
    desk.neif(&[&train[..], &["--steps", "5"]].concat())
        .succeeds();
    let named = ["--steps", "5", "--name", "room", "--json"];
    let run = desk.neif(&[&train[..], &named].concat()).succeeds();
    let added = run.json_lines().pop().expect("events");
    let path = added["path"].as_str().expect("where it is");
    assert!(path.ends_with("room.safetensors"), "{added}");
    assert_eq!(desk.names(), ["gallery", "noon", "room", "scene"]);
    let listed = desk.list();
    assert_eq!(listed[1]["licence"], "CC BY 4.0");
    assert_eq!(listed[2]["kind"], "trained");
    assert_eq!(listed[3]["origin"], scene.as_str());
    let info = desk.neif(&["info", "noon", "--json"]).succeeds().json();
    assert_eq!(info["up"], serde_json::json!([0.0, 1.0, 0.0]), "{info}");
    assert_eq!(info["name"], "noon", "{info}");
    let is_new = |name: &str| !desk.folder.path().join(name).exists();
    assert!(is_new("library"), "no folder of that name is made");
    desk.neif(&["env", "import", "sky.exr", "--out", "./library"])
        .succeeds();
    assert!(!is_new("library/environment.safetensors"), "a folder");
    let file = ["env", "import", "sky.exr", "--out", "new.safetensors"];
    let args = [&file[..], &["--licence", "CC0"]].concat();
    desk.is_refused(&args, &["--licence", "--out library"]);
    assert!(is_new("new.safetensors"), "nothing was begun");
}

#[test]
fn what_is_no_environment_is_not_added() {
    let desk = Desk::new();
    let at = |name: &str| desk.folder.path().join(name);
    fs::write(at("garbage.safetensors"), "no tensors").expect("a file");
    fs::write(at("scan.ply"), SPLAT).expect("a file");
    desk.is_refused(&["env", "add", "garbage.safetensors"], &["garbage"]);
    desk.is_refused(&["env", "add", "NOWHERE"], &["NOWHERE"]);
    desk.is_refused(
        &["env", "add", "scan.ply"],
        &["neif env import scan.ply --out library"],
    );
    assert_eq!(desk.names(), ["gallery"]);
    let library = at("deep/library");
    fs::write(library.join("broken.safetensors"), "no tensors").expect("a file");
    fs::write(library.join("broken.toml"), "license = 1").expect("a file");
    let listed = desk.list();
    assert_eq!(listed[1]["name"], "broken");
    assert!(listed[1]["kind"].is_null(), "{}", listed[1]);
    let problems = listed[1]["problems"].to_string();
    assert!(problems.contains("license"), "{problems}");
}

/// A file of one Gaussian splat.
const SPLAT: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
    property float z\nproperty float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n\
    property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float rot_0\n\
    property float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n0 0 0 0 0 0 1 0 0 0 1 0 0 0\n";
