//! Reads files on threads of their own, so that the window never waits for a disk.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, bounded};

use crate::app::session::session_file::{EXTENSION, SessionFile};
use crate::app::state::messages::with_causes;
use crate::data::{
    DataError, Dataset, LoadOptions, Photo, first_photo, list_capture, write_atomically,
};
use crate::neif::distant::is_environment_file;
use crate::neif::{Environment, EnvironmentTransform};
use crate::render::Scene;
use crate::render::preview::priority::lower_thread_priority;
use crate::train::Snapshot;
use crate::train::session::events::TrainEvent;
use crate::train::session::saved::run_folder::{ENVIRONMENT, RunFolder};

/// Results that may wait for the window.
const QUEUE: usize = 64;
/// Niceness of reading: below the window, above the trainer.
const NICE: i32 = 4;
/// Longest side of a photo on screen; larger ones are thinned.
const MAX_PHOTO_SIDE: usize = 2048;

/// A photo as the screen needs it.
#[derive(Clone, PartialEq, Eq)]
pub struct ScreenPhoto {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// `[height * width]` sRGB with alpha 255.
    pub pixels: Vec<[u8; 4]>,
}

impl std::fmt::Debug for ScreenPhoto {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ScreenPhoto")
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

/// What a path turned out to be, or what was read.
#[derive(Debug)]
pub enum Opened {
    /// A capture, to be trained on.
    Capture(PathBuf),
    /// A saved run: its model at once, its photos later.
    Run {
        /// The folder.
        path: PathBuf,
        /// The model.
        snapshot: Arc<Snapshot>,
        /// The figures of its training so far.
        figures: Vec<TrainEvent>,
    },
    /// The photos of a run.
    RunDataset {
        /// The run's folder.
        path: PathBuf,
        /// The capture.
        dataset: Arc<Dataset>,
    },
    /// An environment.
    Environment {
        /// The file.
        path: PathBuf,
        /// Its content, or why it cannot be used.
        result: Result<Arc<Environment>, String>,
    },
    /// A session.
    Session {
        /// The file.
        path: PathBuf,
        /// What it holds.
        session: Box<SessionFile>,
    },
    /// A session that an earlier window has left behind.
    LeftBehind(Box<SessionFile>),
    /// The first photo of a capture that is being read.
    FirstPhoto {
        /// The capture.
        path: PathBuf,
        /// The photo.
        photo: ScreenPhoto,
    },
    /// The photo of a view of the open capture.
    ViewPhoto {
        /// Index of the view.
        view: usize,
        /// The photo.
        photo: ScreenPhoto,
    },
    /// How the environment is as bright as the capture's own.
    Matched {
        /// Which environment.
        environment: usize,
        /// Its transform; none where there is no light to compare.
        transform: Option<EnvironmentTransform>,
    },
    /// A file was written.
    Wrote(PathBuf),
    /// It cannot be used.
    Failed {
        /// What was opened.
        path: PathBuf,
        /// Why, with file and field.
        reason: String,
    },
}

/// Starts the threads and collects their results.
#[derive(Debug)]
pub struct Opener {
    results: Receiver<Opened>,
    sender: Sender<Opened>,
    wake: Wake,
}

/// Called when there is news.
#[derive(Clone)]
struct Wake(Arc<dyn Fn() + Send + Sync>);

impl std::fmt::Debug for Wake {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Wake")
    }
}

impl Opener {
    /// `wake` is called after each result.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Self {
        let (sender, results) = bounded(QUEUE);
        Self {
            results,
            sender,
            wake: Wake(Arc::new(wake)),
        }
    }

    /// The next result, if there is one.
    pub fn next(&self) -> Option<Opened> {
        self.results.try_recv().ok()
    }

    /// Finds out what is at `path` and reads it; a capture is only named, its session reads it.
    pub fn open(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| open(path, send));
    }

    /// Reads the session that an earlier window has left behind; a damaged one is no session.
    pub fn left_behind(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| match SessionFile::read(&path) {
            Ok(session) => send(Opened::LeftBehind(Box::new(session))),
            Err(error) => tracing::warn!("{error}"),
        });
    }

    /// Reads an environment from its file, or from the folder of a run.
    pub fn load_environment(&self, path: &Path) {
        let path = if path.is_dir() {
            path.join(ENVIRONMENT)
        } else {
            path.to_owned()
        };
        self.spawn(move |send| send(load_environment(path)));
    }

    /// Compares the scene's environment, the one with index `environment`, with the capture's own.
    pub fn match_exposure(&self, scene: Scene, own: Arc<Environment>, environment: usize) {
        self.spawn(move |send| {
            let transform = scene.matched_to(&own);
            send(Opened::Matched {
                environment,
                transform,
            });
        });
    }

    /// Reads the first photo of a capture, ahead of everything else.
    pub fn first_photo(&self, path: &Path) {
        let path = path.to_owned();
        self.spawn(move |send| {
            if let Some(photo) = first_photo(&path) {
                let photo = screen_photo(&photo);
                send(Opened::FirstPhoto { path, photo });
            }
        });
    }

    /// Prepares the photo of a view for the screen.
    pub fn view_photo(&self, dataset: &Arc<Dataset>, view: usize) {
        let dataset = Arc::clone(dataset);
        self.spawn(move |send| {
            let mut views = dataset
                .train
                .iter()
                .chain(&dataset.val)
                .chain(&dataset.test);
            if let Some(found) = views.nth(view) {
                send(Opened::ViewPhoto {
                    view,
                    photo: screen_photo(&found.photo),
                });
            }
        });
    }

    /// Writes a text file whole or not at all, and the folder for it.
    pub fn write_text(&self, path: PathBuf, text: String) {
        self.spawn(move |send| {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
            let written = folder
                .map_or(Ok(()), std::fs::create_dir_all)
                .and_then(|()| write_atomically(&path, |w| w.write_all(text.as_bytes())));
            send(match written {
                Ok(()) => Opened::Wrote(path),
                Err(error) => Opened::Failed {
                    reason: format!("{}: cannot be written: {error}", path.display()),
                    path,
                },
            });
        });
    }

    fn spawn(&self, work: impl FnOnce(&dyn Fn(Opened)) + Send + 'static) {
        let (sender, wake) = (self.sender.clone(), self.wake.clone());
        let send = move |opened| {
            // The window has closed when nobody takes results any more.
            if sender.send(opened).is_ok() {
                (wake.0)();
            }
        };
        let spawned = std::thread::Builder::new()
            .name("neif-open".to_owned())
            .spawn(move || {
                lower_thread_priority(NICE);
                work(&send);
            });
        if let Err(error) = spawned {
            tracing::error!("cannot start a thread to read files: {error}");
        }
    }
}

fn open(path: PathBuf, send: &dyn Fn(Opened)) {
    let failed = |reason: String| Opened::Failed {
        path: path.clone(),
        reason,
    };
    if !path.exists() {
        send(failed(format!(
            "{}: no such file or folder",
            path.display()
        )));
    } else if RunFolder::is_run(&path) {
        open_run(&path, send);
    } else if is_environment_file(&path) {
        send(load_environment(path));
    } else if path
        .extension()
        .is_some_and(|extension| extension == EXTENSION)
    {
        match SessionFile::read(&path) {
            Ok(session) => send(Opened::Session {
                path,
                session: Box::new(session),
            }),
            Err(reason) => send(failed(reason)),
        }
    } else {
        // Listing reveals at once what training would find out later, in the words of the command line.
        match list_capture(&path) {
            Ok(_) => send(Opened::Capture(path)),
            Err(error @ DataError::NotADataset { .. }) => {
                let else_ = "nor is it a run folder or an environment (.safetensors, .hdr, .exr)";
                send(failed(format!("{error}\n  {else_}")));
            }
            Err(error) => send(failed(error.to_string())),
        }
    }
}

fn open_run(path: &Path, send: &dyn Fn(Opened)) {
    let opened = RunFolder::open(path).and_then(|folder| {
        let snapshot = folder.snapshot()?;
        Ok((folder, snapshot))
    });
    let (folder, snapshot) = match opened {
        Ok(both) => both,
        Err(error) => {
            send(Opened::Failed {
                path: path.to_owned(),
                reason: with_causes(&error),
            });
            return;
        }
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
    match Dataset::load(&dataset, &options) {
        Ok(dataset) => send(Opened::RunDataset {
            path: path.to_owned(),
            dataset: Arc::new(dataset),
        }),
        Err(error) => send(Opened::Failed {
            path: dataset,
            reason: format!(
                "The run is shown without its photos\n{}",
                with_causes(&error)
            ),
        }),
    }
}

fn load_environment(path: PathBuf) -> Opened {
    let result = Environment::open(&path)
        .map(Arc::new)
        .map_err(|error| with_causes(&error));
    Opened::Environment { path, result }
}

/// Thins a photo to what a screen can show.
fn screen_photo(photo: &Photo) -> ScreenPhoto {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let stride = width.max(height).div_ceil(MAX_PHOTO_SIDE).max(1);
    let size = [width.div_ceil(stride), height.div_ceil(stride)];
    let pixels = (0..size[0] * size[1])
        .map(|i| {
            let (x, y) = (i % size[0] * stride, i / size[0] * stride);
            let [r, g, b] = photo
                .srgb(y * width + x)
                .map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            [r, g, b, 255]
        })
        .collect();
    ScreenPhoto { size, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(path: &Path) -> Opened {
        let found = std::cell::RefCell::new(Vec::new());
        open(path.to_owned(), &|opened| found.borrow_mut().push(opened));
        let mut found = found.into_inner();
        assert_eq!(found.len(), 1, "{found:?}");
        found.remove(0)
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
            match opened(&path) {
                Opened::Failed { reason, .. } => {
                    assert!(reason.contains(&*path.to_string_lossy()), "{reason}");
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn a_folder_of_no_known_layout_says_what_was_looked_for_like_the_command_line() {
        let folder = tempfile::tempdir().unwrap();
        match opened(folder.path()) {
            Opened::Failed { reason, .. } => {
                let said = list_capture(folder.path()).unwrap_err().to_string();
                assert!(reason.starts_with(&said), "{reason}");
                assert!(reason.contains("COLMAP"), "{reason}");
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_broken_environment_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("env.safetensors");
        std::fs::write(&path, [1, 2, 3]).unwrap();
        match opened(&path) {
            Opened::Environment {
                result: Err(reason),
                ..
            } => assert!(reason.contains("env.safetensors"), "{reason}"),
            other => panic!("{other:?}"),
        }
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
