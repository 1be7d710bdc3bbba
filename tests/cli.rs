//! The commands end to end, through the built program, on a capture that the test makes itself.
//!
//! A grey-red ball stands in a room of coloured walls; photos, masks and mesh come from formulas.
//! One small run is trained once and shared by the tests that only read it.

#[path = "cli/capture.rs"]
mod capture;
#[path = "cli/library.rs"]
mod library;
#[path = "cli/masks.rs"]
mod masks;
#[path = "cli/mesh.rs"]
mod mesh;
#[path = "cli/program.rs"]
mod program;
#[path = "cli/readme.rs"]
mod readme;
#[path = "cli/splats.rs"]
mod splats;
#[path = "cli/takeaway.rs"]
mod takeaway;
#[path = "cli/without_masks.rs"]
mod without_masks;

use std::{fs, sync::LazyLock};

use serde_json::Value;

use self::capture::write_capture;
use self::program::{Run, neif, same_picture};

/// Settings small enough for a test.
const SETTINGS: &str = "object_pixels = 64\nbackground_pixels = 64\nsamples_per_ray = 8\n\
                        render_samples = 8\n\
                        field = { grid = { n_levels = 4, coarsest = 8, finest = 64, log2_table_size = 12 }, n_hidden = 16, view_dependent = true }\n\
                        material = { grid = { n_levels = 4, coarsest = 4, finest = 16, log2_table_size = 10 }, n_hidden = 16 }\n";

/// A folder with a capture (`scene`), settings (`tiny.toml`) and a trained run (`run`).
struct Workshop {
    folder: tempfile::TempDir,
}

static WORKSHOP: LazyLock<Workshop> = LazyLock::new(|| {
    let workshop = Workshop::new();
    workshop.train("run", "120").succeeds();
    workshop
});

impl Workshop {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write_capture(&folder.path().join("scene"));
        fs::write(folder.path().join("tiny.toml"), SETTINGS).expect("settings");
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        let path = self.folder.path().join(name);
        path.to_str().expect("a path of plain letters").to_owned()
    }

    fn train(&self, run: &str, steps: &str) -> Run {
        let (scene, out, preset) = (self.path("scene"), self.path(run), self.path("tiny.toml"));
        neif(&[
            "train", &scene, "--out", &out, "--preset", &preset, "--steps", steps, "--json",
        ])
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.path().join(name)).expect(name)
    }
}

#[test]
fn a_capture_is_read_as_said_and_a_run_keeps_it() {
    let scene = WORKSHOP.path("scene");
    let said = [
        "--up",
        "-y",
        "--max-megapixels",
        "0.004",
        "--test-every",
        "4",
    ];
    let info = neif(&[&["info", &scene, "--json"][..], &said].concat())
        .succeeds()
        .json();
    assert_eq!(info["up"], serde_json::json!([0.0, -1.0, 0.0]));
    assert_eq!(info["up_is_given"], true);
    // 17 photos of 32 x 32 in 4,000 pixels.
    assert_eq!(info["resolutions"][0]["width"], 15);
    assert_eq!(info["views"]["test"], 5);
    let notices = info["problems"].to_string();
    assert!(notices.contains("32 x 32 to 15 x 15"), "{notices}");
    assert!(notices.contains("--max-megapixels"), "{notices}");
    let (run, preset) = (WORKSHOP.path("said"), WORKSHOP.path("tiny.toml"));
    let train = [
        "train", &scene, "--out", &run, "--preset", &preset, "--steps", "3",
    ];
    neif(&[&train[..], &said].concat()).succeeds();
    let info = neif(&["info", &run, "--json"]).succeeds().json();
    assert_eq!(
        info["environment"]["up"],
        serde_json::json!([0.0, -1.0, 0.0])
    );
    let report = neif(&["eval", &run, "--json"]).succeeds().json();
    let n_tested = report["views"].as_array().map(Vec::len);
    assert_eq!(n_tested, Some(5), "the run's own test photos");
    let again = neif(&["train", &scene, "--out", &run, "--resume", "--up", "z"]);
    assert_eq!(again.code, 2, "{}", again.stderr);
    assert!(again.stderr.contains("--resume"), "{}", again.stderr);
}

#[test]
fn lists_in_another_folder_split_a_capture() {
    let (scene, lists) = (WORKSHOP.path("scene"), WORKSHOP.path("lists"));
    fs::create_dir_all(&lists).expect("a folder");
    fs::write(format!("{lists}/test.txt"), "r_000.png\ntrain/r_005\n").expect("a list");
    let info = |lists: &str| neif(&["info", &scene, "--json", "--split-lists", lists]);
    let listed = info(&lists).succeeds().json();
    assert_eq!(listed["views"]["test"], 2);
    assert_eq!(listed["views"]["train"], 15);
    let rule = listed["split_rule"].to_string();
    assert!(rule.contains("lists"), "{rule}");
    let empty = info(&WORKSHOP.path("scene"));
    assert_eq!(empty.code, 2, "{}", empty.stderr);
    assert!(empty.stderr.contains("test.txt"), "{}", empty.stderr);
    let every = neif(&["info", &scene, "--test-every", "1"]);
    assert_eq!(every.code, 2, "{}", every.stderr);
}

#[test]
fn info_says_what_a_capture_and_a_run_are() {
    let info = neif(&["info", &WORKSHOP.path("scene"), "--json"])
        .succeeds()
        .json();
    assert_eq!(info["kind"], "capture", "{info}");
    let info = neif(&["info", &WORKSHOP.path("run"), "--json"])
        .succeeds()
        .json();
    assert_eq!(
        (&info["kind"], &info["steps"]),
        (&"run".into(), &120.into()),
        "{info}"
    );
    let file = WORKSHOP.path("run/environment.safetensors");
    let info = neif(&["info", &file]).succeeds();
    assert!(info.stdout.contains("environment"), "{}", info.stdout);
}

#[test]
fn training_leaves_a_whole_run_folder() {
    for name in [
        "config.toml",
        "checkpoint.safetensors",
        "object.safetensors",
        "environment.safetensors",
        "mesh.glb",
        "metrics.csv",
        "log.jsonl",
    ] {
        assert!(!WORKSHOP.bytes(&format!("run/{name}")).is_empty(), "{name}");
    }
    let log = String::from_utf8(WORKSHOP.bytes("run/log.jsonl")).expect("text");
    let last: Value = log
        .lines()
        .last()
        .map(|l| serde_json::from_str(l).expect("json"))
        .expect("a line");
    assert_eq!(
        (&last["event"], &last["step"]),
        (&"finished".into(), &120.into()),
        "{last}"
    );
    let n_files = fs::read_dir(WORKSHOP.folder.path().join("run"))
        .expect("folder")
        .count();
    assert_eq!(n_files, 7, "no temporary file is left");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let workshop = Workshop::new();
    for run in ["a", "b"] {
        workshop.train(run, "30").succeeds();
    }
    for file in ["environment.safetensors", "object.safetensors"] {
        let (a, b) = (
            workshop.bytes(&format!("a/{file}")),
            workshop.bytes(&format!("b/{file}")),
        );
        assert!(a == b, "{file} differs");
    }
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let workshop = Workshop::new();
    workshop.train("whole", "800").succeeds();
    let (scene, out) = (workshop.path("scene"), workshop.path("parts"));
    let preset = workshop.path("tiny.toml");
    let begin = [
        "train", &scene, "--out", &out, "--preset", &preset, "--steps", "800", "--json",
    ];
    let interrupted = program::interrupted_after(&begin, "\"event\":\"progress\"");
    assert_eq!(interrupted.code, 130, "{}", interrupted.stderr);
    let finished = interrupted.json_lines().pop().expect("events");
    assert_eq!(finished["reason"], "stopped", "{finished}");
    neif(&["train", &scene, "--out", &out, "--resume", "--json"]).succeeds();
    let again = neif(&["train", &scene, "--out", &out, "--resume"]).succeeds();
    assert!(
        again.stderr.contains("finished already"),
        "{}",
        again.stderr
    );
    for file in ["environment.safetensors", "object.safetensors"] {
        let whole = workshop.bytes(&format!("whole/{file}"));
        assert!(
            whole == workshop.bytes(&format!("parts/{file}")),
            "{file} differs"
        );
    }
}

#[test]
fn evaluation_keeps_its_promised_form_and_finds_a_trained_scene() {
    let (run, out) = (WORKSHOP.path("run"), WORKSHOP.path("eval"));
    let report = neif(&["eval", &run, "--json", "--out", &out])
        .succeeds()
        .json();
    assert_eq!(
        (&report["split"], &report["steps"]),
        (&"test".into(), &120.into())
    );
    assert!(
        report["train_seconds"].as_f64().is_some_and(|s| s > 0.0),
        "{report}"
    );
    assert_eq!(report["relight"], serde_json::json!({}), "{report}");
    assert!(
        report["normal_mae_deg"].is_null() && report["pano_psnr"].is_null(),
        "{report}"
    );
    let views = report["views"].as_array().expect("views");
    assert_eq!(views.len(), 3, "{report}");
    let fitted = views.iter().map(|view| &view["fitted"]);
    let means = [&report["mean"], &report["mean_fitted"]];
    for metrics in views.iter().chain(fitted).chain(means) {
        for key in [
            "psnr",
            "psnr_object",
            "psnr_background",
            "psnr_masked",
            "psnr_near",
            "ssim",
            "flip",
        ] {
            assert!(metrics[key].is_f64(), "{key}: {metrics}");
        }
        assert!(metrics["lpips"].is_null(), "no weights given: {metrics}");
    }
    let psnr = report["mean"]["psnr"].as_f64().expect("a number");
    assert!(
        psnr > 12.0,
        "after 120 steps the room must be recognisable: {psnr} dB"
    );
    let sheet = WORKSHOP.folder.path().join("eval/test/contact_sheet.png");
    assert!(sheet.is_file(), "{}", sheet.display());
}

#[test]
fn rendered_pictures_change_as_the_edit_says() {
    let run = WORKSHOP.path("run");
    let render = |name: &str, flags: &[&str]| {
        let out = WORKSHOP.path(name);
        let mut args = vec!["render", &run, "--out", &out];
        args.extend(flags);
        neif(&args).succeeds();
        fs::read_dir(&out).expect("pictures").count()
    };
    let picture = |name: &str| WORKSHOP.folder.path().join(name);
    assert_eq!(render("plain", &[]), 3, "one picture a test view");
    render("again", &[]);
    let plain = picture("plain/t_000.png");
    assert!(
        same_picture(&plain, &picture("again/t_000.png")),
        "rendering is deterministic"
    );
    for (name, flags) in [
        ("rotated", ["--env-rotate", "0,0,90"]),
        ("moved", ["--env-translate", "-0.5,0,0"]),
        ("brighter", ["--env-exposure", "1"]),
        ("rough", ["--roughness", "0.9"]),
        ("red", ["--tint", "1,0,0"]),
        ("matt", ["--tint-scale", "0"]),
        ("dark", ["--diffuse-gain", "0"]),
        ("blurred", ["--background", "blurred"]),
        ("hidden", ["--background", "hidden"]),
        ("exposed", ["--exposure", "-1"]),
    ] {
        render(name, &flags);
        let edited = picture(&format!("{name}/t_000.png"));
        assert!(!same_picture(&plain, &edited), "{name} must show");
    }
    render(
        "identity",
        &[
            "--env-rotate",
            "0,0,0",
            "--roughness-scale",
            "1",
            "--tint-scale",
            "1",
        ],
    );
    assert!(
        same_picture(&plain, &picture("identity/t_000.png")),
        "no edit, no change"
    );
    render("own", &["--env", &run]);
    assert!(
        same_picture(&plain, &picture("own/t_000.png")),
        "its own environment changes nothing"
    );
    let flags = [
        "--turntable",
        "2",
        "--layers",
        "final,normal,environment",
        "--size",
        "20x10",
    ];
    assert_eq!(render("turn", &flags), 6, "two places, three layers");
    let size = image::image_dimensions(picture("turn/turn_000_normal.png")).expect("a picture");
    assert_eq!(size, (20, 10));
    let cameras = WORKSHOP.path("scene/transforms_val.json");
    assert_eq!(render("cameras", &["--cameras", &cameras]), 2);
}

#[test]
fn an_environment_trains_and_shows_on_its_own() {
    let (scene, preset) = (WORKSHOP.path("scene"), WORKSHOP.path("tiny.toml"));
    let out = WORKSHOP.path("room.safetensors");
    neif(&[
        "env", "train", &scene, "--out", &out, "--preset", &preset, "--steps", "30",
    ])
    .succeeds();
    for file in ["pano.exr", "pano.png"] {
        let file = WORKSHOP.path(file);
        let flags = ["--at", "0,0,-0.2", "--width", "32", "--out", &file];
        neif(&[&["env", "panorama", &out][..], &flags].concat()).succeeds();
        assert!(fs::metadata(&file).is_ok_and(|m| m.len() > 100), "{file}");
    }
    let run = WORKSHOP.path("run");
    let lit = WORKSHOP.path("lit_by_room");
    neif(&["render", &run, "--env", &out, "--out", &lit]).succeeds();
}

#[test]
fn a_time_budget_covers_the_whole_command() {
    let workshop = Workshop::new();
    let (scene, out) = (workshop.path("scene"), workshop.path("timed"));
    let preset = workshop.path("tiny.toml");
    let begun = std::time::Instant::now();
    let flags = ["--preset", &preset, "--budget", "4s", "--json"];
    let run = neif(&[&["train", &scene, "--out", &out][..], &flags].concat()).succeeds();
    let secs = begun.elapsed().as_secs_f64();
    assert!((2.0..6.0).contains(&secs), "a budget of 4 s took {secs} s");
    let finished = run.json_lines().pop().expect("events");
    assert_eq!(finished["reason"], "budget", "{finished}");
}

/// Command lines (run inside the workshop's folder) and what their message names.
const UNUSABLE: &[(&str, &str)] = &[
    ("info NOWHERE", "NOWHERE"),
    ("info GARBAGE.safetensors", "GARBAGE.safetensors"),
    ("train NOWHERE --out NEW", "NOWHERE"),
    ("train scene --out NEW --preset BROKEN.toml", "speed"),
    ("train scene --out NEW --preset splendid", "splendid"),
    ("train scene --out run --steps 1", "--resume"),
    ("train scene --out NEW --resume", "config.toml"),
    ("train scene --out NEW --budget 3parsecs", "parsecs"),
    ("train scene --out NEW --steps 5 --budget 5s", "--budget"),
    ("train scene --out NEW --steps 0", "--steps"),
    ("train scene --out NEW --mesh NOWHERE --steps 1", "NOWHERE"),
    ("eval scene", "not a run folder"),
    ("eval run --dataset NOWHERE", "NOWHERE"),
    ("eval run --lpips NOWHERE.safetensors", "NOWHERE"),
    ("eval run --lpips GARBAGE.safetensors", "GARBAGE"),
    (
        "eval run --lpips run/object.safetensors",
        "run/object.safetensors: tensor `features.0.weight` is missing",
    ),
    ("render run --roughness 2 --out NEW", "from 0 to 1"),
    ("render run --layers shiny --out NEW", "shiny"),
    (
        "render run --background green --out NEW",
        "auto, shown, blurred, hidden",
    ),
    ("render run --env GARBAGE.safetensors --out NEW", "GARBAGE"),
    ("render run --size 0x9 --out NEW", "sides"),
    ("render run --cameras NOWHERE --out NEW", "NOWHERE"),
    ("render run --format webm --out NEW", "webm"),
    ("render run --spin camera --out NEW", "--turntable"),
    ("render run --frames 9 --out NEW", "--cameras"),
    ("render run --format gif --out NEW.png", "NEW.png"),
    ("render run --format gif --fps 90 --out NEW", "50 pictures"),
    (
        "render run --format gif --layers final,normal --out NEW",
        "one layer",
    ),
    ("env panorama run --at 0,0 --out x.exr", "three numbers"),
    ("env panorama run --at 0,0,0 --out x.gif", ".exr or .png"),
    ("mesh scene", "mesh"),
    ("frobnicate", "frobnicate"),
];

#[test]
fn unusable_input_ends_with_code_2_and_names_what_is_wrong() {
    let folder = WORKSHOP.folder.path();
    fs::write(folder.join("BROKEN.toml"), "speed = 9\n").expect("settings");
    fs::write(folder.join("GARBAGE.safetensors"), "not tensors").expect("garbage");
    for (line, expected) in UNUSABLE {
        let words: Vec<&str> = line.split(' ').collect();
        let run = program::neif_in(folder, &words);
        assert_eq!(run.code, 2, "{line}: {}", run.stderr);
        assert!(run.stderr.contains(expected), "{line}: {}", run.stderr);
        assert!(!run.stderr.contains("panicked"), "{line}: {}", run.stderr);
    }
    assert!(!folder.join("NEW").exists(), "nothing was begun");
}

#[test]
fn damaged_run_folders_are_refused_by_file() {
    let workshop = Workshop::new();
    workshop.train("run", "2").succeeds();
    let run = workshop.path("run");
    for (file, bytes) in [
        ("environment.safetensors", &b"cut"[..]),
        ("mesh.glb", b"glTF\x02\0\0\0"),
        ("config.toml", b"format = 1"),
    ] {
        let path = workshop.folder.path().join("run").join(file);
        let good = fs::read(&path).expect(file);
        fs::write(&path, bytes).expect(file);
        let eval = neif(&["eval", &run]);
        assert_eq!(eval.code, 2, "{file}: {}", eval.stderr);
        assert!(eval.stderr.contains(file), "{file}: {}", eval.stderr);
        fs::write(&path, good).expect(file);
    }
    neif(&["eval", &run]).succeeds();
}

/// The paper's model, small enough for a test.
const PAPER_SETTINGS: &str = "preset = \"paper\"\nobject_pixels = 8\nbackground_pixels = 8\n\
                              samples_per_ray = 8\nrender_samples = 8\n\
                              [paper.field]\ndepth = 3\nwidth = 16\nview_width = 16\n\
                              [paper.material]\ndepth = 3\nwidth = 16\n";

#[test]
fn the_paper_preset_trains_resumes_and_is_shown_like_any_run() {
    let workshop = Workshop::new();
    fs::write(workshop.folder.path().join("tiny.toml"), PAPER_SETTINGS).expect("settings");
    workshop.train("whole", "24").succeeds();
    let first = workshop.train("parts", "9").succeeds();
    let finished = first.json_lines().pop().expect("events");
    assert_eq!(finished["step"], 9, "{finished}");
    let (scene, parts, whole) = (
        workshop.path("scene"),
        workshop.path("parts"),
        workshop.path("whole"),
    );
    neif(&[
        "train", &scene, "--out", &parts, "--resume", "--steps", "24",
    ])
    .succeeds();
    let info = neif(&["info", &parts, "--json"]).succeeds().json();
    assert_eq!(info["steps"], 24, "{info}");
    let report = neif(&["eval", &whole, "--json"]).succeeds().json();
    assert!(report["mean"]["psnr_object"].is_number(), "{report}");
    let pictures = workshop.path("pictures");
    let room = WORKSHOP.path("run");
    let flags = ["--turntable", "2", "--size", "24x24", "--env", &room];
    neif(&[&["render", &whole, "--out", &pictures][..], &flags].concat()).succeeds();
}
