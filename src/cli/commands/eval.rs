//! `neif eval`: how good a run is on photos that it has not seen.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
};

use anyhow::Context as _;
use neif::data::{Dataset, Split, View, read_exr_linear};
use neif::neif::Environment;
use neif::render::{Layer, Picture, Scene};
use neif::train::measure::eval::{
    AlbedoError, EvalReport, Measures, NormalError, RoughnessError, ViewMetrics, evaluate_views,
    mean_fitted, mean_of_views, panorama_psnr, relit,
};
use neif::train::measure::held_out::after_one_gain;
use neif::train::measure::lpips::{Backbone, Lpips};
use neif::train::measure::metrics::ImageMetrics;

use crate::cli::capture::PhotoArgs;
use crate::cli::failure::{Failure, OrUnusable as _};
use crate::cli::output::{self, Display};
use crate::cli::{interrupt, scenes, sheet, values};

/// Environment variable that names the LPIPS weights where `--lpips` does not.
const LPIPS_VARIABLE: &str = "NEIF_LPIPS";
/// Amplification of difference pictures.
const DIFFERENCE_GAIN: f32 = 4.0;
/// Width of a picture on the contact sheet, in pixels.
const SHEET_WIDTH: u32 = 200;
/// Views (of photo, picture and difference) in a row of the contact sheet.
const SHEET_COLUMNS: usize = 2;

#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "one a flag")]
pub(crate) struct EvalArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Which photos
    #[arg(long, value_name = "SPLIT", default_value = "test")]
    split: Split,
    /// Measure the edits and relightings of the capture's relight/ folder too
    #[arg(long)]
    relight: bool,
    /// Leave the diffuse part as it was learned when the light changes, as the paper does
    #[arg(long)]
    baked_diffuse: bool,
    /// An environment trained on another capture (a file, or a name of the library), under that capture's name, for relightings that
    /// use it
    #[arg(long, value_name = "NAME=FILE", value_parser = values::named_path)]
    env: Vec<(String, PathBuf)>,
    /// Make another environment as bright, and of the same white, as the object's own; not so in the ground truth of
    /// captures that share one exposure
    #[arg(long)]
    env_match: bool,
    /// Folder for pictures: rendered, photo, difference x4, and one contact sheet
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Weights of LPIPS v0.1 (safetensors); without it the file that `NEIF_LPIPS` names
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Where the run's capture lies now
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    photos: PhotoArgs,
    /// Write the figures as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &EvalArgs) -> Result<(), Failure> {
    let mut run = scenes::open_run(&args.run, args.dataset.as_deref())?;
    if args.baked_diffuse {
        run.scene.trained_in = None;
    }
    let lpips = lpips_weights(args.lpips.as_deref())?;
    let (views, root) = run.load_views(args.split, &args.photos)?;
    let trained = run.folder.trained();
    let mut bench = Bench {
        cancel: interrupt::install()?,
        display: Display::new(args.json),
        out: args.out.as_deref(),
        lpips: lpips.as_ref(),
    };
    let split = args.split.to_string();
    let measures = Measures {
        exposures: run.exposures.as_deref(),
        lpips: lpips.as_ref(),
        fitted: Some(run.folder.pose_fit()),
    };
    let results = bench.measure(&run.scene, &views, &split, measures, None)?;
    let [relight, relight_gained] = if args.relight {
        bench.relight(&run.scene, &root, &args.env, args.env_match)?
    } else {
        [BTreeMap::new(), BTreeMap::new()]
    };
    // The true normals and materials are those of the test views.
    let truth = if args.split == Split::Test {
        surface_errors(&run.scene, &views, &root, bench.cancel)?
    } else {
        SurfaceErrors::default()
    };
    let report = EvalReport {
        split,
        train_seconds: trained.map(|trained| trained.train_secs),
        steps: trained.map(|trained| trained.steps),
        mean: mean_of_views(&results),
        mean_fitted: mean_fitted(&results),
        views: results,
        relight,
        relight_gained,
        normal_mae_deg: truth.normals.mean_deg(),
        normal_median_deg: truth.normals.median_deg(),
        roughness_mae: truth.roughness.mean(),
        albedo_psnr: truth.albedo.psnr(),
        pano_psnr: panorama_psnr(&run.scene, &root, bench.cancel).or_unusable()?,
    };
    interrupt::check()?;
    bench.display.finish();
    let json = serde_json::to_string(&report)?;
    if let Some(out) = &args.out {
        output::file(&out.join("report.json"), &json)?;
    }
    let backbone = lpips.as_ref().map(Lpips::backbone);
    let table = || table(&report, backbone);
    Ok(output::line(&if args.json { json } else { table() })?)
}

/// Reads the weights of LPIPS from the given file, or from the one that the environment names.
pub(crate) fn lpips_weights(file: Option<&Path>) -> Result<Option<Lpips>, Failure> {
    let variable = std::env::var_os(LPIPS_VARIABLE).filter(|value| !value.is_empty());
    let file = file.map(Path::to_owned).or(variable.map(PathBuf::from));
    file.map(|file| Lpips::read(&file).context("the LPIPS weights cannot be used"))
        .transpose()
        .or_unusable()
}

/// Renders and measures sets of views.
struct Bench<'a> {
    cancel: &'static AtomicBool,
    display: Display,
    out: Option<&'a Path>,
    lpips: Option<&'a Lpips>,
}

impl Bench<'_> {
    /// Measures the views; writes their pictures into the folder `name` below the output folder, and into `pictures` where
    /// they are asked for.
    fn measure(
        &mut self,
        scene: &Scene,
        views: &[View],
        name: &str,
        measures: Measures<'_>,
        mut pictures: Option<&mut Vec<Picture>>,
    ) -> Result<Vec<ViewMetrics>, Failure> {
        let folder = self.out.map(|out| out.join(name));
        if let Some(folder) = &folder {
            scenes::make_folder(folder)?;
        }
        let mut rows = Vec::new();
        let mut saved: Result<(), Failure> = Ok(());
        let display = &mut self.display;
        let mut on_view = |i: usize, view: &View, picture: &Picture| {
            display.set((i + 1) as f32 / views.len() as f32, "Measuring", name);
            if let (Some(folder), Ok(())) = (&folder, &saved) {
                saved = save_pictures(folder, view, picture, &mut rows);
            }
            if let Some(pictures) = &mut pictures {
                pictures.push(picture.clone());
            }
        };
        let results = evaluate_views(scene, views, measures, self.cancel, &mut on_view);
        saved?;
        if let Some(lpips) = self.lpips {
            note_small_views(lpips, views, name);
        }
        let results = results.ok_or(Failure::Interrupted)?;
        if let Some(folder) = &folder {
            let contact_sheet = sheet::grid(&rows, SHEET_COLUMNS);
            sheet::save(&folder.join("contact_sheet.png"), &contact_sheet)?;
        }
        Ok(results)
    }

    /// Measures every edit that has ground truth: by the edits' names, as they are and after one gain a colour.
    fn relight(
        &mut self,
        scene: &Scene,
        root: &Path,
        environments: &[(String, PathBuf)],
        is_matched: bool,
    ) -> Result<[BTreeMap<String, ImageMetrics>; 2], Failure> {
        let mut known: BTreeMap<String, Arc<Environment>> = BTreeMap::new();
        for (name, path) in environments {
            known.insert(name.clone(), scenes::open_environment(path)?);
        }
        let [mut as_is, mut gained] = [BTreeMap::new(), BTreeMap::new()];
        for case in Dataset::relight_cases(root).or_unusable()? {
            for problem in &case.problems {
                output::note(&format!("{}: {problem}", case.name));
            }
            let name = format!("relight/{}", case.name);
            let mut edited = match relit(scene, &case.apply, &known) {
                Ok(edited) => edited,
                Err(reason) => {
                    output::note(&format!("{name}: left out: {reason}"));
                    continue;
                }
            };
            if is_matched && case.apply.environment_of.is_some() {
                edited.transform = scenes::matched(&edited, &scene.environment)?;
            }
            let measures = Measures {
                lpips: self.lpips,
                ..Measures::default()
            };
            let mut pictures = Vec::new();
            let (views, kept) = (&case.views, Some(&mut pictures));
            let results = self.measure(&edited, views, &name, measures, kept)?;
            gained.insert(case.name.clone(), after_one_gain(&case.views, &pictures));
            as_is.insert(case.name, mean_of_views(&results));
        }
        Ok([as_is, gained])
    }
}

/// How far mesh and material are from the truth.
#[derive(Debug, Default)]
struct SurfaceErrors {
    normals: NormalError,
    roughness: RoughnessError,
    albedo: AlbedoError,
}

/// Says why views have no LPIPS when they are too small for its network.
fn note_small_views(lpips: &Lpips, views: &[View], set: &str) {
    let min_side = lpips.min_side();
    let side = |view: &View| view.camera.width.min(view.camera.height) as usize;
    let n_small = views.iter().filter(|view| side(view) < min_side).count();
    if n_small > 0 {
        output::note(&format!(
            "{set}: {n_small} views without LPIPS: {} needs {min_side} x {min_side} pixels",
            lpips.backbone()
        ));
    }
}

/// Writes a view's three pictures and adds them to the contact sheet.
fn save_pictures(
    folder: &Path,
    view: &View,
    picture: &Picture,
    rows: &mut Vec<Picture>,
) -> Result<(), Failure> {
    let photo = sheet::photo(view);
    let difference = sheet::difference(&photo, picture, DIFFERENCE_GAIN);
    let name = &view.name;
    sheet::save(&folder.join(format!("{name}.png")), picture)?;
    sheet::save(&folder.join(format!("{name}_photo.png")), &photo)?;
    sheet::save(&folder.join(format!("{name}_difference.png")), &difference)?;
    let small = [&photo, picture, &difference].map(|p| sheet::thumbnail(p, SHEET_WIDTH));
    rows.push(sheet::beside(&small.each_ref()));
    Ok(())
}

/// Compares with `gt/normal`, `gt/roughness`, `gt/specular_f0`, `gt/diffuse` and `gt/base_color`, where the capture has them.
fn surface_errors(
    scene: &Scene,
    views: &[View],
    root: &Path,
    cancel: &AtomicBool,
) -> Result<SurfaceErrors, Failure> {
    let mut errors = SurfaceErrors::default();
    let scene = &scene
        .lit_for(&[Layer::Albedo], cancel)
        .ok_or(Failure::Interrupted)?;
    for view in views {
        let read = |layer: &str| -> Result<Option<Vec<[f32; 3]>>, Failure> {
            let file = root.join("gt").join(layer);
            let file = file.join(format!("{}.exr", view.name));
            if !file.is_file() {
                return Ok(None);
            }
            let (width, height, values) = read_exr_linear(&file).or_unusable()?;
            let fits = (width, height) == (view.camera.width, view.camera.height);
            Ok(fits.then_some(values))
        };
        if let Some(normals) = read("normal")? {
            errors.normals.add_view(scene, &view.camera, &normals);
        }
        if let (Some(roughness), Some(f0)) = (read("roughness")?, read("specular_f0")?) {
            let error = &mut errors.roughness;
            error.add_view(scene, view, &roughness, &f0, cancel);
        }
        if let (Some(diffuse), Some(base_color)) = (read("diffuse")?, read("base_color")?) {
            let error = &mut errors.albedo;
            error.add_view(scene, view, (&diffuse, &base_color), cancel);
        }
    }
    Ok(errors)
}

/// The figures for people.
fn table(report: &EvalReport, lpips: Option<Backbone>) -> String {
    let row = |name: &str, m: &ImageMetrics| {
        let cell = |digits: usize, value: Option<f64>| {
            value.map_or("-".to_owned(), |v| format!("{v:.digits$}"))
        };
        let [object, background] = [m.psnr_object, m.psnr_background].map(|v| cell(2, v));
        let [psnr, masked, near] = [m.psnr, m.psnr_masked, m.psnr_near].map(|v| cell(2, v));
        let [ssim, lpips, flip] = [m.ssim, m.lpips, m.flip].map(|v| cell(4, v));
        format!(
            "{name:<24} {psnr:>7} {object:>8} {background:>11} {masked:>8} {near:>8} {ssim:>8} {lpips:>8} {flip:>8}"
        )
    };
    let network = lpips.map_or("LPIPS needs --lpips".to_owned(), |network| {
        format!("LPIPS by {network}")
    });
    let mut lines = vec![format!(
        "{:<24} {:>7} {:>8} {:>11} {:>8} {:>8} {:>8} {:>8} {:>8}   (PSNR in dB; {network})",
        report.split, "PSNR", "object", "background", "masked", "near", "SSIM", "LPIPS", "FLIP"
    )];
    let views = report.views.iter();
    lines.extend(views.map(|view| row(&view.name, &view.metrics)));
    lines.push(row("mean", &report.mean));
    lines.push(row("mean, photo's own fit", &report.mean_fitted));
    let relight = report.relight.iter();
    lines.extend(relight.map(|(name, metrics)| row(name, metrics)));
    let gained = report.relight_gained.iter();
    lines.extend(gained.map(|(name, metrics)| row(&format!("{name}, gain matched"), metrics)));
    let normals = report.normal_mae_deg.zip(report.normal_median_deg);
    lines.extend(normals.map(|(mean, median)| {
        format!("normals: mean error {mean:.2} degrees, median {median:.2}")
    }));
    let roughness = report.roughness_mae;
    lines.extend(roughness.map(|error| format!("roughness: mean error {error:.3}")));
    let albedo = report.albedo_psnr;
    lines.extend(albedo.map(|psnr| format!("albedo: PSNR {psnr:.2} dB after one gain a colour")));
    let panoramas = report.pano_psnr;
    lines.extend(panoramas.map(|psnr| format!("panoramas: PSNR {psnr:.2} dB")));
    lines.join("\n")
}
