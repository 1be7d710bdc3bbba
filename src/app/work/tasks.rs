//! What goes on beside drawing: the training session, reading files, the file dialog.

mod session;
mod training;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use egui::Context;

use super::dialog::{FileDialog, ask, ask_export};
use super::exporter::Exporter;
use super::importer::{Importer, Made};
use super::keeper::Keeper;
use super::opener::{Opened, Opener, ScreenPhoto};
use crate::app::assets;
use crate::app::changes::apply::apply;
use crate::app::changes::leaving;
use crate::app::changes::saving::stand_at_wanted_view;
use crate::app::inspect::InspectState;
use crate::app::object::ObjectState;
use crate::app::session::recent;
use crate::app::state::app_state::{AppState, Compare, ViewState};
use crate::app::state::command::{Command, Effect};
use crate::app::state::export::ExportCommand;
use crate::app::state::history::History;
use crate::app::state::look::Look;
use crate::app::state::source::{EnvironmentContent, Source};
use crate::app::state::training_state::{Level, TrainingState};
use crate::data::CaptureChoices;
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::render::Scene;
use crate::train::Snapshot;
use crate::train::session::events::TrainCommand;
use crate::train::session::handle::Session;

/// Training wakes the window at most so often.
const TRAINING_REPAINT: Duration = Duration::from_millis(250);
/// What the window itself has to do about news.
#[derive(Debug)]
pub(in crate::app) enum News {
    /// Something else was opened: pictures of the old one are void.
    Reset,
    /// To be shown until the preview begins, with what is said of it.
    FirstPicture(ScreenPhoto, &'static str),
    /// The photo of a view.
    ViewPhoto(usize, ScreenPhoto),
}

/// Said of the first photo.
const FIRST_PHOTO: &str = "First photo of the capture; the preview comes next";
/// Said of the surface that is being made.
const GROWTH: &str = "The object's surface takes shape; the preview comes next";

/// The threads' handles.
#[derive(Debug)]
pub(in crate::app) struct Work {
    ctx: Context,
    session: Option<Session>,
    snapshot_version: u64,
    growth_version: u64,
    opener: Opener,
    dialogs: Vec<FileDialog>,
    /// Captures that are read as somebody chose.
    chosen: Vec<(PathBuf, CaptureChoices)>,
    keeper: Keeper,
    exporter: Exporter,
    importer: Importer,
}

impl Work {
    /// Nothing goes on yet; `ctx` is woken when there is news.
    pub(in crate::app) fn new(ctx: &Context) -> std::io::Result<Self> {
        let wake = ctx.clone();
        Ok(Self {
            ctx: ctx.clone(),
            session: None,
            snapshot_version: 0,
            growth_version: 0,
            opener: Opener::new(ctx),
            dialogs: Vec::new(),
            chosen: Vec::new(),
            keeper: Keeper::new(move || wake.request_repaint())?,
            exporter: Exporter::new(ctx),
            importer: Importer::default(),
        })
    }

    /// Writes small files.
    pub(in crate::app) fn keeper(&self) -> &Keeper {
        &self.keeper
    }

    /// Has the captures at `paths` read so from now on.
    pub(in crate::app) fn read_as(&mut self, paths: &[PathBuf], choices: &CaptureChoices) {
        let chosen = paths.iter().map(|path| (path.clone(), choices.clone()));
        self.chosen.extend(chosen);
    }

    fn choices(&self, capture: &Path) -> CaptureChoices {
        let found = self.chosen.iter().find(|(path, _)| path == capture);
        found.map_or_else(CaptureChoices::default, |(_, choices)| choices.clone())
    }

    /// Reads files.
    pub(in crate::app) fn opener(&self) -> &Opener {
        &self.opener
    }

    /// Does what a command asked of the world.
    pub(in crate::app) fn carry_out(
        &mut self,
        state: &mut AppState,
        effect: Effect,
    ) -> Option<News> {
        match effect {
            Effect::Open(path) => self.opener.open(&path),
            Effect::OpenDemo => match assets::demo() {
                Some(path) => return Some(self.open_capture(state, Source::Demo(path))),
                None => state.messages.say(
                    Level::Warning,
                    "The bundled demo was not found: set NEIF_ASSETS to the assets folder, or open a capture",
                ),
            },
            Effect::StartTraining => self.start(state),
            Effect::TrainObject => self.train_object(state),
            Effect::SaveMasks(folder) => {
                if let Some(found) = &state.object.found {
                    self.opener.save_masks(found, folder);
                }
            }
            Effect::Train(command) => self.send(state, command),
            Effect::UseThreads(threads) => {
                self.importer.use_threads(threads);
                if let Some(session) = &self.session {
                    session.use_threads(threads);
                }
            }
            Effect::AddEnvironment(path) => self.opener.load_environment(&path),
            Effect::LoadEnvironment(index) => {
                if let Some(entry) = state.environments.get(index) {
                    self.opener.load_environment(&entry.path);
                }
            }
            Effect::KeepEnvironment(index) => {
                if let Some(made) = state.environments.get(index).and_then(Made::of_entry) {
                    self.opener.keep(made);
                }
            }
            Effect::StopImport(index) => self.importer.stop(index),
            Effect::MatchExposure => self.match_exposure(state),
            Effect::Browse(kind, purpose) => {
                self.browse(state, move || ask(kind, purpose), Command::Browsed);
            }
            Effect::BrowseExport(path) => {
                let settings = state.export.settings;
                let command = |answer| Command::Export(ExportCommand::Browsed(answer));
                self.browse(state, move || ask_export(&settings, &path), command);
            }
            Effect::WriteLog(path) => {
                let csv = state.training.log.to_csv();
                self.keeper.save(&path, csv, "Written to");
            }
            Effect::Export(effect) => self.exporter.carry_out(state, effect),
            Effect::SaveSession(file) => self.save_session(state, file),
            Effect::RestoreSession(session) => return self.open_session(state, session, None),
            Effect::Close => self.ctx.send_viewport_cmd(egui::ViewportCommand::Close),
        }
        None
    }

    fn match_exposure(&self, state: &mut AppState) {
        let chosen = state.look.environment.zip(state.chosen_environment());
        let (Some((index, environment)), Some(snapshot)) = (chosen, &state.snapshot) else {
            state
                .messages
                .say(Level::Info, "Choose another environment to match first");
            return;
        };
        let mut scene = Scene {
            transform: state.look.transform,
            ..snapshot.scene()
        };
        scene.swap_environment(Arc::clone(environment));
        let own = Arc::clone(&snapshot.environment);
        self.opener.match_exposure(scene, own, index);
    }

    /// The cameras of the training photos as training has corrected them, where it has.
    pub(in crate::app) fn cameras(&self) -> Option<Arc<Vec<Camera>>> {
        self.session.as_ref()?.cameras()
    }

    fn send(&self, state: &mut AppState, command: TrainCommand) {
        match &self.session {
            Some(session) => session.send(command),
            None => state
                .messages
                .say(Level::Warning, "Nothing is being trained"),
        }
    }

    fn browse(
        &mut self,
        state: &mut AppState,
        ask: impl FnOnce() -> Option<PathBuf> + Send + 'static,
        command: fn(Result<Option<PathBuf>, String>) -> Command,
    ) {
        match FileDialog::open(&self.ctx, ask, command) {
            Ok(dialog) => self.dialogs.push(dialog),
            Err(error) => {
                let reason = format!("cannot show the file dialog: {error}");
                apply(state, command(Err(reason)), &mut Vec::new());
            }
        }
    }

    /// Forgets what was open and shows a capture instead.
    fn open_capture(&mut self, state: &mut AppState, source: Source) -> News {
        self.reset(state);
        if let Some(path) = source.path() {
            self.opener.first_photo(path);
        }
        if let Source::Capture(path) = &source {
            self.remember(state, path);
        }
        state.source = source;
        self.bring_back_pending(state);
        if state.preferences.is_auto_start {
            self.start(state);
        }
        News::Reset
    }

    fn reset(&mut self, state: &mut AppState) {
        // A dropped session stops by itself and saves in the background where it has a folder.
        self.session = None;
        (self.snapshot_version, self.growth_version) = (0, 0);
        state.training = TrainingState::default();
        state.dataset = None;
        state.snapshot = None;
        state.look = Look::default();
        state.history = History::default();
        state.session.file = None;
        state.is_original_shown = false;
        state.lighting.grab = None;
        state.lighting.split = None;
        state.lighting.kept = None;
        state.view = ViewState::default();
        state.export.keys.clear();
        state.compare = Compare::default();
        state.inspect = InspectState::default();
        state.object = ObjectState::default();
        state.watch.forget();
    }

    /// Takes in what the threads have done since the last frame.
    pub(in crate::app) fn poll(&mut self, state: &mut AppState) -> Vec<News> {
        self.poll_session(state);
        self.exporter.poll(state);
        for made in self.importer.poll(state) {
            self.opener.keep(made);
        }
        self.poll_keeper(state);
        let mut news: Vec<News> = self.poll_growth(state).into_iter().collect();
        while let Some(opened) = self.opener.next() {
            news.extend(self.take(state, opened));
        }
        let mut effects = Vec::new();
        self.dialogs.retain(|dialog| {
            let answer = dialog.poll();
            let is_open = answer.is_none();
            if let Some(answer) = answer {
                apply(state, answer, &mut effects);
            }
            is_open
        });
        for effect in effects {
            news.extend(self.carry_out(state, effect));
        }
        news
    }

    fn poll_session(&mut self, state: &mut AppState) {
        let Some(session) = &self.session else { return };
        while let Ok(event) = session.events().try_recv() {
            tracing::trace!(?event, "training");
            for (level, text) in state.training.take(event) {
                if level != Level::Info {
                    leaving::save_failed(state);
                }
                state.messages.say(level, text);
            }
        }
        if state.dataset.is_none()
            && let Some(dataset) = session.dataset()
        {
            state.set_dataset(dataset);
            stand_at_wanted_view(state);
        }
        let version = session.snapshot_version();
        if version != self.snapshot_version {
            self.snapshot_version = version;
            state.snapshot = session.snapshot();
        }
    }

    /// The object's surface as it grew since the last frame.
    fn poll_growth(&mut self, state: &AppState) -> Option<News> {
        let (picture, version) = self.session.as_ref()?.growth();
        let is_new = std::mem::replace(&mut self.growth_version, version) != version;
        let picture = picture.filter(|_| is_new && state.snapshot.is_none())?;
        let [width, height] = picture.size;
        let shown = ScreenPhoto::thinned(width, height, |i| picture.pixels[i]);
        Some(News::FirstPicture(shown, GROWTH))
    }

    fn take(&mut self, state: &mut AppState, opened: Opened) -> Option<News> {
        match opened {
            Opened::Capture(path) => return Some(self.open_capture(state, Source::Capture(path))),
            Opened::Run {
                path,
                snapshot,
                figures,
            } => {
                self.reset(state);
                state.training.recall(figures);
                state.look_at_model(&snapshot);
                state.snapshot = Some(snapshot);
                self.remember(state, &path);
                state.source = Source::Run(path);
                self.bring_back_pending(state);
                return Some(News::Reset);
            }
            Opened::Session { path, session } => {
                return self.open_session(state, session, Some(path));
            }
            Opened::LeftBehind(session) => state.session.recovery = Some(session),
            Opened::RunDataset { path, dataset } if state.source == Source::Run(path.clone()) => {
                state.set_dataset(dataset);
                stand_at_wanted_view(state);
            }
            Opened::Kept { source, result } => keep(state, &source, result),
            Opened::Scan(path) if state.source == Source::Nothing => {
                return Some(self.open_capture(state, Source::Capture(path)));
            }
            Opened::Scan(path) => self.importer.start(state, &path, &self.ctx),
            Opened::Environment { path, result } => {
                return self.take_environment(state, path, result);
            }
            Opened::Matched {
                environment,
                transform,
            } if state.look.environment == Some(environment) => match transform {
                // The rest may have been dragged on in the meantime.
                Some(matched) => {
                    state.look.transform.exposure_ev = matched.exposure_ev;
                    state.look.transform.white_balance = matched.white_balance;
                }
                None => state
                    .messages
                    .say(Level::Warning, "There is no light to match"),
            },
            Opened::FirstPhoto { path, photo }
                if state.source.path() == Some(&path) && state.snapshot.is_none() =>
            {
                return Some(News::FirstPicture(photo, FIRST_PHOTO));
            }
            Opened::ViewPhoto { view, photo } => return Some(News::ViewPhoto(view, photo)),
            Opened::MasksSaved(Ok(folder)) => {
                let said = format!("The masks are in {}", folder.display());
                state.messages.say(Level::Info, said);
            }
            Opened::MasksSaved(Err(reason)) | Opened::Failed(reason) => {
                state.messages.say(Level::Error, reason);
            }
            // Read for something that is no longer open.
            Opened::RunDataset { .. } | Opened::FirstPhoto { .. } | Opened::Matched { .. } => {}
        }
        None
    }

    fn take_environment(
        &mut self,
        state: &mut AppState,
        path: PathBuf,
        result: Result<Arc<Environment>, String>,
    ) -> Option<News> {
        let environment = match result {
            Ok(environment) => environment,
            Err(reason) => {
                let mut entries = state.environments.iter_mut();
                if let Some(entry) = entries.find(|entry| entry.path == path) {
                    entry.content = EnvironmentContent::Failed(reason.clone());
                }
                if state.chosen_environment().is_none() {
                    state.look.environment = None;
                }
                state.messages.say(Level::Error, reason);
                return None;
            }
        };
        if state.source == Source::Nothing {
            self.reset(state);
            let snapshot = Arc::new(Snapshot {
                step: 0,
                object: None,
                environment,
                exposures: None,
            });
            state.look_at_model(&snapshot);
            state.snapshot = Some(snapshot);
            self.remember(state, &path);
            state.source = Source::Environment(path);
            self.bring_back_pending(state);
            return Some(News::Reset);
        }
        // The run's own file is the light it was trained in; as the same value it is compared at once.
        let own = state.snapshot.as_ref().map(|own| &own.environment);
        let own = own.filter(|own| own.is_same_light(&environment));
        let content = EnvironmentContent::Ready(own.map_or(environment, Arc::clone));
        let is_known = state.environments.iter().any(|entry| entry.path == path);
        let index = state.environment_of_file(&path);
        let entry = &mut state.environments[index];
        // Otherwise it was opened, and not chosen from the list.
        let was_listed = matches!(entry.content, EnvironmentContent::Loading);
        entry.content = content;
        if is_known && !was_listed {
            state.lighting.removed.remove(&index);
            state.look.environment = Some(index);
        }
        if !is_known {
            recent::add(&mut state.recent, &path);
            state.look.environment = Some(index);
        }
        None
    }

    /// Ends the run; waits for it to save where it has a folder.
    pub(in crate::app) fn close(&mut self) {
        self.exporter.close();
        if let Some(session) = self.session.take()
            && let Err(error) = session.join()
        {
            tracing::debug!("the run ended with an error: {error}");
        }
    }

    /// Puts what was opened or saved on the list of that.
    fn remember(&self, state: &mut AppState, path: &Path) {
        recent::add(&mut state.recent, path);
        recent::save(&state.recent, &self.keeper);
    }
}

/// Takes in where the environment of a scan is kept: it is read from there from now on.
fn keep(state: &mut AppState, source: &Path, result: Result<PathBuf, String>) {
    match result {
        Ok(file) => {
            let mut entries = state.environments.iter_mut();
            if let Some(entry) = entries.find(|entry| entry.path == source) {
                let said = format!("“{}” is in the library of environments", entry.name);
                entry.path = file;
                state.messages.say(Level::Info, said);
            }
        }
        Err(reason) => state.messages.say(Level::Error, reason),
    }
}
