//! `neif bench table1`: the model against the baselines `NeILF` and `NeILF*` and against itself without one of its parts,
//! at equal time (Table 1 of the paper).
//!
//! Every result is shown and written as soon as it is there.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use neif::data::{Dataset, Splits, write_atomically};
use neif::neif::neilf::Brdf;
use neif::train::config::TrainConfig;
use neif::train::measure::lpips::Lpips;
use neif::train::measure::metrics::{ImageMetrics, mean};
use neif::train::neilf::NeilfConfig;
use serde_json::{Value, json};

use super::trial::{Length, figure, load, measure, measure_neilf, on_threads, train, train_neilf};
use super::{Common, marks};
use crate::cli::commands::eval::lpips_weights;
use crate::cli::commands::train::config;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::scenes::make_folder;

/// Arguments of `neif bench table1`.
#[derive(Debug, clap::Args)]
pub(crate) struct Table1Args {
    /// The captures
    #[arg(value_name = "DATASET", required = true)]
    datasets: Vec<PathBuf>,
    /// Training time of each run, the tracing of the pixels included
    #[arg(long, value_name = "TIME", value_parser = marks, default_value = "300s")]
    budget: f64,
    /// Only these rows
    #[arg(long, value_name = "ROW,...", value_delimiter = ',', value_parser = rows())]
    only: Vec<String>,
    /// Photos to measure on; choices are made on `val`
    #[arg(long, value_name = "SPLIT", value_parser = ["test", "val"], default_value = "test")]
    split: String,
    #[command(flatten)]
    common: Common,
}

/// A row of the table.
struct Variant {
    /// What `--only` calls it.
    key: &'static str,
    name: &'static str,
    model: Model,
}

/// What is trained.
enum Model {
    /// An incident light field for each surface point.
    Neilf(Brdf),
    /// Ours, with a change to its settings.
    Ours(fn(&mut TrainConfig)),
}

const VARIANTS: [Variant; 12] = [
    Variant {
        key: "neilf",
        name: "NeILF (incident light of each point, Disney reflectance)",
        model: Model::Neilf(Brdf::Disney),
    },
    Variant {
        key: "neilf-star",
        name: "NeILF* (incident light of each point, our reflectance)",
        model: Model::Neilf(Brdf::Lobe),
    },
    Variant {
        key: "ne-env",
        name: "Ne-Env (environment infinitely far)",
        model: Model::Ours(|c| c.field.is_far = true),
    },
    Variant {
        key: "no-ile",
        name: "w/o ILE (lobes are lines)",
        model: Model::Ours(|c| c.field.integrated = false),
    },
    Variant {
        key: "no-bg",
        name: "w/o BG (no background pixels)",
        // A weight of zero would leave the density without any sense; the paper's variant has no background loss.
        model: Model::Ours(|c| c.background_weight = 1e-9),
    },
    Variant {
        key: "no-conv",
        name: "w/o Conv. (no pre-convolved background)",
        model: Model::Ours(|c| c.preconvolved_share = 0.0),
    },
    Variant {
        key: "no-reg",
        name: "w/o Reg. (no smoothness)",
        model: Model::Ours(|c| c.smoothness_weight = 0.0),
    },
    Variant {
        key: "no-self",
        name: "w/o self-reflection",
        model: Model::Ours(|c| c.bounces = 0),
    },
    Variant {
        key: "one-bounce",
        name: "one bounce only",
        model: Model::Ours(|c| c.bounces = 1),
    },
    Variant {
        key: "grey-tint",
        name: "w/o RGB tint",
        model: Model::Ours(|c| c.material.rgb_tint = false),
    },
    Variant {
        key: "no-delay",
        name: "w/o roughness delay",
        model: Model::Ours(|c| c.roughness_delay = 0),
    },
    Variant {
        key: "ours",
        name: "Ours",
        model: Model::Ours(|_| ()),
    },
];

/// Below the table.
const NOTES: &str = "NeILF and NeILF* explain the object alone, so there is no figure for what takes in the environment. \
    They are trained on the object's pixels; a pixel on the silhouette shows the object unmixed.";

fn rows() -> PossibleValuesParser {
    PossibleValuesParser::new(VARIANTS.iter().map(|variant| variant.key))
}

/// What every run needs.
struct Table<'a> {
    args: &'a Table1Args,
    lpips: Option<Lpips>,
    display: Display,
}

/// A row with its results so far, one a capture.
struct Row {
    variant: &'static Variant,
    results: Vec<ImageMetrics>,
}

/// Runs the benchmark.
pub(super) fn run(args: &Table1Args) -> Result<(), Failure> {
    let splits = Splits {
        val: args.split == "val",
        test: args.split == "test",
        ..Splits::ALL
    };
    let datasets = args
        .datasets
        .iter()
        .map(|path| load(path, splits, &args.common.capture))
        .collect::<Result<Vec<_>, _>>()?;
    let mut table = Table {
        args,
        lpips: lpips_weights(args.common.lpips.as_deref())?,
        display: Display::new(args.common.json),
    };
    if !args.common.json {
        output::line("| | object | background | whole | masked | SSIM | LPIPS |")?;
        output::line("|---|---|---|---|---|---|---|")?;
    }
    let names: Vec<&str> = datasets.iter().map(|d| d.name.as_str()).collect();
    let mut rows: Vec<Row> = Vec::new();
    for variant in &VARIANTS {
        if !args.only.is_empty() && !args.only.iter().any(|key| key == variant.key) {
            continue;
        }
        let results = Vec::with_capacity(datasets.len());
        rows.push(Row { variant, results });
        for (i, dataset) in datasets.iter().enumerate() {
            let metrics = table.measure(variant, dataset)?;
            if let Some(row) = rows.last_mut() {
                row.results.push(metrics);
            }
            if let Some(folder) = &args.common.out {
                write_report(folder, &report(args, &names, &rows))?;
            }
            let name = format!("{}, {}", names[i], variant.name);
            table.display.say(&line(&name, &metrics));
        }
        if let Some(row) = rows.last().filter(|_| !args.common.json) {
            output::line(&line(variant.name, &mean(&row.results)))?;
        }
    }
    table.display.finish();
    if args.common.json {
        return Ok(output::json_line(&report(args, &names, &rows))?);
    }
    Ok(output::line(&format!("\n{NOTES}"))?)
}

impl Table<'_> {
    /// Trains on a capture and measures on its held-out views.
    fn measure(&mut self, variant: &Variant, dataset: &Dataset) -> Result<ImageMetrics, Failure> {
        let views = match self.args.split.as_str() {
            "val" => &dataset.val,
            _ => &dataset.test,
        };
        let length = Length::Seconds(self.args.budget);
        let mut config = config(None, Some(self.args.common.seed))?;
        let what = format!("{}, {}", dataset.name, variant.name);
        let display = &mut self.display;
        let lpips = self.lpips.as_ref();
        on_threads(self.args.common.threads, || {
            let mut show = |done| display.set(done, &what, "");
            match variant.model {
                Model::Neilf(brdf) => {
                    let neilf = NeilfConfig::new(brdf);
                    let model = train_neilf(&config, &neilf, dataset, length, &mut show)?;
                    measure_neilf(&model, views)
                }
                Model::Ours(change) => {
                    change(&mut config);
                    let trial = train(&config, dataset, length, &mut show)?;
                    measure(&trial.snapshot, views, lpips)
                }
            }
        })
    }
}

/// All results so far.
fn report(args: &Table1Args, datasets: &[&str], rows: &[Row]) -> Value {
    let rows: Vec<Value> = rows
        .iter()
        .map(|row| {
            let (key, name) = (row.variant.key, row.variant.name);
            json!({ "row": key, "name": name, "results": row.results, "mean": mean(&row.results) })
        })
        .collect();
    json!({
        "seconds": args.budget,
        "split": args.split,
        "datasets": datasets,
        "notes": NOTES,
        "rows": rows,
    })
}

/// Writes `table1.json` whole or not at all.
fn write_report(folder: &Path, report: &Value) -> Result<(), Failure> {
    make_folder(folder)?;
    let path = folder.join("table1.json");
    write_atomically(&path, |file| writeln!(file, "{report}"))?;
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
