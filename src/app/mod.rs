//! The window: shows training as it goes, takes edits, and never waits for either.
//!
//! Drawing reads [`AppState`] and emits [`Command`]s; they are applied after the frame. Training,
//! rendering and reading run on threads of their own and wake the window when there is news.

pub mod assets;
pub mod changes;
mod device_layer;
pub mod diagnostics;
pub mod inspect;
pub mod keys;
pub mod lighting;
pub mod object;
pub mod panels;
pub mod session;
pub mod shell;
pub mod state;
pub mod theme;
pub mod viewport;
mod window;
pub mod work;

use std::path::PathBuf;

use self::session::preferences;
use crate::data::CaptureChoices;
use crate::render::GpuChoice;

pub use self::changes::apply::apply;
pub use self::state::app_state::AppState;
pub use self::state::command::{Command, Effect};

/// Smallest size of the window, in points.
const MIN_SIZE: [f32; 2] = [960.0, 600.0];
/// Size at first, in points.
const SIZE: [f32; 2] = [1280.0, 800.0];

/// What the window begins with.
#[derive(Clone, Debug, Default)]
pub struct AppOptions {
    /// Captures, runs and environments to open; none opens the bundled demo.
    pub open: Vec<PathBuf>,
    /// How the captures among them are read.
    pub choices: CaptureChoices,
    /// Whether a graphics card draws the preview.
    pub gpu: GpuChoice,
}

/// Opens the window and returns when it is closed.
///
/// # Errors
/// When there is no display or no way to draw.
pub fn run(options: AppOptions) -> anyhow::Result<()> {
    device_layer::settle();
    // The rest of the preferences is taken up by the window, which can say what is wrong with them.
    let kept = preferences::file().and_then(|file| preferences::load(&file).0.window);
    let viewport = egui::ViewportBuilder::default()
        .with_title("neif")
        .with_app_id("neif")
        .with_inner_size(kept.unwrap_or(SIZE))
        .with_min_inner_size(MIN_SIZE)
        .with_drag_and_drop(true);
    // Dithering costs time on every pixel and the preview is noisy enough without.
    let native = eframe::NativeOptions {
        viewport,
        dithering: false,
        renderer: eframe::Renderer::Wgpu,
        ..Default::default()
    };
    let creator: eframe::AppCreator<'_> =
        Box::new(|creation| Ok(Box::new(window::Window::new(creation, options)?)));
    eframe::run_native("neif", native, creator)
        .map_err(|error| anyhow::anyhow!("the window cannot be opened: {error}"))
}
