//! `neif env import`: an environment from an equirectangular picture.

use std::path::PathBuf;

use neif::neif::distant::{ImportOptions, Imported, UpAxis, import_environment};

use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::{output, scenes, values};

#[derive(Debug, clap::Args)]
pub(crate) struct EnvImportArgs {
    /// The panorama: .hdr or .exr (linear), or .png or .jpg (lamps no brighter than white)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The environment file (.safetensors) to write, or a folder to put it in
    #[arg(long, value_name = "ENV")]
    out: PathBuf,
    /// Turn it about the up axis, in degrees, anticlockwise seen from above
    #[arg(long, value_name = "DEG", default_value = "0", value_parser = values::finite, allow_hyphen_values = true)]
    rotate: f32,
    /// The world's axis that the panorama's top becomes; its centre is at +x
    #[arg(long, value_name = "AXIS", default_value = "z")]
    up: UpAxis,
    /// Brighten it, in photographic stops
    #[arg(long, value_name = "EV", default_value = "0", value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// What it is called in lists [default: the file's name]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Store it in 16 bits: a smaller file
    #[arg(long)]
    half: bool,
}

pub(crate) fn run(args: &EnvImportArgs) -> Result<(), Failure> {
    let options = ImportOptions {
        up: args.up,
        rotate_deg: args.rotate,
        exposure_ev: args.exposure,
        name: args.name.clone(),
    };
    let Imported {
        environment,
        notices,
    } = import_environment(&args.file, &options).or_unusable()?;
    let target = scenes::new_environment(&args.out)?;
    environment.save(&target, scenes::storage(args.half))?;
    for notice in notices {
        output::note(&format!("{}: {notice}", args.file.display()));
    }
    output::line(&target.display().to_string())?;
    Ok(())
}
