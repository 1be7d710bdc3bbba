//! `neif render`: pictures of a trained run, from any camera, edited and in any light.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::anyhow;
use neif::data::Ending;
use neif::render::{
    Backdrop, Background, Destination, FileKind, Film, FilmError, Layer, LobeShape,
    ReferenceOptions, ToneMap,
};
use strum::VariantArray as _;

use crate::cli::edits::{EnvironmentFlags, MaterialFlags};
use crate::cli::failure::Failure;
use crate::cli::output::{self, Display};
use crate::cli::shots::CameraFlags;
use crate::cli::{interrupt, scenes, values};

#[derive(Debug, clap::Args)]
pub(crate) struct RenderArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    cameras: CameraFlags,
    /// Another environment: an environment file, a run folder, a name of the library, or `own`
    #[arg(long, value_name = "ENV", default_value = "own")]
    env: PathBuf,
    /// Make another environment as bright, and of the same white, as the object's own; `--env-exposure` comes on top
    #[arg(long)]
    env_match: bool,
    #[command(flatten)]
    environment: EnvironmentFlags,
    /// Leave the diffuse part as it was learned when the light changes, as the paper does
    #[arg(long)]
    baked_diffuse: bool,
    #[command(flatten)]
    material: MaterialFlags,
    /// The environment behind the object: shown, blurred, hidden, or auto, which is shown unless no photo showed it, and then
    /// blurred; its light stays
    #[arg(long, value_name = "HOW", default_value_t)]
    background: Background,
    /// Brighten the picture, in photographic stops; --env-exposure brightens the light instead
    #[arg(long, value_name = "EV", default_value_t, value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// What becomes of light brighter than white: clipped as in the photos, or compressed as Khronos' PBR Neutral does
    #[arg(long, value_name = "photo|neutral", default_value_t)]
    tone_map: ToneMap,
    /// The files: a png for each picture and layer, an exr for each picture (linear light, the layers named in it,
    /// with depth), one animated gif, or one mp4 (needs ffmpeg)
    #[arg(long, value_name = "png|exr|gif|mp4", default_value = "png")]
    format: FileKind,
    /// Pictures a second of a gif or mp4
    #[arg(long, value_name = "N", value_parser = values::positive, default_value = "24")]
    fps: f32,
    /// Leave the environment out of the picture: transparent around the object, where --background hidden is black
    #[arg(long)]
    no_background: bool,
    /// What to render: final, diffuse, specular, roughness, tint, normal, environment, depth, visibility, samples, albedo, irradiance, seen
    #[arg(
        long,
        value_name = "LAYER,..",
        value_delimiter = ',',
        default_value = "final"
    )]
    layers: Vec<Layer>,
    /// The final picture by N thin rays a pixel instead of cones: slow, to compare with
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    reference: Option<u32>,
    /// The folder for the pictures, made when missing; for a gif or mp4 also the file
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let run = scenes::open_run(&args.run, args.cameras.dataset.as_deref())?;
    let mut scene = run.scene.clone();
    if args.env != Path::new("own") {
        scene.swap_environment(scenes::open_environment(&args.env)?);
    }
    if args.baked_diffuse {
        scene.trained_in = None;
    }
    let edit = args.material.edit()?;
    (scene.edit, scene.regions) = (edit.whole, edit.regions);
    scene.transform = args.environment.transform();
    scene.background = args.background;
    scene.display_ev = args.exposure;
    scene.tone_map = args.tone_map;
    if args.env_match {
        scene.transform = scenes::matched(&scene, &run.scene.environment)?;
    }
    let (shots, name) = args.cameras.shots(&run, scene.transform)?;
    let film = Film {
        scene,
        shots,
        layers: args.layers.clone(),
        backdrop: if args.no_background {
            Backdrop::Transparent
        } else {
            Backdrop::Shown
        },
        kind: args.format,
        fps: args.fps,
        reference: args.reference.map(|n_paths| ReferenceOptions {
            n_paths,
            lobe: LobeShape::Ggx,
        }),
    };
    write(&film, &destination(args, name)?)
}

/// The folder, or the file in it that a film becomes.
fn destination(args: &RenderArgs, name: &str) -> Result<Destination, Failure> {
    let (out, kind) = (&args.out, args.format);
    if !kind.is_film() {
        return Ok(Destination::Folder(out.clone()));
    }
    match out.extension() {
        Some(extension) if extension == kind.extension() => Ok(Destination::File(out.clone())),
        // A name that is meant for another kind of file is not that of a folder.
        Some(extension)
            if FileKind::VARIANTS
                .iter()
                .any(|kind| extension == kind.extension()) =>
        {
            Err(Failure::unusable(anyhow!(
                "--out {}: --format {kind} makes a .{kind} file",
                out.display()
            )))
        }
        _ => Ok(Destination::File(out.join(format!("{name}.{kind}")))),
    }
}

fn write(film: &Film, destination: &Destination) -> Result<(), Failure> {
    let cancel = interrupt::install()?;
    let (n, display) = (film.shots.len(), Mutex::new(Display::new(false)));
    let on_progress = |fraction: f32| {
        // Several threads report at once; the one that comes too late has old news.
        if let Ok(mut display) = display.try_lock() {
            let number = ((fraction * n as f32) as usize + 1).min(n);
            display.set(fraction, "Rendering", &format!("{number}/{n}"));
        }
    };
    let ending = film.write(destination, cancel, &on_progress);
    drop(display.into_inner().unwrap_or_else(PoisonError::into_inner));
    match ending {
        Ok(Ending::Finished) => {}
        Ok(Ending::Cancelled) => return Err(Failure::Interrupted),
        Err(error @ FilmError::Unusable(_)) => return Err(Failure::unusable(error)),
        Err(error @ FilmError::Write(_)) => return Err(error.into()),
    }
    let per_shot = if film.kind == FileKind::Png {
        film.layers.len()
    } else {
        1
    };
    let (Destination::Folder(path) | Destination::File(path)) = destination;
    let written = match n * per_shot {
        1 => "1 picture".to_owned(),
        n => format!("{n} pictures"),
    };
    output::line(&format!("{}: {written}", path.display()))?;
    Ok(())
}
