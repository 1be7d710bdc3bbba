//! Trains on a capture without a window and saves what was learned: `cargo run --release --example train CAPTURE OUT STEPS`.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use neif::data::{Dataset, LoadOptions};
use neif::neif::Storage;
use neif::train::{TrainConfig, new_trainer};

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args_os().skip(1);
    let mut next = || args.next().map(PathBuf::from);
    let (Some(capture), Some(out), Some(steps)) = (next(), next(), next()) else {
        anyhow::bail!("usage: train CAPTURE OUT STEPS");
    };
    let steps = steps.to_string_lossy().parse()?;
    train(&capture, &out, &TrainConfig::default(), steps)
}

/// Takes so many steps on the capture, and writes `environment.safetensors` and `object.safetensors` into the folder.
pub(crate) fn train(
    capture: &Path,
    out: &Path,
    config: &TrainConfig,
    n_steps: u32,
) -> anyhow::Result<()> {
    let dataset = Dataset::load(capture, &LoadOptions::default())?;
    let cancel = AtomicBool::new(false);
    let mut trainer = new_trainer(config, &dataset, &cancel, &|_| ())?;
    for step in 0..n_steps {
        // How far training is drives the learning rates.
        trainer.step(step as f32 / n_steps as f32);
    }
    let snapshot = trainer.snapshot();
    std::fs::create_dir_all(out)?;
    let storage = Storage::default();
    snapshot
        .environment
        .save(&out.join("environment.safetensors"), storage)?;
    if let Some(object) = &snapshot.object {
        object
            .material
            .save(&out.join("object.safetensors"), storage)?;
    }
    Ok(())
}
