//! `neif bench stability`: absurd captures and settings; training must stay finite and say how much worse it became.
//!
//! Scenes that differ from the normal one by unit, rotation or translation only must train to the same error.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use neif::data::{Dataset, Photo, Splits, View};
use neif::neif::RoughnessEdit;
use neif::render::{Layer, Scene, render};
use neif::train::config::TrainConfig;
use neif::train::metrics::ImageMetrics;
use serde_json::json;

use super::trial::{Length, figure, load, measure, on_threads, train};
use super::{Common, dataset_or_demo};
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::output::{self, Display};
use crate::cli::train::config;

/// How far a scene in another unit or frame may be from the normal one, dB.
const SAME_DB: f64 = 0.2;

/// Arguments of `neif bench stability`.
#[derive(Debug, clap::Args)]
pub(crate) struct StabilityArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps of each run
    #[arg(long, value_name = "N", default_value_t = 1000)]
    steps: u64,
    /// Steps of the long run at tiny size
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    long_steps: u64,
    #[command(flatten)]
    common: Common,
}

/// A capture and settings to survive.
struct Case {
    name: &'static str,
    change: fn(&mut Dataset, &mut TrainConfig),
    /// Whether the error must be the normal one.
    is_same_scene: bool,
}

const fn hard(name: &'static str, change: fn(&mut Dataset, &mut TrainConfig)) -> Case {
    Case {
        name,
        change,
        is_same_scene: false,
    }
}

const fn same(name: &'static str, change: fn(&mut Dataset, &mut TrainConfig)) -> Case {
    Case {
        name,
        change,
        is_same_scene: true,
    }
}

const CASES: [Case; 20] = [
    hard("normal", |_, _| ()),
    same("unit 1e-3", |d, _| {
        move_all(d, Affine3A::from_scale(Vec3::splat(1e-3)));
    }),
    same("unit 1e4", |d, _| {
        move_all(d, Affine3A::from_scale(Vec3::splat(1e4)));
    }),
    same("turned by 30 degrees", |d, _| {
        move_all(
            d,
            Affine3A::from_quat(Quat::from_axis_angle(Vec3::ONE.normalize_or_zero(), 0.52)),
        );
    }),
    same("100 units away", |d, _| {
        move_all(d, Affine3A::from_translation(Vec3::new(100.0, -60.0, 30.0)));
    }),
    hard("1e4 units away", |d, _| {
        move_all(d, Affine3A::from_translation(Vec3::new(1e4, 0.0, 0.0)));
    }),
    hard("learning rates x 10", |_, c| {
        c.grid_rate *= 10.0;
        c.network_rate *= 10.0;
    }),
    hard("learning rates x 100", |_, c| {
        c.grid_rate *= 100.0;
        c.network_rate *= 100.0;
    }),
    hard("one photo", |d, _| d.train.truncate(1)),
    hard("masks of two pixels", |d, _| {
        for view in &mut d.train {
            keep_two_mask_pixels(view);
        }
    }),
    hard("black photos", |d, _| paint(d, |_| [0.0; 3])),
    hard("white photos", |d, _| paint(d, |_| [1.0; 3])),
    hard("radiance 1e5", |d, _| paint(d, |v| v.map(|v| v * 1e5))),
    hard("photos that are not numbers", |d, _| {
        paint(d, |_| [f32::NAN; 3]);
    }),
    hard("contradicting photos", |d, _| {
        let cameras: Vec<_> = d.train.iter().map(|v| v.camera).collect();
        let n = cameras.len();
        for (i, view) in d.train.iter_mut().enumerate() {
            view.camera = cameras[(i * 7 + 1) % n];
        }
    }),
    hard("no mesh", |d, _| d.mesh = None),
    hard("two samples a ray", |_, c| c.samples_per_ray = 2),
    hard("one pixel a step", |_, c| {
        c.object_pixels = 1;
        c.background_pixels = 1;
    }),
    hard("roughness free from the start", |_, c| {
        c.roughness_delay = 0;
    }),
    hard("weights a million times larger", |_, c| {
        c.background_weight *= 1e6;
        c.smoothness_weight *= 1e6;
    }),
];

/// What became of a case.
struct Row {
    name: &'static str,
    is_finite: bool,
    skipped: u64,
    metrics: ImageMetrics,
    verdict: Result<(), String>,
}

/// Runs the benchmark; fails when a case does.
pub(super) fn run(args: &StabilityArgs) -> Result<(), Failure> {
    let splits = Splits {
        test: false,
        ..Splits::ALL
    };
    let dataset = load(&dataset_or_demo(args.dataset.as_ref())?, splits)?;
    let mut display = Display::new(args.common.json);
    let mut rows: Vec<Row> = Vec::new();
    for case in &CASES {
        let normal = rows.first().map(|row| row.metrics);
        let row = one(
            case,
            args.steps,
            normal.as_ref(),
            args,
            &dataset,
            &mut display,
        )?;
        display.say(&line(&row));
        rows.push(row);
    }
    let tiny = hard("long run at tiny size", |_, c| {
        (c.object_pixels, c.background_pixels) = (4, 4);
        c.samples_per_ray = 4;
        c.field.grid.log2_table_size = 10;
        c.material.grid.log2_table_size = 10;
    });
    rows.push(one(
        &tiny,
        args.long_steps,
        None,
        args,
        &dataset,
        &mut display,
    )?);
    display.finish();
    if args.common.json {
        let rows: Vec<_> = rows
            .iter()
            .map(|row| {
                json!({
                    "name": row.name, "finite": row.is_finite, "skipped_steps": row.skipped,
                    "metrics": row.metrics, "ok": row.verdict.is_ok(),
                })
            })
            .collect();
        output::json_line(&json!({ "rows": rows }))?;
    } else {
        output::line("| case | finite | steps skipped | object dB | background dB | verdict |")?;
        output::line("|---|---|---|---|---|---|")?;
        for row in &rows {
            output::line(&line(row))?;
        }
    }
    let failed: Vec<_> = rows
        .iter()
        .filter(|row| row.verdict.is_err())
        .map(|row| row.name)
        .collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Failed(anyhow::anyhow!(
        "unstable: {}",
        failed.join(", ")
    )))
}

fn one(
    case: &Case,
    steps: u64,
    normal: Option<&ImageMetrics>,
    args: &StabilityArgs,
    dataset: &Dataset,
    display: &mut Display,
) -> Result<Row, Failure> {
    let (mut dataset, mut config) = (dataset.clone(), config(None, Some(args.common.seed))?);
    (case.change)(&mut dataset, &mut config);
    on_threads(args.common.threads, || {
        let mut show = |done| display.set(done, case.name, "");
        let trial = train(&config, &dataset, Length::Steps(steps), &mut show)?;
        let scene = trial.snapshot.scene();
        let is_finite = scene.environment.params().iter().all(|v| v.is_finite())
            && renders_finite(&scene, &dataset)?;
        let metrics = measure(&trial.snapshot, &dataset.val, None)?;
        let verdict = judge(case, is_finite, &metrics, normal);
        Ok(Row {
            name: case.name,
            is_finite,
            skipped: trial.skipped,
            metrics,
            verdict,
        })
    })
}

fn judge(
    case: &Case,
    is_finite: bool,
    metrics: &ImageMetrics,
    normal: Option<&ImageMetrics>,
) -> Result<(), String> {
    if !is_finite {
        return Err("not finite".to_owned());
    }
    let Some(normal) = normal.filter(|_| case.is_same_scene) else {
        return Ok(());
    };
    for (a, b) in [
        (metrics.psnr_object, normal.psnr_object),
        (metrics.psnr_background, normal.psnr_background),
    ] {
        let difference = (a.unwrap_or(0.0) - b.unwrap_or(0.0)).abs();
        if difference > SAME_DB {
            return Err(format!("{difference:.2} dB off"));
        }
    }
    Ok(())
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

fn line(row: &Row) -> String {
    let verdict = match &row.verdict {
        Ok(()) => "ok",
        Err(why) => why,
    };
    format!(
        "| {} | {} | {} | {} | {} | {verdict} |",
        row.name,
        if row.is_finite { "yes" } else { "no" },
        row.skipped,
        figure(row.metrics.psnr_object),
        figure(row.metrics.psnr_background),
    )
}

/// Moves, turns or scales cameras and mesh together.
fn move_all(dataset: &mut Dataset, motion: Affine3A) {
    let (_, rotation, _) = motion.to_scale_rotation_translation();
    for view in dataset.train.iter_mut().chain(&mut dataset.val) {
        let pose = view.camera.world_from_camera;
        let (_, turn, at) = pose.to_scale_rotation_translation();
        view.camera.world_from_camera =
            Affine3A::from_rotation_translation(rotation * turn, motion.transform_point3(at));
    }
    dataset.mesh = dataset
        .mesh
        .as_ref()
        .map(|mesh| Arc::new(mesh.transformed(motion)));
}

/// Changes the training photos, in linear radiance.
fn paint(dataset: &mut Dataset, color: fn([f32; 3]) -> [f32; 3]) {
    for view in &mut dataset.train {
        view.photo = Photo::Hdr {
            width: view.photo.width(),
            height: view.photo.height(),
            pixels: (0..view.photo.n_pixels())
                .map(|i| color(view.photo.linear(i)))
                .collect(),
        };
    }
}

/// Leaves two object pixels in a view's mask.
fn keep_two_mask_pixels(view: &mut View) {
    let Some(mask) = &mut view.mask else { return };
    let mut left = 2;
    for coverage in &mut mask.coverage {
        if *coverage < u8::MAX || left == 0 {
            *coverage = 0;
        } else {
            left -= 1;
        }
    }
}
