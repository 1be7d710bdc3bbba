//! A window without a window: the preview, its driver and a picture that changes, as the real window has them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, bounded};
use glam::Vec3;
use neif::app::viewport::camera_control::{CameraMove, Viewpoint};
use neif::app::work::pace::Pace;
use neif::app::work::preview_driver::{PreviewDriver, Situation};
use neif::neif::{Environment, EnvironmentTransform, MaterialEdit};
use neif::render::{GpuChoice, Layer, Preview, PreviewScene};
use neif::train::Snapshot;

use crate::cli::failure::Failure;
use crate::cli::interrupt;

/// Time between two frames of the window while something is dragged.
const TICK: Duration = Duration::from_millis(8);
/// Longest that a picture is waited for.
const PATIENCE: Duration = Duration::from_mins(2);

/// A picture that arrived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// When, seconds since the desk was made.
    pub(super) at_secs: f64,
    pub(super) request: u64,
    /// Resolution divisor per axis.
    pub(super) scale: u32,
    /// Whether no better one follows.
    pub(super) is_last: bool,
    /// Processor time of the pass, seconds.
    pub(super) cpu_secs: f64,
}

/// What is changed by hand.
#[derive(Clone, Debug, Default)]
pub(super) struct Look {
    pub(super) edit: MaterialEdit,
    pub(super) transform: EnvironmentTransform,
    pub(super) environment: Option<Arc<Environment>>,
}

/// The preview and what the window knows of it.
pub(super) struct Desk {
    preview: Preview,
    driver: PreviewDriver,
    news: Receiver<()>,
    started: Instant,
    n_cores: usize,
    n_frames: u64,
    size: (u32, u32),
    pub(super) viewpoint: Viewpoint,
    pub(super) look: Look,
    /// Whether steps are being taken, and for how long they have been.
    pub(super) training_secs: Option<f64>,
    /// How training and the preview share the processor.
    pub(super) pace: Pace,
    /// All pictures so far.
    pub(super) seen: Vec<Seen>,
    newest_request: u64,
}

impl Desk {
    /// A viewport of `size` pixels that looks at the origin.
    pub(super) fn new(size: (u32, u32)) -> Result<Self, Failure> {
        let (wake, news) = bounded(1);
        // A full queue means that the news is known already.
        let wake = move || wake.try_send(()).unwrap_or_default();
        let preview = Preview::new(0, GpuChoice::Off, wake)?;
        Ok(Self {
            preview,
            driver: PreviewDriver::default(),
            news,
            started: Instant::now(),
            n_cores: std::thread::available_parallelism().map_or(1, usize::from),
            n_frames: 0,
            size,
            viewpoint: Viewpoint::look_at(Vec3::new(2.0, -2.0, 1.0), Vec3::ZERO, Vec3::Z),
            look: Look::default(),
            training_secs: None,
            pace: Pace::default(),
            seen: Vec::new(),
            newest_request: 0,
        })
    }

    /// Seconds since the desk was made.
    pub(super) fn now_secs(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Turns the camera about its pivot, radians.
    pub(super) fn orbit(&mut self, yaw: f32, up: Vec3) {
        let movement = CameraMove::Orbit { yaw, pitch: 0.0 };
        self.viewpoint.apply(movement, up);
    }

    /// What the window does in a frame: takes a picture in, asks for what is missing. Waits at most a tick for news.
    pub(super) fn tick(&mut self, snapshot: &Arc<Snapshot>) {
        self.ask(snapshot);
        // Nothing within the tick is no error.
        self.news.recv_timeout(TICK).unwrap_or_default();
        self.take();
    }

    fn ask(&mut self, snapshot: &Arc<Snapshot>) {
        let situation = Situation {
            now_secs: self.now_secs(),
            is_training: self.training_secs.is_some(),
            trained_secs: self.training_secs.unwrap_or(0.0),
            n_cores: self.n_cores,
            drag_share: self.pace.drag_share(),
        };
        let camera = self.viewpoint.camera_for(self.size.0, self.size.1);
        let look = &self.look;
        let scene = |snapshot: &Snapshot| {
            let mut scene = snapshot.scene();
            scene.edit = look.edit;
            scene.transform = look.transform;
            if let Some(environment) = &look.environment {
                scene.environment = Arc::clone(environment);
            }
            PreviewScene {
                scene,
                camera,
                layer: Layer::Final,
                highlight: None,
            }
        };
        if let Some(wanted) = self.driver.decide(snapshot, scene, &situation) {
            let number = self.preview.request(wanted.scene, wanted.passes);
            self.driver.was_requested(number);
            self.newest_request = number;
        }
    }

    fn take(&mut self) {
        let n_frames = self.preview.n_frames();
        if n_frames == self.n_frames {
            return;
        }
        self.n_frames = n_frames;
        let Some(frame) = self.preview.frame() else {
            return;
        };
        if self.driver.was_shown(&frame).is_some() {
            self.seen.push(Seen {
                at_secs: self.now_secs(),
                request: frame.request,
                scale: frame.scale,
                is_last: frame.is_last,
                cpu_secs: frame.output.cpu_secs,
            });
        }
    }

    /// Ticks, with `change` before each, for `secs`; the pictures that came.
    pub(super) fn run(
        &mut self,
        secs: f64,
        mut snapshot: impl FnMut() -> Arc<Snapshot>,
        mut change: impl FnMut(&mut Self, f64),
    ) -> Result<Vec<Seen>, Failure> {
        let (start, first) = (self.now_secs(), self.seen.len());
        while self.now_secs() - start < secs {
            let since = self.now_secs() - start;
            change(self, since);
            self.tick(&snapshot());
            interrupt::check()?;
        }
        Ok(self.seen[first..].to_vec())
    }

    /// Changes something once and waits for the first picture of it that is `enough`; how long that took, seconds.
    pub(super) fn time_to(
        &mut self,
        snapshot: &Arc<Snapshot>,
        change: impl FnOnce(&mut Self),
        enough: impl Fn(&Seen) -> bool,
    ) -> Result<f64, Failure> {
        let (start, first) = (self.now_secs(), self.seen.len());
        change(self);
        self.ask(snapshot);
        let wanted = self.newest_request;
        loop {
            let good = |seen: &&Seen| seen.request >= wanted && enough(seen);
            if let Some(seen) = self.seen[first..].iter().find(good) {
                return Ok(seen.at_secs - start);
            }
            if self.now_secs() - start > PATIENCE.as_secs_f64() {
                return Err(Failure::Failed(anyhow::anyhow!(
                    "no picture within {} s",
                    PATIENCE.as_secs()
                )));
            }
            self.tick(snapshot);
            interrupt::check()?;
        }
    }
}
