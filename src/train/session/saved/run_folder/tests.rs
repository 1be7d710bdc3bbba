//! Tests of `run_folder`.

use super::*;
use crate::train::session::options::SessionOptions;

/// A run in a new folder, with its settings saved.
fn saved(run: &Path, dataset: &Path) -> (RunFolder, RunConfig) {
    let run = RunFolder::create(run).unwrap();
    let train = TrainConfig::preset("fast").unwrap();
    let options = SessionOptions::new(dataset, train, Budget::Seconds(300.0));
    let config = options.describe(Some(&run));
    run.save_config(&config).unwrap();
    (run, config)
}

#[test]
fn settings_survive_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    let (run, written) = saved(&folder.path().join("run"), &capture);
    let read = RunFolder::open(run.path()).unwrap().config().unwrap();
    assert_eq!(
        toml::to_string(&read).unwrap(),
        toml::to_string(&written).unwrap()
    );
}

#[test]
fn a_run_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    RunFolder::create(&path).unwrap();
    // An empty folder is free.
    saved(&path, &path);
    let message = RunFolder::create(&path).unwrap_err().to_string();
    assert!(message.contains("--resume"), "{message}");
}

#[test]
fn a_folder_without_a_run_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let message = RunFolder::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("config.toml is missing"), "{message}");
}

#[test]
fn unknown_and_broken_settings_name_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let (run, _) = saved(folder.path(), folder.path());
    let good = std::fs::read_to_string(folder.path().join(CONFIG)).unwrap();
    for (bad, field) in [
        (format!("surprise = 1\n{good}"), "surprise"),
        (good.replace("format = 1", "format = 99"), "format"),
        (good.replace("seed = 0", "seed = \"x\""), "seed"),
    ] {
        std::fs::write(folder.path().join(CONFIG), bad).unwrap();
        let message = run.config().unwrap_err().to_string();
        assert!(
            message.contains(field) && message.contains(CONFIG),
            "{message}"
        );
    }
}

#[test]
fn settings_that_are_gone_are_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let (run, written) = saved(folder.path(), folder.path());
    let good = std::fs::read_to_string(folder.path().join(CONFIG)).unwrap();
    let old = good.replace(
        "glare_rays = 32",
        "unseen_pairs = 32\nevenness_weight = 0.1\nevenness_delay = 3000",
    );
    assert_ne!(old, good);
    std::fs::write(folder.path().join(CONFIG), &old).unwrap();
    assert_eq!(run.config().unwrap().train, written.train);
    // What else is wrong is named, before and behind them.
    for (wrong, field) in [
        (old.replace("seed = 0", "seed = \"x\""), "seed"),
        (old.replace("bounces = 3", "bounces = \"x\""), "bounces"),
    ] {
        std::fs::write(folder.path().join(CONFIG), wrong).unwrap();
        let message = run.config().unwrap_err().to_string();
        assert!(message.contains(field), "{message}");
    }
}

#[test]
fn a_capture_that_moved_with_its_run_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let before = folder.path().join("before");
    std::fs::create_dir_all(before.join("capture")).unwrap();
    saved(&before.join("runs/one"), &before.join("capture"));
    let after = folder.path().join("after");
    std::fs::rename(&before, &after).unwrap();
    let moved = RunFolder::open(&after.join("runs/one")).unwrap();
    let found = moved.dataset_path(&moved.config().unwrap());
    assert!(found.exists(), "{}", found.display());
}
