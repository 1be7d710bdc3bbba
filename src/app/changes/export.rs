//! What the commands of the export window do, and what is to be rendered.

use std::path::{Path, PathBuf};

use crate::app::state::app_state::AppState;
use crate::app::state::command::Effect;
use crate::app::state::export::{
    EXR_LAYERS, ExportCommand, ExportEffect, ExportSettings, ExportState, KEY_STEP_SECS, Order,
    Subject, n_path_frames,
};
use crate::app::state::source::{Source, file_stem};
use crate::app::state::training_state::Level;
use crate::app::viewport::camera_control::Viewpoint;
use crate::data::{KeyView, MAX_GIF_FPS};
use crate::render::output::film::Shot;
use crate::render::output::turntable;
use crate::render::{CameraPath, Destination, FileKind, Film, Layer};

/// Changes the state by a command; `effects` gets what remains to be done.
pub fn apply(state: &mut AppState, command: ExportCommand, effects: &mut Vec<Effect>) {
    let default = default_path(&state.source, &state.export.settings);
    let viewpoint = state.view.viewpoint;
    let export = &mut state.export;
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
            effects.push(Effect::BrowseExport(path));
        }
        ExportCommand::Browsed(answer) => {
            export.is_browsing = false;
            match answer {
                Ok(Some(path)) => export.typed = Some(path.display().to_string()),
                Ok(None) => {}
                Err(reason) => export.note = Some(reason),
            }
        }
        ExportCommand::AddKey => add_key(export, &viewpoint),
        ExportCommand::RemoveKey(index) => {
            export.note = None;
            if index < export.keys.len() {
                export.keys.remove(index);
            }
        }
        ExportCommand::SetKeyTime(index, secs) => {
            export.note = None;
            if let Some(key) = export.keys.get_mut(index)
                && secs.is_finite()
            {
                key.time_secs = secs.clamp(0.0, 86_400.0);
            }
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
            effects.push(Effect::Export(ExportEffect::SaveKeys(path)));
        }
        ExportCommand::Screenshot => {
            let settings = ExportSettings {
                subject: Subject::Picture,
                size: None,
                still_kind: FileKind::Png,
                ..export.settings
            };
            effects.push(Effect::Export(ExportEffect::Write(Order {
                settings,
                path: default_path(&state.source, &settings),
                may_replace: false,
            })));
        }
        ExportCommand::Start => start(state, effects),
        ExportCommand::Cancel => effects.push(Effect::Export(ExportEffect::Cancel)),
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

fn add_key(export: &mut ExportState, viewpoint: &Viewpoint) {
    let (width, height) = export.window_px;
    let last = export.keys.last().map(|key| key.time_secs);
    export.note = None;
    export.keys.push(KeyView {
        camera: viewpoint.camera_for(width.max(1), height.max(1)),
        time_secs: last.map_or(0.0, |secs| secs + KEY_STEP_SECS),
    });
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
        Source::Capture(path) | Source::Run(path) | Source::Environment(path) => file_stem(path),
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

/// Informs the person of how an export ended.
pub fn say_ending(state: &mut AppState, ending: Result<String, String>) {
    match ending {
        Ok(text) => state.messages.say(Level::Info, text),
        Err(reason) => {
            state.export.note = Some(reason.clone());
            state.messages.say(Level::Error, reason);
        }
    }
}
