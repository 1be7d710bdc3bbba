//! `neif bench train`: where the time of a step goes, and how near the kernels are to what this machine can do.

use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

use neif::data::{Dataset, Splits};
use neif::neif::kernels::peak;
use neif::neif::networks::hash_grid::{
    FEATURES, FeatureColumns, SamplePoints, encode_level, scatter_level,
};
use neif::neif::networks::mlp::{Mlp, MlpBuffers};
use neif::train::config::TrainConfig;
use neif::train::{Fast, Stage, Trainer};
use serde::Serialize;
use serde_json::json;
use strum::VariantArray as _;

use super::Common;
use super::trial::{on_threads, quantile, rounded};
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::{interrupt, output};

/// Samples of a kernel's run: about those of one of a step's eight chunks.
const N_SAMPLES: usize = 1152;
/// Runs of a kernel; the fastest counts, since neighbours only ever slow it down.
const KERNEL_RUNS: usize = 400;

#[derive(Debug, clap::Args)]
pub(crate) struct TrainBenchArgs {
    /// The capture [default: the bundled one]
    #[arg(value_name = "DATASET")]
    dataset: Option<PathBuf>,
    /// Steps that are timed, after as many untimed ones
    #[arg(long, value_name = "N", default_value_t = 500)]
    steps: u64,
    #[command(flatten)]
    common: Common,
}

/// A kernel's best run, one thread.
#[derive(Serialize)]
struct Kernel {
    name: &'static str,
    samples_per_sec: f64,
    /// GFLOP/s, where arithmetic is the limit.
    gflops: Option<f64>,
    /// GB/s of table rows touched, where memory is.
    gbytes_per_sec: Option<f64>,
}

/// Rounds that the timed steps are split into; one thread and several take turns, so that a neighbour's load on the
/// machine meets both.
const ROUNDS: u64 = 10;

/// Time of the steps by stage, and speed round by round.
pub(super) struct StepTimes {
    pub(super) threads: usize,
    pub(super) rays_per_sec: Vec<f64>,
    stage_secs: Vec<(Stage, f64)>,
}

impl StepTimes {
    /// How many times as fast as `one`, of each pair of rounds, in order.
    pub(super) fn gains_over(&self, one: &Self) -> Vec<f64> {
        let pairs = self.rays_per_sec.iter().zip(&one.rays_per_sec);
        let mut gains: Vec<f64> = pairs.map(|(many, one)| many / one).collect();
        gains.sort_by(f64::total_cmp);
        gains
    }
}

pub(super) fn run(args: &TrainBenchArgs) -> Result<(), Failure> {
    let dataset = args.common.load(args.dataset.as_ref(), Splits::TRAIN_VAL)?;
    let config = args.common.config(None)?;
    let (peak_gflops, peak_gbytes) = (peak::gflops(), peak::read_gbytes_per_sec());
    let kernels = kernels(&config);
    let mut counts = vec![1, args.common.n_threads()];
    counts.dedup();
    let times = time_in_turns(&config, &dataset, &counts, args.steps)?;
    if args.common.json {
        let step = |t: &StepTimes| {
            let stage =
                |(s, secs): &(Stage, f64)| json!({"stage": format!("{s:?}"), "seconds": secs});
            json!({
                "threads": t.threads, "rays_per_sec": quantile(&t.rays_per_sec, 0.5), "rounds": t.rays_per_sec,
                "stages": t.stage_secs.iter().map(stage).collect::<Vec<_>>(),
            })
        };
        let steps: Vec<_> = times.iter().map(step).collect();
        return Ok(output::json_line(&json!({
            "peak_gflops": peak_gflops, "peak_gbytes_per_sec": peak_gbytes,
            "kernels": kernels, "steps": steps,
        }))?);
    }
    output::line(&format!(
        "one thread of this machine: {peak_gflops:.1} GFLOP/s, {peak_gbytes:.1} GB/s\n"
    ))?;
    let line = |k: &Kernel| {
        format!(
            "| {} | {:.2} | {} | {} | {} |",
            k.name,
            k.samples_per_sec * 1e-6,
            rounded(k.gflops, 1),
            rounded(k.gflops.map(|g| g / peak_gflops), 2),
            rounded(k.gbytes_per_sec, 1),
        )
    };
    let header = "| kernel, one thread | M samples/s | GFLOP/s | of the peak | GB/s of rows |";
    output::table(header, kernels.iter().map(line))?;
    for t in &times {
        output::line(&format!(
            "\n{} thread(s): {:.0} rays/s",
            t.threads,
            quantile(&t.rays_per_sec, 0.5)
        ))?;
        let total: f64 = t.stage_secs.iter().map(|(_, secs)| secs).sum();
        for (stage, secs) in &t.stage_secs {
            output::line(&format!(
                "  {:10} {:5.1} %  {:.3} ms a step",
                format!("{stage:?}"),
                100.0 * secs / total,
                secs * 1e3 / (ROUNDS * args.steps.div_ceil(ROUNDS)) as f64
            ))?;
        }
    }
    if let [one, many] = times.as_slice() {
        let gains = many.gains_over(one);
        output::line(&format!(
            "\n{} threads are {:.2} x as fast as one (median of {ROUNDS} pairs, {:.2} to {:.2})",
            many.threads,
            quantile(&gains, 0.5),
            gains[0],
            gains[gains.len() - 1],
        ))?;
    }
    Ok(())
}

/// Where in the plan steps are timed: in its middle, where the batch has its mean size.
pub(super) const STEADY: f32 = 0.5;

/// A trainer after so many untimed steps.
pub(super) fn warmed_up(
    config: &TrainConfig,
    dataset: &Dataset,
    threads: usize,
    steps: u64,
) -> Result<Trainer<Fast>, Failure> {
    on_threads(threads, || {
        let cancel = interrupt::install()?;
        let mut trainer = Fast::trainer(config, dataset, cancel, &|_| ()).or_unusable()?;
        trainer.trace_rest();
        for _ in 0..steps {
            interrupt::check()?;
            trainer.step(STEADY);
        }
        Ok(trainer)
    })
}

/// Times `steps` steps with each number of threads, in turns, after as many untimed ones.
pub(super) fn time_in_turns(
    config: &TrainConfig,
    dataset: &Dataset,
    counts: &[usize],
    steps: u64,
) -> Result<Vec<StepTimes>, Failure> {
    let mut all = Vec::new();
    for &threads in counts {
        let trainer = warmed_up(config, dataset, threads, steps)?;
        let times = StepTimes {
            threads,
            rays_per_sec: Vec::new(),
            stage_secs: Stage::VARIANTS.iter().map(|stage| (*stage, 0.0)).collect(),
        };
        all.push((trainer, times));
    }
    for _ in 0..ROUNDS {
        for (trainer, times) in &mut all {
            on_threads(times.threads, || {
                time_steps(trainer, steps.div_ceil(ROUNDS), times)
            })?;
        }
    }
    Ok(all.into_iter().map(|(_, times)| times).collect())
}

/// Adds a round's times.
fn time_steps(
    trainer: &mut Trainer<Fast>,
    steps: u64,
    times: &mut StepTimes,
) -> Result<(), Failure> {
    let start = Instant::now();
    let mut last = start;
    let mut rays = 0;
    for _ in 0..steps {
        interrupt::check()?;
        let mut on_done = |stage| {
            let now = Instant::now();
            let stages = times.stage_secs.iter_mut();
            for (_, secs) in stages.filter(|(s, _)| *s == stage) {
                *secs += (now - last).as_secs_f64();
            }
            last = now;
        };
        rays += u64::from(trainer.step_by_stage(STEADY, &mut on_done).rays);
    }
    let secs = start.elapsed().as_secs_f64();
    times.rays_per_sec.push(rays as f64 / secs);
    Ok(())
}

/// The fastest of many runs, in seconds.
fn best_secs(mut run: impl FnMut()) -> f64 {
    (0..KERNEL_RUNS)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn kernels(config: &TrainConfig) -> Vec<Kernel> {
    let net = Mlp {
        n_in: config.field.grid.n_features(),
        n_hidden: config.field.n_hidden,
        n_out: 16,
    };
    let multiply_adds = (net.n_in * net.n_hidden + net.n_hidden * net.n_out) as f64;
    let wave = |n: usize, scale: f32| -> Vec<f32> {
        (0..n).map(|i| (i as f32 * 0.37).sin() * scale).collect()
    };
    let params = wave(net.n_params(), 0.2);
    let mut transposed = vec![0.0; params.len()];
    net.transpose(&params, &mut transposed);
    let input = wave(N_SAMPLES * net.n_in, 1.0);
    let mut buffers = MlpBuffers::default();
    let forward = best_secs(|| net.forward(&params, &input, &mut buffers));
    buffers.d_output = wave(N_SAMPLES * net.n_out, 1e-3);
    let mut d_params = vec![0.0; net.n_params()];
    let both = best_secs(|| {
        net.forward(&params, &input, &mut buffers);
        net.backward(&transposed, &input, &mut buffers, &mut d_params);
    });
    black_box(&d_params);
    let flops =
        |secs: f64, passes: f64| 2.0 * passes * multiply_adds * N_SAMPLES as f64 / secs * 1e-9;
    let mut kernels = vec![
        Kernel {
            name: "network forward",
            samples_per_sec: N_SAMPLES as f64 / forward,
            gflops: Some(flops(forward, 1.0)),
            gbytes_per_sec: None,
        },
        Kernel {
            name: "network forward and backward",
            samples_per_sec: N_SAMPLES as f64 / both,
            gflops: Some(flops(both, 3.0)),
            gbytes_per_sec: None,
        },
    ];
    kernels.extend(grid_kernels(config));
    kernels
}

/// Encoding and scattering of the finest level, with the samples of straight rays.
fn grid_kernels(config: &TrainConfig) -> [Kernel; 2] {
    let Some(level) = config.field.grid.levels().pop() else {
        unreachable!("a grid has at least four levels")
    };
    let positions: Vec<[f32; 3]> = (0..N_SAMPLES)
        .map(|i| {
            let (ray, t) = ((i / 16) as f32, (i % 16) as f32 / 16.0);
            [
                0.5 + 0.4 * (ray * 1.3).sin() * t,
                0.5 + 0.4 * (ray * 2.1).cos() * t,
                0.3 + 0.4 * t,
            ]
        })
        .collect();
    let footprints = vec![1e-4; N_SAMPLES];
    let points = SamplePoints {
        positions: &positions,
        footprints: &footprints,
    };
    let mut table = vec![0.5; level.n_entries * FEATURES];
    let mut out = vec![0.0; N_SAMPLES * FEATURES];
    let encode = best_secs(|| encode_level(&level, &table, points, &mut out));
    let layout = FeatureColumns {
        stride: FEATURES,
        column: 0,
    };
    let scatter = best_secs(|| scatter_level(&level, points, &out, layout, &mut table));
    let row_bytes = (8 * FEATURES * size_of::<f32>() * N_SAMPLES) as f64;
    [
        ("finest level, encode", encode, 1.0),
        ("finest level, scatter", scatter, 2.0),
    ]
    .map(|(name, secs, passes)| Kernel {
        name,
        samples_per_sec: N_SAMPLES as f64 / secs,
        gflops: None,
        gbytes_per_sec: Some(passes * row_bytes / secs * 1e-9),
    })
}
