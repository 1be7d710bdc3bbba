//! `neif bench preview`: how long the passes of the preview take after each kind of change.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::Vec3;
use neif::data::Splits;
use neif::neif::RoughnessEdit;
use neif::render::Layer;
use neif::render::progressive::{PassKind, PreviewScene, Progressive, SCALES};
use serde_json::json;

use super::trial::{Length, load, on_threads, train};
use super::{Common, dataset_or_demo};
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::output::{self, Display};
use crate::cli::train::config;

/// Repetitions of a change; the median counts.
const REPEATS: usize = 5;

/// Arguments of `neif bench preview`.
#[derive(Debug, clap::Args)]
pub(crate) struct PreviewArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps of training before
    #[arg(long, value_name = "N", default_value_t = 1000)]
    steps: u64,
    /// Pixels per row and rows of the picture at full resolution
    #[arg(long, value_name = "N", default_value_t = 640)]
    size: u32,
    #[command(flatten)]
    common: Common,
}

/// A change of what is shown; the number says which repetition.
struct Change {
    name: &'static str,
    apply: fn(&mut PreviewScene, usize),
}

const CHANGES: [Change; 4] = [
    Change {
        name: "nothing",
        apply: |_, _| (),
    },
    Change {
        name: "roughness",
        apply: |request, i| {
            request.scene.edit.roughness = RoughnessEdit::Constant(0.2 + 0.05 * i as f32);
        },
    },
    Change {
        name: "surroundings turned",
        apply: |request, i| {
            request.scene.transform.rotate_deg = Vec3::new(0.0, 0.0, 5.0 + i as f32);
        },
    },
    Change {
        name: "camera moved",
        apply: |request, i| {
            request.camera.world_from_camera.translation.x *= 1.0 - 0.01 * (i + 1) as f32;
        },
    },
];

/// Milliseconds of a pass.
struct Row {
    change: &'static str,
    scale: u32,
    millis: f64,
}

/// Runs the benchmark.
pub(super) fn run(args: &PreviewArgs) -> Result<(), Failure> {
    let dataset = load(&dataset_or_demo(args.dataset.as_ref())?, Splits::TRAIN_VAL)?;
    let config = config(None, Some(args.common.seed))?;
    let mut display = Display::new(args.common.json);
    let view = dataset.val.first().or_else(|| dataset.train.first());
    let view = view
        .ok_or_else(|| anyhow::anyhow!("the capture has no photo"))
        .or_unusable()?;
    let rows = on_threads(args.common.threads, || {
        let mut show = |done| display.set(done, "training", "");
        let trial = train(&config, &dataset, Length::Steps(args.steps), &mut show)?;
        let request = PreviewScene {
            scene: trial.snapshot.scene(),
            camera: view.camera.resized(args.size, args.size),
            layer: Layer::Final,
        };
        Ok(measure(&request))
    })?;
    display.finish();
    if args.common.json {
        let rows: Vec<_> = rows
            .iter()
            .map(|row| json!({ "change": row.change, "scale": row.scale, "milliseconds": row.millis }))
            .collect();
        return Ok(output::json_line(
            &json!({ "size": args.size, "rows": rows }),
        )?);
    }
    output::line(&format!(
        "a picture of {0} x {0}, milliseconds of a pass",
        args.size
    ))?;
    output::line("| after a change of | a quarter | half | full resolution |")?;
    output::line("|---|---|---|---|")?;
    for change in &CHANGES {
        let cells: Vec<String> = rows
            .iter()
            .filter(|row| row.change == change.name)
            .map(|row| format!("{:.1}", row.millis))
            .collect();
        output::line(&format!("| {} | {} |", change.name, cells.join(" | ")))?;
    }
    Ok(())
}

fn measure(request: &PreviewScene) -> Vec<Row> {
    let never = AtomicBool::new(false);
    let mut rows = Vec::new();
    for change in &CHANGES {
        for scale in SCALES {
            let mut progressive = Progressive::default();
            let mut request = request.clone();
            progressive.pass(&request, PassKind::plain(scale), &never);
            let mut millis: Vec<f64> = (0..REPEATS)
                .map(|i| {
                    (change.apply)(&mut request, i);
                    let start = Instant::now();
                    progressive.pass(&request, PassKind::plain(scale), &never);
                    start.elapsed().as_secs_f64() * 1e3
                })
                .collect();
            millis.sort_by(f64::total_cmp);
            rows.push(Row {
                change: change.name,
                scale,
                millis: millis[REPEATS / 2],
            });
        }
    }
    rows
}
