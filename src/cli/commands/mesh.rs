//! `neif mesh`: stage one alone, a mesh from the depth maps, masks or points of a capture.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use neif::data::{CaptureChoices, Dataset, LoadOptions, read_mesh, write_glb};
use neif::geometry::Mesh;
use neif::train::shape::stage_one::{
    Making, StageOneError, StageOneOptions, compare, make_mesh, silhouette_agreement,
};
use serde_json::json;

use crate::cli::capture::PhotoArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::output::Display;
use crate::cli::{interrupt, output, scenes, values};

#[derive(Debug, clap::Args)]
pub(crate) struct MeshArgs {
    /// The capture: a folder or file of posed photos with masks, depth maps, or the points that they were posed by
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// The file to write
    #[arg(long, value_name = "FILE.glb")]
    out: PathBuf,
    /// Wall time of the whole command: 120s, 2m
    #[arg(long, value_name = "TIME", value_parser = values::duration_secs, default_value = "120s")]
    budget: f64,
    /// Cells of the grid along the object's longest side: detail against time and triangles
    #[arg(long, value_name = "N", default_value_t = StageOneOptions::default().n_cells as u64,
          value_parser = clap::value_parser!(u64).range(16..=176))]
    cells: u64,
    /// Say how far the result is from this mesh (the true one)
    #[arg(long, value_name = "MESH")]
    compare: Option<PathBuf>,
    #[command(flatten)]
    photos: PhotoArgs,
    /// Write JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &MeshArgs, started: Instant) -> Result<(), Failure> {
    scenes::check_is_glb(&args.out)?;
    let cancel = interrupt::install()?;
    let reference = args.compare.as_deref().map(read_mesh);
    let reference = reference.transpose().or_unusable()?;
    let load_options = LoadOptions {
        choices: args.photos.over(CaptureChoices::default()),
        ..LoadOptions::default()
    };
    let dataset = Dataset::load(&args.dataset, &load_options).or_unusable()?;
    let options = StageOneOptions {
        n_cells: args.cells as usize,
        deadline: Some(started + Duration::from_secs_f64(0.95 * args.budget)),
        ..StageOneOptions::default()
    };
    let display = std::sync::Mutex::new(Display::new(args.json));
    let show = |making: Making<'_>| {
        let Making::Progress(fraction) = making else {
            return;
        };
        // Progress that cannot be shown is no reason to stop the work.
        if let Ok(mut display) = display.lock() {
            display.set(fraction, "Making the mesh", "");
            if args.json {
                let line = json!({"event": "progress", "fraction": fraction});
                output::json_line(&line).unwrap_or_default();
            }
        }
    };
    let mesh = match make_mesh(&dataset, &options, cancel, &show) {
        Err(StageOneError::Cancelled) => return Err(Failure::Interrupted),
        made => Arc::new(made.or_unusable()?),
    };
    if let Ok(display) = display.lock() {
        display.finish();
    }
    scenes::make_folder_of(&args.out)?;
    write_glb(&args.out, &mesh)?;
    report(args, &dataset, &mesh, reference, started)
}

/// Says how long it took and how good the mesh is, on views that it was not made from.
fn report(
    args: &MeshArgs,
    dataset: &Dataset,
    mesh: &Arc<Mesh>,
    reference: Option<Mesh>,
    started: Instant,
) -> Result<(), Failure> {
    let seconds = started.elapsed().as_secs_f64();
    let held_out = if dataset.test.is_empty() {
        &dataset.val
    } else {
        &dataset.test
    };
    let agreement = silhouette_agreement(mesh, held_out.iter());
    let difference = reference.map(|reference| {
        let cameras: Vec<_> = held_out.iter().map(|view| view.camera).collect();
        compare(mesh, &Arc::new(reference), &cameras)
    });
    let n_triangles = mesh.triangles.len();
    if args.json {
        output::json_line(&json!({
            "event": "finished", "mesh": args.out.to_string_lossy(), "triangles": n_triangles,
            "seconds": seconds, "silhouette_iou": agreement,
            "difference": difference,
        }))?;
        return Ok(());
    }
    let iou = agreement.map(|iou| 100.0 * iou);
    let iou = iou.map(|iou| format!(", {iou:.1} % of the held-out silhouettes in common"));
    output::line(&format!(
        "{}: {n_triangles} triangles in {seconds:.1} s{}",
        args.out.display(),
        iou.unwrap_or_default()
    ))?;
    if let Some(d) = difference {
        output::line(&format!(
            "distance {:.2} % of {:.4} units, {:.2} % where seen; normals {:.1} degrees off (median), {:.1} (mean)",
            100.0 * d.chamfer,
            d.diameter,
            100.0 * d.chamfer_visible,
            d.normal_median_deg,
            d.normal_mean_deg
        ))?;
    }
    Ok(())
}
