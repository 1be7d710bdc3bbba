//! The exposures of a run's photos, and what that of another photo probably is.

use std::io::Write as _;
use std::path::Path;
use std::sync::OnceLock;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::data::{DataError, Dataset, View, write_atomically};
use crate::render::Scene;

/// Distances over which exposures of neighbouring photos may be alike, in mean distances of the cameras from their centre;
/// the last is the mean of all.
const ALIKE: [f32; 6] = [0.07, 0.15, 0.3, 0.6, 1.2, 1e3];
/// Most photos whose exposures are foretold from the others to find which distance it is.
const MOST_FORETOLD: usize = 256;

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
}

/// Those of all training photos.
#[derive(Clone, Debug, Default)]
pub struct PhotoExposures {
    photos: Vec<PhotoExposure>,
    /// Distance over which they are alike, world units; found when it is first asked for.
    alike: OnceLock<f32>,
}

impl PhotoExposures {
    /// Of the training photos, all alike.
    pub(super) fn even(dataset: &Dataset) -> Self {
        let of_photo = |view: &View| PhotoExposure {
            name: view.name.clone(),
            position: view.camera.position(),
            gain: Vec3::ONE,
        };
        Self::new(dataset.train.iter().map(of_photo).collect())
    }

    fn new(photos: Vec<PhotoExposure>) -> Self {
        Self {
            photos,
            alike: OnceLock::new(),
        }
    }

    /// The same photos with other gains, in their order.
    pub(super) fn with_gains(mut self, gains: &[Vec3]) -> Self {
        for (photo, gain) in self.photos.iter_mut().zip(gains) {
            photo.gain = *gain;
        }
        Self::new(self.photos)
    }

    /// The gain a colour of the photo `name` taken at `position`: its own where it is known, else the geometric mean of the
    /// others by nearness. Automatic exposure follows what a camera sees, and neighbours see much the same.
    pub fn gain(&self, name: &str, position: Vec3) -> Vec3 {
        if let Some(own) = self.photos.iter().find(|photo| photo.name == name) {
            return own.gain;
        }
        let alike = *self.alike.get_or_init(|| self.best_alike());
        self.foretold(position, alike, None).exp()
    }

    /// The distance over which exposures are alike: the one that foretells those of the photos from all others
    /// best.
    fn best_alike(&self) -> f32 {
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
                let foretold = self.foretold(photo.position, alike, Some(i));
                foretold.distance_squared(photo.gain.map(f32::ln))
            });
            errors.sum()
        };
        let choices = ALIKE.map(|alike| (error(alike * mean), alike * mean));
        let best = choices.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(mean, |(_, alike)| alike)
    }

    /// The logarithm of the gain at a place, from all photos but one.
    fn foretold(&self, position: Vec3, alike: f32, without: Option<usize>) -> Vec3 {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (i, photo) in self.photos.iter().enumerate() {
            if Some(i) == without {
                continue;
            }
            // Never nought, so that a camera far away gets the mean.
            let away = photo.position.distance(position) / alike.max(f32::MIN_POSITIVE);
            let weight = (-away).exp().max(1e-30);
            sum += weight * photo.gain.map(f32::ln);
            total += weight;
        }
        if total > 0.0 { sum / total } else { Vec3::ZERO }
    }

    /// The scene with the gain of the view's photo.
    pub fn exposed_like(&self, view: &View, scene: &Scene) -> Scene {
        scene.exposed(self.gain(&view.name, view.camera.position()))
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
            photo.position.is_finite() && photo.gain.is_finite() && photo.gain.min_element() > 0.0
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

    fn photos() -> PhotoExposures {
        let photo = |name: &str, x: f32, gain: f32| PhotoExposure {
            name: name.to_owned(),
            position: Vec3::new(x, 0.0, 1.0),
            gain: Vec3::new(gain, 1.0, 1.0 / gain),
        };
        PhotoExposures::new(vec![
            photo("a", -2.0, 0.5),
            photo("b", -1.9, 0.6),
            photo("c", 2.0, 2.0),
        ])
    }

    #[test]
    fn a_photo_has_its_own_exposure_and_another_that_of_its_neighbours() {
        let photos = photos();
        let at = |x: f32| Vec3::new(x, 0.0, 1.0);
        assert_eq!(photos.gain("c", at(-2.0)).x, 2.0, "its own");
        let near = photos.gain("new", at(-1.95));
        assert!((0.5..0.6).contains(&near.x), "{near}");
        assert!((near.x * near.z - 1.0).abs() < 1e-5, "{near}");
        let far = photos.gain("new", Vec3::splat(1e6));
        let mean = (0.5_f32 * 0.6 * 2.0).cbrt();
        assert!((far.x - mean).abs() < 1e-3, "{far}, not {mean}");
        assert_eq!(PhotoExposures::default().gain("new", at(0.0)), Vec3::ONE);
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
