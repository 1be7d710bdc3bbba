//! `neif bench error`: run time against error, one run for each budget, since the learning rate falls over the plan.

use std::io::Write as _;
use std::path::PathBuf;

use neif::data::{Splits, write_atomically};
use neif::train::measure::metrics::{ImageMetrics, mean};
use serde_json::json;

use super::plot::{Curve, write_plot};
use super::trial::{Length, figure, load, measure, on_threads, train};
use super::{Common, dataset_or_demo, marks};
use crate::cli::commands::eval::lpips_weights;
use crate::cli::commands::train::config;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::scenes::make_folder;

/// Budgets up to this many seconds are repeated with other seeds.
const SHORT_SECS: f64 = 30.0;

/// Arguments of `neif bench error`.
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
    #[arg(long, value_name = "TIMES", value_delimiter = ',', value_parser = marks, default_value = "10s,30s,60s,120s,300s,600s")]
    budget: Vec<f64>,
    /// Runs of each budget up to 30 s, with other seeds; the median counts
    #[arg(long, value_name = "N", default_value_t = 3)]
    repeats: u64,
    #[command(flatten)]
    common: Common,
}

/// A point of a curve.
#[derive(Clone, Debug)]
struct Row {
    preset: String,
    budget: f64,
    steps: u64,
    rays_per_sec: f64,
    metrics: ImageMetrics,
}

/// Runs the benchmark.
pub(super) fn run(args: &ErrorArgs) -> Result<(), Failure> {
    if let Some(out) = &args.common.out {
        make_folder(out)?;
    }
    let dataset = load(
        &dataset_or_demo(args.dataset.as_ref())?,
        Splits::ALL,
        &args.common.capture,
    )?;
    let lpips = lpips_weights(args.common.lpips.as_deref())?;
    let mut display = Display::new(args.common.json);
    let mut rows = Vec::new();
    for preset in &args.preset {
        for &budget in &args.budget {
            let n = if budget <= SHORT_SECS {
                args.repeats.max(1)
            } else {
                1
            };
            let mut runs = Vec::new();
            for repeat in 0..n {
                let config = config(Some(preset), Some(args.common.seed + repeat))?;
                let trial = on_threads(args.common.threads, || {
                    let what = format!("{preset}, {budget:.0} s");
                    let mut show = |done| display.set(done, &what, "");
                    let trial = train(&config, &dataset, Length::Seconds(budget), &mut show)?;
                    let metrics = measure(&trial.snapshot, &dataset.test, lpips.as_ref())?;
                    Ok(Row {
                        preset: preset.clone(),
                        budget,
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
        let csv = csv(&rows);
        write_atomically(&out.join("error.csv"), |file| {
            file.write_all(csv.as_bytes())
        })?;
        write_plot(&out.join("error"), &curves(&rows))?;
    }
    if args.common.json {
        let rows: Vec<_> = rows
            .iter()
            .map(|row| {
                json!({
                    "preset": row.preset, "seconds": row.budget, "steps": row.steps,
                    "rays_per_sec": row.rays_per_sec, "metrics": row.metrics,
                })
            })
            .collect();
        return Ok(output::json_line(&json!({ "rows": rows }))?);
    }
    output::line(
        "| preset | seconds | steps | rays/s | object | background | whole | SSIM | LPIPS | FLIP |",
    )?;
    output::line("|---|---|---|---|---|---|---|---|---|---|")?;
    for row in &rows {
        output::line(&line(row))?;
    }
    Ok(())
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

fn line(row: &Row) -> String {
    let m = &row.metrics;
    let cells = [
        m.psnr_object,
        m.psnr_background,
        m.psnr,
        m.ssim,
        m.lpips,
        m.flip,
    ]
    .map(figure);
    format!(
        "| {} | {:.0} | {} | {:.0} | {} |",
        row.preset,
        row.budget,
        row.steps,
        row.rays_per_sec,
        cells.join(" | ")
    )
}

fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "preset,seconds,steps,rays_per_sec,psnr_object,psnr_background,psnr,ssim,lpips,flip\n",
    );
    for row in rows {
        let m = &row.metrics;
        let cells = [
            m.psnr_object,
            m.psnr_background,
            m.psnr,
            m.ssim,
            m.lpips,
            m.flip,
        ]
        .map(|v| v.map_or_else(String::new, |v| format!("{v:.4}")));
        text += &[
            row.preset.clone(),
            row.budget.to_string(),
            row.steps.to_string(),
            format!("{:.0}", row.rays_per_sec),
            cells.join(","),
        ]
        .join(",");
        text.push('\n');
    }
    text
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
                    .filter_map(|row| Some((row.budget, value(&row.metrics)?)))
                    .collect(),
            })
        })
        .filter(|curve| !curve.points.is_empty())
        .collect()
}
