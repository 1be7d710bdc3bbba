//! What may happen: every change of the window's state is a [`Command`], applied after drawing.
//!
//! [`apply`] changes plain state only. What needs threads, files or the system comes back as an
//! [`Effect`], which the window carries out.

use std::path::PathBuf;

use glam::{Vec2, Vec3};

use super::app_state::{
    AppState, EnvironmentContent, Look, Overlays, PathDialog, PathPurpose, Source, file_name,
};
use super::export::{self, ExportCommand, ExportEffect};
use super::history::{self, HistoryCommand};
use super::palette::{self, PaletteCommand};
use super::training_state::{Level, Phase};
use super::watch::{self, Comparison, WatchCommand};
use crate::app::inspect::{self, InspectCommand};
use crate::app::lighting::{self, LightingCommand};
use crate::app::session::leaving::{self, Goal, LeavingCommand};
use crate::app::session::preferences::{self, PreferencesCommand};
use crate::app::session::saving::{self, SessionCommand};
use crate::app::session::session_file::{EXTENSION, SessionFile};
use crate::app::viewport::camera_control::{CameraMove, Viewpoint};
use crate::app::work::pace::{self, PaceCommand};
use crate::neif::{EnvironmentTransform, MaterialEdit};
use crate::render::Layer;
use crate::train::session::events::TrainCommand;
use crate::train::session::handle::Threads;
use crate::train::session::plan::Budget;

/// Which system dialog to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Browse {
    /// For a file.
    File,
    /// For a folder.
    Folder,
}

/// Control of training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Train {
    /// Begin with the open capture, or continue the open run.
    Start,
    /// Pause, or go on after a pause.
    PauseOrResume,
    /// One step, then stay paused.
    Step,
    /// End the run; asks first where something would be lost.
    Stop,
    /// End the run.
    StopForSure,
    /// Train this many seconds more.
    Extend(f64),
}

/// Everything that may happen.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Open a capture, a run or an environment.
    Open(PathBuf),
    /// Open the bundled capture.
    OpenDemo,
    /// Show the window for a path.
    AskPath(PathPurpose),
    /// Close that window.
    ClosePathDialog,
    /// Text in that window.
    TypePath(String),
    /// Use the typed path.
    UseTypedPath,
    /// Show the system's dialog.
    Browse(Browse),
    /// The system's dialog gave a path, or a reason why not.
    Browsed(Result<Option<PathBuf>, String>),
    /// Control training.
    Train(Train),
    /// Share the processor between training and the window.
    Pace(PaceCommand),
    /// Training time for the next run, in seconds.
    SetBudget(f64),
    /// Whether opening a capture starts training.
    SetAutoStart(bool),
    /// Edit the material.
    Edit(MaterialEdit),
    /// Move the surroundings.
    MoveEnvironment(EnvironmentTransform),
    /// Make the chosen surroundings as bright as the capture's own.
    MatchExposure,
    /// Choose surroundings; none is the capture's own.
    ChooseEnvironment(Option<usize>),
    /// See, grab or compare the surroundings.
    Lighting(LightingCommand),
    /// Hide the edits, or show them.
    ShowOriginal(bool),
    /// Show a part of the picture.
    ShowLayer(Layer),
    /// Move the camera.
    MoveCamera(CameraMove),
    /// The world's up axis, unit; the horizon becomes level.
    SetUp(Vec3),
    /// Turn about what is seen at this point of a window of that size, both in pixels.
    PivotAt {
        /// From the top left.
        at: Vec2,
        /// Width and height.
        window: (u32, u32),
    },
    /// Stand where a photo was taken.
    GoToView(usize),
    /// Go on by so many views, around the end.
    StepView(isize),
    /// Show the whole object.
    FrameObject,
    /// Back to the first view.
    ResetView,
    /// The wipe's place, or off.
    SetWipe(Option<f32>),
    /// Show the photo alone.
    HoldPhoto(bool),
    /// Take pictures away.
    Export(ExportCommand),
    /// Fill the screen, or no longer.
    ToggleFullScreen,
    /// Show or hide the table of keys.
    ToggleHelp,
    /// Show or hide the messages.
    ToggleLog,
    /// Close whatever is over the main window.
    CloseOverlays,
    /// Take a message off the viewport.
    Dismiss(usize),
    /// Look into a point, or edit a part.
    Inspect(InspectCommand),
    /// Watch training.
    Watch(WatchCommand),
    /// Look for a command.
    Palette(PaletteCommand),
    /// Undo or redo.
    History(HistoryCommand),
    /// Save the session, or bring one back.
    Session(SessionCommand),
    /// Close, and the question before it.
    Leaving(LeavingCommand),
    /// Change the preferences.
    Preferences(PreferencesCommand),
}

/// What a command asks of the world.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Find out what is at the path and open it.
    Open(PathBuf),
    /// Open the bundled capture.
    OpenDemo,
    /// Start training on the open capture, or continue the open run.
    StartTraining,
    /// Tell the session.
    Train(TrainCommand),
    /// Train on so many threads.
    UseThreads(Threads),
    /// Read surroundings from a file or a run folder, put them on the list and choose them.
    AddEnvironment(PathBuf),
    /// Read the environment with this index.
    LoadEnvironment(usize),
    /// Find the exposure and white balance of the chosen surroundings.
    MatchExposure,
    /// Show the system's dialog.
    Browse(Browse, PathPurpose),
    /// Write the table of the run's figures.
    WriteLog(PathBuf),
    /// Take pictures away.
    Export(ExportEffect),
    /// Save the session in this file.
    SaveSession(PathBuf),
    /// Bring back a session that was left behind.
    RestoreSession(Box<SessionFile>),
    /// Close the window.
    Close,
}

/// Changes the state by a command; `effects` gets what remains to be done.
pub fn apply(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    let before = history::before(state, &command);
    dispatch(state, command, effects);
    if state.is_original_shown && state.look == Look::default() {
        state.is_original_shown = false;
    }
    history::after(state, before);
}

fn dispatch(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    match command {
        Command::Open(path) => leaving::go(state, Goal::Open(path), effects),
        Command::OpenDemo => leaving::go(state, Goal::OpenDemo, effects),
        Command::AskPath(_)
        | Command::ClosePathDialog
        | Command::TypePath(_)
        | Command::UseTypedPath
        | Command::Browse(_)
        | Command::Browsed(_) => apply_path(state, command, effects),
        Command::Train(train) => apply_train(state, train, effects),
        Command::Pace(command) => pace::apply(&mut state.pace, command, effects),
        Command::SetBudget(secs) => state.budget_secs = secs.clamp(5.0, 86_400.0),
        Command::SetAutoStart(on) => state.preferences.is_auto_start = on,
        Command::Edit(edit) => state.look.edit = edit,
        Command::MoveEnvironment(transform) => state.look.transform = transform,
        Command::MatchExposure => effects.push(Effect::MatchExposure),
        Command::ChooseEnvironment(index) => choose_environment(state, index, effects),
        Command::Lighting(command) => lighting::apply(state, command),
        Command::ShowOriginal(on) => state.is_original_shown = on,
        Command::ShowLayer(layer) => state.layer = layer,
        Command::SetWipe(_) | Command::HoldPhoto(_) => apply_compare(state, &command),
        Command::Export(command) => export::apply(state, command, effects),
        Command::ToggleFullScreen => state.is_full_screen ^= true,
        Command::ToggleHelp => state.overlays.is_help_open ^= true,
        Command::ToggleLog => state.preferences.is_log_open ^= true,
        Command::CloseOverlays => close_front(state),
        Command::Inspect(command) => inspect::apply(state, command),
        Command::Dismiss(index) => state.messages.dismiss(index),
        Command::Watch(command) => watch::apply(state, command),
        Command::Palette(command) => palette::apply(state, command, effects),
        Command::History(command) => history::apply(state, command, effects),
        Command::Session(command) => saving::apply(state, command, effects),
        Command::Leaving(command) => leaving::apply(state, command, effects),
        Command::Preferences(command) => preferences::apply(state, command),
        Command::MoveCamera(_)
        | Command::SetUp(_)
        | Command::PivotAt { .. }
        | Command::GoToView(_)
        | Command::StepView(_)
        | Command::FrameObject
        | Command::ResetView => apply_view(state, &command),
    }
}

/// Closes the windows over the main one; where there is none, forgets the picked point.
fn close_front(state: &mut AppState) {
    if state.overlays != Overlays::default() {
        state.overlays = Overlays::default();
    } else if state.export.is_open {
        state.export.is_open = false;
    } else if state.preferences.is_log_open {
        state.preferences.is_log_open = false;
    } else {
        state.inspect.forget();
    }
    state.leaving = None;
}

fn apply_path(state: &mut AppState, command: Command, effects: &mut Vec<Effect>) {
    let dialog = &mut state.overlays.path_dialog;
    match (command, dialog) {
        (Command::AskPath(purpose), dialog) => {
            let typed = match purpose {
                PathPurpose::Open | PathPurpose::AddEnvironment => String::new(),
                PathPurpose::Save => state
                    .training
                    .saved
                    .clone()
                    .unwrap_or_else(|| run_folder_for(&state.source))
                    .display()
                    .to_string(),
                PathPurpose::Log => run_folder_for(&state.source)
                    .with_extension("csv")
                    .display()
                    .to_string(),
                PathPurpose::SaveSession => state.session.file.as_ref().map_or_else(
                    || format!("{}.{EXTENSION}", run_folder_for(&state.source).display()),
                    |file| file.display().to_string(),
                ),
            };
            *dialog = Some(PathDialog {
                purpose,
                typed,
                note: None,
                is_browsing: false,
            });
        }
        (Command::ClosePathDialog, dialog) => *dialog = None,
        (Command::TypePath(typed), Some(dialog)) => {
            dialog.typed = typed;
            dialog.note = None;
        }
        (Command::UseTypedPath, Some(dialog)) => {
            let path = PathBuf::from(dialog.typed.trim());
            use_path(state, path, effects);
        }
        (Command::Browse(kind), Some(dialog)) => {
            dialog.is_browsing = true;
            dialog.note = None;
            effects.push(Effect::Browse(kind, dialog.purpose));
        }
        (Command::Browsed(result), Some(dialog)) => {
            dialog.is_browsing = false;
            match result {
                Ok(Some(path)) => use_path(state, path, effects),
                Ok(None) => {}
                Err(reason) => dialog.note = Some(reason),
            }
        }
        _ => {}
    }
}

fn use_path(state: &mut AppState, path: PathBuf, effects: &mut Vec<Effect>) {
    let Some(dialog) = &mut state.overlays.path_dialog else {
        return;
    };
    if path.as_os_str().is_empty() {
        dialog.note = Some("Type a path first.".to_owned());
        return;
    }
    let purpose = dialog.purpose;
    state.overlays.path_dialog = None;
    match purpose {
        PathPurpose::Open => leaving::go(state, Goal::Open(path), effects),
        PathPurpose::Save => {
            leaving::save_began(state);
            effects.push(Effect::Train(TrainCommand::Save(path)));
        }
        PathPurpose::AddEnvironment => effects.push(Effect::AddEnvironment(path)),
        PathPurpose::Log => effects.push(Effect::WriteLog(path)),
        PathPurpose::SaveSession => {
            let has_extension = path
                .extension()
                .is_some_and(|extension| extension == EXTENSION);
            let file = if has_extension {
                path
            } else {
                PathBuf::from(format!("{}.{EXTENSION}", path.display()))
            };
            effects.push(Effect::SaveSession(file));
        }
    }
}

/// Where a run is saved unless another folder is typed.
fn run_folder_for(source: &Source) -> PathBuf {
    let home = directories::UserDirs::new()
        .map_or_else(|| PathBuf::from("."), |dirs| dirs.home_dir().to_owned());
    let name = match source {
        Source::Demo(_) => "demo".to_owned(),
        _ => source
            .path()
            .map_or_else(|| "run".to_owned(), |path| file_name(path)),
    };
    home.join("neif-runs").join(name)
}

fn apply_train(state: &mut AppState, train: Train, effects: &mut Vec<Effect>) {
    let phase = &state.training.phase;
    match train {
        Train::Start => effects.push(Effect::StartTraining),
        Train::PauseOrResume if *phase == Phase::Paused => {
            effects.push(Effect::Train(TrainCommand::Resume));
        }
        Train::PauseOrResume if *phase == Phase::Training => {
            effects.push(Effect::Train(TrainCommand::Pause));
        }
        Train::Step if matches!(phase, Phase::Training | Phase::Paused) => {
            effects.push(Effect::Train(TrainCommand::StepOnce));
        }
        Train::Extend(secs) if phase.takes_commands() => {
            effects.push(Effect::Train(TrainCommand::Extend(Budget::Seconds(secs))));
            if matches!(phase, Phase::Finished(_)) {
                state.training.phase = Phase::Training;
            }
        }
        Train::Stop if state.training.is_unsaved() && phase.takes_commands() => {
            state.overlays.is_stop_asked = true;
        }
        Train::Stop | Train::StopForSure => {
            state.overlays.is_stop_asked = false;
            effects.push(Effect::Train(TrainCommand::Stop));
        }
        Train::PauseOrResume | Train::Step | Train::Extend(_) => {}
    }
}

/// Chooses surroundings; those that cannot be used are said and not chosen.
pub(in crate::app) fn choose_environment(
    state: &mut AppState,
    index: Option<usize>,
    effects: &mut Vec<Effect>,
) {
    state.look.environment = index;
    let Some(entry) = index.and_then(|i| state.environments.get_mut(i)) else {
        state.look.environment = None;
        return;
    };
    if let EnvironmentContent::Failed(reason) = &entry.content {
        let reason = reason.clone();
        state.look.environment = None;
        state.messages.say(Level::Error, reason);
    } else if let Some(index) = index {
        load_environment(state, index, effects);
    }
}

/// Has surroundings of the list read, unless they are or will be.
pub(in crate::app) fn load_environment(
    state: &mut AppState,
    index: usize,
    effects: &mut Vec<Effect>,
) {
    if let Some(entry) = state.environments.get_mut(index)
        && matches!(entry.content, EnvironmentContent::NotLoaded)
    {
        entry.content = EnvironmentContent::Loading;
        effects.push(Effect::LoadEnvironment(index));
    }
}

fn apply_compare(state: &mut AppState, command: &Command) {
    let is_wanted = !matches!(command, Command::SetWipe(None) | Command::HoldPhoto(false));
    if is_wanted && state.view.at_view.is_none() {
        if let Some(index) = state.nearest_view() {
            go_to_view(state, index);
        } else {
            state
                .messages
                .say(Level::Info, "There is no photo to compare with");
            return;
        }
    }
    match command {
        Command::SetWipe(at) => {
            state.compare.wipe = at.map(|at| at.clamp(0.0, 1.0));
            state.compare.with_photo = Comparison::Off;
        }
        Command::HoldPhoto(on) => state.compare.is_photo_held = *on,
        _ => {}
    }
}

fn apply_view(state: &mut AppState, command: &Command) {
    match command {
        Command::MoveCamera(movement) => {
            let up = state.view.up;
            state.view.viewpoint.apply(*movement, up);
            leave_view(state);
        }
        Command::SetUp(up) => {
            state.view.up = *up;
            state.view.viewpoint.apply(CameraMove::Level, *up);
            leave_view(state);
        }
        Command::PivotAt { at, window } => set_pivot(state, *at, *window),
        Command::GoToView(index) => go_to_view(state, *index),
        Command::StepView(by) => {
            let n = state.views().count() as isize;
            if n > 0 {
                let from = state
                    .view
                    .at_view
                    .or_else(|| state.nearest_view())
                    .unwrap_or(0) as isize;
                // Away from all views, the first press goes to the nearest.
                let by = if state.view.at_view.is_some() { *by } else { 0 };
                go_to_view(state, (from + by).rem_euclid(n) as usize);
            }
        }
        Command::FrameObject => {
            if let Some(bounds) = state.view.bounds {
                state.view.viewpoint.frame(&bounds);
                leave_view(state);
            }
        }
        Command::ResetView => {
            state.view.viewpoint = state.view.home;
            state.view.was_moved = true;
            state.view.at_view = state.view_at(0).is_some().then_some(0);
        }
        _ => {}
    }
}

fn leave_view(state: &mut AppState) {
    state.view.at_view = None;
    state.view.was_moved = true;
    state.compare = super::app_state::Compare::default();
}

/// Puts the camera where a photo was taken.
pub(in crate::app) fn go_to_view(state: &mut AppState, index: usize) {
    if let Some(view) = state.view_at(index) {
        state.view.viewpoint = Viewpoint::of_camera(&view.camera, state.view.viewpoint.pivot);
        state.view.at_view = Some(index);
        state.view.was_moved = true;
    }
}

fn set_pivot(state: &mut AppState, at: Vec2, window: (u32, u32)) {
    let Some(object) = state
        .snapshot
        .as_ref()
        .and_then(|snapshot| snapshot.object.as_ref())
    else {
        return;
    };
    let ray = state
        .view
        .viewpoint
        .camera_for(window.0, window.1)
        .ray(at.x, at.y);
    match object.tracer.intersect(&ray, 0.0, f32::INFINITY) {
        Some(hit) => state.view.viewpoint.pivot = hit.position,
        None => state.messages.say(
            Level::Info,
            "Double-click the object to turn about that point",
        ),
    }
}
