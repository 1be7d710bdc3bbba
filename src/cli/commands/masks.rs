//! `neif masks`: finds the object in the photos of a capture and writes a mask of each.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use glam::{Vec2, Vec3};
use neif::data::{CaptureChoices, Dataset, LoadOptions, Mask, View};
use neif::geometry::Aabb;
use neif::scans::load_capture;
use neif::train::TrainError;
use neif::train::config::TrainConfig;
use neif::train::masks::{
    FoundObject, LearnedPlace, MaskError, Selection, Stroke, agreement_of, find_object,
    learn_environment, point_at,
};
use neif::train::session::plan::Budget;
use serde_json::json;

use crate::cli::capture::PhotoArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::output::Display;
use crate::cli::{interrupt, output, scenes, values};

/// Time in which the environment is learned where none is given, seconds.
const DEFAULT_SECS: f64 = 60.0;
/// So many doubtful photos are named.
const MOST_NAMED: usize = 5;

#[derive(Debug, clap::Args)]
pub(crate) struct MasksArgs {
    /// The capture: a folder or file of posed photos
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// The folder to write the masks into, one a photo: `--masks DIR` of the other commands reads them
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A point on the object, scene units [default: the object that the cameras look at]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vector, allow_hyphen_values = true)]
    at: Option<Vec3>,
    /// A pixel on the object: a photo's name (or with its split: `train/r_000`) and the place in it
    #[arg(long, value_name = "PHOTO,X,Y", conflicts_with = "at")]
    pixel: Option<String>,
    /// A box that the object is within, scene units
    #[arg(long = "box", value_name = "X,Y,Z,X,Y,Z", value_parser = values::aabb, allow_hyphen_values = true)]
    within: Option<Aabb>,
    /// Refine the masks that the capture has (or `--masks`) instead, and make those that it lacks
    #[arg(long, conflicts_with_all = ["at", "pixel", "within"])]
    refine_masks: bool,
    /// A stroke over a part of the object that was missed: a photo's name and the places that the brush passes
    #[arg(long, value_name = "PHOTO,X,Y[,X,Y...]")]
    add: Vec<String>,
    /// A stroke over what is not the object
    #[arg(long, value_name = "PHOTO,X,Y[,X,Y...]")]
    remove: Vec<String>,
    /// Radius of the strokes' brush, pixels
    #[arg(long, value_name = "PX", default_value_t = 4.0, value_parser = values::positive)]
    brush: f32,
    /// An environment that was trained on these photos with the object in them, or a run: it is learned otherwise
    #[arg(long, value_name = "RUN|FILE", conflicts_with = "budget")]
    environment: Option<PathBuf>,
    /// Time to learn the environment in: 60s, 2m [default: 60s]
    #[arg(long, value_name = "TIME", value_parser = values::duration_secs)]
    budget: Option<f64>,
    /// Steps of learning instead: gives the same masks on every machine speed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), conflicts_with_all = ["budget", "environment"])]
    steps: Option<u64>,
    #[command(flatten)]
    photos: PhotoArgs,
    /// Write JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &MasksArgs, started: Instant) -> Result<(), Failure> {
    let cancel = interrupt::install()?;
    let load_options = LoadOptions {
        choices: args.photos.over(CaptureChoices::default()),
        ..LoadOptions::default()
    };
    let dataset = load_capture(&args.dataset, &load_options, cancel)
        .or_unusable()?
        .ok_or(Failure::Interrupted)?;
    let display = std::sync::Mutex::new(Display::new(args.json));
    let report = |what: &str, fraction: f32| {
        // Progress that cannot be shown is no reason to stop the work.
        if let Ok(mut display) = display.lock() {
            display.set(fraction, what, "");
        }
        if args.json {
            let line = json!({"event": "progress", "what": what, "fraction": fraction});
            output::json_line(&line).unwrap_or_default();
        }
    };
    let pixel = args.pixel.as_deref();
    let pixel = pixel
        .map(|text| pixels_of("--pixel", text, &dataset))
        .transpose();
    let pixel = pixel.map_err(Failure::unusable)?;
    let strokes = strokes(args, &dataset).map_err(Failure::unusable)?;
    let place = if let Some(path) = &args.environment {
        LearnedPlace::as_given(scenes::open_environment(path)?)
    } else {
        let seconds = Budget::Seconds(args.budget.unwrap_or(DEFAULT_SECS));
        let budget = args.steps.map_or(seconds, Budget::Steps);
        let config = TrainConfig::default();
        let on_progress = |fraction| report("Learning the environment", fraction);
        match learn_environment(&dataset, &config, budget, cancel, &on_progress) {
            Err(TrainError::Cancelled) => return Err(Failure::Interrupted),
            learned => learned.or_unusable()?,
        }
    };
    let pointed = pixel.and_then(|(index, at)| {
        let view = dataset.views().nth(index)?;
        point_at(&place.environment, &view.camera, at[0])
    });
    let selection = Selection {
        at: args.at.or(pointed),
        within: args.within,
        is_masked: args.refine_masks,
    };
    let learned = Instant::now();
    let on_progress = |fraction| report("Finding the object", fraction);
    let found = match find_object(
        &dataset,
        &place,
        (&selection, &strokes),
        cancel,
        &on_progress,
    ) {
        Err(MaskError::Cancelled) => return Err(Failure::Interrupted),
        found => found.or_unusable()?,
    };
    let found_secs = learned.elapsed().as_secs_f64();
    if let Ok(display) = display.lock() {
        display.finish();
    }
    found.save(&args.out)?;
    report_on(args, &dataset, &found, (started, found_secs))
}

/// The strokes that are asked for.
fn strokes(args: &MasksArgs, dataset: &Dataset) -> anyhow::Result<Vec<Stroke>> {
    let of = |option: &'static str, texts: &[String], adds: bool| {
        let stroke = |text: &String| {
            let (view, places) = pixels_of(option, text, dataset)?;
            Ok(Stroke {
                view,
                places,
                radius: args.brush,
                adds,
            })
        };
        texts
            .iter()
            .map(stroke)
            .collect::<anyhow::Result<Vec<Stroke>>>()
    };
    let mut strokes = of("--add", &args.add, true)?;
    strokes.extend(of("--remove", &args.remove, false)?);
    Ok(strokes)
}

/// The photo (its index) and the places in it that `PHOTO,X,Y,...` names.
fn pixels_of(option: &str, text: &str, dataset: &Dataset) -> anyhow::Result<(usize, Vec<Vec2>)> {
    // A photo's name may have commas in it.
    let n_numbers = text
        .rsplit(',')
        .take_while(|part| values::finite(part).is_ok())
        .count();
    let parts: Vec<&str> = text.rsplitn(n_numbers / 2 * 2 + 1, ',').collect();
    let [numbers @ .., name] = &parts[..] else {
        anyhow::bail!("{option}: expected PHOTO,X,Y");
    };
    anyhow::ensure!(
        !numbers.is_empty(),
        "{option}: expected PHOTO,X,Y as in r_000,160,120, found `{text}`"
    );
    let number =
        |text| values::finite(text).map_err(|e| anyhow::anyhow!("{option}: `{text}`: {e}"));
    let is_named =
        |view: &&View| view.name == *name || format!("{}/{}", view.split, view.name) == *name;
    let mut views = dataset.views().enumerate();
    let found = views.find(|(_, view)| is_named(view));
    let (index, view) = found.with_context(|| format!("{option}: no photo is named `{name}`"))?;
    let (width, height) = (view.camera.width as f32, view.camera.height as f32);
    let mut places = Vec::new();
    for pair in numbers.chunks(2).rev() {
        let at = Vec2::new(number(pair[1])?, number(pair[0])?);
        anyhow::ensure!(
            (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y),
            "{option}: {},{} lies outside the photo `{name}` of {width} x {height}",
            at.x,
            at.y
        );
        places.push(at);
    }
    Ok((index, places))
}

/// Says how sure the masks are, and how like those that the capture has.
fn report_on(
    args: &MasksArgs,
    dataset: &Dataset,
    found: &FoundObject,
    (started, found_secs): (Instant, f64),
) -> Result<(), Failure> {
    let views: Vec<&View> = dataset.views().collect();
    let own: Vec<(&Mask, &Mask)> = views
        .iter()
        .zip(&found.masks)
        .filter_map(|(view, mask)| Some((view.mask.as_ref()?, mask)))
        .collect();
    let in_common: Vec<f32> = own.iter().map(|(a, b)| agreement_of(a, b)).collect();
    let mean = |values: &[f32]| {
        (!values.is_empty()).then(|| values.iter().sum::<f32>() / values.len() as f32)
    };
    let least = |values: &[f32]| values.iter().copied().reduce(f32::min);
    let doubtful = found.doubtful();
    let seconds = started.elapsed().as_secs_f64();
    if args.json {
        let photos = views.iter().zip(&found.agreement).map(|(view, agreement)| {
            json!({"photo": view.name, "split": view.split.to_string(), "agreement": agreement})
        });
        return Ok(output::json_line(&json!({
            "event": "finished", "masks": args.out.to_string_lossy(), "seconds": seconds,
            "seconds_to_find": found_secs,
            "agreement": mean(&found.agreement),
            "in_common_with_own": mean(&in_common), "least_in_common_with_own": least(&in_common),
            "doubtful": doubtful, "photos": photos.collect::<Vec<_>>(),
        }))?);
    }
    output::line(&format!(
        "{}: {} masks in {seconds:.1} s ({found_secs:.1} s to find the object)",
        args.out.display(),
        found.masks.len()
    ))?;
    if let (Some(mean), Some(least)) = (mean(&in_common), least(&in_common)) {
        output::line(&format!(
            "{:.1} % in common with the capture's own masks, {:.1} % at least",
            100.0 * mean,
            100.0 * least
        ))?;
    }
    if !doubtful.is_empty() {
        let names = &doubtful[..doubtful.len().min(MOST_NAMED)];
        output::line(&format!(
            "look at {} of them, which the other photos contradict: {}{}",
            doubtful.len(),
            names.join(", "),
            if doubtful.len() > MOST_NAMED {
                ", ..."
            } else {
                ""
            }
        ))?;
    }
    Ok(())
}
