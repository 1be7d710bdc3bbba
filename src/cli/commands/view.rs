//! The window, and what happens where there can be none.

use std::{path::PathBuf, time::Instant};

use neif::data::CaptureChoices;

use super::demo;
use crate::cli::capture::CaptureArgs;
use crate::cli::failure::Failure;
use crate::cli::library;

#[derive(Debug, clap::Args)]
pub(crate) struct ViewArgs {
    /// Captures, run folders or environment files to open, or names of the library
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    capture: CaptureArgs,
}

pub(crate) fn run(args: &ViewArgs) -> Result<(), Failure> {
    let paths = args.paths.iter().map(|path| library::path_or_name(path));
    let paths: Vec<PathBuf> = paths.collect::<Result<_, _>>()?;
    match no_window_reason() {
        Some(reason) => Err(Failure::Failed(anyhow::anyhow!("{reason}"))),
        None => open_window(paths, args.capture.choices()),
    }
}

/// `neif` alone: the window with the demo, or the demo without a window.
pub(crate) fn window_or_demo(started: Instant) -> Result<(), Failure> {
    match no_window_reason() {
        Some(reason) => demo::run(&reason, started),
        None => open_window(Vec::new(), CaptureChoices::default()),
    }
}

#[cfg(feature = "gui")]
fn open_window(open: Vec<PathBuf>, choices: CaptureChoices) -> Result<(), Failure> {
    let gpu = gpu_choice().map_err(Failure::unusable)?;
    Ok(neif::app::run(neif::app::AppOptions {
        open,
        choices,
        gpu,
    })?)
}

/// Whether a graphics card draws the preview, as the environment says.
#[cfg(feature = "gui")]
fn gpu_choice() -> anyhow::Result<neif::render::GpuChoice> {
    let name = neif::render::GpuChoice::VARIABLE;
    let text = std::env::var(name).unwrap_or_default();
    text.parse()
        .map_err(|error| anyhow::anyhow!("{name}: {error}"))
}

#[cfg(not(feature = "gui"))]
fn open_window(_open: Vec<PathBuf>, _choices: CaptureChoices) -> Result<(), Failure> {
    Err(Failure::Failed(anyhow::anyhow!("this build has no window")))
}

/// Why there can be no window; none when there can be one.
fn no_window_reason() -> Option<String> {
    if !cfg!(feature = "gui") {
        return Some("this build has no window (feature `gui` is off)".to_owned());
    }
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let has_display = !cfg!(target_os = "linux") || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
    (!has_display).then(|| "no display: neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned())
}
