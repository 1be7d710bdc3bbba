//! Environments from equirectangular picture files: `.hdr`, `.exr`, and with a notice `.png` and `.jpg`.

use std::path::Path;

use glam::{Quat, Vec3};

use super::equirect::Equirect;
use super::light::{DistantConfig, DistantLight};
use super::pyramid::MAX_WIDTH;
use crate::color::exposure_gain;
use crate::data::{Photo, read_photo};
use crate::neif::{Environment, NeifError};

/// Least width that is kept; a lamp must be distinguishable from its opposite.
const MIN_WIDTH: usize = 8;
/// How far the sides' ratio may be from two.
const RATIO_TOLERANCE: f32 = 0.01;

/// How a picture becomes an environment.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportOptions {
    /// The unit direction in the world that the picture's top becomes. The centre of a picture whose top is +z, the convention here
    /// and in Blender, is at +x; others are turned from there by the least angle.
    pub up: Vec3,
    /// Rotation about it, degrees, anticlockwise seen from above.
    pub rotate_deg: f32,
    /// Exposure, stops.
    pub exposure_ev: f32,
    /// Height of the camera above a level floor that the picture stands on, scene units, positive; none is infinitely far.
    pub floor: Option<f32>,
    /// Shown in lists; none is the file's name.
    pub name: Option<String>,
}

impl Default for ImportOptions {
    /// As it is, z up.
    fn default() -> Self {
        Self {
            up: Vec3::Z,
            rotate_deg: 0.0,
            exposure_ev: 0.0,
            floor: None,
            name: None,
        }
    }
}

/// What came of a picture.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The environment.
    pub environment: Environment,
    /// What was changed or is lacking, in words.
    pub notices: Vec<String>,
}

/// Whether a file's name is that of a panorama of linear radiance, which is taken wherever an environment is.
pub fn is_panorama_file(path: &Path) -> bool {
    matches!(extension(path).as_str(), "hdr" | "exr")
}

/// Whether a file's name is that of an environment: a trained or imported one, or a panorama.
pub fn is_environment_file(path: &Path) -> bool {
    extension(path) == "safetensors" || is_panorama_file(path)
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

/// Reads an equirectangular picture as an environment of gamma 1.
///
/// Pictures wider than 1024 pixels are reduced to that, each pixel the mean over its solid angle. Negative values become
/// 0, with a notice.
///
/// # Errors
/// When the file is no such picture, is not twice as wide as high, or holds a pixel that is NaN or infinite (named).
pub fn import_environment(path: &Path, options: &ImportOptions) -> Result<Imported, NeifError> {
    let unusable = |what: &str| not_a_panorama(path, what);
    let is_encoded = matches!(extension(path).as_str(), "png" | "jpg" | "jpeg");
    if path.is_dir() {
        return Err(unusable("is a folder"));
    }
    if !is_encoded && !is_panorama_file(path) {
        return Err(unusable("has none of these endings"));
    }
    let photo = read_photo(path)?;
    let (width, height) = (photo.width(), photo.height());
    let ratio = width as f32 / height as f32;
    if (ratio / 2.0 - 1.0).abs() > RATIO_TOLERANCE || (width as usize) < MIN_WIDTH {
        let what = format!(
            "has {width} x {height} pixels; a panorama of all directions is twice as wide as high"
        );
        return Err(unusable(&what));
    }
    let mut notices = Vec::new();
    if is_encoded {
        notices.push("no HDR picture: lamps are no brighter than white".to_owned());
    }
    let pixels = radiance(&photo, exposure_gain(options.exposure_ev), &mut notices);
    let picture = sized(path, &photo, pixels, &mut notices)?;
    let name = options.name.clone().unwrap_or_else(|| file_stem(path));
    let config = DistantConfig {
        width: picture.width(),
        height: picture.height(),
        world_from_picture: world_from_picture(options),
        has_floor: false,
    };
    let light = DistantLight::new(config, picture.pixels().as_flattened())
        .ok_or_else(|| unusable("has an unusable size"))?;
    let far = Environment::of_distant(name, options.up, light);
    Ok(Imported {
        environment: match options.floor {
            Some(height) => far.on_floor(height),
            None => far,
        },
        notices,
    })
}

fn not_a_panorama(path: &Path, what: &str) -> NeifError {
    NeifError::NotAPanorama {
        file: path.to_owned(),
        what: what.to_owned(),
    }
}

/// Linear radiance times a gain; not negative and finite.
fn radiance(photo: &Photo, gain: f32, notices: &mut Vec<String>) -> Vec<[f32; 3]> {
    let mut n_negative = 0;
    let pixels = (0..photo.n_pixels()).map(|i| {
        let pixel = photo.linear(i);
        n_negative += usize::from(pixel.iter().any(|v| *v < 0.0));
        pixel.map(|v| (v.max(0.0) * gain).min(f32::MAX))
    });
    let pixels = pixels.collect();
    if n_negative > 0 {
        notices.push(format!("{n_negative} pixels had negative values: made 0"));
    }
    pixels
}

/// The picture at a supported size: as it is where that is one.
fn sized(
    path: &Path,
    photo: &Photo,
    pixels: Vec<[f32; 3]>,
    notices: &mut Vec<String>,
) -> Result<Equirect, NeifError> {
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let target = (width / 2 * 2).min(MAX_WIDTH);
    // An odd width cannot go on beyond the poles; a column more is only for the way to another size.
    let (columns, pixels) = if width.is_multiple_of(2) {
        (width, pixels)
    } else {
        let doubled = pixels.iter().flat_map(|pixel| [*pixel; 2]).collect();
        (2 * width, doubled)
    };
    let picture = Equirect::new(columns, height, pixels)
        .ok_or_else(|| not_a_panorama(path, "has an unusable size"))?;
    if (columns, height) == (target, target / 2) {
        return Ok(picture);
    }
    notices.push(format!(
        "{width} x {height} pixels were averaged to {target} x {}",
        target / 2
    ));
    Ok(picture.resampled(target, target / 2))
}

fn world_from_picture(options: &ImportOptions) -> Quat {
    let upright = if options.up == Vec3::NEG_Z {
        Quat::from_rotation_x(std::f32::consts::PI)
    } else {
        Quat::from_rotation_arc(Vec3::Z, options.up)
    };
    let turn = Quat::from_axis_angle(options.up, options.rotate_deg.to_radians());
    (turn * upright).normalize()
}

fn file_stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or(path.as_os_str());
    stem.to_string_lossy().into_owned()
}

impl Environment {
    /// Reads an environment file, or a panorama (`.hdr`, `.exr`) as an infinitely far environment with z up.
    ///
    /// # Errors
    /// As [`Self::load`] and [`import_environment`].
    pub fn open(path: &Path) -> Result<Self, NeifError> {
        if is_panorama_file(path) {
            let imported = import_environment(path, &ImportOptions::default())?;
            return Ok(imported.environment);
        }
        Self::load(path)
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::data::{ExrSample, write_exr};
    use crate::neif::Storage;
    use crate::neif::field::field_batch::{FieldBatch, FieldRay};
    use crate::neif::light::environment::{EnvironmentField, LightScratch};

    fn written(width: u32, height: u32, pixels: &[[f32; 3]]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.exr");
        write_exr(&path, width, height, pixels, ExrSample::Float).unwrap();
        (folder, path)
    }

    fn seen(environment: &Environment, d: Vec3) -> Vec3 {
        let mut batch = FieldBatch::default();
        batch
            .rays
            .push(FieldRay::of_pixel([3.0, 2.0, 1.0], d.to_array(), 0.0, 0.0));
        environment.light(&mut batch, &mut LightScratch::default());
        Vec3::from(batch.radiance[0])
    }

    /// Bright above, with a lamp at the picture's centre and one at a quarter.
    fn sky() -> Vec<[f32; 3]> {
        let mut pixels: Vec<[f32; 3]> = (0..32 * 16)
            .map(|i| if i < 32 * 4 { [1.0; 3] } else { [0.1; 3] })
            .collect();
        for x in 14..18 {
            for y in 6..10 {
                pixels[y * 32 + x] = [50.0, 0.0, 0.0];
                pixels[y * 32 + x - 8] = [0.0, 20.0, 0.0];
            }
        }
        pixels
    }

    #[test]
    fn axes_are_as_promised() {
        let (_folder, path) = written(32, 16, &sky());
        let import = |options: ImportOptions| import_environment(&path, &options).unwrap();
        let z_up = import(ImportOptions::default());
        assert!(z_up.notices.is_empty(), "{:?}", z_up.notices);
        let y_up = import(ImportOptions {
            up: Vec3::Y,
            ..ImportOptions::default()
        });
        let turned = import(ImportOptions {
            rotate_deg: 90.0,
            exposure_ev: 1.0,
            ..ImportOptions::default()
        });
        for (imported, top, center, quarter, gain) in [
            (&z_up, Vec3::Z, Vec3::X, Vec3::Y, 1.0),
            (&y_up, Vec3::Y, Vec3::X, Vec3::NEG_Z, 1.0),
            (&turned, Vec3::Z, Vec3::Y, Vec3::NEG_X, 2.0),
        ] {
            let environment = &imported.environment;
            assert_eq!(environment.up(), top, "up");
            assert_eq!(seen(environment, top), Vec3::splat(gain), "top");
            assert_eq!(seen(environment, center), Vec3::X * 50.0 * gain, "centre");
            assert_eq!(seen(environment, quarter), Vec3::Y * 20.0 * gain, "quarter");
            assert_eq!(environment.gamma(), 1.0, "plain sRGB");
            assert_eq!(environment.name(), "sky", "the file's name");
        }
    }

    #[test]
    fn an_imported_environment_is_saved_and_read_back() {
        let (folder, path) = written(32, 16, &sky());
        let options = ImportOptions {
            up: Vec3::Y,
            rotate_deg: 30.0,
            name: Some("evening".to_owned()),
            ..ImportOptions::default()
        };
        let environment = import_environment(&path, &options).unwrap().environment;
        for storage in [Storage::F32, Storage::F16] {
            let file = folder.path().join("env.safetensors");
            environment.save(&file, storage).unwrap();
            let back = Environment::load(&file).unwrap();
            assert!(matches!(back.field(), EnvironmentField::Distant(_)), "kind");
            assert!(back.is_far(), "far");
            assert_eq!(back.name(), "evening");
            let d = Vec3::new(0.6, 0.48, 0.64);
            let error = (seen(&back, d) - seen(&environment, d)).abs().max_element();
            assert!(error < 1e-3, "{storage:?}: {error}");
        }
    }

    #[test]
    fn large_and_odd_pictures_are_averaged() {
        for (width, height, expected) in [(2048, 1024, 1024), (33, 17, 32), (1026, 513, 1024)] {
            let value = |i: u32| [(i % 97) as f32, 1.0, 3.0];
            let pixels: Vec<_> = (0..width * height).map(value).collect();
            let (_folder, path) = written(width, height, &pixels);
            if let Ok(imported) = import_environment(&path, &ImportOptions::default()) {
                let EnvironmentField::Distant(light) = imported.environment.field() else {
                    panic!("a distant light");
                };
                assert_eq!(light.config.width, expected, "{width}");
                assert_eq!(imported.notices.len(), 1, "{:?}", imported.notices);
                assert!(
                    (light.mean() - Vec3::new(48.0, 1.0, 3.0)).length() < 0.5,
                    "{}",
                    light.mean()
                );
            } else {
                assert_eq!(width, 33, "33 x 17 is not twice as wide as high");
            }
        }
    }

    #[test]
    fn unusable_pictures_are_refused_by_name_and_negative_values_noted() {
        let mut pixels = sky();
        pixels[5] = [-0.5, 1.0, 1.0];
        let (folder, path) = written(32, 16, &pixels);
        let imported = import_environment(&path, &ImportOptions::default()).unwrap();
        assert!(
            imported.notices[0].contains("1 pixels"),
            "{:?}",
            imported.notices
        );
        let refused = |path: &Path, expected: &str| {
            let error = import_environment(path, &ImportOptions::default())
                .unwrap_err()
                .to_string();
            assert!(error.contains(expected), "{error}");
            assert!(error.contains(&*path.to_string_lossy()), "{error}");
        };
        refused(folder.path(), "folder");
        refused(&folder.path().join("sky.tiff"), "endings");
        refused(&folder.path().join("missing.hdr"), "missing.hdr");
        for bad in [f32::NAN, f32::INFINITY] {
            pixels[40][1] = bad;
            let (_folder, path) = written(32, 16, &pixels);
            refused(&path, "(8, 1)");
        }
        let (_folder, path) = written(30, 20, &[[1.0; 3]; 600]);
        refused(&path, "30 x 20");
    }
}
