//! `neif bench`: run time against error, what each skip saves, numerical stability, the kernels.
//!
//! Every benchmark trains on the capture's training views. Error against time is measured on the test views, since that
//! is what is reported; skips and stability are judged on the validation views.

#[cfg(feature = "gui")]
mod desk;
mod error;
mod lobes;
mod plot;
#[cfg(feature = "gui")]
mod preview;
mod scaling;
mod skip;
mod stability;
mod table1;
mod train;
mod trial;

use std::path::PathBuf;

use clap::Subcommand;
use neif::data::{Dataset, LoadOptions, Splits};
use neif::train::config::TrainConfig;

use super::demo::find_assets;
use super::train::config;
use crate::cli::capture::CaptureArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::output::Display;

/// What to measure.
#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    /// Speed of a training step, stage by stage, against what this machine can do
    Train(train::TrainBenchArgs),
    /// How quickly the preview answers, with and without training beside it
    #[cfg(feature = "gui")]
    Preview(preview::PreviewArgs),
    /// Error on test views after 10 s, 30 s, ... of training: a table, a CSV file and a plot
    Error(error::ErrorArgs),
    /// Cones against many thin rays a pixel, roughness by roughness
    Lobes(lobes::LobesArgs),
    /// Speed-up of training on 2 to 64 cores: predicted from the time of each task on one, and measured on those there are
    Scaling(scaling::ScalingArgs),
    /// What each shortcut of training saves, and what it costs in error
    Skip(skip::SkipArgs),
    /// Whether absurd input and settings leave training finite, and how much worse
    Stability(stability::StabilityArgs),
    /// The model against the same model without its parts, at equal time (Table 1 of the paper)
    Table1(table1::Table1Args),
}

pub(crate) fn run(command: &BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Train(args) => train::run(args),
        #[cfg(feature = "gui")]
        BenchCommand::Preview(args) => preview::run(args),
        BenchCommand::Error(args) => error::run(args),
        BenchCommand::Lobes(args) => lobes::run(args),
        BenchCommand::Scaling(args) => scaling::run(args),
        BenchCommand::Skip(args) => skip::run(args),
        BenchCommand::Stability(args) => stability::run(args),
        BenchCommand::Table1(args) => table1::run(args),
    }
}

/// Options common to all benchmarks.
#[derive(Debug, clap::Args)]
struct Common {
    /// Folder for the report's files
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Weights of LPIPS v0.1 (safetensors); without it the file that `NEIF_LPIPS` names
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Write the figures as JSON
    #[arg(long)]
    json: bool,
    /// Seed of all random choices
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Worker threads; 0 is one for each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    capture: CaptureArgs,
}

impl Common {
    /// What shows how far the work is.
    fn display(&self) -> Display {
        Display::new(self.json)
    }

    /// Worker threads, counted.
    fn n_threads(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
    }

    /// The settings of a preset, or the default ones, with the seed that was asked for.
    fn config(&self, preset: Option<&str>) -> Result<TrainConfig, Failure> {
        config(preset, Some(self.seed))
    }

    /// Reads splits of the given capture, or of the bundled one.
    fn load(&self, dataset: Option<&PathBuf>, splits: Splits) -> Result<Dataset, Failure> {
        let options = LoadOptions {
            splits,
            choices: self.capture.choices(),
            ..LoadOptions::default()
        };
        Dataset::load(&dataset_or_demo(dataset)?, &options).or_unusable()
    }
}

/// The given capture, or the bundled one.
fn dataset_or_demo(given: Option<&PathBuf>) -> Result<PathBuf, Failure> {
    match given {
        Some(path) => Ok(path.clone()),
        None => Ok(find_assets()?.join("demo")),
    }
}
