//! Reads files on threads of their own, so that the window never waits for a disk.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crossbeam::channel::{Receiver, Sender, bounded};
use egui::Context;

use super::importer::Made;
use super::threads::spawn;
use crate::app::session::session_file::{EXTENSION, SessionFile};
use crate::app::state::messages::with_causes;
use crate::data::{DataError, Dataset, LoadOptions, Photo, first_photo, list_capture};
use crate::neif::distant::is_environment_file;
use crate::neif::{Environment, EnvironmentTransform, Storage};
use crate::render::Scene;
use crate::render::library::{Library, Record};
use crate::scans::{Scan, load_capture};
use crate::train::Snapshot;
use crate::train::masks::FoundObject;
use crate::train::session::events::TrainEvent;
use crate::train::session::saved::run_folder::{ENVIRONMENT, RunFolder};

/// Results that may wait for the window.
const QUEUE: usize = 64;
/// Niceness of reading: below the window, above the trainer.
const NICE: i32 = 4;

/// A photo as the screen needs it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::app) struct ScreenPhoto {
    /// Width and height in pixels.
    pub(in crate::app) size: [usize; 2],
    /// `[height * width]` sRGB with alpha 255.
    pub(in crate::app) pixels: Vec<[u8; 4]>,
}

impl ScreenPhoto {
    /// Longest side of a picture on screen, pixels; larger ones are thinned.
    pub(in crate::app) const MAX_SIDE: usize = 2048;

    /// The sRGB pixels of a picture, by their index in it, thinned to what a screen can show.
    pub(in crate::app) fn thinned(
        width: usize,
        height: usize,
        pixel: impl Fn(usize) -> [u8; 3],
    ) -> Self {
        let stride = width.max(height).div_ceil(Self::MAX_SIDE).max(1);
        let size = [width.div_ceil(stride), height.div_ceil(stride)];
        let pixels = (0..size[0] * size[1]).map(|i| {
            let (x, y) = (i % size[0] * stride, i / size[0] * stride);
            let [r, g, b] = pixel(y * width + x);
            [r, g, b, 255]
        });
        Self {
            size,
            pixels: pixels.collect(),
        }
    }
}

/// What a path turned out to be, or what was read.
#[derive(Debug)]
pub(super) enum Opened {
    /// A capture, to be trained on.
    Capture(PathBuf),
    /// A saved run: its model at once, its photos later.
    Run {
        path: PathBuf,
        snapshot: Arc<Snapshot>,
        /// Of its training so far.
        figures: Vec<TrainEvent>,
    },
    /// The photos of the run at this path.
    RunDataset {
        path: PathBuf,
        dataset: Arc<Dataset>,
    },
    /// Another program's scan, of which an environment is to be made.
    Scan(PathBuf),
    /// The file of the library in which what was made of the file at this path is kept, or why it is not.
    Kept {
        source: PathBuf,
        result: Result<PathBuf, String>,
    },
    /// An environment, or why it cannot be used.
    Environment {
        path: PathBuf,
        result: Result<Arc<Environment>, String>,
    },
    Session {
        path: PathBuf,
        session: Box<SessionFile>,
    },
    /// A session that an earlier window has left behind.
    LeftBehind(Box<SessionFile>),
    /// The first photo of the capture at this path, which is being read.
    FirstPhoto { path: PathBuf, photo: ScreenPhoto },
    /// The photo of a view of the open capture, by its index.
    ViewPhoto { view: usize, photo: ScreenPhoto },
    /// The folder in which the masks of the object that was found are, or why not.
    MasksSaved(Result<PathBuf, String>),
    /// How the environment of this index is as bright as the capture's own; none where there is no light to compare.
    Matched {
        environment: usize,
        transform: Option<EnvironmentTransform>,
    },
    /// Why something cannot be used, with file and field.
    Failed(String),
}

/// Starts the threads and collects their results.
#[derive(Debug)]
pub(in crate::app) struct Opener {
    results: Receiver<Opened>,
    sender: Sender<Opened>,
    ctx: Context,
}

impl Opener {
    /// `ctx` is woken after each result.
    pub(super) fn new(ctx: &Context) -> Self {
        let (sender, results) = bounded(QUEUE);
        Self {
            results,
            sender,
            ctx: ctx.clone(),
        }
    }

    /// Puts an environment into the library.
    pub(super) fn keep(&self, made: Made) {
        let Made {
            source,
            environment,
        } = made;
        self.spawn(move |send| {
            let record = Record {
                origin: Some(source.display().to_string()),
                ..Record::default()
            };
            let kept = Library::of_system().add(&environment, Storage::default(), record);
            let result = kept
                .map(|entry| entry.file)
                .map_err(|error| with_causes(&error));
            send(Opened::Kept { source, result });
        });
    }

    /// The next result, if there is one.
    pub(super) fn next(&self) -> Option<Opened> {
        self.results.try_recv().ok()
    }

    /// Finds out what is at `path` and reads it; a capture is only named, its session reads it.
    pub(in crate::app) fn open(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| open(path, send));
    }

    /// Reads the session that an earlier window has left behind; a damaged one is no session.
    pub(in crate::app) fn left_behind(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| match SessionFile::read(&path) {
            Ok(session) => send(Opened::LeftBehind(Box::new(session))),
            Err(error) => tracing::warn!("{error}"),
        });
    }

    /// Reads an environment from its file, or from the folder of a run.
    pub(in crate::app) fn load_environment(&self, path: &Path) {
        let path = if path.is_dir() {
            path.join(ENVIRONMENT)
        } else {
            path.to_owned()
        };
        self.spawn(move |send| send(load_environment(path)));
    }

    /// Compares the scene's environment, the one with index `environment`, with the capture's own.
    pub(in crate::app) fn match_exposure(
        &self,
        scene: Scene,
        own: Arc<Environment>,
        environment: usize,
    ) {
        self.spawn(move |send| {
            let transform = scene.matched_to(&own);
            send(Opened::Matched {
                environment,
                transform,
            });
        });
    }

    /// Reads the first photo of a capture, ahead of everything else.
    pub(in crate::app) fn first_photo(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| {
            if let Some(photo) = first_photo(&path) {
                let photo = screen_photo(&photo);
                send(Opened::FirstPhoto { path, photo });
            }
        });
    }

    /// Prepares the photo of a view for the screen.
    pub(in crate::app) fn view_photo(&self, dataset: &Arc<Dataset>, view: usize) {
        let dataset = Arc::clone(dataset);
        self.spawn(move |send| {
            if let Some(found) = dataset.views().nth(view) {
                let photo = screen_photo(&found.photo);
                send(Opened::ViewPhoto { view, photo });
            }
        });
    }

    /// Writes the masks of an object that was found into a folder.
    pub(super) fn save_masks(&self, found: &Arc<FoundObject>, folder: PathBuf) {
        let found = Arc::clone(found);
        self.spawn(move |send| {
            let saved = found.save(&folder).map_err(|error| with_causes(&error));
            send(Opened::MasksSaved(saved.map(|()| folder)));
        });
    }

    fn spawn(&self, work: impl FnOnce(&dyn Fn(Opened)) + Send + 'static) {
        let (sender, ctx) = (self.sender.clone(), self.ctx.clone());
        let send = move |opened| {
            // The window has closed when nobody takes results any more.
            if sender.send(opened).is_ok() {
                ctx.request_repaint();
            }
        };
        let spawned = spawn("neif-open", NICE, move || work(&send));
        if let Err(error) = spawned {
            tracing::error!("cannot start a thread to read files: {error}");
        }
    }
}

fn open(path: PathBuf, send: &dyn Fn(Opened)) {
    if !path.exists() {
        let reason = format!("{}: no such file or folder", path.display());
        send(Opened::Failed(reason));
    } else if RunFolder::is_run(&path) {
        open_run(&path, send);
    } else if is_environment_file(&path) {
        send(load_environment(path));
    } else if Scan::is_scan(&path) {
        send(Opened::Scan(path));
    } else if path.extension().is_some_and(|ending| ending == EXTENSION) {
        let session = SessionFile::read(&path).map(Box::new);
        send(session.map_or_else(Opened::Failed, |session| Opened::Session { path, session }));
    } else {
        // Listing reveals at once what training would find out later, in the words of the command line.
        send(match list_capture(&path) {
            Ok(_) => Opened::Capture(path),
            Err(error @ DataError::NotADataset { .. }) => {
                let else_ = "nor is it a run folder, an environment (.safetensors, .hdr, .exr) or a scan (.ply, .splat, .spz, .sog, a NeRF)";
                Opened::Failed(format!("{error}\n  {else_}"))
            }
            Err(error) => Opened::Failed(error.to_string()),
        });
    }
}

fn open_run(path: &Path, send: &dyn Fn(Opened)) {
    let opened = RunFolder::open(path).and_then(|folder| {
        let snapshot = folder.snapshot()?;
        Ok((folder, snapshot))
    });
    let (folder, snapshot) = match opened {
        Ok(both) => both,
        Err(error) => return send(Opened::Failed(with_causes(&error))),
    };
    let log = folder.log();
    send(Opened::Run {
        path: path.to_owned(),
        snapshot: Arc::new(Snapshot {
            step: log.last_row().map_or(0, |trained| trained.steps),
            ..snapshot
        }),
        figures: log.figures(),
    });
    let Ok(config) = folder.config() else { return };
    let dataset = folder.dataset_path(&config);
    let options = LoadOptions {
        choices: config.dataset.choices,
        ..LoadOptions::default()
    };
    match load_capture(&dataset, &options, &AtomicBool::new(false)) {
        Ok(None) => (),
        Ok(Some(dataset)) => send(Opened::RunDataset {
            path: path.to_owned(),
            dataset: Arc::new(dataset),
        }),
        Err(error) => send(Opened::Failed(format!(
            "The run is shown without its photos\n{}",
            with_causes(&error)
        ))),
    }
}

fn load_environment(path: PathBuf) -> Opened {
    if Scan::is_scan(&path) {
        return Opened::Scan(path);
    }
    let result = Environment::open(&path)
        .map(Arc::new)
        .map_err(|error| with_causes(&error));
    Opened::Environment { path, result }
}

fn screen_photo(photo: &Photo) -> ScreenPhoto {
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    ScreenPhoto::thinned(width, height, |i| photo.srgb(i).map(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Why what is at a path cannot be used.
    fn failure(path: &Path) -> String {
        let found = std::cell::RefCell::new(Vec::new());
        open(path.to_owned(), &|opened| found.borrow_mut().push(opened));
        match &found.into_inner()[..] {
            [
                Opened::Failed(reason)
                | Opened::Environment {
                    result: Err(reason),
                    ..
                },
            ] => reason.clone(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_cannot_be_opened_is_said_with_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let text = folder.path().join("notes.txt");
        std::fs::write(&text, "hello").unwrap();
        for path in [
            text,
            folder.path().join("missing"),
            folder.path().to_owned(),
        ] {
            let reason = failure(&path);
            assert!(reason.contains(&*path.to_string_lossy()), "{reason}");
        }
    }

    #[test]
    fn a_folder_of_no_known_layout_says_what_was_looked_for_like_the_command_line() {
        let folder = tempfile::tempdir().unwrap();
        let reason = failure(folder.path());
        let said = list_capture(folder.path()).unwrap_err().to_string();
        assert!(reason.starts_with(&said), "{reason}");
        assert!(reason.contains("COLMAP"), "{reason}");
    }

    #[test]
    fn a_broken_environment_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("env.safetensors");
        std::fs::write(&path, [1, 2, 3]).unwrap();
        let reason = failure(&path);
        assert!(reason.contains("env.safetensors"), "{reason}");
    }

    #[test]
    fn a_large_photo_is_thinned() {
        let pixels = vec![[65535, 0, 0]; 5000 * 3];
        let photo = screen_photo(&Photo::Ldr {
            width: 5000,
            height: 3,
            pixels,
        });
        assert_eq!((photo.size, photo.pixels[0]), ([1667, 1], [255, 0, 0, 255]));
    }
}
