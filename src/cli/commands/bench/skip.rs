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

use super::Common;
use super::trial::{Length, Trial, measure, on_threads, train};
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};

/// The run without shortcuts is given up after so many times the steps.
const MOST_LONGER: u64 = 8;

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

type Change = fn(&mut TrainConfig);

/// The shortcuts, and how each is switched off.
const SKIPS: [(&str, Change); 3] = [
    ("samples with next to no gradient", |config| {
        config.gradient_cut_off = CutOff::default();
    }),
    ("grid levels finer than the footprint", |config| {
        config.field.grid.least_weight = 0.0;
        config.material.grid.least_weight = 0.0;
    }),
    ("empty space (samples where the density is)", |config| {
        config.uniform_share = 1e3;
    }),
];

/// One run.
struct Row {
    name: String,
    trial: Trial,
    metrics: ImageMetrics,
}

pub(super) fn run(args: &SkipArgs) -> Result<(), Failure> {
    let mut bench = Bench {
        args,
        dataset: args.common.load(args.dataset.as_ref(), Splits::TRAIN_VAL)?,
        display: args.common.display(),
    };
    let all_on = args.common.config(None)?;
    let mut all_off = all_on.clone();
    let mut rows = vec![bench.measure("all skips", &all_on, args.steps)?];
    for (name, switch_off) in SKIPS {
        let mut one_off = all_on.clone();
        switch_off(&mut one_off);
        switch_off(&mut all_off);
        rows.push(bench.measure(&format!("without: {name}"), &one_off, args.steps)?);
    }
    rows.push(bench.measure("no skip", &all_off, args.steps)?);
    let longer = bench.until_equal(&all_off, &rows[0])?;
    bench.display.finish();
    report(args, &rows, longer.as_ref())
}

/// What all runs share.
struct Bench<'a> {
    args: &'a SkipArgs,
    dataset: Dataset,
    display: Display,
}

impl Bench<'_> {
    fn measure(&mut self, name: &str, config: &TrainConfig, steps: u64) -> Result<Row, Failure> {
        let (dataset, display) = (&self.dataset, &mut self.display);
        on_threads(self.args.common.threads, || {
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

    /// The shortest run without skips, of 2, 4 or 8 times the steps, that is as good as `target`.
    fn until_equal(&mut self, config: &TrainConfig, target: &Row) -> Result<Option<Row>, Failure> {
        let mut factor = 2;
        while factor <= MOST_LONGER {
            let name = format!("no skip, {factor} x the steps");
            let row = self.measure(&name, config, self.args.steps * factor)?;
            if row.metrics.psnr_object >= target.metrics.psnr_object
                && row.metrics.psnr_background >= target.metrics.psnr_background
            {
                return Ok(Some(row));
            }
            factor *= 2;
        }
        Ok(None)
    }
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
    let line = |row: &Row| {
        let change = |pick: fn(&ImageMetrics) -> Option<f64>| match (
            pick(&row.metrics),
            pick(&reference.metrics),
        ) {
            (Some(v), Some(r)) => format!("{v:.2} ({:+.2})", v - r),
            _ => "–".to_owned(),
        };
        format!(
            "| {} | {:.2} | {:.2} x | {} | {} |",
            row.name,
            cpu_per_step(row) * 1e3,
            cpu_per_step(row) / cpu_per_step(reference),
            change(|m| m.psnr_object),
            change(|m| m.psnr_background),
        )
    };
    let header =
        "| run | processor ms a step | slower than all skips | object dB | background dB |";
    output::table(header, rows.iter().chain(longer).map(line))?;
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
