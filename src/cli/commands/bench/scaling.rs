//! `neif bench scaling`: how much faster more cores train.
//!
//! Every task of some steps is timed on one thread (its CPU clock, so that neighbours do not count); then the steps are replayed:
//! each pass hands its tasks, in order, to whichever worker is free first, and ends with the last.
//! What is in no pass, and a barrier a pass, is added.

use std::hint::black_box;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use neif::data::{Dataset, Splits};
use neif::neif::networks::hash_grid::GridConfig;
use neif::render::preview::thread_clock::thread_cpu;
use neif::train::config::TrainConfig;
use neif::train::{Fast, TaskClock, Trainer};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

use super::Common;
use super::train::{STEADY, time_in_turns, warmed_up};
use super::trial::{on_threads, quantile, rounded};
use crate::cli::failure::Failure;
use crate::cli::{interrupt, output};

/// Workers that are imagined.
const WORKERS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Bytes that an update of a parameter reads and writes: itself, its gradient and two moments, and its copy in bf16.
const UPDATE_BYTES: f64 = 34.0;
/// Readings of the clock that tell what one takes.
const READINGS: u32 = 1000;
/// Empty passes whose median is the cost of a barrier.
const BARRIERS: usize = 2000;

#[derive(Debug, clap::Args)]
pub(crate) struct ScalingArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps that are timed task by task
    #[arg(long, value_name = "N", default_value_t = 50)]
    steps: u64,
    /// Steps before them
    #[arg(long, value_name = "N", default_value_t = 500)]
    warm_up: u64,
    /// Memory bandwidth of the imagined machine, GB/s
    #[arg(long, value_name = "GB/S", default_value_t = 200.0)]
    bandwidth: f64,
    #[command(flatten)]
    common: Common,
}

/// A pass of a step: its tasks' times in order, nanoseconds.
#[derive(Debug)]
struct Pass {
    name: &'static str,
    tasks: Vec<u64>,
}

/// Keeps the times of a step's tasks.
#[derive(Debug, Default)]
struct Recorder {
    passes: Mutex<Vec<Pass>>,
}

impl Recorder {
    fn with<T>(&self, act: impl FnOnce(&mut Vec<Pass>) -> T) -> T {
        act(&mut self.passes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl TaskClock for Recorder {
    fn now(&self) -> u64 {
        thread_cpu().as_nanos() as u64
    }

    fn begin(&self, name: &'static str) {
        let tasks = Vec::new();
        self.with(|passes| passes.push(Pass { name, tasks }));
    }

    fn done(&self, start: u64) {
        let taken = self.now().saturating_sub(start);
        self.with(|passes| passes.last_mut().map(|pass| pass.tasks.push(taken)));
    }
}

/// Means over steps, nanoseconds a step.
#[derive(Debug, Default)]
struct PassMean {
    name: &'static str,
    /// Number of tasks.
    tasks: f64,
    /// From its first task to its last.
    span: f64,
}

/// A number of workers, replayed.
#[derive(Debug, Default)]
struct Replay {
    workers: usize,
    passes: Vec<PassMean>,
    /// Outside of all passes.
    serial: f64,
    barriers: f64,
    /// For which memory makes workers wait.
    waiting: f64,
}

impl Replay {
    /// A step, nanoseconds.
    fn step(&self) -> f64 {
        let spans: f64 = self.passes.iter().map(|pass| pass.span).sum();
        spans + self.serial + self.barriers + self.waiting
    }

    /// Adds a step's passes to the sums.
    fn add(&mut self, passes: &[Pass]) {
        for pass in passes {
            let at = self.passes.iter().position(|mean| mean.name == pass.name);
            let at = at.unwrap_or_else(|| {
                self.passes.push(PassMean {
                    name: pass.name,
                    ..PassMean::default()
                });
                self.passes.len() - 1
            });
            let mean = &mut self.passes[at];
            mean.tasks += pass.tasks.len() as f64;
            mean.span += span(&pass.tasks, self.workers) as f64;
        }
    }

    fn divide(&mut self, n_steps: f64) {
        for pass in &mut self.passes {
            for value in [&mut pass.tasks, &mut pass.span] {
                *value /= n_steps;
            }
        }
        self.serial /= n_steps;
    }
}

/// When the last of `tasks` ends, if each goes to the worker that is free first.
fn span(tasks: &[u64], workers: usize) -> u64 {
    let mut ends = vec![0_u64; workers.max(1)];
    for task in tasks {
        if let Some(first) = ends.iter_mut().min() {
            *first += task;
        }
    }
    ends.into_iter().max().unwrap_or(0)
}

pub(super) fn run(args: &ScalingArgs) -> Result<(), Failure> {
    let dataset = args.common.load(args.dataset.as_ref(), Splits::TRAIN_VAL)?;
    let config = args.common.config(None)?;
    let cores = args.common.n_threads();
    let mut replays = replays(args, &config, &dataset)?;
    let barrier = barrier_nanos(cores)?;
    let grids = [config.field.grid, config.material.grid];
    let levels = grids.iter().flat_map(GridConfig::levels);
    let bytes = UPDATE_BYTES * levels.map(|level| level.n_values() as f64).sum::<f64>();
    for replay in &mut replays {
        let depth = (replay.workers as f64).log2();
        replay.barriers = barrier * depth * replay.passes.len() as f64;
        let update = replay.passes.iter().find(|pass| pass.name == "update");
        let span = update.map_or(0.0, |pass| pass.span);
        replay.waiting = (bytes / args.bandwidth - span).max(0.0);
    }
    let one = replays[0].step();
    let counts: Vec<usize> = WORKERS.into_iter().filter(|n| *n <= cores).collect();
    let measured = time_in_turns(&config, &dataset, &counts, 10 * args.steps)?;
    let rows: Vec<Row> = replays
        .iter()
        .map(|replay| {
            let times = measured.iter().find(|t| t.threads == replay.workers);
            Row {
                workers: replay.workers,
                step_ms: replay.step() * 1e-6,
                predicted: one / replay.step(),
                measured: times.map(|t| quantile(&t.gains_over(&measured[0]), 0.5)),
                serial_ms: replay.serial * 1e-6,
                barriers_ms: replay.barriers * 1e-6,
                waiting_ms: replay.waiting * 1e-6,
            }
        })
        .collect();
    if args.common.json {
        let passes = |r: &Replay| {
            let pass =
                |p: &PassMean| json!({"name": p.name, "tasks": p.tasks, "span_ms": p.span * 1e-6});
            r.passes.iter().map(pass).collect::<Vec<_>>()
        };
        return Ok(output::json_line(&json!({
            "barrier_us": barrier * 1e-3, "update_megabytes": bytes * 1e-6, "workers": rows,
            "passes": replays.iter().map(passes).collect::<Vec<_>>(),
        }))?);
    }
    print(&replays, &rows, barrier, bytes)
}

#[derive(Serialize)]
struct Row {
    workers: usize,
    step_ms: f64,
    predicted: f64,
    measured: Option<f64>,
    serial_ms: f64,
    barriers_ms: f64,
    waiting_ms: f64,
}

fn print(replays: &[Replay], rows: &[Row], barrier: f64, bytes: f64) -> Result<(), Failure> {
    output::line(&format!(
        "a barrier of two workers takes {:.1} us, an update touches at most {:.0} MB\n",
        barrier * 1e-3,
        bytes * 1e-6
    ))?;
    let line = |r: &Row| {
        format!(
            "| {} | {:.3} | {:.2} | {} | {:.3} | {:.3} | {:.3} |",
            r.workers,
            r.step_ms,
            r.predicted,
            rounded(r.measured, 2),
            r.serial_ms,
            r.barriers_ms,
            r.waiting_ms
        )
    };
    let header =
        "| workers | ms a step | predicted x | measured x | serial ms | barriers ms | memory ms |";
    output::table(header, rows.iter().map(line))?;
    output::line("")?;
    let line = |(i, one): (usize, &PassMean)| {
        let spans = replays
            .iter()
            .map(|r| format!("{:.2}", r.passes[i].span * 1e-6));
        let spans: Vec<String> = spans.collect();
        format!(
            "| {} | {:.0} | {} |",
            one.name,
            one.tasks,
            spans.join(" | ")
        )
    };
    let workers: Vec<String> = replays.iter().map(|r| r.workers.to_string()).collect();
    let header = format!("| pass | tasks | ms by {} |", workers.join(" | "));
    let passes = replays[0].passes.iter().enumerate();
    Ok(output::table(&header, passes.map(line))?)
}

/// Times the tasks of some steps, and replays them for each number of workers.
fn replays(
    args: &ScalingArgs,
    config: &TrainConfig,
    dataset: &Dataset,
) -> Result<Vec<Replay>, Failure> {
    let mut trainer = warmed_up(config, dataset, args.common.threads, args.warm_up)?;
    let of = |workers| Replay {
        workers,
        ..Replay::default()
    };
    let mut replays: Vec<Replay> = WORKERS.into_iter().map(of).collect();
    on_threads(1, || {
        for _ in 0..args.steps {
            interrupt::check()?;
            let (passes, serial) = recorded(&mut trainer);
            for replay in &mut replays {
                replay.serial += serial;
                replay.add(&passes);
            }
        }
        Ok(())
    })?;
    for replay in &mut replays {
        replay.divide(args.steps as f64);
    }
    Ok(replays)
}

/// The passes of a step, and what is in none of them, nanoseconds.
fn recorded(trainer: &mut Trainer<Fast>) -> (Vec<Pass>, f64) {
    let (recorder, reading) = (Recorder::default(), clock_nanos());
    let start = recorder.now();
    trainer.step_by_task(STEADY, &recorder);
    let taken = recorder.now().saturating_sub(start);
    let mut passes = recorder.with(std::mem::take);
    // A task's own time has one reading of the clock in it, and one lies beside it.
    let (mut work, mut beside) = (0, 0.0);
    for task in passes.iter_mut().flat_map(|pass| &mut pass.tasks) {
        work += *task;
        beside += reading;
        *task = task.saturating_sub(reading as u64);
    }
    (
        passes,
        (taken.saturating_sub(work) as f64 - beside).max(0.0),
    )
}

/// What it takes to read the clock, nanoseconds.
fn clock_nanos() -> f64 {
    let start = thread_cpu();
    for _ in 0..READINGS {
        black_box(thread_cpu());
    }
    thread_cpu().saturating_sub(start).as_nanos() as f64 / f64::from(READINGS)
}

/// What a pass costs on two of this machine's cores beyond its tasks, nanoseconds; 0 where there is one.
fn barrier_nanos(cores: usize) -> Result<f64, Failure> {
    if cores < 2 {
        return Ok(0.0);
    }
    on_threads(2, || {
        let pass = |_| {
            let start = Instant::now();
            [0_u8; 16].par_iter().with_max_len(1).for_each(|_| ());
            start.elapsed().as_nanos() as f64
        };
        let times: Vec<f64> = (0..BARRIERS).map(pass).collect();
        Ok(quantile(&times, 0.5))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_go_to_whoever_is_free() {
        assert_eq!(span(&[5, 3, 2, 2], 1), 12);
        assert_eq!(span(&[5, 3, 2, 2], 2), 7);
        assert_eq!(span(&[5, 3, 2, 2], 8), 5);
        assert_eq!(span(&[], 3), 0);
    }

    #[test]
    fn a_step_is_its_passes_and_what_is_in_none() {
        let mut replay = Replay {
            workers: 2,
            serial: 10.0,
            ..Replay::default()
        };
        let pass = |name, tasks: &[u64]| Pass {
            name,
            tasks: tasks.to_vec(),
        };
        replay.add(&[pass("a", &[4, 4]), pass("b", &[6])]);
        replay.add(&[pass("a", &[2, 2]), pass("b", &[6])]);
        replay.divide(2.0);
        assert!(
            (replay.step() - (3.0 + 6.0 + 5.0)).abs() < 1e-9,
            "{replay:?}"
        );
    }
}
