//! `neif bench table1`: the model against the baselines `NeILF` and `NeILF*` and against itself without one of its parts,
//! at equal time (Table 1 of the paper).
//!
//! Every result is shown and written as soon as it is there.

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use neif::data::{Dataset, Splits};
use neif::neif::neilf::Brdf;
use neif::train::config::TrainConfig;
use neif::train::measure::lpips::Lpips;
use neif::train::measure::metrics::{ImageMetrics, mean};
use neif::train::neilf::NeilfConfig;
use serde_json::{Value, json};

use super::Common;
use super::trial::{Length, figure, measure, measure_neilf, on_threads, train, train_neilf};
use crate::cli::commands::eval::lpips_weights;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::scenes::make_folder;
use crate::cli::values;

#[derive(Debug, clap::Args)]
pub(crate) struct Table1Args {
    /// The captures
    #[arg(value_name = "DATASET", required = true)]
    datasets: Vec<PathBuf>,
    /// Training time of each run, the tracing of the pixels included
    #[arg(long, value_name = "TIME", value_parser = values::duration_secs, default_value = "300s")]
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

const fn ours(key: &'static str, name: &'static str, change: fn(&mut TrainConfig)) -> Variant {
    let model = Model::Ours(change);
    Variant { key, name, model }
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
    ours("ne-env", "Ne-Env (environment infinitely far)", |c| {
        c.field.is_far = true;
    }),
    ours("no-ile", "w/o ILE (lobes are lines)", |c| {
        c.field.integrated = false;
    }),
    // A weight of zero would leave the density without any sense; the paper's variant has no background loss.
    ours("no-bg", "w/o BG (no background pixels)", |c| {
        c.background_weight = 1e-9;
    }),
    ours("no-conv", "w/o Conv. (no pre-convolved background)", |c| {
        c.preconvolved_share = 0.0;
    }),
    ours("no-reg", "w/o Reg. (no smoothness)", |c| {
        c.smoothness_weight = 0.0;
    }),
    ours("no-self", "w/o self-reflection", |c| c.bounces = 0),
    ours("one-bounce", "one bounce only", |c| c.bounces = 1),
    ours("grey-tint", "w/o RGB tint", |c| c.material.rgb_tint = false),
    ours("no-delay", "w/o roughness delay", |c| c.roughness_delay = 0),
    ours("ours", "Ours", |_| ()),
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

pub(super) fn run(args: &Table1Args) -> Result<(), Failure> {
    let splits = Splits {
        val: args.split == "val",
        test: args.split == "test",
        ..Splits::ALL
    };
    let load = |path| args.common.load(Some(path), splits);
    let datasets: Vec<Dataset> = args.datasets.iter().map(load).collect::<Result<_, _>>()?;
    let mut table = Table {
        args,
        lpips: lpips_weights(args.common.lpips.as_deref())?,
        display: args.common.display(),
    };
    if !args.common.json {
        let header = "| | object | background | whole | masked | SSIM | LPIPS |";
        output::table(header, [])?;
    }
    let names: Vec<&str> = datasets.iter().map(|d| d.name.as_str()).collect();
    let mut rows: Vec<Row> = Vec::new();
    for variant in &VARIANTS {
        if !args.only.is_empty() && !args.only.iter().any(|key| key == variant.key) {
            continue;
        }
        let at = rows.len();
        let results = Vec::new();
        rows.push(Row { variant, results });
        for (i, dataset) in datasets.iter().enumerate() {
            let metrics = table.measure(variant, dataset)?;
            rows[at].results.push(metrics);
            if let Some(folder) = &args.common.out {
                make_folder(folder)?;
                let report = report(args, &names, &rows);
                output::file(&folder.join("table1.json"), &format!("{report}\n"))?;
            }
            let name = format!("{}, {}", names[i], variant.name);
            table.display.say(&line(&name, &metrics));
        }
        if !args.common.json {
            output::line(&line(variant.name, &mean(&rows[at].results)))?;
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
        let mut config = self.args.common.config(None)?;
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
