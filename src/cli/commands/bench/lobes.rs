//! `neif bench lobes`: pictures by cones against pictures by many thin rays, roughness by roughness.

use std::path::PathBuf;

use neif::data::{Split, View};
use neif::neif::RoughnessEdit;
use neif::render::{
    GBuffer, Layer, LobeShape, PathOptions, Picture, ReferenceOptions, Scene, render,
    render_reference,
};
use neif::train::measure::metrics::SquaredError;
use serde_json::json;

use super::trial::{figure, on_threads};
use crate::cli::capture::PhotoArgs;
use crate::cli::edits::EnvironmentFlags;
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::{interrupt, scenes, values};

#[derive(Debug, clap::Args)]
pub(crate) struct LobesArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Roughnesses to set everywhere
    #[arg(long, value_name = "V,..", value_delimiter = ',', value_parser = values::unit_interval,
          default_value = "0.02,0.1,0.2,0.4,0.6,0.8,1")]
    roughness: Vec<f32>,
    /// Rays a pixel of the reference
    #[arg(long, value_name = "N", default_value_t = 256,
          value_parser = clap::value_parser!(u32).range(1..=65_536))]
    rays: u32,
    /// Draw the reference's rays from the model's own lobe instead of GGX
    #[arg(long)]
    model_lobe: bool,
    /// Validation views to measure on
    #[arg(long, value_name = "N", default_value_t = 2)]
    views: usize,
    /// Where the run's capture lies now
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Write the figures as JSON
    #[arg(long)]
    json: bool,
    /// Worker threads; 0 is one for each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    environment: EnvironmentFlags,
    #[command(flatten)]
    photos: PhotoArgs,
}

/// Which object pixels are compared.
const GROUPS: [&str; 4] = ["all", "flat", "curved", "meets itself"];

/// PSNR of each group of pixels at one roughness (none: as learned).
struct Row {
    roughness: Option<f32>,
    psnr: [Option<f64>; GROUPS.len()],
}

pub(super) fn run(args: &LobesArgs) -> Result<(), Failure> {
    let run = scenes::open_run(&args.run, args.dataset.as_deref())?;
    let (views, _) = run.load_views(Split::Val, &args.photos)?;
    let views: Vec<View> = views.into_iter().take(args.views.max(1)).collect();
    let mut display = Display::new(args.json);
    let edits: Vec<Option<f32>> = std::iter::once(None)
        .chain(args.roughness.iter().copied().map(Some))
        .collect();
    let mut rows = Vec::new();
    for (i, roughness) in edits.iter().copied().enumerate() {
        let mut scene = run.scene.clone();
        scene.transform = args.environment.transform();
        if let Some(roughness) = roughness {
            scene.edit.roughness = RoughnessEdit::Constant(roughness);
        }
        display.set(i as f32 / edits.len() as f32, "Measuring", "");
        let psnr = on_threads(args.threads, || measure(&scene, &views, args))?;
        rows.push(Row { roughness, psnr });
    }
    display.finish();
    report(&rows, args.json)
}

/// PSNR over the object pixels of all views, by group.
fn measure(
    scene: &Scene,
    views: &[View],
    args: &LobesArgs,
) -> Result<[Option<f64>; GROUPS.len()], Failure> {
    let cancel = interrupt::install()?;
    let options = ReferenceOptions {
        n_paths: args.rays,
        lobe: if args.model_lobe {
            LobeShape::Model
        } else {
            LobeShape::Ggx
        },
    };
    let mut errors = [SquaredError::default(); GROUPS.len()];
    for view in views {
        let camera = &view.camera;
        let cones = render(scene, camera, Layer::Final, cancel, &|_| {});
        let rays = render_reference(scene, camera, options, cancel, &|_| {});
        let (Some(cones), Some(rays)) = (cones, rays) else {
            return Err(Failure::Interrupted);
        };
        add(scene, view, [&cones, &rays], &mut errors);
    }
    Ok(errors.map(|error| error.psnr()))
}

/// Adds the differences of one view's pictures.
fn add(
    scene: &Scene,
    view: &View,
    [cones, rays]: [&Picture; 2],
    errors: &mut [SquaredError; GROUPS.len()],
) {
    let tracer = scene.object.as_ref().map(|object| &*object.tracer);
    let rows = 0..view.camera.height;
    let gbuffer = GBuffer::trace(tracer, &view.camera, rows, PathOptions::PLAIN);
    let first = |pixel: usize| {
        let path = gbuffer.paths_at(pixel as u32).next()?;
        (gbuffer.coverage()[pixel] >= 1.0).then(|| (path[0].point.spread, path.len()))
    };
    let mut spreads: Vec<f32> = (0..cones.pixels.len())
        .filter_map(|pixel| Some(first(pixel)?.0))
        .collect();
    spreads.sort_by(f32::total_cmp);
    let median = spreads.get(spreads.len() / 2).copied().unwrap_or(0.0);
    for (pixel, (a, b)) in cones.pixels.iter().zip(&rays.pixels).enumerate() {
        let Some((spread, n_vertices)) = first(pixel) else {
            continue;
        };
        errors[0].add(*a, *b);
        errors[if spread < median { 1 } else { 2 }].add(*a, *b);
        if n_vertices > 1 {
            errors[3].add(*a, *b);
        }
    }
}

fn report(rows: &[Row], as_json: bool) -> Result<(), Failure> {
    if as_json {
        let rows: Vec<_> = rows
            .iter()
            .map(|row| {
                let [all, flat, curved, meets_itself] = row.psnr;
                json!({
                    "roughness": row.roughness, "psnr": all, "psnr_flat": flat,
                    "psnr_curved": curved, "psnr_meets_itself": meets_itself,
                })
            })
            .collect();
        return Ok(output::json_line(&json!({ "rows": rows }))?);
    }
    let header = format!("| roughness | {} |", GROUPS.join(" | "));
    let line = |row: &Row| {
        let roughness = row.roughness.map(|v| format!("{v:.2}"));
        let name = roughness.unwrap_or("as learned".to_owned());
        format!("| {name} | {} |", row.psnr.map(figure).join(" | "))
    };
    Ok(output::table(&header, rows.iter().map(line))?)
}
