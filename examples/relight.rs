//! A trained object under an HDRI: `cargo run --release --example relight RUN PANORAMA OUT.png`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use neif::data::write_png_srgb;
use neif::geometry::Camera;
use neif::neif::Environment;
use neif::render::{Layer, render};
use neif::train::session::saved::run_folder::RunFolder;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(run), Some(panorama), Some(out)) = (args.next(), args.next(), args.next()) else {
        anyhow::bail!("usage: relight RUN PANORAMA OUT.png");
    };
    relight(&run, &panorama, &out, 512)
}

/// Draws the run's object in the environment of the panorama, from the front, `side` by `side` pixels.
pub(crate) fn relight(run: &Path, panorama: &Path, out: &Path, side: u32) -> anyhow::Result<()> {
    let mut scene = RunFolder::open(run)?.scene()?;
    let Some(object) = &scene.object else {
        anyhow::bail!("{}: the run has no object", run.display());
    };
    let bounds = object.tracer.mesh().bounds();
    let (middle, up) = (bounds.center(), scene.environment.up());
    let eye = middle + 2.0 * bounds.extent().length() * up.any_orthonormal_vector();
    let camera = Camera::look_at(eye, middle, up, 0.7, side, side);
    scene.swap_environment(Arc::new(Environment::open(panorama)?));
    let never = AtomicBool::new(false);
    let picture = render(&scene, &camera, Layer::Final, &never, &|_| ());
    let picture = picture.ok_or_else(|| anyhow::anyhow!("cancelled"))?;
    write_png_srgb(out, picture.width, picture.height, &picture.pixels)?;
    Ok(())
}
