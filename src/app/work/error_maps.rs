//! Measures a view against its photo on threads of its own: renders it at the photo's size, then colours the differences.
//!
//! What the person changes is measured at once; a new snapshot alone takes at most [`SHARE`] of the time while training
//! runs, and never interrupts a measurement.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use crossbeam::channel::{Receiver, Sender, bounded};
use egui::{Context, TextureHandle, TextureId, TextureOptions};
use rayon::ThreadPool;
use strum::VariantArray as _;

use super::opener::ScreenPhoto;
use super::threads;
use crate::app::state::app_state::AppState;
use crate::app::state::look::Look;
use crate::app::state::training_state::Level;
use crate::app::state::watch::{Comparison, ErrorKind, MeasuredView};
use crate::app::viewport::texture;
use crate::data::Dataset;
use crate::render::{Layer, Scene, render};
use crate::train::Snapshot;
use crate::train::measure::view_error::ViewError;

/// Niceness of the threads: below the preview, above the trainer.
const NICE: i32 = 8;
/// Share of the time that measurements may take while training runs.
const SHARE: f64 = 0.1;
/// Progress is reported in so many parts.
const PARTS: u32 = 20;

/// What a measurement is of.
#[derive(Clone, Debug)]
struct Subject {
    snapshot: Arc<Snapshot>,
    dataset: Arc<Dataset>,
    view: usize,
    look: Look,
    is_original: bool,
    is_environment_ready: bool,
}

impl Subject {
    /// What the person wants measured now, if anything.
    fn of(state: &AppState) -> Option<Self> {
        let is_wanted = matches!(state.compare.with_photo, Comparison::Error(_));
        Some(Self {
            view: state.view.at_view.filter(|_| is_wanted)?,
            snapshot: state.snapshot.clone()?,
            dataset: state.dataset.clone()?,
            look: state.look,
            is_original: state.is_original_shown,
            is_environment_ready: state.chosen_environment().is_some(),
        })
    }

    /// Whether only training makes a difference.
    fn is_same_view(&self, other: &Self) -> bool {
        self.view == other.view
            && self.look == other.look
            && self.is_original == other.is_original
            && self.is_environment_ready == other.is_environment_ready
            && Arc::ptr_eq(&self.dataset, &other.dataset)
    }

    fn is_edited(&self) -> bool {
        !self.is_original && self.look != Look::default()
    }
}

/// What to do now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decision {
    Nothing,
    Cancel,
    Start,
}

/// A measurement that is done.
#[derive(Clone, Debug)]
struct Done {
    subject: Subject,
    ended_secs: f64,
    took_secs: f64,
}

fn decide(
    running: Option<&Subject>,
    done: Option<&Done>,
    wanted: Option<&Subject>,
    is_training: bool,
    now_secs: f64,
) -> Decision {
    let Some(wanted) = wanted else {
        return running.map_or(Decision::Nothing, |_| Decision::Cancel);
    };
    let done = done.filter(|done| done.subject.is_same_view(wanted));
    let is_due = match (running, done) {
        (Some(running), _) => !running.is_same_view(wanted),
        (None, None) => true,
        (None, Some(done)) => {
            let is_newer = !Arc::ptr_eq(&done.subject.snapshot, &wanted.snapshot);
            let rest = done.took_secs * (1.0 / SHARE - 1.0);
            is_newer && (!is_training || now_secs - done.ended_secs >= rest)
        }
    };
    if is_due {
        Decision::Start
    } else {
        Decision::Nothing
    }
}

/// What a thread made.
struct Maps {
    number: u64,
    measured: MeasuredView,
    /// By kind of error.
    pictures: [ScreenPhoto; ErrorKind::VARIANTS.len()],
}

/// A thread at work.
struct Running {
    job: Arc<Job>,
    begun_secs: f64,
}

/// The threads, their newest result, and its picture on the graphics card.
pub(in crate::app) struct ErrorMaps {
    pool: Arc<ThreadPool>,
    sender: Sender<Maps>,
    results: Receiver<Maps>,
    running: Option<Running>,
    done: Option<Done>,
    n_started: u64,
    newest: Option<Maps>,
    texture: Option<(u64, ErrorKind, TextureHandle)>,
}

impl ErrorMaps {
    /// Starts the threads.
    ///
    /// # Errors
    /// When the system gives none.
    pub(in crate::app) fn new() -> std::io::Result<Self> {
        let pool = threads::pool("neif-compare", 0, NICE)?;
        let (sender, results) = bounded(4);
        Ok(Self {
            pool: Arc::new(pool),
            sender,
            results,
            running: None,
            done: None,
            n_started: 0,
            newest: None,
            texture: None,
        })
    }

    /// Takes in results, begins or ends measurements as the state wants, and brings the picture up to date.
    pub(in crate::app) fn update(&mut self, ctx: &Context, state: &mut AppState) {
        let now = state.messages.now_secs;
        while let Ok(maps) = self.results.try_recv() {
            self.take(state, maps, now);
        }
        let wanted = Subject::of(state);
        let running = self.running.as_ref().map(|running| &running.job.subject);
        let is_training = state.is_learning();
        match decide(
            running,
            self.done.as_ref(),
            wanted.as_ref(),
            is_training,
            now,
        ) {
            Decision::Nothing => {}
            Decision::Cancel => self.cancel(),
            Decision::Start => {
                self.cancel();
                if let Some(subject) = wanted {
                    self.start(ctx, state, subject);
                }
            }
        }
        state.watch.measuring = self.running.as_ref().map(|running| {
            let parts = running.job.parts_done.load(Ordering::Relaxed);
            parts as f32 / PARTS as f32
        });
        self.upload(ctx, state);
    }

    /// Drops everything: something else was opened.
    pub(in crate::app) fn clear(&mut self) {
        self.cancel();
        self.done = None;
        self.newest = None;
        self.texture = None;
    }

    /// The picture of the error map that is asked for, once there is one of the view.
    pub(in crate::app) fn texture(&self, state: &AppState) -> Option<TextureId> {
        let (_, kind, texture) = self.texture.as_ref()?;
        let view = self.newest.as_ref()?.measured.view;
        let is_wanted = state.compare.with_photo == Comparison::Error(*kind)
            && state.view.at_view == Some(view);
        is_wanted.then(|| texture.id())
    }

    fn take(&mut self, state: &mut AppState, maps: Maps, now: f64) {
        let Some(running) = self.running.take_if(|r| r.job.number == maps.number) else {
            return;
        };
        self.done = Some(Done {
            took_secs: now - running.begun_secs,
            ended_secs: now,
            subject: running.job.subject.clone(),
        });
        state.watch.measured = Some(maps.measured);
        if !maps.measured.is_edited {
            let measured = maps.measured;
            state.watch.by_view.insert(measured.view, measured);
        }
        self.newest = Some(maps);
    }

    fn cancel(&mut self) {
        if let Some(running) = self.running.take() {
            running.job.cancel.store(true, Ordering::Relaxed);
        }
    }

    fn start(&mut self, ctx: &Context, state: &mut AppState, subject: Subject) {
        self.n_started += 1;
        let job = Arc::new(Job {
            scene: state.scene_of(&subject.snapshot),
            subject,
            number: self.n_started,
            cancel: AtomicBool::new(false),
            parts_done: AtomicU32::new(0),
            ctx: ctx.clone(),
        });
        let (pool, sender) = (Arc::clone(&self.pool), self.sender.clone());
        let theirs = Arc::clone(&job);
        let spawned = threads::spawn("neif-compare", NICE, move || {
            // A window that has closed takes no results; that is no error.
            if let Some(maps) = pool.install(|| theirs.run())
                && sender.send(maps).is_ok()
            {
                theirs.ctx.request_repaint();
            }
        });
        match spawned {
            Ok(_detached) => {
                let begun_secs = state.messages.now_secs;
                self.running = Some(Running { job, begun_secs });
            }
            Err(error) => state
                .messages
                .say(Level::Error, format!("cannot compare: {error}")),
        }
    }

    fn upload(&mut self, ctx: &Context, state: &AppState) {
        let (Comparison::Error(kind), Some(maps)) = (state.compare.with_photo, &self.newest) else {
            return;
        };
        let is_current = self
            .texture
            .as_ref()
            .is_some_and(|(number, of, _)| (*number, *of) == (maps.number, kind));
        if !is_current {
            let picture = &maps.pictures[kind as usize];
            let pixels = (picture.size, picture.pixels.as_slice());
            let texture = texture::upload(ctx, "error map", pixels, TextureOptions::NEAREST);
            self.texture = Some((maps.number, kind, texture));
        }
    }
}

/// What a thread needs, and how far it is.
struct Job {
    scene: Scene,
    subject: Subject,
    number: u64,
    cancel: AtomicBool,
    parts_done: AtomicU32,
    ctx: Context,
}

impl Job {
    /// Renders and compares; `None` when cancelled.
    fn run(&self) -> Option<Maps> {
        let view = self.subject.dataset.views().nth(self.subject.view)?;
        let on_progress = |done: f32| {
            let parts = (done * PARTS as f32) as u32;
            if self.parts_done.fetch_max(parts, Ordering::Relaxed) < parts {
                self.ctx.request_repaint();
            }
        };
        let picture = render(
            &self.scene,
            &view.camera,
            Layer::Final,
            &self.cancel,
            &on_progress,
        )?;
        let error = ViewError::of(&picture, view);
        let pictures = [
            (ErrorKind::Absolute, &error.absolute),
            (ErrorKind::Signed, &error.signed),
            (ErrorKind::Flip, &error.flip),
        ];
        let pictures = pictures.map(|(kind, values)| colored(values, error.width, kind));
        Some(Maps {
            number: self.number,
            measured: MeasuredView {
                view: self.subject.view,
                step: self.subject.snapshot.step,
                is_edited: self.subject.is_edited(),
                figures: error.figures,
            },
            pictures,
        })
    }
}

/// The picture of some values, thinned to what a screen can show.
fn colored(values: &[f32], width: usize, kind: ErrorKind) -> ScreenPhoto {
    let height = values.len() / width.max(1);
    ScreenPhoto::thinned(width, height, |i| kind.color(values[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::app_state::tests::snapshot;

    fn subject(snapshot: &Arc<Snapshot>, dataset: &Arc<Dataset>, view: usize) -> Subject {
        Subject {
            snapshot: Arc::clone(snapshot),
            dataset: Arc::clone(dataset),
            view,
            look: Look::default(),
            is_original: false,
            is_environment_ready: false,
        }
    }

    fn dataset() -> Arc<Dataset> {
        Arc::new(Dataset::of_views(Vec::new()))
    }

    #[test]
    fn another_view_is_measured_at_once_and_a_newer_snapshot_in_its_turn() {
        let (first, second, dataset) = (snapshot(1), snapshot(1), dataset());
        let here = subject(&first, &dataset, 0);
        let newer = subject(&second, &dataset, 0);
        let there = subject(&first, &dataset, 1);
        let done = Done {
            subject: here.clone(),
            ended_secs: 100.0,
            took_secs: 2.0,
        };
        let decide_at = |running: Option<&Subject>, wanted: &Subject, is_training, now| {
            decide(running, Some(&done), Some(wanted), is_training, now)
        };
        assert_eq!(
            decide_at(None, &here, true, 999.0),
            Decision::Nothing,
            "known"
        );
        assert_eq!(decide_at(None, &there, true, 100.0), Decision::Start);
        assert_eq!(decide_at(None, &newer, true, 110.0), Decision::Nothing);
        assert_eq!(decide_at(None, &newer, true, 118.0), Decision::Start);
        assert_eq!(decide_at(None, &newer, false, 100.0), Decision::Start);
        // A snapshot a second would otherwise end every measurement before it is done.
        assert_eq!(
            decide_at(Some(&here), &newer, true, 200.0),
            Decision::Nothing
        );
        assert_eq!(decide_at(Some(&here), &there, true, 100.0), Decision::Start);
        assert_eq!(
            decide(Some(&here), None, None, true, 0.0),
            Decision::Cancel,
            "nobody looks any more"
        );
    }

    #[test]
    fn a_map_has_the_colours_of_its_values() {
        let picture = colored(&[0.0, 1.0], 2, ErrorKind::Flip);
        let opaque = |[r, g, b]: [u8; 3]| [r, g, b, 255];
        let colors = [0.0, 1.0].map(|v| opaque(ErrorKind::Flip.color(v)));
        assert_eq!((picture.size, picture.pixels), ([2, 1], colors.to_vec()));
    }
}
