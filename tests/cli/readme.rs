//! What the README says to type works, in its order.

use super::Workshop;
use super::capture::write_capture;
use super::program::{Run, neif_in, neif_with_library};
use super::splats::write_room;

/// What stands in the README for longer than a test may take, and what is typed instead.
const SHORTER: [(&str, &str); 3] = [
    ("--budget 300s", "--preset tiny.toml --steps 8"),
    ("SCAN.ply", "SCAN.splat --steps 20"),
    ("--turntable 36", "--turntable 2 --size 24x24"),
];

#[test]
fn the_readme_s_commands_work() {
    let workshop = Workshop::new();
    let folder = workshop.folder.path();
    write_capture(&folder.join("CAPTURE"));
    write_room(&folder.join("SCAN.splat"));
    let readme = include_str!("../../README.md");
    let lines = readme
        .lines()
        .filter_map(|line| line.strip_prefix("    neif "));
    let mut n_run = 0;
    for line in lines {
        let mut typed = line.split('#').next().unwrap_or_default().trim().to_owned();
        for (long, short) in SHORTER {
            typed = typed.replace(long, short);
        }
        let words: Vec<&str> = typed.split_whitespace().collect();
        let run: Run = match words[0] {
            // There need not be a display.
            "view" => neif_in(folder, &["help", "view"]),
            _ => neif_with_library(&folder.join("library"), folder, &words),
        };
        run.succeeds();
        n_run += 1;
    }
    assert!(n_run >= 5, "the README names only {n_run} commands");
    for made in [
        "RUN/environment.safetensors",
        "pictures",
        "object.glb",
        "library/SCAN.safetensors",
    ] {
        assert!(folder.join(made).exists(), "{made}");
    }
}
