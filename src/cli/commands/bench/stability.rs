//! `neif bench stability`: absurd captures and settings; training must stay finite and say how much worse it became.
//!
//! Scenes that differ from the normal one by unit, rotation or translation only must train to the same error, and so
//! must the normal model when it was stored in half precision and read back.

mod cases;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use neif::data::{Dataset, Splits};
use neif::neif::light::environment::{EnvironmentField, EnvironmentPlace};
use neif::neif::{Environment, ObjectModel, RoughnessEdit, Storage, SurfaceField};
use neif::render::{Layer, Scene, render};
use neif::train::Snapshot;
use neif::train::measure::metrics::ImageMetrics;
use serde_json::json;

use super::Common;
use super::trial::{Length, figure, measure, on_threads, train};
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::output::{self, Display};
use cases::{CASES, Case, Expected, NORMAL, TINY};

/// How far a scene in another unit or frame may be from the normal one, dB.
const SAME_DB: f64 = 0.2;
/// A run that learns again over its last tenth has recovered.
const LAST_PART: f64 = 0.1;
/// Factor that takes the logarithm of nearly every density to one of its ends.
const DENSE: f32 = 1e4;

#[derive(Debug, clap::Args)]
pub(crate) struct StabilityArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps of each run
    #[arg(long, value_name = "N", default_value_t = 1000)]
    steps: u64,
    /// Steps of the long run at tiny size; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    long_steps: u64,
    /// Only the cases whose name contains this, beside the normal one
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    #[command(flatten)]
    common: Common,
}

/// What became of a case.
struct Row {
    name: &'static str,
    is_finite: bool,
    has_recovered: bool,
    skipped: u64,
    metrics: ImageMetrics,
    /// Against the normal run: object, background, dB.
    difference: [Option<f64>; 2],
    verdict: Result<(), String>,
}

/// What all cases share.
struct Bench<'a> {
    args: &'a StabilityArgs,
    dataset: Dataset,
    normal: Option<ImageMetrics>,
    rows: Vec<Row>,
    display: Display,
}

/// Runs the benchmark; fails when a case does.
pub(super) fn run(args: &StabilityArgs) -> Result<(), Failure> {
    let mut bench = Bench {
        args,
        dataset: args.common.load(args.dataset.as_ref(), Splits::TRAIN_VAL)?,
        normal: None,
        rows: Vec::new(),
        display: args.common.display(),
    };
    let normal = bench.train(&NORMAL, args.steps)?;
    bench.normal = bench.rows.first().map(|row| row.metrics);
    bench.store(&normal)?;
    for case in CASES.iter().filter(|case| args.wants(case.name)) {
        bench.train(case, args.steps)?;
    }
    if args.long_steps > 0 && args.wants(TINY.name) {
        bench.train(&TINY, args.long_steps)?;
    }
    bench.display.finish();
    bench.report()
}

impl StabilityArgs {
    fn wants(&self, name: &str) -> bool {
        name.contains(&self.only)
    }
}

impl Bench<'_> {
    /// Trains a case and judges what became of it; the trained model.
    fn train(&mut self, case: &Case, steps: u64) -> Result<Snapshot, Failure> {
        let (mut dataset, mut config) = (self.dataset.clone(), self.args.common.config(None)?);
        (case.change)(&mut dataset, &mut config);
        let display = &mut self.display;
        let trial = on_threads(self.args.common.threads, || {
            let mut show = |done| display.set(done, case.name, "");
            train(&config, &dataset, Length::Steps(steps), &mut show)
        })?;
        let first_of_last = (steps as f64 * (1.0 - LAST_PART)) as u64;
        let row = self.judge(case.name, case.expected, &trial.snapshot, &dataset)?;
        self.add(Row {
            has_recovered: trial.last_skipped.is_none_or(|step| step <= first_of_last),
            skipped: trial.skipped,
            ..row
        });
        Ok(trial.snapshot)
    }

    /// The normal model after a round through files of half the precision, and with densities at the end of their range.
    fn store(&mut self, normal: &Snapshot) -> Result<(), Failure> {
        type Change = fn(&Snapshot) -> Result<Snapshot, Failure>;
        let cases: [(_, _, Change); 3] = [
            ("stored as f16", Expected::SameError, |normal| {
                reloaded(normal, Storage::F16)
            }),
            ("stored as bf16", Expected::Finite, |normal| {
                reloaded(normal, Storage::Bf16)
            }),
            ("densities of 1e-7 and 3e6", Expected::Finite, |normal| {
                Ok(dense(normal))
            }),
        ];
        for (name, expected, change) in cases {
            if self.args.wants(name) {
                let row = self.judge(name, expected, &change(normal)?, &self.dataset)?;
                self.add(row);
            }
        }
        Ok(())
    }

    /// The row of a model that was trained on `dataset`, as if no step had been skipped.
    fn judge(
        &self,
        name: &'static str,
        expected: Expected,
        snapshot: &Snapshot,
        dataset: &Dataset,
    ) -> Result<Row, Failure> {
        let (is_finite, metrics) = on_threads(self.args.common.threads, || {
            let scene = snapshot.scene();
            let is_finite = scene.environment.params().iter().all(|v| v.is_finite())
                && renders_finite(&scene, dataset)?;
            Ok((is_finite, measure(snapshot, &dataset.val, None)?))
        })?;
        let difference = self.normal.map_or([None; 2], |normal| {
            let object = metrics.psnr_object.zip(normal.psnr_object);
            let background = metrics.psnr_background.zip(normal.psnr_background);
            [object, background].map(|pair| pair.map(|(a, b)| a - b))
        });
        let largest = difference
            .iter()
            .flatten()
            .fold(0.0, |m: f64, d| m.max(d.abs()));
        let verdict = if !is_finite {
            Err("not finite".to_owned())
        } else if expected == Expected::SameError && largest > SAME_DB {
            Err(format!("{largest:.2} dB off"))
        } else {
            Ok(())
        };
        Ok(Row {
            name,
            is_finite,
            has_recovered: true,
            skipped: 0,
            metrics,
            difference,
            verdict,
        })
    }

    /// Keeps and shows a row.
    fn add(&mut self, row: Row) {
        self.display.say(&line(&row));
        self.rows.push(row);
    }

    /// Prints all rows; an error names the cases that failed.
    fn report(&self) -> Result<(), Failure> {
        if self.args.common.json {
            let rows: Vec<_> = self.rows.iter().map(json_row).collect();
            output::json_line(&json!({ "rows": rows }))?;
        } else {
            let header = "| case | finite | recovered | steps skipped | object dB | background dB | against normal | verdict |";
            output::table(header, self.rows.iter().map(line))?;
        }
        let failed = self.rows.iter().filter(|row| row.verdict.is_err());
        let failed: Vec<_> = failed.map(|row| row.name).collect();
        if failed.is_empty() {
            return Ok(());
        }
        let failed = failed.join(", ");
        Err(Failure::Failed(anyhow::anyhow!("unstable: {failed}")))
    }
}

fn json_row(row: &Row) -> serde_json::Value {
    json!({
        "name": row.name, "finite": row.is_finite, "recovered": row.has_recovered, "skipped_steps": row.skipped,
        "metrics": row.metrics, "object_against_normal": row.difference[0],
        "background_against_normal": row.difference[1], "ok": row.verdict.is_ok(),
    })
}

fn line(row: &Row) -> String {
    let yes = |is: bool| if is { "yes" } else { "no" };
    let verdict = match &row.verdict {
        Ok(()) => "ok",
        Err(why) => why,
    };
    let [object, background] = row
        .difference
        .map(|d| d.map_or_else(|| "–".to_owned(), |d| format!("{d:+.2}")));
    format!(
        "| {} | {} | {} | {} | {} | {} | {object} / {background} | {verdict} |",
        row.name,
        yes(row.is_finite),
        yes(row.has_recovered),
        row.skipped,
        figure(row.metrics.psnr_object),
        figure(row.metrics.psnr_background),
    )
}

/// The model as it comes back from its files.
fn reloaded(snapshot: &Snapshot, storage: Storage) -> Result<Snapshot, Failure> {
    let folder = tempfile::tempdir().context("a folder for the stored model")?;
    let path = folder.path().join("field.safetensors");
    snapshot.environment.save(&path, storage)?;
    let environment = Arc::new(Environment::load(&path)?);
    let object = match &snapshot.object {
        Some(object) => {
            object.material.save(&path, storage)?;
            Some(Arc::new(ObjectModel {
                tracer: Arc::clone(&object.tracer),
                material: Arc::new(SurfaceField::load(&path)?),
            }))
        }
        None => None,
    };
    Ok(Snapshot {
        step: snapshot.step,
        object,
        environment,
        exposures: None,
    })
}

/// The model with grid values so large that its densities are as small and as large as they can be.
fn dense(snapshot: &Snapshot) -> Snapshot {
    let old = &snapshot.environment;
    let EnvironmentField::Grid { field, density } = old.field() else {
        return snapshot.clone();
    };
    let mut field = field.clone();
    let n_networks = field.n_network_params();
    for value in &mut field.params[n_networks..] {
        *value *= DENSE;
    }
    let place = EnvironmentPlace {
        name: old.name().to_owned(),
        frame: *old.frame(),
        gamma: old.gamma(),
        n_samples: old.n_samples(),
        up: old.up(),
    };
    Snapshot {
        environment: Arc::new(Environment::new(place, field, density.clone())),
        ..snapshot.clone()
    }
}

/// Whether a view is finite as trained and under extreme edits.
fn renders_finite(scene: &Scene, dataset: &Dataset) -> Result<bool, Failure> {
    let cancel = interrupt::install()?;
    let Some(view) = dataset.val.first() else {
        return Ok(true);
    };
    let camera = view.camera.resized(64, 64);
    for (roughness, tint) in [
        (None, 1.0),
        (Some(0.0), 1.0),
        (Some(1.0), 0.0),
        (Some(1.0), 100.0),
    ] {
        let mut edited = scene.clone();
        edited.edit.tint_scale = tint;
        if let Some(roughness) = roughness {
            edited.edit.roughness = RoughnessEdit::Constant(roughness);
        }
        let Some(picture) = render(&edited, &camera, Layer::Final, cancel, &|_| ()) else {
            return Err(Failure::Interrupted);
        };
        if !picture.pixels.iter().flatten().all(|v| v.is_finite()) {
            return Ok(false);
        }
    }
    Ok(true)
}
