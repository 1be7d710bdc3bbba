//! Measures a trained scene: held-out views, relighting ground truth, normals, panoramas.
//!
//! The report's field names are a contract with scripts (`neif eval --json`).

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::held_out::{PoseFit, fitted, truth_and_mask};
use super::lpips::Lpips;
use super::metrics::{ImageMetrics, SquaredError, compare, compare_object, mean, mean_of};
use crate::color::srgb_from_linear;
use crate::data::{DataError, RelightApply, View, read_exr_linear};
use crate::geometry::Camera;
use crate::neif::neilf::NeilfModel;
use crate::neif::{Environment, EnvironmentTransform, MaterialEdit, RoughnessEdit};
use crate::render::{
    Layer, PartsOptions, PathOptions, Picture, Scene, compose, panorama, render, render_neilf,
    render_parts, render_with,
};
use crate::train::photos::photo_exposures::PhotoExposures;
use crate::train::statistics::middle;

/// Quality of one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewMetrics {
    /// Name of the view in the capture.
    pub name: String,
    /// The measures.
    #[serde(flatten)]
    pub metrics: ImageMetrics,
    /// The same after the photo's own exposure, white balance and pose ([`super::held_out::fitted`]).
    pub fitted: ImageMetrics,
}

/// Everything that `neif eval --json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvalReport {
    /// Which photos: `test`, `val` or `train`.
    pub split: String,
    /// Seconds of training, where the run says so.
    pub train_seconds: Option<f64>,
    /// Optimiser steps, where the run says so.
    pub steps: Option<u64>,
    /// Each view.
    pub views: Vec<ViewMetrics>,
    /// Means over the views.
    pub mean: ImageMetrics,
    /// Means of [`ViewMetrics::fitted`].
    pub mean_fitted: ImageMetrics,
    /// Means over the views of each relighting or edit with ground truth.
    pub relight: BTreeMap<String, ImageMetrics>,
    /// The same after one gain a colour for all views of an edit: what is left when the exposure is matched.
    pub relight_gained: BTreeMap<String, ImageMetrics>,
    /// Mean angle between true and rendered shading normals in degrees, where there is truth.
    pub normal_mae_deg: Option<f64>,
    /// The median of these angles.
    pub normal_median_deg: Option<f64>,
    /// Mean absolute error of roughness where the surface reflects, where there is truth.
    pub roughness_mae: Option<f64>,
    /// PSNR of the albedo in dB, where there is truth.
    pub albedo_psnr: Option<f64>,
    /// Mean PSNR of panoramas in dB, where there is truth.
    pub pano_psnr: Option<f64>,
}

/// What is measured of views besides what always is, and how.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measures<'a> {
    /// How the training photos are exposed, where each in its own way.
    pub exposures: Option<&'a PhotoExposures>,
    /// The weights for LPIPS.
    pub lpips: Option<&'a Lpips>,
    /// What is fitted to each photo for [`ViewMetrics::fitted`].
    pub fitted: Option<PoseFit>,
}

/// Renders each view, with its photo's exposure where it was trained on and had its own, and measures it against its
/// photo; `on_view` gets each picture. `None` when cancelled.
pub fn evaluate_views(
    scene: &Scene,
    views: &[View],
    measures: Measures<'_>,
    cancel: &AtomicBool,
    on_view: &mut dyn FnMut(usize, &View, &Picture),
) -> Option<Vec<ViewMetrics>> {
    let scene = &scene.lit(cancel)?;
    let mut results = Vec::with_capacity(views.len());
    for (index, view) in views.iter().enumerate() {
        let own = measures.exposures.and_then(|photos| photos.trained(view));
        let exposed = own.map(|gain| scene.exposed(gain));
        let scene = exposed.as_ref().unwrap_or(scene);
        let picture = render(scene, &view.camera, Layer::Final, cancel, &|_| {})?;
        let (truth, mask) = truth_and_mask(view, picture.pixels.len());
        let width = picture.width as usize;
        let mut metrics = compare(&picture.pixels, &truth, mask.as_deref(), width);
        let own = match measures.fitted {
            Some(pose) => fitted(scene, view, &picture, pose, cancel)?,
            None => ImageMetrics::default(),
        };
        metrics.lpips = measures
            .lpips
            .and_then(|lpips| lpips.distance(&truth, &picture.pixels, width));
        results.push(ViewMetrics {
            name: view.name.clone(),
            metrics,
            fitted: own,
        });
        on_view(index, view, &picture);
    }
    Some(results)
}

/// Renders each view with a model that knows nothing of the environment, and measures what it explains: the object
/// and masked scopes. The other measures, which take in the environment, stay `None`. `None` when cancelled.
pub fn evaluate_object(
    model: &NeilfModel,
    views: &[View],
    cancel: &AtomicBool,
) -> Option<Vec<ImageMetrics>> {
    let measure = |view: &View| {
        let picture = render_neilf(model, &view.camera, cancel)?;
        let (truth, mask) = truth_and_mask(view, picture.pixels.len());
        let metrics = mask.map(|mask| compare_object(&picture.pixels, &truth, &mask));
        Some(metrics.unwrap_or_default())
    };
    views.iter().map(measure).collect()
}

/// The mean of the measures over views.
pub fn mean_of_views(views: &[ViewMetrics]) -> ImageMetrics {
    let metrics: Vec<ImageMetrics> = views.iter().map(|view| view.metrics).collect();
    mean(&metrics)
}

/// The mean over views of what is left when each photo's exposure is undone.
pub fn mean_fitted(views: &[ViewMetrics]) -> ImageMetrics {
    let metrics: Vec<ImageMetrics> = views.iter().map(|view| view.fitted).collect();
    mean(&metrics)
}

/// The scene after an edit with ground truth. Environments of other captures are looked up by name.
///
/// # Errors
/// What is missing or unknown, in words: the edit cannot be measured then.
pub fn relit(
    scene: &Scene,
    apply: &RelightApply,
    environments: &BTreeMap<String, Arc<Environment>>,
) -> Result<Scene, String> {
    if let Some(unknown) = apply.unknown.keys().next() {
        return Err(format!("the edit `{unknown}` is not known"));
    }
    let mut relit = scene.clone();
    if let Some(name) = &apply.environment_of {
        let environment = environments.get(name);
        let missing = || format!("the environment of `{name}` is not given");
        relit.swap_environment(Arc::clone(environment.ok_or_else(missing)?));
    }
    if let Some(moved) = apply.environment_transform {
        relit.transform = EnvironmentTransform {
            rotate_deg: moved.rotate_deg_xyz,
            translate: moved.translate,
            ..EnvironmentTransform::default()
        };
    }
    relit.edit = MaterialEdit {
        roughness: match apply.roughness {
            Some(roughness) => RoughnessEdit::Constant(roughness),
            None => MaterialEdit::default().roughness,
        },
        tint_scale: apply.specular_scale.unwrap_or(1.0),
        ..MaterialEdit::default()
    };
    Ok(relit)
}

/// `env_panos.json`: what the environment looks like from listed points.
#[derive(Deserialize)]
struct PanoramaList {
    panos: Vec<PanoramaTruth>,
}

#[derive(Deserialize)]
struct PanoramaTruth {
    file: String,
    position: Vec3,
}

/// Mean PSNR, in dB, of the environment seen from the points of `root/env_panos.json`, after
/// clipping to 0..1 and sRGB encoding. `None` without that file, or when cancelled.
///
/// # Errors
/// When the file or one of its pictures is damaged.
pub fn panorama_psnr(
    scene: &Scene,
    root: &Path,
    cancel: &AtomicBool,
) -> Result<Option<f64>, DataError> {
    let json = root.join("env_panos.json");
    if !json.is_file() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&json).map_err(|source| DataError::io(&json, source))?;
    let list: PanoramaList = serde_json::from_str(&text).map_err(|source| DataError::Json {
        path: json.clone(),
        source,
    })?;
    let Some(scene) = scene.emptied(cancel) else {
        return Ok(None);
    };
    let mut found = Vec::new();
    for truth in &list.panos {
        let (width, _, pixels) = read_exr_linear(&root.join(&truth.file))?;
        let Some(seen) = panorama(&scene, truth.position, 0.0, width, cancel) else {
            return Ok(None);
        };
        let mut error = SquaredError::default();
        for (truth, seen) in pixels.iter().zip(&seen.pixels) {
            let truth = truth.map(|v| srgb_from_linear(v.clamp(0.0, 1.0)));
            let seen = compose(&scene, Layer::Environment, 0.0, [0.0; 3], *seen);
            error.add(seen, truth);
        }
        found.extend(error.psnr());
    }
    Ok(mean_of(&found))
}

/// Differences between roughnesses, of every pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoughnessError(Vec<f64>);

impl RoughnessError {
    /// Adds the pixels of a view whose true roughness is given, `[height * width]`, where the true reflectance at normal
    /// incidence is at least 0.03 (nothing shows the roughness of a surface that does not reflect) and the pixel is
    /// all object. Pixels that miss the mesh are left out.
    pub fn add_view(
        &mut self,
        scene: &Scene,
        view: &View,
        roughness: &[[f32; 3]],
        reflectance: &[[f32; 3]],
        cancel: &AtomicBool,
    ) {
        const REFLECTS: f32 = 0.03;
        let layer = Layer::Roughness;
        let options = PathOptions::PLAIN;
        let Some(shown) = render_with(scene, &view.camera, layer, options, cancel, &|_| {}) else {
            return;
        };
        for (i, shown) in shown.pixels.iter().enumerate() {
            let is_whole = view.mask.as_ref().is_none_or(|mask| mask.share(i) > 0.99);
            if is_whole && reflectance[i].iter().any(|v| *v >= REFLECTS) {
                self.0.push(f64::from((shown[0] - roughness[i][0]).abs()));
            }
        }
    }

    /// The mean; none without pixels.
    pub fn mean(&self) -> Option<f64> {
        mean_of(&self.0)
    }
}

/// Pixels of the albedo with their truth, linear.
#[derive(Clone, Debug, Default)]
pub struct AlbedoError(Vec<[[f32; 3]; 2]>);

impl AlbedoError {
    /// Adds the pixels of a view that are all object and whose true diffuse reflectance is given, `[height * width]`: where
    /// that is 0, the true reflectance at normal incidence `base_color` is compared with the tint.
    pub fn add_view(
        &mut self,
        scene: &Scene,
        view: &View,
        (diffuse, base_color): (&[[f32; 3]], &[[f32; 3]]),
        cancel: &AtomicBool,
    ) {
        let layers = [Layer::Albedo, Layer::Tint];
        let options = PartsOptions::new(&layers);
        let Some(parts) = render_parts(scene, &view.camera, &options, cancel, &|_| {}) else {
            return;
        };
        let [albedo, tint] = [0, 1].map(|layer: usize| &parts.objects[layer].1);
        for (i, diffuse) in diffuse.iter().enumerate() {
            let is_whole = view.mask.as_ref().is_none_or(|mask| mask.share(i) > 0.99);
            if !is_whole || parts.coverage[i] < 0.99 {
                continue;
            }
            let is_metal = diffuse.iter().all(|v| *v <= 0.0);
            self.0.push(if is_metal {
                [tint[i], base_color[i]]
            } else {
                [albedo[i], *diffuse]
            });
        }
    }

    /// PSNR in sRGB after the gain a colour that brings all pixels nearest to the truth; none without pixels.
    pub fn psnr(&self) -> Option<f64> {
        let gain: [f32; 3] = std::array::from_fn(|c| {
            let sum = |of: fn([f32; 2]) -> f32| -> f64 {
                let pixels = self.0.iter();
                pixels
                    .map(|[shown, truth]| f64::from(of([shown[c], truth[c]])))
                    .sum()
            };
            let squares = sum(|[shown, _]| shown * shown);
            // Black stays black whatever the gain.
            if squares > 0.0 {
                (sum(|[shown, truth]| shown * truth) / squares) as f32
            } else {
                1.0
            }
        });
        let mut error = SquaredError::default();
        for [shown, truth] in &self.0 {
            let srgb = |v: f32| srgb_from_linear(v.clamp(0.0, 1.0));
            let gained = std::array::from_fn(|c| srgb(shown[c] * gain[c]));
            error.add(gained, truth.map(srgb));
        }
        error.psnr()
    }
}

/// Angles between normals in degrees, of every pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalError(Vec<f32>);

impl NormalError {
    /// Adds the pixels of a view whose true world normal is given, `[height * width]`, zero where
    /// there is no surface. Pixels that miss the mesh are left out.
    pub fn add_view(&mut self, scene: &Scene, camera: &Camera, truth: &[[f32; 3]]) {
        let Some(object) = &scene.object else {
            return;
        };
        for (i, normal) in truth.iter().enumerate() {
            let truth = Vec3::from(*normal);
            // Antialiased silhouettes hold shortened normals, which mean nothing.
            if truth.length_squared() < 0.81 {
                continue;
            }
            let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            if let Some(hit) = object.tracer.intersect(&ray, 0.0, f32::INFINITY) {
                self.0.push(hit.normal.angle_between(truth).to_degrees());
            }
        }
    }

    /// Mean angle in degrees; none without pixels.
    pub fn mean_deg(&self) -> Option<f64> {
        let angles: Vec<f64> = self.0.iter().copied().map(f64::from).collect();
        mean_of(&angles)
    }

    /// Median angle in degrees; none without pixels.
    pub fn median_deg(&self) -> Option<f64> {
        let mut angles = self.0.clone();
        (!angles.is_empty()).then(|| f64::from(middle(&mut angles)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_albedo_is_compared_after_one_gain_a_colour() {
        let truth = [[0.1, 0.2, 0.3], [0.4, 0.1, 0.2], [0.05, 0.3, 0.6]];
        let gained = |v: [f32; 3]| [2.0 * v[0], 0.5 * v[1], v[2]];
        let same = AlbedoError(truth.iter().map(|v| [gained(*v), *v]).collect());
        assert!(same.psnr().expect("pixels") > 80.0, "{:?}", same.psnr());
        let mut other = same;
        other.0[1][0][0] = 0.0;
        assert!(other.psnr().expect("pixels") < 20.0, "{:?}", other.psnr());
        assert_eq!(AlbedoError::default().psnr(), None);
    }

    #[test]
    fn the_report_has_the_promised_fields_in_order() {
        let view = ViewMetrics {
            name: "r_000".to_owned(),
            metrics: ImageMetrics::default(),
            fitted: ImageMetrics::default(),
        };
        let report = EvalReport {
            split: "test".to_owned(),
            train_seconds: Some(1.5),
            steps: None,
            mean: mean_of_views(std::slice::from_ref(&view)),
            mean_fitted: mean_fitted(std::slice::from_ref(&view)),
            views: vec![view],
            relight: BTreeMap::from([("rough_02".to_owned(), ImageMetrics::default())]),
            relight_gained: BTreeMap::new(),
            normal_mae_deg: None,
            normal_median_deg: None,
            roughness_mae: None,
            albedo_psnr: None,
            pano_psnr: Some(20.0),
        };
        let keys = r#""psnr":null,"psnr_object":null,"psnr_background":null,"psnr_masked":null,"psnr_near":null,"ssim":null,"lpips":null,"flip":null"#;
        assert_eq!(
            serde_json::to_string(&report).unwrap(),
            format!(
                r#"{{"split":"test","train_seconds":1.5,"steps":null,"views":[{{"name":"r_000",{keys},"fitted":{{{keys}}}}}],"mean":{{{keys}}},"mean_fitted":{{{keys}}},"relight":{{"rough_02":{{{keys}}}}},"relight_gained":{{}},"normal_mae_deg":null,"normal_median_deg":null,"roughness_mae":null,"albedo_psnr":null,"pano_psnr":20.0}}"#
            )
        );
    }
}
