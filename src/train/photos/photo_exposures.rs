//! The exposures of a run's photos, and that of another photo beside which the scene is shown.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::data::{DataError, Dataset, Split, View, write_atomically};
use crate::render::{Layer, Scene, render};
use crate::train::measure::held_out::nearest_gain;

/// The longer side of the pictures that another photo's exposure is found with, pixels.
const COMPARED_SIDE: u32 = 32;
/// Largest gain that is found; its reciprocal is the least.
const MOST: f32 = 20.0;

/// Exposure and white balance of one photo; runs from before noted more, which is not read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct PhotoExposure {
    name: String,
    /// What it multiplies radiance by, a colour; their geometric mean over the photos is 1.
    gain: Vec3,
}

/// Those of all training photos.
#[derive(Debug, Default)]
pub struct PhotoExposures {
    photos: Vec<PhotoExposure>,
    /// What was found for other photos, by name.
    found: Mutex<BTreeMap<(Split, String), Vec3>>,
}

impl PhotoExposures {
    /// Of the training photos, with their gains.
    pub(crate) fn of(dataset: &Dataset, gains: &[Vec3]) -> Self {
        let of_photo = |(view, gain): (&View, &Vec3)| PhotoExposure {
            name: view.name.clone(),
            gain: *gain,
        };
        Self::new(dataset.train.iter().zip(gains).map(of_photo).collect())
    }

    fn new(photos: Vec<PhotoExposure>) -> Self {
        Self {
            photos,
            ..Self::default()
        }
    }

    /// The same photos with other gains, in their order.
    pub(in crate::train) fn with_gains(&self, gains: &[Vec3]) -> Self {
        let of_photo = |(photo, gain): (&PhotoExposure, &Vec3)| PhotoExposure {
            name: photo.name.clone(),
            gain: *gain,
        };
        Self::new(self.photos.iter().zip(gains).map(of_photo).collect())
    }

    /// The gain a colour of the view's photo; `None` where it was not trained on, though one of the same name was.
    pub fn trained(&self, view: &View) -> Option<Vec3> {
        let mut photos = self.photos.iter().filter(|_| view.split == Split::Train);
        let photo = photos.find(|photo| photo.name == view.name);
        photo.map(|photo| photo.gain)
    }

    /// The gain a colour of the view's photo: its own where it was trained on, else the one that brings the unedited `scene`
    /// nearest to it.
    pub fn gain(&self, view: &View, scene: &Scene) -> Vec3 {
        if let Some(own) = self.trained(view) {
            return own;
        }
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        let find = || fitting_gain(view, scene);
        let photo = (view.split, view.name.clone());
        *found.entry(photo).or_insert_with(find)
    }

    /// Reads what [`Self::write`] wrote; `None` where there is no file.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(in crate::train) fn read(path: &Path) -> Result<Option<Self>, DataError> {
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
        let is_sane =
            |photo: &PhotoExposure| photo.gain.is_finite() && photo.gain.min_element() > 0.0;
        match photos.iter().position(|photo| !is_sane(photo)) {
            Some(frame) => Err(DataError::Field {
                path: path.to_owned(),
                frame: Some(frame),
                field: "gain".to_owned(),
                problem: "the gain must be finite and above 0".to_owned(),
            }),
            None => Ok(Some(Self::new(photos))),
        }
    }

    /// Writes the list as JSON; whole or not at all.
    pub(in crate::train) fn write(&self, path: &Path) -> std::io::Result<()> {
        let json = serde_json::to_string(&self.photos)?;
        write_atomically(path, |file| file.write_all(json.as_bytes()))
    }
}

/// The gain a colour of radiance with which the scene looks most like the photo, in small.
fn fitting_gain(view: &View, scene: &Scene) -> Vec3 {
    let small = view.within(COMPARED_SIDE);
    let never = AtomicBool::new(false);
    let Some(picture) = render(scene, &small.camera, Layer::Final, &never, &|_| ()) else {
        return Vec3::ONE;
    };
    let shown = nearest_gain(&[small], &[picture], |_, _| true);
    // The display transform raises all to a power.
    let gain = Vec3::from(shown).powf(1.0 / scene.environment.gamma());
    if gain.is_finite() {
        gain.clamp(Vec3::splat(1.0 / MOST), Vec3::splat(MOST))
    } else {
        Vec3::ONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::fog;
    use crate::train::test_scene::sphere_in_a_box;

    fn photos() -> PhotoExposures {
        let photo = |name: &str, gain: f32| PhotoExposure {
            name: name.to_owned(),
            gain: Vec3::new(gain, 1.0, 1.0 / gain),
        };
        PhotoExposures::new(vec![photo("a", 0.5), photo("b", 2.0)])
    }

    #[test]
    fn another_photo_has_the_exposure_that_it_looks_like() {
        let mut view = sphere_in_a_box(2, 8).train.remove(0);
        view.name = "a".to_owned();
        let scene = Scene::new(None, fog(0.2_f32.ln(), 0.0));
        let own = photos().gain(&view, &scene);
        assert_eq!(own, Vec3::new(0.5, 1.0, 2.0), "its own");
        // A held-out photo of the same name is another.
        view.split = Split::Test;
        assert_eq!(photos().trained(&view), None);
        let n = view.photo.n_pixels();
        let shown = (0..n).map(|i| Vec3::from(view.photo.linear(i)));
        let shown = shown.sum::<Vec3>() / n as f32;
        let gain = photos().gain(&view, &scene);
        let off = (0.2 * gain - shown).abs().max_element();
        assert!(off < 0.02, "{gain} for {shown}");
        let dark = Scene::new(None, fog(-80.0, 0.0));
        assert_eq!(photos().gain(&view, &dark), Vec3::splat(MOST), "nothing");
    }

    #[test]
    fn the_file_keeps_them_and_a_damaged_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("exposures.json");
        assert!(PhotoExposures::read(&path).unwrap().is_none());
        photos().write(&path).unwrap();
        let read = PhotoExposures::read(&path).unwrap().expect("a file");
        assert_eq!(read.photos, photos().photos);
        for bad in [r#"[{"name":"a","gain":[0,1,1]}]"#, r#"[{"name":"a"}]"#] {
            std::fs::write(&path, bad).unwrap();
            let message = PhotoExposures::read(&path).unwrap_err().to_string();
            let are_named = ["exposures.json", "gain"].map(|what| message.contains(what));
            assert_eq!(are_named, [true; 2], "{message}");
        }
    }
}
