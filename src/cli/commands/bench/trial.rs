//! One training run of a benchmark, without run folder, window or validation: the trainer and a clock.

use std::time::Instant;

use neif::data::{Dataset, View};
use neif::neif::neilf::NeilfModel;
use neif::train::config::TrainConfig;
use neif::train::measure::eval::{Measures, evaluate_object, evaluate_views, mean_of_views};
use neif::train::measure::lpips::Lpips;
use neif::train::measure::metrics::{ImageMetrics, mean};
use neif::train::neilf::NeilfConfig;
use neif::train::{Neilf, Snapshot, new_trainer};

use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::interrupt;

/// How long to train.
#[derive(Clone, Copy, Debug)]
pub(super) enum Length {
    /// Wall time from the start, the tracing of the pixels included.
    Seconds(f64),
    Steps(u64),
}

/// What a run took and left.
#[derive(Debug)]
pub(super) struct Trial {
    /// Steps taken.
    pub(super) steps: u64,
    /// Steps that learned nothing because a value was not finite.
    pub(super) skipped: u64,
    /// The last of them.
    pub(super) last_skipped: Option<u64>,
    /// Wall time of the steps, seconds.
    pub(super) step_secs: f64,
    /// Processor time of the steps, all threads, seconds.
    pub(super) cpu_secs: f64,
    /// Field rays of all steps.
    pub(super) rays: u64,
    /// The trained fields.
    pub(super) snapshot: Snapshot,
}

impl Trial {
    /// Field rays a second of wall time.
    pub(super) fn rays_per_sec(&self) -> f64 {
        self.rays as f64 / self.step_secs.max(1e-9)
    }
}

/// Runs `work` on a pool of `threads` threads (0 is one a core).
pub(super) fn on_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    pool.install(work)
}

/// Trains on the current thread pool; `on_step` gets the share that is done.
pub(super) fn train(
    config: &TrainConfig,
    dataset: &Dataset,
    length: Length,
    on_step: &mut dyn FnMut(f32),
) -> Result<Trial, Failure> {
    let cancel = interrupt::install()?;
    let begin = Instant::now();
    let mut trainer = new_trainer(config, dataset, cancel, &|_| ()).or_unusable()?;
    let (start, cpu_start) = (Instant::now(), process_cpu_secs());
    let mut rays = 0;
    let mut last_skipped = None;
    take_steps(length, begin, &mut |done| {
        let stats = trainer.step(done);
        rays += u64::from(stats.rays);
        if stats.skipped {
            last_skipped = Some(trainer.steps());
        }
        on_step(done);
    })?;
    Ok(Trial {
        steps: trainer.steps(),
        skipped: trainer.skipped_steps(),
        last_skipped,
        step_secs: start.elapsed().as_secs_f64(),
        cpu_secs: process_cpu_secs() - cpu_start,
        rays,
        snapshot: trainer.snapshot(),
    })
}

/// The same for a baseline: the trained model alone.
pub(super) fn train_neilf(
    config: &TrainConfig,
    neilf: &NeilfConfig,
    dataset: &Dataset,
    length: Length,
    on_step: &mut dyn FnMut(f32),
) -> Result<NeilfModel, Failure> {
    let cancel = interrupt::install()?;
    let begin = Instant::now();
    let mut trainer = Neilf::trainer(config, neilf, dataset, cancel).or_unusable()?;
    take_steps(length, begin, &mut |done| {
        trainer.step(done);
        on_step(done);
    })?;
    Ok(trainer.trained())
}

/// Calls `step` with the share that is done, from the end of the setup that began at `begin` until the length is over.
fn take_steps(length: Length, begin: Instant, step: &mut dyn FnMut(f32)) -> Result<(), Failure> {
    let setup_secs = begin.elapsed().as_secs_f64();
    let start = Instant::now();
    let mut steps = 0;
    loop {
        let done = match length {
            Length::Seconds(secs) => start.elapsed().as_secs_f64() / (secs - setup_secs).max(1e-3),
            Length::Steps(n) => steps as f64 / n.max(1) as f64,
        };
        if done >= 1.0 {
            return Ok(());
        }
        interrupt::check()?;
        step(done as f32);
        steps += 1;
    }
}

/// Mean quality of the rendered views.
pub(super) fn measure(
    snapshot: &Snapshot,
    views: &[View],
    lpips: Option<&Lpips>,
) -> Result<ImageMetrics, Failure> {
    let cancel = interrupt::install()?;
    let measures = Measures {
        exposures: snapshot.exposures.as_deref(),
        lpips,
        fitted: None,
    };
    let scene = snapshot.scene();
    let results = evaluate_views(&scene, views, measures, cancel, &mut |_, _, _| ());
    let mean = results.map(|results| mean_of_views(&results));
    mean.ok_or(Failure::Interrupted)
}

/// The same for a baseline: what it explains of the views.
pub(super) fn measure_neilf(model: &NeilfModel, views: &[View]) -> Result<ImageMetrics, Failure> {
    let cancel = interrupt::install()?;
    let metrics = evaluate_object(model, views, cancel).ok_or(Failure::Interrupted)?;
    Ok(mean(&metrics))
}

/// Processor time of the process, all threads together.
#[cfg(unix)]
pub(super) fn process_cpu_secs() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Elsewhere the wall clock must do.
#[cfg(not(unix))]
pub(super) fn process_cpu_secs() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

/// A quantile of some values; 0 without any.
pub(super) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (sorted.len() as f64 * share) as usize;
    let at = at.min(sorted.len().saturating_sub(1));
    sorted.get(at).copied().unwrap_or(0.0)
}

/// A figure with so many digits after the point, or a dash.
pub(super) fn rounded(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{v:.digits$}"))
}

/// A figure with two digits, or a dash.
pub(super) fn figure(value: Option<f64>) -> String {
    rounded(value, 2)
}
