//! The exposures of a run's photos, and what that of another photo probably is.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::exposure_law::{ExposureLaw, LawSums, Meter, log_light, mean_color};
use crate::data::{DataError, Dataset, View, write_atomically};
use crate::render::Scene;

/// Distances over which exposures of neighbouring photos may be alike, in mean distances of the cameras from their centre;
/// the last is the mean of all.
const ALIKE: [f32; 6] = [0.07, 0.15, 0.3, 0.6, 1.2, 1e3];
/// Most photos whose exposures are foretold from the others to find which distance it is.
const MOST_FORETOLD: usize = 256;

/// How often a gain is metered anew with the gain before.
const ROUNDS: usize = 4;

/// Exposure and white balance of one photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoExposure {
    /// The photo's name.
    pub name: String,
    /// Where its camera stood, world.
    pub position: Vec3,
    /// What it multiplies radiance by, a colour; their geometric mean over the photos is 1.
    pub gain: Vec3,
    /// The mean of its colours, linear; runs from before did not note it.
    #[serde(default)]
    pub mean: Option<Vec3>,
}

/// Those of all training photos.
#[derive(Debug, Default)]
pub struct PhotoExposures {
    photos: Vec<PhotoExposure>,
    /// Found when it is first asked for.
    foretelling: OnceLock<Foretelling>,
    /// What was foretold of other photos, by name.
    foretold: Mutex<BTreeMap<String, Vec3>>,
}

/// How exposures are foretold.
#[derive(Clone, Debug, PartialEq)]
struct Foretelling {
    /// How they follow from the light, where that helps.
    law: Option<ExposureLaw>,
    /// What the law leaves of the photos' logarithms.
    rest: Vec<Vec3>,
    /// Distance over which these are alike, world units.
    alike: f32,
}

impl PhotoExposures {
    /// Of the training photos, with their gains.
    pub(crate) fn of(dataset: &Dataset, gains: &[Vec3]) -> Self {
        let of_photo = |(view, gain): (&View, &Vec3)| PhotoExposure {
            name: view.name.clone(),
            position: view.camera.position(),
            gain: *gain,
            mean: Some(mean_color(&view.photo)),
        };
        let photos = dataset.train.par_iter().zip(gains);
        Self::new(photos.map(of_photo).collect())
    }

    fn new(photos: Vec<PhotoExposure>) -> Self {
        Self {
            photos,
            ..Self::default()
        }
    }

    /// The same photos with other gains, in their order.
    pub(super) fn with_gains(&self, gains: &[Vec3]) -> Self {
        let mut photos = self.photos.clone();
        for (photo, gain) in photos.iter_mut().zip(gains) {
            photo.gain = *gain;
        }
        Self::new(photos)
    }

    /// The gain a colour of the view's photo: its own where it is known, else what automatic exposure and white balance
    /// would choose for what the unedited `scene` shows, as they did for the training photos; and as near ones did.
    pub fn gain(&self, view: &View, scene: &Scene) -> Vec3 {
        if let Some(own) = self.photos.iter().find(|photo| photo.name == view.name) {
            return own.gain;
        }
        let mut known = self.foretold.lock().unwrap_or_else(PoisonError::into_inner);
        let foretell = || self.foretell(view.camera.position(), || Meter::of(scene, &view.camera));
        *known.entry(view.name.clone()).or_insert_with(foretell)
    }

    /// The gain of another photo.
    fn foretell(&self, position: Vec3, meter: impl FnOnce() -> Meter) -> Vec3 {
        let by = self.foretelling.get_or_init(|| self.learn());
        let rest = self.nearby(&by.rest, position, by.alike, None);
        let Some(law) = by.law else {
            return rest.exp();
        };
        let meter = meter();
        let gains = || self.photos.iter().map(|photo| photo.gain);
        let least = gains().fold(Vec3::INFINITY, Vec3::min);
        let most = gains().fold(Vec3::ZERO, Vec3::max);
        // What is clipped depends on the gain. No camera goes far beyond what it did.
        (0..ROUNDS).fold(Vec3::ONE, |gain, _| {
            let light = log_light(meter.mean_color(gain), gain);
            let foretold = (law.log_gain(light) + rest).exp();
            foretold.clamp(least, most)
        })
    }

    /// Finds what foretells those of the photos from all others best.
    fn learn(&self) -> Foretelling {
        let log_gains: Vec<Vec3> = self.photos.iter().map(|p| p.gain.map(f32::ln)).collect();
        let (alike, error) = self.best_alike(&log_gains);
        let plain = Foretelling {
            law: None,
            rest: log_gains,
            alike,
        };
        let Some((law, rest)) = self.law() else {
            return plain;
        };
        let (alike, error_by_law) = self.best_alike(&rest);
        if error_by_law >= error {
            return plain;
        }
        Foretelling {
            law: Some(law),
            rest,
            alike,
        }
    }

    /// How gains follow from the light, and what that leaves of each photo's, foretold from all others.
    fn law(&self) -> Option<(ExposureLaw, Vec<Vec3>)> {
        let sample = |photo: &PhotoExposure| {
            Some((log_light(photo.mean?, photo.gain), photo.gain.map(f32::ln)))
        };
        let samples: Vec<(Vec3, Vec3)> = self.photos.iter().map(sample).collect::<Option<_>>()?;
        let all = samples
            .iter()
            .fold(LawSums::NONE, |sums, sample| sums.with(*sample, 1.0));
        let rest = |(light, gain): &(Vec3, Vec3)| {
            let others = all.with((*light, *gain), -1.0).law()?;
            Some(*gain - others.log_gain(*light))
        };
        let rest = samples.iter().map(rest).collect::<Option<_>>()?;
        Some((all.law()?, rest))
    }

    /// The distance over which the photos' `values` are alike, that which foretells them from all others best; and the
    /// error.
    fn best_alike(&self, values: &[Vec3]) -> (f32, f32) {
        let n = self.photos.len().max(1) as f32;
        let center = self.photos.iter().map(|photo| photo.position).sum::<Vec3>() / n;
        let distances = self
            .photos
            .iter()
            .map(|photo| photo.position.distance(center));
        let mean = distances.sum::<f32>() / n;
        let stride = self.photos.len().div_ceil(MOST_FORETOLD).max(1);
        let error = |alike: f32| -> f32 {
            let photos = self.photos.iter().enumerate().step_by(stride);
            let errors = photos.map(|(i, photo)| {
                let foretold = self.nearby(values, photo.position, alike, Some(i));
                foretold.distance_squared(values[i])
            });
            errors.sum()
        };
        let choices = ALIKE.map(|alike| (alike * mean, error(alike * mean)));
        let best = choices.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.unwrap_or((mean, 0.0))
    }

    /// The mean of the photos' `values` by nearness to a place, all photos but one.
    fn nearby(&self, values: &[Vec3], position: Vec3, alike: f32, without: Option<usize>) -> Vec3 {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (i, (photo, value)) in self.photos.iter().zip(values).enumerate() {
            if Some(i) == without {
                continue;
            }
            // Never nought, so that a camera far away gets the mean.
            let away = photo.position.distance(position) / alike.max(f32::MIN_POSITIVE);
            let weight = (-away).exp().max(1e-30);
            sum += weight * *value;
            total += weight;
        }
        if total > 0.0 { sum / total } else { Vec3::ZERO }
    }

    /// Reads what [`Self::write`] wrote; `None` where there is no file.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(super) fn read(path: &Path) -> Result<Option<Self>, DataError> {
        if !path.is_file() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(path).map_err(|source| DataError::Io {
            path: path.to_owned(),
            source,
        })?;
        let photos: Vec<PhotoExposure> =
            serde_json::from_str(&text).map_err(|source| DataError::Json {
                path: path.to_owned(),
                source,
            })?;
        let is_sane = |photo: &PhotoExposure| {
            let mean = photo.mean.unwrap_or_default();
            let is_placed = photo.position.is_finite() && mean.is_finite();
            is_placed && photo.gain.is_finite() && photo.gain.min_element() > 0.0
        };
        match photos.iter().position(|photo| !is_sane(photo)) {
            Some(frame) => Err(DataError::Field {
                path: path.to_owned(),
                frame: Some(frame),
                field: "gain".to_owned(),
                problem: "position and gain must be finite, and the gain above 0".to_owned(),
            }),
            None => Ok(Some(Self::new(photos))),
        }
    }

    /// Writes the list as JSON; whole or not at all.
    pub(super) fn write(&self, path: &Path) -> std::io::Result<()> {
        let json = serde_json::to_string(&self.photos)?;
        write_atomically(path, |file| file.write_all(json.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::{camera, fog};
    use crate::train::test_scene::sphere_in_a_box;

    fn photos() -> PhotoExposures {
        let photo = |name: &str, x: f32, gain: f32| PhotoExposure {
            name: name.to_owned(),
            position: Vec3::new(x, 0.0, 1.0),
            gain: Vec3::new(gain, 1.0, 1.0 / gain),
            mean: None,
        };
        PhotoExposures::new(vec![
            photo("a", -2.0, 0.5),
            photo("b", -1.9, 0.6),
            photo("c", 2.0, 2.0),
        ])
    }

    fn no_meter() -> Meter {
        panic!("nothing is known of the photos' light");
    }

    #[test]
    fn a_photo_has_the_exposure_of_its_neighbours() {
        let photos = photos();
        let near = photos.foretell(Vec3::new(-1.95, 0.0, 1.0), no_meter);
        assert!((0.5..0.6).contains(&near.x), "{near}");
        assert!((near.x * near.z - 1.0).abs() < 1e-5, "{near}");
        let far = photos.foretell(Vec3::splat(1e6), no_meter);
        let mean = (0.5_f32 * 0.6 * 2.0).cbrt();
        assert!((far.x - mean).abs() < 1e-3, "{far}, not {mean}");
        let none = PhotoExposures::default();
        assert_eq!(none.foretell(Vec3::ZERO, no_meter), Vec3::ONE);
    }

    /// Photos of cameras anywhere, in light of that strength a colour, with that gain.
    fn taken_in(photo: impl Fn(usize) -> (f32, f32)) -> PhotoExposures {
        let photos = (0..40).map(|i| {
            let (light, gain) = photo(i);
            PhotoExposure {
                name: i.to_string(),
                position: Vec3::new((7 * i % 40) as f32, (11 * i % 40) as f32, 1.0),
                gain: Vec3::splat(gain),
                mean: Some(Vec3::splat(light * gain)),
            }
        });
        PhotoExposures::new(photos.collect())
    }

    #[test]
    fn automatic_exposure_follows_the_light() {
        let auto = taken_in(|i| {
            let light = 0.1 + 0.01 * i as f32;
            (light, 0.2 / light)
        });
        let scene = |light: f32| Scene::new(None, fog(light.ln(), 0.0));
        let view = |name: &str| View {
            name: name.to_owned(),
            camera: camera(64, 48),
            ..sphere_in_a_box(2, 8).train.remove(0)
        };
        for light in [0.12_f32, 0.3] {
            let gain = auto.gain(&view(&light.to_string()), &scene(light));
            assert!(
                (gain * light - 0.2).abs().max_element() < 0.02,
                "{gain} in {light}"
            );
        }
        let dark = auto.gain(&view("dark"), &scene(1e-3));
        assert!(
            (dark - 2.0).abs().max_element() < 1e-3,
            "{dark}: no photo has more"
        );
        assert_eq!(
            auto.gain(&view("7"), &scene(0.3)),
            auto.photos[7].gain,
            "its own"
        );
        let by_hand = taken_in(|i| {
            (
                0.1 + 0.01 * i as f32,
                if i.is_multiple_of(3) { 1.3 } else { 0.9 },
            )
        });
        assert_eq!(by_hand.learn().law, None, "gains of chance follow nothing");
    }

    #[test]
    fn the_file_keeps_them_and_a_damaged_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("exposures.json");
        assert!(PhotoExposures::read(&path).unwrap().is_none());
        photos().write(&path).unwrap();
        let read = PhotoExposures::read(&path).unwrap().expect("a file");
        assert_eq!(read.photos, photos().photos);
        for (bad, what) in [
            (
                r#"[{"name":"a","position":[0,0,0],"gain":[0,1,1]}]"#,
                "gain",
            ),
            (r#"[{"name":"a","position":[0,0,0]}]"#, "gain"),
        ] {
            std::fs::write(&path, bad).unwrap();
            let message = PhotoExposures::read(&path).unwrap_err().to_string();
            assert!(
                message.contains("exposures.json") && message.contains(what),
                "{message}"
            );
        }
    }
}
