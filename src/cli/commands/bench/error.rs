//! `neif bench error`: run time against error, one run for each budget, since the learning rate falls over the plan.

use std::path::PathBuf;

use neif::data::Splits;
use neif::train::measure::metrics::{ImageMetrics, mean};
use serde::Serialize;
use serde_json::json;

use super::Common;
use super::plot::{Curve, write_plot};
use super::trial::{Length, figure, measure, on_threads, train};
use crate::cli::commands::eval::lpips_weights;
use crate::cli::failure::Failure;
use crate::cli::scenes::make_folder;
use crate::cli::{output, values};

/// Budgets up to this many seconds are repeated with other seeds.
const SHORT_SECS: f64 = 30.0;

#[derive(Debug, clap::Args)]
pub(crate) struct ErrorArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Presets or TOML files to compare
    #[arg(
        long,
        value_name = "NAME|FILE.toml",
        value_delimiter = ',',
        default_value = "fast"
    )]
    preset: Vec<String>,
    /// Training times, the tracing of the pixels included
    #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = values::duration_secs, default_value = "10s,30s,60s,120s,300s,600s")]
    budget: Vec<f64>,
    /// Runs of each budget up to 30 s, with other seeds; the median counts
    #[arg(long, value_name = "N", default_value_t = 3)]
    repeats: u64,
    #[command(flatten)]
    common: Common,
}

/// A point of a curve.
#[derive(Clone, Debug, Serialize)]
struct Row {
    preset: String,
    seconds: f64,
    steps: u64,
    rays_per_sec: f64,
    metrics: ImageMetrics,
}

pub(super) fn run(args: &ErrorArgs) -> Result<(), Failure> {
    if let Some(out) = &args.common.out {
        make_folder(out)?;
    }
    let dataset = args.common.load(args.dataset.as_ref(), Splits::ALL)?;
    let lpips = lpips_weights(args.common.lpips.as_deref())?;
    let mut display = args.common.display();
    let mut rows = Vec::new();
    for preset in &args.preset {
        for &seconds in &args.budget {
            let n = if seconds <= SHORT_SECS {
                args.repeats.max(1)
            } else {
                1
            };
            let mut runs = Vec::new();
            for repeat in 0..n {
                let mut config = args.common.config(Some(preset))?;
                config.seed += repeat;
                let trial = on_threads(args.common.threads, || {
                    let what = format!("{preset}, {seconds:.0} s");
                    let mut show = |done| display.set(done, &what, "");
                    let trial = train(&config, &dataset, Length::Seconds(seconds), &mut show)?;
                    let metrics = measure(&trial.snapshot, &dataset.test, lpips.as_ref())?;
                    Ok(Row {
                        preset: preset.clone(),
                        seconds,
                        steps: trial.steps,
                        rays_per_sec: trial.rays_per_sec(),
                        metrics,
                    })
                })?;
                runs.push(trial);
            }
            let row = median(runs);
            display.say(&line(&row));
            rows.push(row);
        }
    }
    display.finish();
    if let Some(out) = &args.common.out {
        output::file(&out.join("error.csv"), &csv(&rows))?;
        write_plot(&out.join("error"), &curves(&rows))?;
    }
    if args.common.json {
        return Ok(output::json_line(&json!({ "rows": rows }))?);
    }
    let header =
        "| preset | seconds | steps | rays/s | object | background | whole | SSIM | LPIPS | FLIP |";
    Ok(output::table(header, rows.iter().map(line))?)
}

/// The run whose object (or whole) PSNR is in the middle.
fn median(mut runs: Vec<Row>) -> Row {
    let key = |row: &Row| row.metrics.psnr_object.or(row.metrics.psnr).unwrap_or(0.0);
    runs.sort_by(|a, b| key(a).total_cmp(&key(b)));
    let middle = runs.len() / 2;
    if runs.len().is_multiple_of(2) {
        let pair = [runs[middle - 1].metrics, runs[middle].metrics];
        runs[middle].metrics = mean(&pair);
    }
    runs.swap_remove(middle)
}

/// The measures of a row, as they stand in the table's columns.
fn measures(m: &ImageMetrics) -> [Option<f64>; 6] {
    let [object, background] = [m.psnr_object, m.psnr_background];
    [object, background, m.psnr, m.ssim, m.lpips, m.flip]
}

fn line(row: &Row) -> String {
    format!(
        "| {} | {:.0} | {} | {:.0} | {} |",
        row.preset,
        row.seconds,
        row.steps,
        row.rays_per_sec,
        measures(&row.metrics).map(figure).join(" | ")
    )
}

fn csv(rows: &[Row]) -> String {
    let line = |row: &Row| {
        let cell = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.4}"));
        format!(
            "{},{},{},{:.0},{}\n",
            row.preset,
            row.seconds,
            row.steps,
            row.rays_per_sec,
            measures(&row.metrics).map(cell).join(",")
        )
    };
    let header =
        "preset,seconds,steps,rays_per_sec,psnr_object,psnr_background,psnr,ssim,lpips,flip\n";
    rows.iter()
        .fold(header.to_owned(), |csv, row| csv + &line(row))
}

/// Object and background PSNR of each preset.
fn curves(rows: &[Row]) -> Vec<Curve> {
    let mut presets: Vec<&str> = rows.iter().map(|row| row.preset.as_str()).collect();
    presets.dedup();
    type Measure = fn(&ImageMetrics) -> Option<f64>;
    let pick: [(&str, Measure); 2] = [
        ("object", |m| m.psnr_object),
        ("background", |m| m.psnr_background),
    ];
    presets
        .iter()
        .flat_map(|preset| {
            pick.map(|(name, value)| Curve {
                name: format!("{preset}, {name}"),
                points: rows
                    .iter()
                    .filter(|row| row.preset == *preset)
                    .filter_map(|row| Some((row.seconds, value(&row.metrics)?)))
                    .collect(),
            })
        })
        .filter(|curve| !curve.points.is_empty())
        .collect()
}
