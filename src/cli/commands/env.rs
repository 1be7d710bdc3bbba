//! `neif env`: an environment on its own.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use neif::color::srgb_from_linear;
use neif::data::{ExrSample, write_exr, write_png_srgb};
use neif::render::{Picture, environment_map, panorama as render_panorama, trained_light};
use neif::train::session::options::SessionOptions;

use super::env_import::EnvImportArgs;
use super::env_library::{EnvAddArgs, EnvListArgs, EnvRemoveArgs};
use super::train::{BudgetArgs, config};
use crate::cli::capture::CaptureArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::place::{AboutArgs, Place};
use crate::cli::{interrupt, output, scenes, values};

/// What can be done with an environment.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum EnvCommand {
    /// Train an environment from posed photos, without an object
    Train(EnvTrainArgs),
    /// Make an environment of another program's scan (Gaussian splats, a NeRF) or of a panorama (.hdr, .exr, .png, .jpg)
    Import(EnvImportArgs),
    /// Render what a point of the environment sees all around
    Panorama(PanoramaArgs),
    /// List the library: environments that go by a name wherever one is asked for, in the window too
    List(EnvListArgs),
    /// Add an environment to the library
    Add(EnvAddArgs),
    /// Delete an environment of the library
    Remove(EnvRemoveArgs),
}

#[derive(Debug, clap::Args)]
pub(crate) struct EnvTrainArgs {
    /// A folder or file of posed photos
    #[arg(value_name = "IMAGES")]
    images: PathBuf,
    /// The environment file (.safetensors) to write, or a folder to put it in; `library` puts it into the library
    #[arg(long, value_name = "ENV")]
    out: PathBuf,
    /// What it is called in lists [default: the capture's name]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Settings: `fast`, `paper`, or a TOML file with the values that differ from it [default: fast]
    #[arg(long, value_name = "NAME|FILE.toml")]
    preset: Option<String>,
    #[command(flatten)]
    budget: BudgetArgs,
    #[command(flatten)]
    capture: CaptureArgs,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Worker threads; 0 is one for each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Store the trained grid in 16 bits: a smaller file
    #[arg(long)]
    half: bool,
    /// Write events as lines of JSON
    #[arg(long)]
    json: bool,
    #[command(flatten, next_help_heading = "In the library")]
    about: AboutArgs,
}

pub(crate) fn train(args: &EnvTrainArgs, started: Instant) -> Result<(), Failure> {
    // Before the training, so that a wrong place shows at once.
    let place = Place::of(&args.out, &args.about)?;
    let mut config = config(args.preset.as_deref(), args.seed)?;
    config.threads = args.threads;
    config.validate().or_unusable()?;
    let options = SessionOptions {
        environment_only: true,
        choices: args.capture.choices(),
        started,
        storage: scenes::storage(args.half),
        ..SessionOptions::new(&args.images, config, args.budget.or_default())
    };
    let record = args.about.record(args.name.as_deref(), &args.images);
    place.fill(options, args.json, record)
}

#[derive(Debug, clap::Args)]
pub(crate) struct PanoramaArgs {
    /// An environment file, a run folder or a name of the library
    #[arg(value_name = "ENV")]
    environment: PathBuf,
    /// The point in the world to look from
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    at: Vec3,
    /// Blur as a surface of this roughness reflects it, 0 (sharp) to 1
    #[arg(long, value_name = "V", default_value = "0", value_parser = values::unit_interval)]
    roughness: f32,
    /// Width in pixels; the height is half of it
    #[arg(long, value_name = "N", default_value_t = 512,
          value_parser = clap::value_parser!(u32).range(2..=16384))]
    width: u32,
    /// Linear radiance as .exr, or a picture as .png
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(crate) fn panorama(args: &PanoramaArgs) -> Result<(), Failure> {
    let unknown = || Failure::at(&args.out, "the name must end in .exr or .png");
    let kind = PanoramaFile::of(&args.out).ok_or_else(unknown)?;
    let scene = scenes::open_environment_scene(&args.environment)?;
    let cancel = interrupt::install()?;
    let light = trained_light(&scene, cancel);
    let picture = if args.roughness > 0.0 {
        let empty = scene.emptied_of(light.as_deref());
        render_panorama(&empty, args.at, args.roughness, args.width, cancel)
    } else {
        environment_map(&scene, light.as_deref(), args.at, args.width, cancel)
    };
    let picture = picture.ok_or(Failure::Interrupted)?;
    kind.write(&args.out, &picture)?;
    output::line(&args.out.display().to_string())?;
    Ok(())
}

/// How a panorama is stored.
#[derive(Clone, Copy)]
pub(crate) enum PanoramaFile {
    /// Linear radiance.
    Exr,
    /// Clipped and encoded for looking at.
    Png,
}

impl PanoramaFile {
    /// By the ending of the name.
    pub(crate) fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Some(Self::Exr),
            "png" => Some(Self::Png),
            _ => None,
        }
    }

    /// Writes a linear panorama.
    pub(crate) fn write(self, path: &Path, linear: &Picture) -> Result<(), Failure> {
        let (width, height) = (linear.width, linear.height);
        match self {
            Self::Exr => write_exr(path, width, height, &linear.pixels, ExrSample::Float)?,
            Self::Png => {
                let encode = |pixel: &[f32; 3]| pixel.map(|v| srgb_from_linear(v.clamp(0.0, 1.0)));
                let pixels: Vec<[f32; 3]> = linear.pixels.iter().map(encode).collect();
                write_png_srgb(path, width, height, &pixels)?;
            }
        }
        Ok(())
    }
}
