//! `neif bench skip`: each shortcut of training switched off alone, and all of them, against all on.
//!
//! Equal steps give the cost of a step and the error; the run without any shortcut then goes on until it is as good as
//! the run with all, which gives the speed-up to equal error.

use std::path::PathBuf;

use neif::data::{Dataset, Splits};
use neif::neif::field::radiance_field::CutOff;
use neif::train::config::TrainConfig;
use neif::train::measure::metrics::ImageMetrics;
use serde_json::json;

use super::trial::{Length, Trial, load, measure, on_threads, train};
use super::{Common, dataset_or_demo};
use crate::cli::commands::train::config;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};

/// The run without shortcuts is given up after so many times the steps.
const MOST_LONGER: u64 = 8;

/// Arguments of `neif bench skip`.
#[derive(Debug, clap::Args)]
pub(crate) struct SkipArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps of each run
    #[arg(long, value_name = "N", default_value_t = 2000)]
    steps: u64,
    #[command(flatten)]
    common: Common,
}

/// A shortcut and how it is switched off.
struct Skip {
    name: &'static str,
    off: fn(&mut TrainConfig),
}

const SKIPS: [Skip; 3] = [
    Skip {
        name: "samples with next to no gradient",
        off: |config| config.gradient_cut_off = CutOff::default(),
    },
    Skip {
        name: "grid levels finer than the footprint",
        off: |config| {
            config.field.grid.least_weight = 0.0;
            config.material.grid.least_weight = 0.0;
        },
    },
    Skip {
        name: "empty space (samples where the density is)",
        off: |config| config.uniform_share = 1e3,
    },
];

/// One run.
struct Row {
    name: String,
    trial: Trial,
    metrics: ImageMetrics,
}

/// Runs the benchmark.
pub(super) fn run(args: &SkipArgs) -> Result<(), Failure> {
    let splits = Splits {
        test: false,
        ..Splits::ALL
    };
    let dataset = load(
        &dataset_or_demo(args.dataset.as_ref())?,
        splits,
        &args.common.capture,
    )?;
    let mut display = Display::new(args.common.json);
    let all_on = config(None, Some(args.common.seed))?;
    let mut all_off = all_on.clone();
    let mut settings = vec![("all skips".to_owned(), all_on.clone())];
    for skip in &SKIPS {
        let mut one_off = all_on.clone();
        (skip.off)(&mut one_off);
        (skip.off)(&mut all_off);
        settings.push((format!("without: {}", skip.name), one_off));
    }
    settings.push(("no skip".to_owned(), all_off.clone()));
    let mut rows = Vec::new();
    for (name, config) in settings {
        rows.push(one(
            &name,
            &config,
            args.steps,
            args,
            &dataset,
            &mut display,
        )?);
    }
    let longer = until_equal(args, &all_off, &dataset, &rows[0], &mut display)?;
    display.finish();
    report(args, &rows, longer.as_ref())
}

fn one(
    name: &str,
    config: &TrainConfig,
    steps: u64,
    args: &SkipArgs,
    dataset: &Dataset,
    display: &mut Display,
) -> Result<Row, Failure> {
    on_threads(args.common.threads, || {
        let mut show = |done| display.set(done, name, "");
        let trial = train(config, dataset, Length::Steps(steps), &mut show)?;
        let metrics = measure(&trial.snapshot, &dataset.val, None)?;
        Ok(Row {
            name: name.to_owned(),
            trial,
            metrics,
        })
    })
}

/// The shortest run without skips, of 1, 2, 4 or 8 times the steps, that is as good as `target`.
fn until_equal(
    args: &SkipArgs,
    config: &TrainConfig,
    dataset: &Dataset,
    target: &Row,
    display: &mut Display,
) -> Result<Option<Row>, Failure> {
    let mut factor = 2;
    while factor <= MOST_LONGER {
        let name = format!("no skip, {factor} x the steps");
        let row = one(&name, config, args.steps * factor, args, dataset, display)?;
        if row.metrics.psnr_object >= target.metrics.psnr_object
            && row.metrics.psnr_background >= target.metrics.psnr_background
        {
            return Ok(Some(row));
        }
        factor *= 2;
    }
    Ok(None)
}

fn report(args: &SkipArgs, rows: &[Row], longer: Option<&Row>) -> Result<(), Failure> {
    let cpu_per_step = |row: &Row| row.trial.cpu_secs / row.trial.steps.max(1) as f64;
    let reference = &rows[0];
    if args.common.json {
        let rows: Vec<_> = rows
            .iter()
            .chain(longer)
            .map(|row| {
                json!({
                    "name": row.name, "steps": row.trial.steps, "step_seconds": row.trial.step_secs,
                    "cpu_seconds": row.trial.cpu_secs, "rays": row.trial.rays, "metrics": row.metrics,
                })
            })
            .collect();
        return Ok(output::json_line(&json!({ "rows": rows }))?);
    }
    output::line(
        "| run | processor ms a step | slower than all skips | object dB | background dB |",
    )?;
    output::line("|---|---|---|---|---|")?;
    for row in rows.iter().chain(longer) {
        let change = |pick: fn(&ImageMetrics) -> Option<f64>| match (
            pick(&row.metrics),
            pick(&reference.metrics),
        ) {
            (Some(v), Some(r)) => format!("{v:.2} ({:+.2})", v - r),
            _ => "–".to_owned(),
        };
        output::line(&format!(
            "| {} | {:.2} | {:.2} x | {} | {} |",
            row.name,
            cpu_per_step(row) * 1e3,
            cpu_per_step(row) / cpu_per_step(reference),
            change(|m| m.psnr_object),
            change(|m| m.psnr_background),
        ))?;
    }
    output::line(&match longer {
        Some(row) => format!(
            "to equal error the skips are {:.1} x faster",
            row.trial.cpu_secs / reference.trial.cpu_secs
        ),
        None => format!(
            "without skips {MOST_LONGER} x the steps do not reach the same error: the skips are more than {:.1} x faster",
            MOST_LONGER as f64 * cpu_per_step(&rows[rows.len() - 1]) / cpu_per_step(reference)
        ),
    })?;
    Ok(())
}
