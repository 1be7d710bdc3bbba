//! The preview worker: takes the newest request, delivers pictures from coarse to fine.
//!
//! A newer request supersedes a running one within a tile of pixels, except that a first picture is
//! always finished: while something is dragged there is one for every request taken, and
//! none is ever coarser than a half per axis. Threads run below the window's priority and
//! above the trainer's.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::accelerator::{Accelerator, Attempt};
use super::drawn_by::{DrawnBy, GpuChoice};
use super::inbox::Inbox;
use super::priority::lower_thread_priority;
use super::progressive::{PassOutput, Progressive};
use super::request::{PreviewScene, Quality};
use super::sketch::{Purpose, Sketch};
use crate::render::irradiance::DiffuseLights;

/// Niceness of the preview's threads: the window has 0, the trainer 19.
const NICE: i32 = 5;
/// A view that has not changed for so long counts as at rest.
const REST: Duration = Duration::from_millis(100);

/// Which pictures to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// A sketch at once; when the view stays, one at full resolution, several paths a pixel, and then what
    /// [`crate::render::render`] makes.
    Refine,
    /// The same without the last two, which take long.
    Glance,
    /// One of a changed model, at this resolution divisor: 4, 2 or 1.
    Only(u32),
}

impl Passes {
    /// What is made one after the other. `motion` is the resolution divisor of what changes.
    fn steps(self, motion: u32) -> Vec<Step> {
        let sketch = |scale, purpose| Step::Sketch { scale, purpose };
        let glance = [sketch(motion, Purpose::Motion), sketch(1, Purpose::Rest)];
        match self {
            Self::Refine => {
                let still = [Quality::Fine, Quality::Settled].map(Step::Still);
                glance.into_iter().chain(still).collect()
            }
            Self::Glance => glance.to_vec(),
            Self::Only(scale @ 1..=2) => vec![sketch(scale, Purpose::SharpRefresh)],
            Self::Only(_) => vec![sketch(2, Purpose::Refresh)],
        }
    }

    /// The same by a graphics card, which needs no sketches.
    fn card_steps(self) -> Vec<Step> {
        let plain = Step::Card { is_fine: false };
        match self {
            Self::Refine => vec![plain, Step::Card { is_fine: true }],
            Self::Glance | Self::Only(_) => vec![plain],
        }
    }
}

/// One picture of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Sketch {
        scale: u32,
        purpose: Purpose,
    },
    /// At full resolution; settled where that is anything else.
    Still(Quality),
    /// By the graphics card.
    Card {
        is_fine: bool,
    },
}

impl Step {
    /// Resolution divisor of its light.
    fn scale(self) -> u32 {
        match self {
            Self::Sketch {
                scale,
                purpose: Purpose::Refresh,
            } => 2 * scale,
            Self::Sketch { scale, .. } => scale,
            Self::Still(_) | Self::Card { .. } => 1,
        }
    }

    /// Whether the object has several paths a pixel.
    fn is_fine(self) -> bool {
        matches!(self, Self::Still(_) | Self::Card { is_fine: true })
    }
}

/// A finished picture.
#[derive(Clone, Debug)]
pub struct PreviewFrame {
    /// The request's number, from [`Preview::request`].
    pub request: u64,
    /// Resolution divisor per axis: 4, 2 or 1.
    pub scale: u32,
    /// Whether the object has several paths a pixel.
    pub is_fine: bool,
    /// Whether no further pass follows.
    pub is_last: bool,
    /// The picture, and what it took.
    pub output: PassOutput,
}

/// Renders on threads of its own. Dropping it ends them.
#[derive(Debug)]
pub struct Preview {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What waits to be rendered.
#[derive(Debug)]
struct Request {
    scene: PreviewScene,
    passes: Passes,
}

#[derive(Debug, Default)]
struct Shared {
    inbox: Inbox<Request>,
    frame: Mutex<Option<Arc<PreviewFrame>>>,
    drawn_by: Mutex<DrawnBy>,
    n_frames: AtomicU64,
}

impl Preview {
    /// Starts the threads (0: one per core), which draw by the card of that choice, or without one by the processor. `wake`
    /// is called after each picture; it must not block.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(
        n_threads: usize,
        choice: GpuChoice,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let pool = ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .thread_name(|i| format!("neif-preview-{i}"))
            .start_handler(|_| lower_thread_priority(NICE))
            .build()
            .map_err(std::io::Error::other)?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("neif-preview".to_owned())
            .spawn(move || {
                lower_thread_priority(NICE);
                Worker {
                    shared: theirs,
                    pool,
                    sketch: Sketch::default(),
                    progressive: Progressive::default(),
                    lights: DiffuseLights::default(),
                    accelerator: Accelerator::new(choice),
                }
                .run(&wake);
            })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Asks for a picture instead of whatever is waiting or running; returns the request's number.
    pub fn request(&self, scene: PreviewScene, passes: Passes) -> u64 {
        self.shared.inbox.put(Request { scene, passes })
    }

    /// The newest finished picture.
    pub fn frame(&self) -> Option<Arc<PreviewFrame>> {
        let frame = self.shared.frame.lock();
        // A panic elsewhere cannot leave a half-written pointer.
        frame.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What draws, as of the newest request that was begun.
    pub fn drawn_by(&self) -> DrawnBy {
        let drawn_by = self.shared.drawn_by.lock();
        drawn_by.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How many pictures there have been: a change means news.
    pub fn n_frames(&self) -> u64 {
        self.shared.n_frames.load(Ordering::Acquire)
    }
}

impl Drop for Preview {
    fn drop(&mut self) {
        self.shared.inbox.close();
        if self
            .thread
            .take()
            .is_some_and(|thread| thread.join().is_err())
        {
            tracing::error!("the preview thread broke down (this is a bug)");
        }
    }
}

struct Worker {
    shared: Arc<Shared>,
    pool: ThreadPool,
    sketch: Sketch,
    progressive: Progressive,
    lights: DiffuseLights,
    accelerator: Accelerator,
}

impl Worker {
    fn run(mut self, wake: &(impl Fn() + Send)) {
        while let Some((number, request)) = self.shared.inbox.take() {
            self.serve(number, &request, wake);
        }
    }

    fn serve(&mut self, number: u64, request: &Request, wake: &(impl Fn() + Send)) {
        let mut picture = request.scene.clone();
        // Motion is lit by few probes; those of the last picture take longer than a frame.
        if picture.layer.is_lit() {
            let lights = &mut self.lights;
            picture.scene = (self.pool).install(|| lights.quick(&picture.scene, picture.layer));
        }
        if self.accelerator.takes(&picture) {
            let steps = request.passes.card_steps();
            if self.serve_steps((number, request), &mut picture, &steps, wake) {
                return;
            }
        }
        self.publish_who_draws();
        let motion = self.pool.install(|| self.sketch.motion_scale());
        let steps = request.passes.steps(motion);
        self.serve_steps((number, request), &mut picture, &steps, wake);
    }

    /// Makes the pictures one after the other until something newer comes; false where the graphics card failed.
    fn serve_steps(
        &mut self,
        (number, request): (u64, &Request),
        picture: &mut PreviewScene,
        steps: &[Step],
        wake: &(impl Fn() + Send),
    ) -> bool {
        // The first picture of a change is always finished; what is only a refresh may be dropped.
        let never = AtomicBool::new(false);
        let is_change = !matches!(request.passes, Passes::Only(_));
        for (i, &step) in steps.iter().enumerate() {
            if i == 1 && !self.shared.inbox.stays_quiet(REST) {
                return true;
            }
            let shared = Arc::clone(&self.shared);
            let cancel = if i == 0 && is_change {
                &never
            } else {
                shared.inbox.superseded()
            };
            let output = match step {
                Step::Card { is_fine } => match self.accelerator.draw(picture, is_fine, cancel) {
                    Attempt::Drawn(output) => Some(output),
                    Attempt::Cancelled => None,
                    Attempt::Failed => return false,
                },
                _ => self.make(picture, step, cancel),
            };
            tracing::trace!(number, ?step, is_done = output.is_some(), "pass");
            let Some(output) = output else { return true };
            self.publish_who_draws();
            let is_last = i + 1 == steps.len() || output.is_settled;
            self.publish(number, step, is_last, output);
            wake();
            if is_last || self.shared.inbox.is_superseded() {
                return true;
            }
        }
        true
    }

    fn publish_who_draws(&self) {
        let drawn_by = self.shared.drawn_by.lock();
        drawn_by
            .unwrap_or_else(PoisonError::into_inner)
            .clone_from(&self.accelerator.drawn_by);
    }

    /// One picture by the processor; `None` when cancelled.
    fn make(
        &mut self,
        picture: &mut PreviewScene,
        step: Step,
        cancel: &AtomicBool,
    ) -> Option<PassOutput> {
        let Self {
            pool,
            sketch,
            progressive,
            lights,
            ..
        } = self;
        pool.install(|| match step {
            Step::Sketch { scale, purpose } => sketch.picture(picture, scale, purpose, cancel),
            Step::Still(quality) => {
                if quality == Quality::Fine && picture.layer.is_lit() {
                    lights.prepare(&picture.scene, cancel);
                    picture.scene = lights.fine(&picture.scene, &[picture.layer], cancel)?;
                }
                progressive.pass(picture, quality, cancel)
            }
            Step::Card { .. } => None,
        })
    }

    fn publish(&self, request: u64, step: Step, is_last: bool, output: PassOutput) {
        let frame = PreviewFrame {
            request,
            scale: step.scale(),
            is_fine: step.is_fine(),
            is_last,
            output,
        };
        let newest = self.shared.frame.lock();
        *newest.unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(frame));
        self.shared.n_frames.fetch_add(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests;
