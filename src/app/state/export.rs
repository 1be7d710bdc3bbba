//! Taking pictures away: what is chosen in the export window, what its commands do, and what is to be rendered.

use std::path::{Path, PathBuf};

use super::app_state::{AppState, Source, file_name};
use super::command::Effect;
use super::training_state::Level;
use crate::app::viewport::camera_control::Viewpoint;
use crate::data::{KeyView, MAX_GIF_FPS};
use crate::geometry::Camera;
use crate::render::output::turntable;
use crate::render::{Backdrop, CameraPath, Destination, FileKind, Film, Layer, Shot, Spin};

/// Longest side of a picture, in pixels.
pub const MAX_SIDE_PX: u32 = 16_384;
/// Most pictures of a series.
pub const MAX_FRAMES: u32 = 10_000;
/// Most pictures a second.
pub const MAX_FPS: f32 = 120.0;
/// Time from one key view to the next until it is changed, in seconds.
const KEY_STEP_SECS: f64 = 2.0;
/// What an EXR of one picture holds.
const EXR_LAYERS: [Layer; 6] = [
    Layer::Final,
    Layer::Diffuse,
    Layer::Specular,
    Layer::Roughness,
    Layer::Tint,
    Layer::Normal,
];

/// What is taken away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Subject {
    /// The current view.
    #[default]
    Picture,
    /// A full turn.
    Turntable,
    /// The way through the key views.
    Path,
}

impl Subject {
    /// All of them, in order.
    pub const ALL: [Self; 3] = [Self::Picture, Self::Turntable, Self::Path];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Picture => "Picture",
            Self::Turntable => "Turntable",
            Self::Path => "Camera path",
        }
    }
}

/// What is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportSettings {
    /// What is taken away.
    pub subject: Subject,
    /// Width and height in pixels; none is the window's.
    pub size: Option<(u32, u32)>,
    /// Whether the surroundings are in it.
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
    fn clamped(self) -> Self {
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
    /// Show the system's dialog, with this path in it.
    Browse(PathBuf),
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

/// Changes the state by a command; `effects` gets what remains to be done.
pub fn apply(state: &mut AppState, command: ExportCommand, effects: &mut Vec<Effect>) {
    let default = default_path(&state.source, &state.export.settings);
    let viewpoint = state.view.viewpoint;
    let export = &mut state.export;
    let mut ask = |effect: ExportEffect| effects.push(Effect::Export(effect));
    match command {
        ExportCommand::Show(subject) => {
            export.is_open = true;
            let settings = ExportSettings {
                subject,
                ..export.settings
            };
            set(export, settings);
        }
        ExportCommand::Close => export.is_open = false,
        ExportCommand::Set(settings) => set(export, settings),
        ExportCommand::Type(typed) => {
            export.typed = Some(typed);
            export.note = None;
        }
        ExportCommand::Browse => {
            export.is_browsing = true;
            let path = export.typed.as_ref().map_or(default, PathBuf::from);
            ask(ExportEffect::Browse(path));
        }
        ExportCommand::Browsed(answer) => {
            export.is_browsing = false;
            match answer {
                Ok(Some(path)) => export.typed = Some(path.display().to_string()),
                Ok(None) => {}
                Err(reason) => export.note = Some(reason),
            }
        }
        ExportCommand::AddKey | ExportCommand::RemoveKey(_) | ExportCommand::SetKeyTime(..) => {
            apply_keys(export, &viewpoint, &command);
        }
        ExportCommand::GoToKey(index) => {
            if let Some(key) = export.keys.get(index) {
                state.view.viewpoint = Viewpoint::of_camera(&key.camera, viewpoint.pivot);
                state.view.at_view = None;
                state.view.was_moved = true;
            }
        }
        ExportCommand::SaveKeys => {
            let path = export_folder().join(format!("{}_cameras.json", source_name(&state.source)));
            ask(ExportEffect::SaveKeys(path));
        }
        ExportCommand::Screenshot => {
            let settings = ExportSettings {
                subject: Subject::Picture,
                size: None,
                still_kind: FileKind::Png,
                ..export.settings
            };
            ask(ExportEffect::Write(Order {
                settings,
                path: default_path(&state.source, &settings),
                may_replace: false,
            }));
        }
        ExportCommand::Start => start(state, effects),
        ExportCommand::Cancel => ask(ExportEffect::Cancel),
    }
}

/// Chooses; a typed path follows the kind of file.
fn set(export: &mut ExportState, settings: ExportSettings) {
    let (old, new) = (export.settings, settings.clamped());
    export.settings = new;
    export.note = None;
    if (old.kind(), old.needs_folder()) == (new.kind(), new.needs_folder()) {
        return;
    }
    if let Some(typed) = &mut export.typed {
        let extension = if new.needs_folder() {
            ""
        } else {
            new.kind().extension()
        };
        *typed = Path::new(typed)
            .with_extension(extension)
            .display()
            .to_string();
    }
}

fn apply_keys(export: &mut ExportState, viewpoint: &Viewpoint, command: &ExportCommand) {
    export.note = None;
    match *command {
        ExportCommand::AddKey => {
            let (width, height) = export.window_px;
            let last = export.keys.last().map(|key| key.time_secs);
            export.keys.push(KeyView {
                camera: viewpoint.camera_for(width.max(1), height.max(1)),
                time_secs: last.map_or(0.0, |secs| secs + KEY_STEP_SECS),
            });
        }
        ExportCommand::RemoveKey(index) if index < export.keys.len() => {
            export.keys.remove(index);
        }
        ExportCommand::SetKeyTime(index, secs) => {
            if let Some(key) = export.keys.get_mut(index)
                && secs.is_finite()
            {
                key.time_secs = secs.clamp(0.0, 86_400.0);
            }
        }
        _ => {}
    }
}

fn start(state: &mut AppState, effects: &mut Vec<Effect>) {
    let settings = state.export.settings;
    let typed = state.export.typed.as_deref().map(str::trim);
    let typed = typed.filter(|typed| !typed.is_empty());
    let path = match typed {
        Some(typed) => with_ending(Path::new(typed), &settings),
        None => Ok(default_path(&state.source, &settings)),
    };
    let order = path.map(|path| Order {
        settings,
        path,
        may_replace: typed.is_some(),
    });
    match order.and_then(|order| plan(state, &order).map(|_| order)) {
        Ok(order) => {
            state.export.note = None;
            effects.push(Effect::Export(ExportEffect::Write(order)));
        }
        Err(reason) => state.export.note = Some(reason),
    }
}

/// A typed path with the ending that its kind of file needs.
fn with_ending(typed: &Path, settings: &ExportSettings) -> Result<PathBuf, String> {
    let wanted = settings.kind().extension();
    match typed.extension() {
        _ if settings.needs_folder() => Ok(typed.to_owned()),
        None => Ok(typed.with_extension(wanted)),
        Some(ending) if ending.eq_ignore_ascii_case(wanted) => Ok(typed.to_owned()),
        Some(_) => Err(format!(
            "{}: the name must end in .{wanted}",
            typed.display()
        )),
    }
}

/// Where it goes unless something else is typed.
pub fn default_path(source: &Source, settings: &ExportSettings) -> PathBuf {
    let name = source_name(source);
    let name = match settings.subject {
        Subject::Picture => name,
        Subject::Turntable => format!("{name}_turntable"),
        Subject::Path => format!("{name}_path"),
    };
    let folder = export_folder();
    if settings.needs_folder() {
        folder.join(name)
    } else {
        folder.join(format!("{name}.{}", settings.kind()))
    }
}

fn export_folder() -> PathBuf {
    let dirs = directories::UserDirs::new();
    let pictures = dirs.as_ref().map(|dirs| {
        let pictures = dirs.picture_dir().map(Path::to_owned);
        pictures.unwrap_or_else(|| dirs.home_dir().join("Pictures"))
    });
    pictures.unwrap_or_default().join("neif")
}

fn source_name(source: &Source) -> String {
    match source {
        Source::Nothing => "picture".to_owned(),
        Source::Demo(_) => "demo".to_owned(),
        Source::Capture(path) | Source::Run(path) | Source::Environment(path) => {
            path.file_stem().map_or_else(
                || file_name(path),
                |stem| stem.to_string_lossy().into_owned(),
            )
        }
    }
}

/// What an order renders now, and where it goes.
///
/// # Errors
/// In the person's words, what is missing.
pub fn plan(state: &AppState, order: &Order) -> Result<(Film, Destination), String> {
    let (export, settings) = (&state.export, &order.settings);
    let scene = state
        .scene()
        .ok_or("There is nothing to take away yet: the first picture is still to come.")?;
    let (width, height) = settings.size.unwrap_or(export.window_px);
    let (width, height) = (width.max(1), height.max(1));
    let camera = state.view.viewpoint.camera_for(width, height);
    let shots = match settings.subject {
        Subject::Picture => vec![Shot {
            name: "picture".to_owned(),
            camera,
            transform: scene.transform,
        }],
        Subject::Turntable => {
            let axis = (turntable::turning_point(&scene), state.view.up);
            let n = settings.n_frames;
            turntable::shots(settings.spin, &camera, &scene.transform, axis, n)
        }
        Subject::Path => {
            let path = CameraPath::new(&export.keys, width, height).map_err(|e| e.to_string())?;
            path.shots(&scene.transform, n_path_frames(export))
        }
    };
    if settings.kind() == FileKind::Gif && settings.fps > MAX_GIF_FPS {
        return Err(format!(
            "A GIF has at most {MAX_GIF_FPS} pictures a second."
        ));
    }
    let film = Film {
        layers: layers(state.layer, settings.kind()),
        scene,
        shots,
        backdrop: settings.backdrop,
        kind: settings.kind(),
        fps: settings.fps,
        reference: None,
    };
    let path = order.path.clone();
    let destination = if settings.needs_folder() {
        Destination::Folder(path)
    } else {
        Destination::File(path)
    };
    film.check(&destination).map_err(|e| e.to_string())?;
    Ok((film, destination))
}

/// An EXR holds all layers, other files the one that is shown.
fn layers(shown: Layer, kind: FileKind) -> Vec<Layer> {
    match (kind, shown) {
        (FileKind::Exr, Layer::Environment) => vec![Layer::Environment],
        (FileKind::Exr, _) => EXR_LAYERS.to_vec(),
        _ => vec![shown],
    }
}

/// Pictures of the camera's path at the chosen speed.
pub fn n_path_frames(export: &ExportState) -> u32 {
    let times = export.keys.iter().map(|key| key.time_secs);
    let secs = times.clone().fold(0.0, f64::max) - times.fold(f64::INFINITY, f64::min);
    let n = secs * f64::from(export.settings.fps);
    (n.round().clamp(1.0, f64::from(MAX_FRAMES)) as u32).max(2)
}

/// The camera of a key view, to tell people where it is.
pub fn key_text(camera: &Camera) -> String {
    let p = camera.position();
    format!("at {:.2}, {:.2}, {:.2}", p.x, p.y, p.z)
}

/// What the person is told of how an export ended.
pub fn say_ending(state: &mut AppState, ending: Result<String, String>) {
    match ending {
        Ok(text) => state.messages.say(Level::Info, text),
        Err(reason) => {
            state.export.note = Some(reason.clone());
            state.messages.say(Level::Error, reason);
        }
    }
}
