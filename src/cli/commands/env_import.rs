//! `neif env import`: an environment from another program's radiance field, or from an equirectangular picture.

use std::path::PathBuf;
use std::time::Instant;

use glam::Vec3;
use neif::data::CaptureChoices;
use neif::neif::distant::{ImportOptions, Imported, import_environment};
use neif::scans::Scan;
use neif::train::session::options::SessionOptions;

use super::train::{BudgetArgs, config};
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::place::{AboutArgs, Place};
use crate::cli::{output, scenes, values};

#[derive(Debug, clap::Args)]
pub(crate) struct EnvImportArgs {
    /// A scan: 3D Gaussian splats (.ply, .splat, .spz, .sog) or a NeRF (instant-ngp, nerfstudio, nerf-pytorch). Or a panorama: .hdr
    /// or .exr (linear), .png or .jpg (lamps no brighter than white)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The environment file (.safetensors) to write, or a folder to put it in; `library` puts it into the library
    #[arg(long, value_name = "ENV")]
    out: PathBuf,
    /// Of a panorama, the direction that its top becomes [default: z]; of a scan, which way is up in it [default: across its floors
    /// and tables]
    #[arg(long, value_name = "AXIS|X,Y,Z", value_parser = values::direction, allow_hyphen_values = true)]
    up: Option<Vec3>,
    /// What it is called in lists [default: the file's name]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Store it in 16 bits: a smaller file
    #[arg(long)]
    half: bool,
    #[command(flatten)]
    scan: ScanArgs,
    #[command(flatten)]
    panorama: PanoramaArgs,
    #[command(flatten, next_help_heading = "In the library")]
    about: AboutArgs,
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Of a scan")]
struct ScanArgs {
    /// Where in it the object will stand: light is learned around it [default: a free place near the middle]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    at: Option<Vec3>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Worker threads; 0 is one for each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Write events as lines of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Of a panorama")]
struct PanoramaArgs {
    /// Turn it about the up axis, in degrees, anticlockwise seen from above; the centre of a picture whose top is +z is at +x
    #[arg(long, value_name = "DEG", default_value = "0", value_parser = values::finite, allow_hyphen_values = true)]
    rotate: f32,
    /// Brighten it, in photographic stops
    #[arg(long, value_name = "EV", default_value = "0", value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// Put it on a level floor, so far below the camera that took it, in scene units; else it is infinitely far, and an object floats
    #[arg(long, value_name = "HEIGHT", value_parser = values::positive)]
    floor: Option<f32>,
}

pub(crate) fn run(args: &EnvImportArgs, started: Instant) -> Result<(), Failure> {
    if Scan::is_scan(&args.file) {
        distill(args, started)
    } else {
        import_panorama(args)
    }
}

/// Trains an environment on pictures of the scan.
fn distill(args: &EnvImportArgs, started: Instant) -> Result<(), Failure> {
    let place = Place::of(&args.out, &args.about)?;
    let mut config = config(None, args.scan.seed)?;
    config.threads = args.scan.threads;
    let options = SessionOptions {
        environment_only: true,
        choices: CaptureChoices {
            up: args.up,
            at: args.scan.at,
            ..CaptureChoices::default()
        },
        storage: scenes::storage(args.half),
        started,
        ..SessionOptions::new(&args.file, config, args.scan.budget.or_default())
    };
    let record = args.about.record(args.name.as_deref(), &args.file);
    place.fill(options, args.scan.json, record)
}

fn import_panorama(args: &EnvImportArgs) -> Result<(), Failure> {
    let defaults = ImportOptions::default();
    let options = ImportOptions {
        up: args.up.unwrap_or(defaults.up),
        rotate_deg: args.panorama.rotate,
        exposure_ev: args.panorama.exposure,
        floor: args.panorama.floor,
        name: args.name.clone(),
    };
    let Imported {
        environment,
        notices,
    } = import_environment(&args.file, &options).or_unusable()?;
    let place = Place::of(&args.out, &args.about)?;
    let record = args.about.record(args.name.as_deref(), &args.file);
    let target = place.put(environment, scenes::storage(args.half), record)?;
    for notice in notices {
        output::note(&format!("{}: {notice}", args.file.display()));
    }
    output::line(&target.display().to_string())?;
    Ok(())
}
