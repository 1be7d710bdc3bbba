//! `neif bench table1`: the model against itself without one of its parts, at equal time (after Table 1 of the paper).
//!
//! `NeILF` and `NeILF*` (an incident light field for each surface point) are not built.

use std::path::PathBuf;

use neif::data::Splits;
use neif::train::config::TrainConfig;
use neif::train::metrics::{ImageMetrics, mean};
use serde_json::json;

use super::trial::{Length, figure, load, measure, on_threads, train};
use super::{Common, marks};
use crate::cli::eval::lpips_weights;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::train::config;

/// Arguments of `neif bench table1`.
#[derive(Debug, clap::Args)]
pub(crate) struct Table1Args {
    /// The captures
    #[arg(value_name = "DATASET", required = true)]
    datasets: Vec<PathBuf>,
    /// Training time of each run, the tracing of the pixels included
    #[arg(long, value_name = "TIME", value_parser = marks, default_value = "300s")]
    budget: f64,
    #[command(flatten)]
    common: Common,
}

/// A row of the table: a change to the settings.
struct Variant {
    name: &'static str,
    change: fn(&mut TrainConfig),
}

const VARIANTS: [Variant; 10] = [
    Variant {
        name: "Ne-Env (surroundings infinitely far)",
        change: |c| c.field.is_far = true,
    },
    Variant {
        name: "w/o ILE (lobes are lines)",
        change: |c| c.field.integrated = false,
    },
    Variant {
        name: "w/o BG (no background pixels)",
        // A weight of zero would leave the density without any sense; the paper's variant has no background loss.
        change: |c| c.background_weight = 1e-9,
    },
    Variant {
        name: "w/o Conv. (no pre-convolved background)",
        change: |c| c.preconvolved_share = 0.0,
    },
    Variant {
        name: "w/o Reg. (no smoothness)",
        change: |c| c.smoothness_weight = 0.0,
    },
    Variant {
        name: "w/o self-reflection",
        change: |c| c.bounces = 0,
    },
    Variant {
        name: "one bounce only",
        change: |c| c.bounces = 1,
    },
    Variant {
        name: "w/o RGB tint",
        change: |c| c.material.rgb_tint = false,
    },
    Variant {
        name: "w/o roughness delay",
        change: |c| c.roughness_delay = 0,
    },
    Variant {
        name: "Ours",
        change: |_| (),
    },
];

/// Runs the benchmark.
pub(super) fn run(args: &Table1Args) -> Result<(), Failure> {
    let splits = Splits {
        val: false,
        ..Splits::ALL
    };
    let datasets = args
        .datasets
        .iter()
        .map(|path| load(path, splits))
        .collect::<Result<Vec<_>, _>>()?;
    let lpips = lpips_weights(args.common.lpips.as_deref())?;
    let mut display = Display::new(args.common.json);
    let mut rows = Vec::new();
    for variant in &VARIANTS {
        let mut config = config(None, Some(args.common.seed))?;
        (variant.change)(&mut config);
        let mut results = Vec::new();
        for dataset in &datasets {
            results.push(on_threads(args.common.threads, || {
                let what = format!("{}, {}", dataset.name, variant.name);
                let mut show = |done| display.set(done, &what, "");
                let trial = train(&config, dataset, Length::Seconds(args.budget), &mut show)?;
                measure(&trial.snapshot, &dataset.test, lpips.as_ref())
            })?);
        }
        display.say(&line(variant.name, &mean(&results)));
        rows.push((variant.name, results));
    }
    display.finish();
    if args.common.json {
        let names: Vec<&str> = datasets.iter().map(|d| d.name.as_str()).collect();
        let rows: Vec<_> = rows
            .iter()
            .map(|(name, results)| json!({ "name": name, "results": results, "mean": mean(results) }))
            .collect();
        return Ok(output::json_line(
            &json!({ "seconds": args.budget, "datasets": names, "rows": rows }),
        )?);
    }
    output::line("| | object | background | whole | masked | SSIM | LPIPS |")?;
    output::line("|---|---|---|---|---|---|---|")?;
    for (name, results) in &rows {
        output::line(&line(name, &mean(results)))?;
    }
    Ok(())
}

fn line(name: &str, m: &ImageMetrics) -> String {
    let cells = [
        m.psnr_object,
        m.psnr_background,
        m.psnr,
        m.psnr_masked,
        m.ssim,
        m.lpips,
    ];
    format!("| {name} | {} |", cells.map(figure).join(" | "))
}
