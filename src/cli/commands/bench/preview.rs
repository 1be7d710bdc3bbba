//! `neif bench preview`: how quickly the preview answers, with and without training beside it.
//!
//! Drives the window's own preview and the driver that decides what it renders, without a window. Frames of the window
//! itself are in its log: `NEIF_LOG=neif=trace neif view PATH` writes a line `drawing` for each frame, with the seconds
//! since the start, and a line `preview` for each picture that is shown.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use glam::Vec3;
use neif::app::viewport::camera_control::Viewpoint;
use neif::neif::{Environment, MaterialEdit, RoughnessEdit};
use neif::render::library::Library;
use neif::train::Snapshot;
use neif::train::session::events::{TrainCommand, TrainEvent};
use neif::train::session::handle::Session;
use neif::train::session::options::SessionOptions;
use neif::train::session::plan::Budget;
use neif::train::session::saved::run_folder::RunFolder;
use serde::Serialize;
use serde_json::json;

use super::desk::{Desk, Seen};
use super::trial::{process_cpu_secs, quantile, rounded};
use super::{Common, dataset_or_demo};
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::scenes::open_run;
use crate::cli::{interrupt, output};

/// Repetitions of a single change.
const REPEATS: usize = 9;
/// How long something is dragged, and how long training is watched, seconds.
const WATCH_SECS: f64 = 8.0;
/// Speed of an orbit, radians a second: once around in ten seconds.
const ORBIT: f32 = 0.63;
/// Training beyond any benchmark.
const ENDLESS_SECS: f64 = 3600.0;

#[derive(Debug, clap::Args)]
pub(crate) struct PreviewArgs {
    /// A run, or a capture, which is trained first [default: the bundled capture]
    #[arg(value_name = "RUN|DATASET")]
    path: Option<PathBuf>,
    /// Training before the first figure, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 15.0)]
    warm_up: f64,
    /// Pixels per row of the viewport
    #[arg(long, value_name = "N", default_value_t = 1280)]
    width: u32,
    /// Rows of the viewport
    #[arg(long, value_name = "N", default_value_t = 800)]
    height: u32,
    #[command(flatten)]
    common: Common,
}

/// One figure of the report.
#[derive(Debug, Default, Serialize)]
struct Row {
    name: &'static str,
    unit: &'static str,
    value: f64,
    /// Median and 99th percentile of the single times, milliseconds, and the coarsest resolution divisor among them.
    median_ms: Option<f64>,
    p99_ms: Option<f64>,
    scale: Option<u32>,
    /// Mean processor time of a picture, milliseconds.
    cpu_ms: Option<f64>,
}

pub(super) fn run(args: &PreviewArgs) -> Result<(), Failure> {
    let mut display = args.common.display();
    let path = dataset_or_demo(args.path.as_ref())?;
    let (dataset, trained) = if RunFolder::is_run(&path) {
        let run = open_run(&path, None)?;
        (run.dataset, Some(run.scene))
    } else {
        (path, None)
    };
    let mut bench = Bench::start(args, &dataset)?;
    let mut rows = vec![bench.first_picture()?];
    display.set(0.2, "training", "");
    rows.extend(bench.beside_training(args.warm_up)?);
    if let Some(scene) = trained {
        bench.snapshot = Arc::new(Snapshot {
            step: 0,
            object: scene.object,
            environment: scene.environment,
            exposures: None,
        });
    }
    display.set(0.6, "paused", "");
    rows.extend(bench.paused()?);
    display.finish();
    report(args, &rows)
}

/// The desk, the session beside it and what is shown.
struct Bench {
    desk: Desk,
    session: Session,
    snapshot: Arc<Snapshot>,
    started: Instant,
    up: Vec3,
    /// Step and seconds of the last report of training.
    progress: (u64, f64),
}

impl Bench {
    /// Starts training and waits for its first snapshot.
    fn start(args: &PreviewArgs, dataset: &Path) -> Result<Self, Failure> {
        interrupt::install()?;
        let mut config = args.common.config(None)?;
        config.threads = args.common.threads;
        let started = Instant::now();
        let desk = Desk::new((args.width, args.height))?;
        let options = SessionOptions {
            nice: true,
            choices: args.common.capture.choices(),
            ..SessionOptions::new(dataset, config, Budget::Seconds(ENDLESS_SECS))
        };
        let session = Session::spawn(options, || ()).or_unusable()?;
        let snapshot = loop {
            if let Some(snapshot) = session.snapshot() {
                break snapshot;
            }
            if session.is_over() {
                session.join().or_unusable()?;
                return Err(Failure::Failed(anyhow::anyhow!("training ended at once")));
            }
            std::thread::sleep(Duration::from_millis(2));
        };
        Ok(Self {
            desk,
            session,
            snapshot,
            started,
            up: Vec3::Z,
            progress: (0, 0.0),
        })
    }

    fn first_picture(&mut self) -> Result<Row, Failure> {
        let dataset = self.session.dataset().context("the capture was read")?;
        let view = dataset.train.first().context("the capture has no photo")?;
        let bounds = dataset.mesh.as_ref().map(|mesh| mesh.bounds().center());
        let pivot = bounds.unwrap_or_else(|| view.camera.position() + view.camera.forward());
        self.desk.viewpoint = Viewpoint::of_camera(&view.camera, pivot);
        self.up = self.snapshot.environment.up();
        self.desk.training_secs = Some(0.0);
        let snapshot = Arc::clone(&self.snapshot);
        self.desk.time_to(&snapshot, |_| (), |_| true)?;
        let secs = self.started.elapsed().as_secs_f64();
        Ok(Row::new("start to first picture", "s", secs))
    }

    /// Rows with training: its speed alone, beside an idle viewport and beside one that is turned.
    fn beside_training(&mut self, warm_up: f64) -> Result<Vec<Row>, Failure> {
        self.watch(warm_up, |_| Ok(()))?;
        let before = self.watch(WATCH_SECS, |_| Ok(()))?;
        let idle = self.watch(WATCH_SECS, |bench| bench.drag(0.0).map(|_| ()))?;
        let mut seen = Vec::new();
        let orbit = self.watch(WATCH_SECS, |bench| {
            seen = bench.drag(ORBIT)?;
            Ok(())
        })?;
        let alone = 0.5 * (before + self.watch(WATCH_SECS, |_| Ok(()))?);
        let slower = |speed: f64| 100.0 * (1.0 - speed / alone);
        Ok(vec![
            Row::new("training alone", "steps/s", alone),
            Row::new("training slowed by an idle viewport", "%", slower(idle)),
            Row::new("training slowed by orbiting", "%", slower(orbit)),
            Row::of_frames("orbit while training", &seen),
        ])
    }

    /// Turns the camera for a while, following training.
    fn drag(&mut self, speed: f32) -> Result<Vec<Seen>, Failure> {
        let (session, up) = (&self.session, self.up);
        let mut shown = Arc::clone(&self.snapshot);
        let mut last = 0.0;
        self.desk.run(
            WATCH_SECS,
            || {
                shown = session.snapshot().unwrap_or_else(|| Arc::clone(&shown));
                Arc::clone(&shown)
            },
            |desk, since| {
                desk.training_secs = Some(desk.training_secs.unwrap_or(0.0) + since - last);
                if speed > 0.0 {
                    desk.orbit(speed * (since - last) as f32, up);
                }
                last = since;
            },
        )
    }

    /// Steps a second of training while `work` goes on, or while nothing does for `secs`.
    fn watch(
        &mut self,
        secs: f64,
        work: impl FnOnce(&mut Self) -> Result<(), Failure>,
    ) -> Result<f64, Failure> {
        self.take_events()?;
        let (step, elapsed) = self.progress;
        let end = Instant::now() + Duration::from_secs_f64(secs);
        work(self)?;
        while Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20));
            self.take_events()?;
        }
        self.take_events()?;
        let (new_step, new_elapsed) = self.progress;
        Ok((new_step - step) as f64 / (new_elapsed - elapsed).max(1e-9))
    }

    fn take_events(&mut self) -> Result<(), Failure> {
        interrupt::check()?;
        while let Ok(event) = self.session.events().try_recv() {
            match event {
                TrainEvent::Progress(progress) => {
                    self.progress = (progress.step, progress.elapsed_secs);
                }
                TrainEvent::Failed(reason) => return Err(Failure::Failed(anyhow::anyhow!(reason))),
                _ => {}
            }
        }
        Ok(())
    }

    /// Rows without training.
    fn paused(&mut self) -> Result<Vec<Row>, Failure> {
        self.session.send(TrainCommand::Pause);
        self.desk.training_secs = None;
        self.desk.run(0.5, self.shown(), |_, _| ())?;
        let mut rows = vec![self.orbit_paused()?];
        rows.push(self.change("roughness to changed picture", |desk, i| {
            desk.look.edit.roughness = RoughnessEdit::Constant(0.1 + 0.05 * i as f32);
        })?);
        self.desk.look.edit = MaterialEdit::default();
        rows.push(
            self.change("turned environment to changed picture", |desk, i| {
                desk.look.transform.rotate_deg = Vec3::new(0.0, 0.0, 5.0 + i as f32);
            })?,
        );
        self.desk.look.transform.rotate_deg = Vec3::ZERO;
        let listed = Library::of_system().entries().unwrap_or_default();
        if let Some(entry) = listed.iter().find(|entry| entry.is_bundled) {
            let other = Arc::new(Environment::open(&entry.file).or_unusable()?);
            rows.push(
                self.change("swapped environment to first picture", |desk, i| {
                    desk.look.environment = (i % 2 == 0).then(|| Arc::clone(&other));
                })?,
            );
            self.desk.look.environment = None;
        }
        rows.extend(self.rest()?);
        Ok(rows)
    }

    fn shown(&self) -> impl FnMut() -> Arc<Snapshot> + use<> {
        let snapshot = Arc::clone(&self.snapshot);
        move || Arc::clone(&snapshot)
    }

    fn orbit_paused(&mut self) -> Result<Row, Failure> {
        let up = self.up;
        let mut last = 0.0;
        let seen = self.desk.run(WATCH_SECS, self.shown(), |desk, since| {
            desk.orbit(ORBIT * (since - last) as f32, up);
            last = since;
        })?;
        Ok(Row::of_frames("orbit while paused", &seen))
    }

    /// The time from single changes to the first picture of them, a moment apart.
    fn change(
        &mut self,
        name: &'static str,
        mut change: impl FnMut(&mut Desk, usize),
    ) -> Result<Row, Failure> {
        let snapshot = Arc::clone(&self.snapshot);
        let (mut times, first) = (Vec::new(), self.desk.seen.len());
        for i in 0..REPEATS {
            let change = |desk: &mut Desk| change(desk, i);
            times.push(self.desk.time_to(&snapshot, change, |_| true)?);
            self.desk.run(0.4, self.shown(), |_, _| ())?;
        }
        let seen = &self.desk.seen[first..];
        Ok(Row {
            p99_ms: Some(1e3 * quantile(&times, 0.99)),
            scale: seen.iter().map(|seen| seen.scale).max(),
            ..Row::new(name, "ms", 1e3 * quantile(&times, 0.5))
        })
    }

    /// From the end of an orbit to full resolution and to the last picture; then what an idle program costs.
    fn rest(&mut self) -> Result<Vec<Row>, Failure> {
        let (snapshot, up) = (Arc::clone(&self.snapshot), self.up);
        let (mut full, mut settled) = (Vec::new(), Vec::new());
        for _ in 0..3 {
            let start = self.desk.now_secs();
            let turn = |desk: &mut Desk| desk.orbit(0.1, up);
            full.push(self.desk.time_to(&snapshot, turn, |seen| seen.scale == 1)?);
            while !self.desk.seen.last().is_some_and(|seen| seen.is_last) {
                self.desk.run(0.1, self.shown(), |_, _| ())?;
            }
            settled.push(self.desk.seen.last().map_or(0.0, |seen| seen.at_secs) - start);
        }
        let (start, cpu) = (Instant::now(), process_cpu_secs());
        self.desk.run(4.0, self.shown(), |_, _| ())?;
        let idle = (process_cpu_secs() - cpu) / start.elapsed().as_secs_f64();
        Ok(vec![
            Row::new("full resolution after rest", "s", quantile(&full, 0.5)),
            Row::new("settled after rest", "s", quantile(&settled, 0.5)),
            Row::new("idle and settled", "% of a core", 100.0 * idle),
        ])
    }
}

impl Row {
    fn new(name: &'static str, unit: &'static str, value: f64) -> Self {
        Self {
            name,
            unit,
            value,
            ..Self::default()
        }
    }

    /// Frames a second and the gaps between them.
    fn of_frames(name: &'static str, seen: &[Seen]) -> Self {
        let gaps: Vec<f64> = seen
            .windows(2)
            .map(|pair| pair[1].at_secs - pair[0].at_secs)
            .collect();
        let cpu: f64 = seen.iter().map(|seen| seen.cpu_secs).sum();
        let per_sec = gaps.len() as f64 / gaps.iter().sum::<f64>().max(1e-9);
        Self {
            median_ms: Some(1e3 * quantile(&gaps, 0.5)),
            p99_ms: Some(1e3 * quantile(&gaps, 0.99)),
            scale: seen.iter().map(|seen| seen.scale).max(),
            cpu_ms: Some(1e3 * cpu / seen.len().max(1) as f64),
            ..Self::new(name, "frames/s", per_sec)
        }
    }
}

fn report(args: &PreviewArgs, rows: &[Row]) -> Result<(), Failure> {
    if args.common.json {
        let report = json!({ "width": args.width, "height": args.height, "rows": rows });
        return Ok(output::json_line(&report)?);
    }
    output::line(&format!("a viewport of {} x {}", args.width, args.height))?;
    let line = |row: &Row| {
        let scale = row.scale.map(|scale| format!("1/{scale}"));
        format!(
            "| {} | {:.2} {} | {} | {} | {} | {} |",
            row.name,
            row.value,
            row.unit,
            rounded(row.median_ms, 0),
            rounded(row.p99_ms, 0),
            scale.unwrap_or("–".to_owned()),
            rounded(row.cpu_ms, 0)
        )
    };
    let header = "| what | value | median ms | p99 ms | coarsest | processor ms a picture |";
    Ok(output::table(header, rows.iter().map(line))?)
}
