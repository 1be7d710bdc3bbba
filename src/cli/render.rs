//! `neif render`: pictures of a trained run, from any camera, edited and in any light.

use std::path::{Path, PathBuf};

use glam::Vec3;
use neif::geometry::Camera;
use neif::render::{
    Background, Layer, LobeShape, ReferenceOptions, Scene, render, render_reference,
};

use super::capture::PhotoArgs;
use super::edits::{EnvironmentFlags, MaterialFlags, apply};
use super::failure::Failure;
use super::output::{self, Display};
use super::scenes::{self, OpenRun, Split};
use super::values::Size;
use super::{interrupt, sheet, turntable, values};

/// Arguments of `neif render`.
#[derive(Debug, clap::Args)]
pub(crate) struct RenderArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    cameras: CameraFlags,
    /// Other surroundings: an environment file, a run folder, or `own`
    #[arg(long, value_name = "ENV", default_value = "own")]
    env: PathBuf,
    /// Make other surroundings as bright, and of the same white, as the object's own; `--env-exposure` comes on top
    #[arg(long)]
    env_match: bool,
    #[command(flatten)]
    environment: EnvironmentFlags,
    /// Leave the diffuse part as it was learned when the light changes, as the paper does
    #[arg(long)]
    baked_diffuse: bool,
    #[command(flatten)]
    material: MaterialFlags,
    /// The surroundings behind the object: shown, blurred or hidden; its light stays
    #[arg(long, value_name = "HOW", default_value_t)]
    background: Background,
    /// Brighten the picture, in photographic stops; --env-exposure brightens the light instead
    #[arg(long, value_name = "EV", default_value_t, value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// What to render: final, diffuse, specular, roughness, tint, normal, environment, depth, visibility, samples
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
    /// The folder for the pictures; made when missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Where the pictures are taken from.
#[derive(Debug, clap::Args)]
struct CameraFlags {
    /// From where the photos of this split were taken [default: test]
    #[arg(long, value_name = "SPLIT", conflicts_with_all = ["cameras", "turntable"])]
    split: Option<Split>,
    /// From the cameras of a transforms.json; its photos need not exist
    #[arg(long, value_name = "FILE", conflicts_with = "turntable")]
    cameras: Option<PathBuf>,
    /// From N places on a circle around the object
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    turntable: Option<u32>,
    /// Size of the pictures [default: that of the cameras; 512x512 on a turntable]
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    size: Option<Size>,
    /// Where the run's capture lies now
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Which way is up on a turntable: x, y, z, -x, -y, -z or X,Y,Z [default: as in the run]
    #[arg(long, value_name = "AXIS|X,Y,Z", value_parser = values::direction, allow_hyphen_values = true, requires = "turntable")]
    up: Option<Vec3>,
    #[command(flatten)]
    photos: PhotoArgs,
}

/// A camera and what its pictures are called.
#[derive(Clone, Debug)]
pub(crate) struct NamedCamera {
    /// File name without ending.
    pub(crate) name: String,
    /// Where it stands.
    pub(crate) camera: Camera,
}

/// `neif render`.
pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let run = scenes::open_run(&args.run, args.cameras.dataset.as_deref())?;
    let mut scene = run.scene.clone();
    if args.env != Path::new("own") {
        scene.swap_environment(scenes::open_environment(&args.env)?);
    }
    if args.baked_diffuse {
        scene.trained_in = None;
    }
    let mut scene = apply(scene, &args.material, &args.environment)?;
    scene.background = args.background;
    scene.display_ev = args.exposure;
    if args.env_match {
        scene.transform = scenes::matched(&scene, &run.scene.environment)?;
    }
    let cameras = args.cameras.cameras(&run)?;
    scenes::make_folder(&args.out)?;
    if args.reference.is_some() && args.layers != [Layer::Final] {
        return Err(Failure::unusable(anyhow::anyhow!(
            "--reference makes the final picture only; leave out --layers"
        )));
    }
    let n_pictures = render_all(&scene, &cameras, args)?;
    output::line(&format!("{}: {n_pictures} pictures", args.out.display()))?;
    Ok(())
}

/// Renders every layer from every camera; returns the number of pictures.
fn render_all(scene: &Scene, cameras: &[NamedCamera], args: &RenderArgs) -> Result<usize, Failure> {
    let cancel = interrupt::install()?;
    let scene = &scene.lit(cancel).ok_or(Failure::Interrupted)?;
    let mut display = Display::new(false);
    let total = cameras.len() * args.layers.len();
    let mut done = 0;
    for NamedCamera { name, camera } in cameras {
        for &layer in &args.layers {
            let picture = match args.reference {
                Some(n_paths) => {
                    let lobe = LobeShape::Ggx;
                    let options = ReferenceOptions { n_paths, lobe };
                    render_reference(scene, camera, options, cancel, &|_| {})
                }
                None => render(scene, camera, layer, cancel, &|_| {}),
            };
            let picture = picture.ok_or(Failure::Interrupted)?;
            sheet::save(&args.out.join(file_name(name, layer)), &picture)?;
            done += 1;
            display.set(
                done as f32 / total as f32,
                "Rendering",
                &format!("{done}/{total}"),
            );
        }
    }
    Ok(done)
}

/// `NAME.png` for the final picture, `NAME_layer.png` for the others.
fn file_name(name: &str, layer: Layer) -> String {
    match layer {
        Layer::Final => format!("{name}.png"),
        other => format!("{name}_{other}.png"),
    }
}

impl CameraFlags {
    fn cameras(&self, run: &OpenRun) -> Result<Vec<NamedCamera>, Failure> {
        let cameras = if let Some(n) = self.turntable {
            let up = self.up.unwrap_or(run.scene.environment.up());
            turntable::cameras(&run.scene, n, up)
        } else if let Some(file) = &self.cameras {
            scenes::read_cameras(file)?
        } else {
            let (views, _) = run.load_views(self.split.unwrap_or(Split::Test), &self.photos)?;
            let named = views.into_iter().map(|view| NamedCamera {
                name: view.name,
                camera: view.camera,
            });
            named.collect()
        };
        Ok(match self.size {
            Some(Size { width, height }) => cameras
                .into_iter()
                .map(|NamedCamera { name, camera }| NamedCamera {
                    name,
                    camera: camera.resized(width, height),
                })
                .collect(),
            None => cameras,
        })
    }
}
