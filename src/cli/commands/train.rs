//! `neif train`: from photos to a run folder.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use glam::Vec3;
use neif::data::MeshPlacement;
use neif::neif::Storage;
use neif::train::config::{Normals, PhotoFit, TrainConfig};
use neif::train::masks::Selection;
use neif::train::session::options::{SessionOptions, WantedObject};
use neif::train::session::plan::Budget;
use neif::train::session::saved::run_folder::RunFolder;

use crate::cli::capture::CaptureArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::{output, training, values};

/// Time budget where none is given, in seconds.
const DEFAULT_BUDGET_SECS: f64 = 300.0;

/// How long to train; the same for captures and environments.
#[derive(Debug, clap::Args)]
pub(crate) struct BudgetArgs {
    /// Wall time of the whole command, loading and saving included: 300s, 5m, 1h [default: 300s]
    #[arg(long, value_name = "TIME", value_parser = values::duration_secs, conflicts_with = "steps")]
    budget: Option<f64>,
    /// Total number of steps instead: gives the same bits on every machine speed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
}

impl BudgetArgs {
    /// What was asked for, if anything was.
    pub(crate) fn given(&self) -> Option<Budget> {
        let steps = self.steps.map(Budget::Steps);
        steps.or(self.budget.map(Budget::Seconds))
    }

    /// What was asked for, or the default.
    pub(crate) fn or_default(&self) -> Budget {
        self.given().unwrap_or(Budget::Seconds(DEFAULT_BUDGET_SECS))
    }
}

#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "flags as they are typed")]
pub(crate) struct TrainArgs {
    /// The capture: a folder or file of posed photos with masks
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// The run folder to make, or to continue with --resume
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// Settings: `fast`, `quality` (a finer environment, for large sharp photos and more than two minutes), `paper` (the paper's own
    /// networks: a slow reference), or a TOML file with the values that differ from `fast` or from the preset that its entry
    /// `preset` names [default: fast]
    #[arg(long, value_name = "NAME|FILE.toml", conflicts_with = "resume")]
    preset: Option<String>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Find the object in photos without masks: `auto` is the one that the cameras look at, X,Y,Z a point on another
    /// [default: without masks or a mesh the environment alone is trained]
    #[arg(long, value_name = "auto|X,Y,Z", value_parser = values::selection, allow_hyphen_values = true, conflicts_with = "resume")]
    object: Option<Selection>,
    /// A mesh instead of the one beside the capture
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    mesh: Option<PathBuf>,
    #[command(flatten)]
    placement: MeshPlacementArgs,
    #[command(flatten)]
    capture: CaptureArgs,
    /// Continue the run in --out exactly where it was saved: to the end of its plan, or under the
    /// --budget (for this command) or --steps (in total) given
    #[arg(long)]
    resume: bool,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    seed: Option<u64>,
    /// Worker threads; 0 is one for each core [default: 0]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Whether each photo has an exposure and a white balance of its own [default: where the photos say so]
    #[arg(long, value_name = "on|off", conflicts_with = "resume")]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "on")]
    photo_exposures: Option<PhotoFit>,
    /// Whether the poses of the photos are refined [default: where the photos say that they are off]
    #[arg(long, value_name = "on|off", conflicts_with = "resume")]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "on")]
    refine_poses: Option<PhotoFit>,
    /// Whether the environment is learned from the background of the photos [default: unless that is cut away or
    /// stands still in the picture, as on a turntable; light is then learned from reflections alone]
    #[arg(long, value_name = "on|off", conflicts_with = "resume")]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "on")]
    background: Option<PhotoFit>,
    /// Refine the mesh's normals while training: for meshes that are good to a degree or two. It is done anyway where the
    /// mesh was made from masks or depth maps
    #[arg(long, conflicts_with = "resume")]
    refine_normals: bool,
    /// Use the whole budget even when the validation error has settled
    #[arg(long)]
    no_early_stop: bool,
    /// Store the trained grids in 16 bits: smaller files to keep and to show, the same checkpoint
    #[arg(long)]
    half: bool,
    /// Write events as lines of JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &TrainArgs, started: Instant) -> Result<(), Failure> {
    let options = options(args, started)?;
    let before = RunFolder::open(&args.out)
        .ok()
        .and_then(|folder| folder.trained());
    let outcome = training::train(options, args.json)?;
    if args.resume && before.is_some_and(|before| before.steps == outcome.finish.step) {
        output::note("the run had finished already: --budget or --steps trains it further");
    }
    if !args.json {
        outcome.report(&args.out)?;
    }
    outcome.verdict()
}

/// How a mesh that stands otherwise than the cameras is brought into the capture's frame.
#[derive(Debug, clap::Args)]
struct MeshPlacementArgs {
    /// Turn the mesh about the world's x, then y, then z axis, degrees
    #[arg(id = "mesh-rotate", long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true, conflicts_with = "resume")]
    rotate: Option<Vec3>,
    /// Scale the mesh
    #[arg(id = "mesh-scale", long, value_name = "S", conflicts_with = "resume")]
    scale: Option<f32>,
    /// Move the mesh, in scene units
    #[arg(id = "mesh-translate", long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true, conflicts_with = "resume")]
    translate: Option<Vec3>,
}

impl MeshPlacementArgs {
    fn placement(&self) -> MeshPlacement {
        let still = MeshPlacement::default();
        MeshPlacement {
            rotate_deg_xyz: self.rotate.unwrap_or(still.rotate_deg_xyz),
            scale: self.scale.unwrap_or(still.scale),
            translate: self.translate.unwrap_or(still.translate),
        }
    }
}

fn options(args: &TrainArgs, started: Instant) -> Result<SessionOptions, Failure> {
    let mut options = if args.resume {
        if args.capture.is_given() {
            return Err(Failure::unusable(anyhow::anyhow!(
                "--resume continues on the capture as it was read; --up, --max-megapixels, --test-every, \
                 --split-lists and --masks need a new run"
            )));
        }
        let resumed = SessionOptions::resume(&args.out, args.budget.given()).or_unusable()?;
        SessionOptions {
            dataset: args.dataset.clone(),
            ..resumed
        }
    } else {
        let config = config(args.preset.as_deref(), args.seed)?;
        SessionOptions {
            mesh: args.mesh.clone(),
            mesh_placement: args.placement.placement(),
            choices: args.capture.choices(),
            object: args.object.map(WantedObject::Find),
            run: Some(args.out.clone()),
            ..SessionOptions::new(&args.dataset, config, args.budget.or_default())
        }
    };
    options.started = started;
    if args.half {
        options.storage = Storage::F16;
    }
    let config = &mut options.config;
    config.photo_exposures = args.photo_exposures.unwrap_or(config.photo_exposures);
    config.refine_poses = args.refine_poses.unwrap_or(config.refine_poses);
    config.background = args.background.unwrap_or(config.background);
    if args.refine_normals {
        config.normals = Normals::Refined;
    }
    config.threads = args.threads.unwrap_or(config.threads);
    config.early_stop &= !args.no_early_stop;
    config.validate().or_unusable()?;
    Ok(options)
}

/// The settings of a preset by name or file, with another seed where one is given.
pub(crate) fn config(preset: Option<&str>, seed: Option<u64>) -> Result<TrainConfig, Failure> {
    let preset = preset.unwrap_or("fast");
    let is_file = Path::new(preset)
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let mut config = if is_file {
        let text = std::fs::read_to_string(preset).with_context(|| preset.to_owned());
        let config = TrainConfig::from_toml(&text.or_unusable()?);
        config.with_context(|| preset.to_owned()).or_unusable()?
    } else {
        TrainConfig::preset(preset).or_unusable()?
    };
    config.seed = seed.unwrap_or(config.seed);
    Ok(config)
}
