//! What may happen: every change of the window's state is a [`Command`], applied after drawing ([`crate::app::changes`]).
//!
//! What needs threads, files or the system comes back as an [`Effect`], which the window carries out.

use std::path::PathBuf;

use glam::{Vec2, Vec3};

use super::app_state::PathPurpose;
use super::export::{ExportCommand, ExportEffect};
use super::history::HistoryCommand;
use super::palette::PaletteCommand;
use super::watch::WatchCommand;
use crate::app::inspect::InspectCommand;
use crate::app::lighting::LightingCommand;
use crate::app::object::ObjectCommand;
use crate::app::session::leaving::LeavingCommand;
use crate::app::session::preferences::PreferencesCommand;
use crate::app::session::saving::SessionCommand;
use crate::app::session::session_file::SessionFile;
use crate::app::viewport::camera_control::CameraMove;
use crate::app::work::pace::Pace;
use crate::neif::{EnvironmentTransform, MaterialEdit};
use crate::render::Layer;
use crate::train::session::events::TrainCommand;
use crate::train::session::handle::Threads;

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
    /// How training and the window share the processor.
    SetPace(Pace),
    /// Training time for the next run, in seconds.
    SetBudget(f64),
    /// Whether opening a capture starts training.
    SetAutoStart(bool),
    /// Edit the material.
    Edit(MaterialEdit),
    /// Move the environment.
    MoveEnvironment(EnvironmentTransform),
    /// Make the chosen environment as bright as the capture's own.
    MatchExposure,
    /// Put the chosen panorama on a floor, and the object on that.
    PutOnFloor,
    /// Choose an environment; none is the capture's own.
    ChooseEnvironment(Option<usize>),
    /// End the import of the environment with this index; what was learned stays.
    StopImport(usize),
    /// See, grab or compare the environment.
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
    /// Select the object of photos without masks.
    Object(ObjectCommand),
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
    /// Train on the open capture anew, with the object that was found in its photos.
    TrainObject,
    /// Write the masks of the object that was found into this folder.
    SaveMasks(PathBuf),
    /// Tell the session.
    Train(TrainCommand),
    /// Train on so many threads.
    UseThreads(Threads),
    /// Read an environment from a file or a run folder, put it on the list and choose it.
    AddEnvironment(PathBuf),
    /// Read the environment with this index.
    LoadEnvironment(usize),
    /// End the import of the environment with this index.
    StopImport(usize),
    /// Put the environment with this index, which is in no file yet, into the library.
    KeepEnvironment(usize),
    /// Find the exposure and white balance of the chosen environment.
    MatchExposure,
    /// Show the system's dialog.
    Browse(Browse, PathPurpose),
    /// Show the system's dialog for an export, with this path in it.
    BrowseExport(PathBuf),
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
