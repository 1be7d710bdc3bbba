//! Taking pictures away: what is chosen in the export window.

use std::path::PathBuf;

use crate::data::KeyView;
use crate::geometry::Camera;
use crate::render::{Backdrop, FileKind, Layer, Spin};

/// Longest side of a picture, in pixels.
pub const MAX_SIDE_PX: u32 = 16_384;
/// Most pictures of a series.
pub const MAX_FRAMES: u32 = 10_000;
/// Most pictures a second.
pub const MAX_FPS: f32 = 120.0;
/// Time from one key view to the next until it is changed, in seconds.
pub(in crate::app) const KEY_STEP_SECS: f64 = 2.0;
/// What an EXR of one picture holds.
pub(in crate::app) const EXR_LAYERS: [Layer; 6] = [
    Layer::Final,
    Layer::Diffuse,
    Layer::Specular,
    Layer::Roughness,
    Layer::Tint,
    Layer::Normal,
];

/// What is taken away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, strum::IntoStaticStr, strum::VariantArray)]
pub enum Subject {
    /// The current view.
    #[default]
    Picture,
    /// A full turn.
    Turntable,
    /// The way through the key views.
    #[strum(serialize = "Camera path")]
    Path,
}

/// What is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportSettings {
    /// What is taken away.
    pub subject: Subject,
    /// Width and height in pixels; none is the window's.
    pub size: Option<(u32, u32)>,
    /// Whether the environment is in it.
    pub backdrop: Backdrop,
    /// File of a single picture.
    pub still_kind: FileKind,
    /// File or files of a series.
    pub film_kind: FileKind,
    /// What a turntable turns.
    pub spin: Spin,
    /// Pictures of a turn.
    pub n_frames: u32,
    /// Pictures a second.
    pub fps: f32,
}

impl Default for ExportSettings {
    fn default() -> Self {
        Self {
            subject: Subject::Picture,
            size: None,
            backdrop: Backdrop::Shown,
            still_kind: FileKind::Png,
            film_kind: FileKind::Gif,
            spin: Spin::Camera,
            n_frames: 72,
            fps: 24.0,
        }
    }
}

impl ExportSettings {
    /// The kind of file of the chosen subject.
    pub fn kind(&self) -> FileKind {
        match self.subject {
            Subject::Picture => self.still_kind,
            Subject::Turntable | Subject::Path => self.film_kind,
        }
    }

    /// Whether the pictures go into a folder.
    pub fn needs_folder(&self) -> bool {
        self.subject != Subject::Picture && !self.kind().is_film()
    }

    /// The same within what can be made.
    pub(in crate::app) fn clamped(self) -> Self {
        let side = |side: u32| side.clamp(1, MAX_SIDE_PX);
        Self {
            size: self.size.map(|(width, height)| (side(width), side(height))),
            n_frames: self.n_frames.clamp(1, MAX_FRAMES),
            fps: self.fps.clamp(1.0, MAX_FPS),
            ..self
        }
    }
}

/// An export that is running.
#[derive(Clone, Debug, PartialEq)]
pub struct RunningExport {
    /// Where it goes.
    pub path: PathBuf,
    /// How far it is, 0 to 1.
    pub fraction: f32,
    /// When it began, by the window's clock.
    pub started_secs: f64,
}

/// All that the export window shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExportState {
    /// Whether the window is open.
    pub is_open: bool,
    /// What is chosen.
    pub settings: ExportSettings,
    /// The path as typed; none is one made of the capture's name.
    pub typed: Option<String>,
    /// Views on the camera's path, by time.
    pub keys: Vec<KeyView>,
    /// Whether the system's file dialog is up.
    pub is_browsing: bool,
    /// What is wrong, if anything.
    pub note: Option<String>,
    /// What is running.
    pub running: Option<RunningExport>,
    /// Width and height of the viewport in pixels.
    pub window_px: (u32, u32),
}

/// What may happen.
#[derive(Clone, Debug, PartialEq)]
pub enum ExportCommand {
    /// Open the window for a subject.
    Show(Subject),
    /// Close it; what runs goes on.
    Close,
    /// Choose.
    Set(ExportSettings),
    /// Text in the path's field.
    Type(String),
    /// Show the system's dialog.
    Browse,
    /// It gave a path, or a reason why not.
    Browsed(Result<Option<PathBuf>, String>),
    /// Put the current view on the camera's path.
    AddKey,
    /// Take a key view off it.
    RemoveKey(usize),
    /// Set a key view's time, seconds.
    SetKeyTime(usize, f64),
    /// Stand where a key view is.
    GoToKey(usize),
    /// Write the key views to a file.
    SaveKeys,
    /// Save the current view at the window's size under a name of its own.
    Screenshot,
    /// Do what is chosen.
    Start,
    /// End what runs; nothing of it stays.
    Cancel,
}

/// What the commands ask of the world.
#[derive(Clone, Debug, PartialEq)]
pub enum ExportEffect {
    /// Render and write.
    Write(Order),
    /// Write the key views to this file, or one beside it if it exists.
    SaveKeys(PathBuf),
    /// End what runs.
    Cancel,
}

/// What is to be rendered, and where it goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// What.
    pub settings: ExportSettings,
    /// File or folder.
    pub path: PathBuf,
    /// Whether what is there may be replaced; otherwise another name is taken.
    pub may_replace: bool,
}

/// Pictures of the camera's path at the chosen speed.
pub fn n_path_frames(export: &ExportState) -> u32 {
    let times = export.keys.iter().map(|key| key.time_secs);
    let secs = times.clone().fold(0.0, f64::max) - times.fold(f64::INFINITY, f64::min);
    let n = secs * f64::from(export.settings.fps);
    (n.round().clamp(1.0, f64::from(MAX_FRAMES)) as u32).max(2)
}

/// The camera of a key view as text, to show people where it is.
pub fn key_text(camera: &Camera) -> String {
    let p = camera.position();
    format!("at {:.2}, {:.2}, {:.2}", p.x, p.y, p.z)
}
