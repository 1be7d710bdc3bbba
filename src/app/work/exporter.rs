//! The thread that renders and writes what is taken away.
//!
//! It has a thread pool of its own, below the window and the preview; while training runs it takes half of the cores.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam::channel::{Receiver, TryRecvError, bounded};
use egui::Context;

use super::threads;
use crate::app::changes::export::{plan, say_ending};
use crate::app::state::app_state::AppState;
use crate::app::state::export::{ExportEffect, Order, RunningExport};
use crate::app::state::training_state::Level;
use crate::data::{Ending, write_key_views};
use crate::render::{Destination, Film};

/// Niceness of rendering: between the preview and training.
const NICE: i32 = 15;
/// Progress wakes the window at most so often.
const REPAINT: Duration = Duration::from_millis(250);
/// Steps of progress from nothing to all.
const STEPS: f32 = 10_000.0;

/// The handles.
#[derive(Debug)]
pub(in crate::app) struct Exporter {
    ctx: Context,
    job: Option<Job>,
}

/// What runs.
#[derive(Debug)]
struct Job {
    path: PathBuf,
    cancel: Arc<AtomicBool>,
    progress: Arc<AtomicU32>,
    result: Receiver<Result<Ending, String>>,
    thread: JoinHandle<()>,
}

impl Exporter {
    /// Nothing runs yet; `ctx` is woken when there is news.
    pub(in crate::app) fn new(ctx: &Context) -> Self {
        Self {
            ctx: ctx.clone(),
            job: None,
        }
    }

    /// Does what a command asked of the world.
    pub(in crate::app) fn carry_out(&mut self, state: &mut AppState, effect: ExportEffect) {
        match effect {
            ExportEffect::Write(order) => self.begin(state, order),
            ExportEffect::SaveKeys(path) => save_keys(state, &path),
            ExportEffect::Cancel => self.cancel(),
        }
    }

    fn begin(&mut self, state: &mut AppState, order: Order) {
        if self.job.is_some() {
            let text = "An export is running; wait for it or cancel it first";
            state.messages.say(Level::Warning, text);
            return;
        }
        let path = if order.may_replace {
            order.path
        } else {
            unused(&order.path)
        };
        let order = Order { path, ..order };
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        let n_threads = if state.is_learning() {
            n_cores.div_ceil(2)
        } else {
            n_cores
        };
        let job = plan(state, &order).and_then(|(film, destination)| {
            let wake = self.ctx.clone();
            Job::spawn(film, destination, order.path, n_threads, wake).map_err(|e| e.to_string())
        });
        match job {
            Ok(job) => {
                state.export.running = Some(RunningExport {
                    path: job.path.clone(),
                    fraction: 0.0,
                    started_secs: state.messages.now_secs,
                });
                self.job = Some(job);
            }
            Err(reason) => say_ending(state, Err(reason)),
        }
    }

    fn cancel(&self) {
        if let Some(job) = &self.job {
            job.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Takes in what has happened since the last frame.
    pub(in crate::app) fn poll(&mut self, state: &mut AppState) {
        let Some(job) = &self.job else { return };
        if let Some(running) = &mut state.export.running {
            running.fraction = job.progress.load(Ordering::Relaxed) as f32 / STEPS;
        }
        let path = job.path.display();
        let ending = match job.result.try_recv() {
            Err(TryRecvError::Empty) => return,
            Ok(Ok(Ending::Finished)) => Ok(format!("Saved {path}")),
            Ok(Ok(Ending::Cancelled)) => {
                Ok("The export was cancelled; no file was left".to_owned())
            }
            Ok(Err(reason)) => Err(reason),
            Err(TryRecvError::Disconnected) => Err(format!("{path}: the export broke off")),
        };
        self.job = None;
        state.export.running = None;
        say_ending(state, ending);
    }

    /// Ends what runs and waits until its temporary files are gone.
    pub(in crate::app) fn close(&mut self) {
        self.cancel();
        if let Some(job) = self.job.take()
            && job.thread.join().is_err()
        {
            tracing::debug!("the export broke off");
        }
    }
}

impl Job {
    fn spawn(
        film: Film,
        destination: Destination,
        path: PathBuf,
        n_threads: usize,
        wake: Context,
    ) -> std::io::Result<Self> {
        let (cancel, progress) = (Arc::<AtomicBool>::default(), Arc::<AtomicU32>::default());
        let (cancel_there, progress_there) = (Arc::clone(&cancel), Arc::clone(&progress));
        let (sender, result) = bounded(1);
        let thread = threads::spawn("neif-export", NICE, move || {
            let on_progress = |fraction: f32| {
                let now = (fraction * STEPS) as u32;
                if progress_there.fetch_max(now, Ordering::Relaxed) < now {
                    wake.request_repaint_after(REPAINT);
                }
            };
            let written = match threads::pool("neif-export", n_threads, NICE) {
                Ok(pool) => pool
                    .install(|| film.write(&destination, &cancel_there, &on_progress))
                    .map_err(|error| error.to_string()),
                Err(error) => Err(error.to_string()),
            };
            // The window has closed when nobody takes the result any more.
            if sender.send(written).is_ok() {
                wake.request_repaint();
            }
        })?;
        Ok(Self {
            path,
            cancel,
            progress,
            result,
            thread,
        })
    }
}

/// Writes the key views; a small file, at once.
fn save_keys(state: &mut AppState, path: &Path) {
    let path = unused(path);
    let folder = path.parent().unwrap_or(Path::new("."));
    let written = std::fs::create_dir_all(folder)
        .map_err(|error| format!("{}: {error}", folder.display()))
        .and_then(|()| {
            write_key_views(&path, &state.export.keys).map_err(|error| error.to_string())
        });
    let ending = written.map(|()| {
        let path = path.display();
        format!("Saved {path}: `neif render RUN --cameras {path} --frames N` takes the same way")
    });
    say_ending(state, ending);
}

/// The path, or with a number behind its name where that exists.
fn unused(path: &Path) -> PathBuf {
    let original = path;
    let name = |number: u32| {
        let mut name = path.file_stem().unwrap_or_default().to_owned();
        name.push(format!("_{number}"));
        let path = path.with_file_name(name);
        // Added: what follows a dot in the stem is no ending.
        path.with_added_extension(original.extension().unwrap_or_default())
    };
    let mut paths = std::iter::once(path.to_owned()).chain((2..100_000).map(name));
    paths
        .find(|path| !path.exists())
        .unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_put_behind_names_that_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        assert_eq!(unused(&path), path);
        std::fs::write(&path, "").unwrap();
        assert_eq!(unused(&path), folder.path().join("a_2.png"));
        std::fs::write(folder.path().join("a_2.png"), "").unwrap();
        assert_eq!(unused(&path), folder.path().join("a_3.png"));
    }
}
