//! The demo without a window: trains on the bundled capture for a minute, then shows in pictures
//! what the program can do.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::Vec3;
use neif::data::{Dataset, LoadOptions, Splits, View, bundled_assets};
use neif::neif::RoughnessEdit;
use neif::render::output::turntable::turning_point;
use neif::render::{Layer, Picture, Scene, environment_map, render, trained_light};
use neif::train::config::TrainConfig;
use neif::train::measure::eval::{Measures, evaluate_views, mean_of_views};
use neif::train::session::options::SessionOptions;
use neif::train::session::plan::Budget;

use super::env::PanoramaFile;
use crate::cli::failure::Failure;
use crate::cli::training::{self, Outcome};
use crate::cli::{interrupt, output, scenes, sheet};

/// Training time, in seconds.
const TRAIN_SECS: f64 = 60.0;
/// Where the results go, in the current folder.
const OUT: &str = "neif-demo";
/// Test views that are shown.
const MAX_VIEWS: usize = 4;
/// Width of the panorama in pixels.
const PANORAMA_WIDTH: u32 = 512;

/// Runs the demo; `reason` says why there is no window.
pub(crate) fn run(reason: &str, started: Instant) -> Result<(), Failure> {
    output::line(&format!(
        "{reason}; running the demo without a window, into ./{OUT}/"
    ))?;
    let assets = find_assets()?;
    let config = TrainConfig::preset("fast")?;
    let options = SessionOptions {
        started,
        ..SessionOptions::new(&assets.join("demo"), config, Budget::Seconds(TRAIN_SECS))
    };
    let outcome = training::train(options, false)?;
    let trained_secs = started.elapsed().as_secs_f64();
    let test = load_test_views(&assets.join("demo"))?;
    let mut gallery = Gallery::new(Path::new(OUT))?;
    gallery.compare_test_views(&outcome, &test)?;
    if let Some(view) = test.first() {
        gallery.edit_and_relight(&outcome, view, &assets)?;
    }
    gallery.write_report(&outcome, trained_secs, started)?;
    outcome.verdict()
}

/// The photos that training has not seen.
fn load_test_views(capture: &Path) -> Result<Vec<View>, Failure> {
    let options = LoadOptions {
        splits: Splits::TEST,
        ..LoadOptions::default()
    };
    Ok(Dataset::load(capture, &options)?.test)
}

/// The folder of bundled files.
pub(crate) fn find_assets() -> Result<PathBuf, Failure> {
    bundled_assets().map_err(|places| {
        let searched: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
        Failure::unusable(anyhow::anyhow!(
            "the bundled demo was not found in {}; set NEIF_ASSETS to the assets folder",
            searched.join(", ")
        ))
    })
}

/// Collects pictures and what is said about them.
struct Gallery {
    out: PathBuf,
    cancel: &'static AtomicBool,
    files: Vec<(String, String)>,
    figures: String,
}

impl Gallery {
    fn new(out: &Path) -> Result<Self, Failure> {
        scenes::make_folder(out)?;
        Ok(Self {
            out: out.to_owned(),
            cancel: interrupt::install()?,
            files: Vec::new(),
            figures: String::new(),
        })
    }

    fn save(&mut self, name: &str, about: &str, picture: &Picture) -> Result<(), Failure> {
        sheet::save(&self.out.join(name), picture)?;
        self.files.push((name.to_owned(), about.to_owned()));
        Ok(())
    }

    fn render(&self, scene: &Scene, view: &View, layer: Layer) -> Result<Picture, Failure> {
        let picture = render(scene, &view.camera, layer, self.cancel, &|_| {});
        picture.ok_or(Failure::Interrupted)
    }

    /// Test views beside their photos, with their figures.
    fn compare_test_views(&mut self, outcome: &Outcome, test: &[View]) -> Result<(), Failure> {
        let scene = outcome.snapshot.scene();
        let measures = Measures {
            exposures: outcome.snapshot.exposures.as_deref(),
            ..Measures::default()
        };
        let views = &test[..test.len().min(MAX_VIEWS)];
        let mut rows = Vec::new();
        let mut on_view = |_, view: &View, picture: &Picture| {
            let photo = sheet::photo(view);
            let difference = sheet::difference(&photo, picture, 4.0);
            rows.push(sheet::beside(&[&photo, picture, &difference]));
        };
        let results = evaluate_views(&scene, views, measures, self.cancel, &mut on_view);
        let results = results.ok_or(Failure::Interrupted)?;
        let about = "held-out photos, the same views rendered, and four times their difference";
        self.save("test_views.png", about, &sheet::grid(&rows, 1))?;
        for view in &results {
            let db = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.2} dB"));
            writeln!(
                self.figures,
                "  {:<20} PSNR {:>9}   on the object {:>9}",
                view.name,
                db(view.metrics.psnr),
                db(view.metrics.psnr_object)
            )?;
        }
        let mean = mean_of_views(&results);
        if let (Some(psnr), Some(object)) = (mean.psnr, mean.psnr_object) {
            writeln!(
                self.figures,
                "  mean PSNR {psnr:.2} dB, on the object {object:.2} dB"
            )?;
        }
        Ok(())
    }

    /// The same view with other material, turned and other light, taken apart, and its panorama.
    fn edit_and_relight(
        &mut self,
        outcome: &Outcome,
        view: &View,
        assets: &Path,
    ) -> Result<(), Failure> {
        let own = outcome.snapshot.scene();
        let mut rough = own.clone();
        rough.edit.roughness = RoughnessEdit::Constant(0.5);
        let mut turned = own.clone();
        turned.transform.rotate_deg = Vec3::new(0.0, 0.0, 90.0);
        let mut changed = vec![
            ("edited_roughness.png", "roughness 0.5 everywhere", rough),
            (
                "relit_rotated.png",
                "environment turned by 90 degrees",
                turned,
            ),
        ];
        let other = assets.join("environments/gallery.safetensors");
        if other.exists() {
            let mut relit = own.clone();
            relit.environment = scenes::open_environment(&other)?;
            let about = "in another environment, trained elsewhere";
            changed.push(("relit_gallery.png", about, relit));
        }
        for (name, about, scene) in changed {
            let picture = self.render(&scene, view, Layer::Final)?;
            self.save(name, about, &picture)?;
        }
        let layers = [
            Layer::Diffuse,
            Layer::Specular,
            Layer::Roughness,
            Layer::Tint,
        ];
        let pictures: Result<Vec<Picture>, Failure> = layers
            .iter()
            .map(|&layer| self.render(&own, view, layer))
            .collect();
        let about = "what was learned: diffuse part, specular part, roughness, tint";
        self.save("layers.png", about, &sheet::grid(&pictures?, 4))?;
        self.panorama(&own)
    }

    fn panorama(&mut self, scene: &Scene) -> Result<(), Failure> {
        let light = trained_light(scene, self.cancel);
        let at = turning_point(scene);
        let picture = environment_map(scene, light.as_deref(), at, PANORAMA_WIDTH, self.cancel);
        let picture = picture.ok_or(Failure::Interrupted)?;
        let about = "the environment as the object's middle sees it, without the object's shadow";
        for (name, kind) in [
            ("panorama.png", PanoramaFile::Png),
            ("panorama.exr", PanoramaFile::Exr),
        ] {
            kind.write(&self.out.join(name), &picture)?;
            self.files.push((name.to_owned(), about.to_owned()));
        }
        Ok(())
    }

    fn write_report(
        &self,
        outcome: &Outcome,
        trained_secs: f64,
        started: Instant,
    ) -> Result<(), Failure> {
        let mut text = format!("neif {} demo\n\n", env!("CARGO_PKG_VERSION"));
        writeln!(
            text,
            "Trained on {} photos for {:.1} s ({} steps); {:.1} s with loading.\n",
            outcome.dataset.train.len(),
            outcome.finish.train_secs,
            outcome.finish.step,
            trained_secs
        )?;
        writeln!(text, "Held-out test views:\n{}", self.figures)?;
        writeln!(text, "Files:")?;
        for (name, about) in &self.files {
            writeln!(text, "  {name:<24} {about}")?;
        }
        writeln!(
            text,
            "\nEverything took {:.1} s.",
            started.elapsed().as_secs_f64()
        )?;
        output::file(&self.out.join("report.txt"), &text)?;
        Ok(output::line(&text)?)
    }
}
