//! Depth maps beside photos: 16-bit PNG, EXR, PFM and npy files, read when they are needed.
//!
//! Depth is measured along the camera's axis, as depth cameras and renderers give it. What is not known is 0.

use std::path::{Path, PathBuf};

use image::DynamicImage;

use super::exr_image::read_exr_depth;
use super::image::open;
use super::limits::check_size;
use crate::data::files::capture_path::{first_extended, read_bytes};
use crate::data::files::npy::read_npy;
use crate::data::{DataError, Intrinsics};
use crate::geometry::Camera;

/// Extensions of depth maps, in the order in which they are tried.
const EXTENSIONS: [&str; 4] = ["png", "exr", "pfm", "npy"];
/// Scene units of a step of whole numbers: depth cameras write millimetres and poses in metres.
pub(in crate::data) const MILLIMETRE: f32 = 1e-3;
/// The code of whole numbers that stands for "not measured", beside 0.
const NOT_MEASURED: u16 = u16::MAX;
/// From here on depths are a renderer's infinity, scene units.
const INFINITE: f32 = 1e9;
/// Largest difference of neighbouring depths between which the surface goes on, share of the depth.
const CONTINUOUS: f32 = 0.02;

/// A depth map that belongs to a photo, not yet read.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFile {
    /// The file.
    pub path: PathBuf,
    /// Scene units of a step, for whole numbers; floats are scene units.
    pub unit: f32,
    /// Depth from which a pixel shows nothing, scene units.
    pub nothing_from: f32,
    /// The lens, where it is not the photo's.
    pub lens: Option<Intrinsics>,
}

impl DepthFile {
    /// The first of the files `path` with a depth map's extension that exists.
    pub(in crate::data) fn find(path: &Path, unit: f32) -> Option<Self> {
        first_extended(path, &EXTENSIONS).map(|path| Self::new(path, unit))
    }

    /// A map of the photo's lens that ends nowhere.
    pub(in crate::data) fn new(path: PathBuf, unit: f32) -> Self {
        Self {
            path,
            unit,
            nothing_from: f32::INFINITY,
            lens: None,
        }
    }

    /// Width, height and depths in scene units, 0 where nothing is known.
    ///
    /// # Errors
    /// When the file cannot be read or is no depth map.
    pub(in crate::data) fn read(&self) -> Result<(u32, u32, Vec<f32>), DataError> {
        let path = &self.path;
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let (width, height, mut depths) = match extension.to_ascii_lowercase().as_str() {
            "exr" => read_exr_depth(path)?,
            "pfm" => read_pfm(path)?,
            "npy" => read_array(path)?,
            _ => read_codes(path, self.unit)?,
        };
        for depth in &mut depths {
            // NaN is unknown too.
            if !(*depth > 0.0 && *depth < self.nothing_from.min(INFINITE)) {
                *depth = 0.0;
            }
        }
        Ok((width, height, depths))
    }
}

/// Depths of a picture.
#[derive(Clone, Debug)]
pub struct DepthMap {
    /// The camera, for exactly the map's size.
    pub camera: Camera,
    /// `[height * width]` along the camera's axis, scene units; 0 where nothing is known.
    pub depths: Vec<f32>,
}

impl DepthMap {
    /// The depth at a point of the picture, between the four pixels around it where they belong to one surface, else that
    /// of the nearest; `None` outside and where nothing is known.
    pub fn at(&self, x_px: f32, y_px: f32) -> Option<f32> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        if !(x_px >= 0.0 && y_px >= 0.0 && x_px < width as f32 && y_px < height as f32) {
            return None;
        }
        let nearest = self.depths[y_px as usize * width + x_px as usize];
        let (u, v) = ((x_px - 0.5).max(0.0), (y_px - 0.5).max(0.0));
        let (x, y) = (u as usize, v as usize);
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        let at = |x: usize, y: usize| self.depths[y * width + x];
        let corners = [at(x, y), at(right, y), at(x, below), at(right, below)];
        let is_smooth = corners
            .iter()
            .all(|depth| (depth - nearest).abs() < CONTINUOUS * nearest);
        if !is_smooth {
            return (nearest > 0.0).then_some(nearest);
        }
        let (s, t) = (u - x as f32, v - y as f32);
        let [a, b, c, d] = corners;
        Some((1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d))
    }
}

fn read_codes(path: &Path, unit: f32) -> Result<(u32, u32, Vec<f32>), DataError> {
    let DynamicImage::ImageLuma16(codes) = open(path)? else {
        let problem = "not a grey picture of 16 bits, as depth maps are";
        return Err(DataError::unusable(path, problem));
    };
    let depth = |code: u16| match code {
        NOT_MEASURED => f32::INFINITY,
        code => unit * f32::from(code),
    };
    let depths = codes.pixels().map(|code| depth(code.0[0])).collect();
    Ok((codes.width(), codes.height(), depths))
}

fn read_array(path: &Path) -> Result<(u32, u32, Vec<f32>), DataError> {
    let array = read_npy(path)?;
    let (height, width) = match array.shape.as_slice() {
        [height, width] | [height, width, 1] => (*height, *width),
        shape => {
            let problem = format!("an array of shape {shape:?} is no depth map");
            return Err(DataError::unusable(path, problem));
        }
    };
    check_size(path, width as u64, height as u64)?;
    let depths = array.values.iter().map(|depth| *depth as f32).collect();
    Ok((width as u32, height as u32, depths))
}

/// Reads a portable float map of one channel: `Pf`, width, height, a scale whose sign says the order of bytes, then the
/// rows from the lowest up.
fn read_pfm(path: &Path) -> Result<(u32, u32, Vec<f32>), DataError> {
    /// The largest picture that is read has as many bytes, and a header.
    const MAX_BYTES: u64 = (128 << 20) * 4 + 1024;
    parse_pfm(path, &read_bytes(path, MAX_BYTES)?)
}

fn parse_pfm(path: &Path, bytes: &[u8]) -> Result<(u32, u32, Vec<f32>), DataError> {
    let fail = |problem: &str| DataError::unusable(path, problem);
    let mut rest = bytes;
    let mut word = || -> Option<&str> {
        rest = rest.trim_ascii_start();
        let end = rest.iter().position(u8::is_ascii_whitespace)?;
        let (head, tail) = rest.split_at(end);
        // One white space ends the header, and the numbers may begin with another.
        rest = &tail[1..];
        std::str::from_utf8(head).ok()
    };
    if word() != Some("Pf") {
        return Err(fail("not a PFM file of one channel"));
    }
    let mut side = || word()?.parse::<u32>().ok();
    let (Some(width), Some(height)) = (side(), side()) else {
        return Err(fail("the PFM header has no width and height"));
    };
    check_size(path, width.into(), height.into())?;
    let scale = word().and_then(|word| word.parse::<f32>().ok());
    let scale = scale.ok_or_else(|| fail("the PFM header has no scale"))?;
    let (numbers, _) = rest.as_chunks::<4>();
    let n_pixels = width as usize * height as usize;
    if numbers.len() < n_pixels {
        return Err(fail("the PFM file ends early"));
    }
    let number = |bytes: &[u8; 4]| {
        if scale < 0.0 {
            f32::from_le_bytes(*bytes)
        } else {
            f32::from_be_bytes(*bytes)
        }
    };
    let rows = numbers[..n_pixels].chunks_exact(width as usize).rev();
    Ok((width, height, rows.flatten().map(number).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::files::npy::tests::npy_of;
    use crate::data::formats::test_formats::folder;
    use crate::data::test_asserts::assert_error;

    fn file(path: PathBuf) -> DepthFile {
        DepthFile {
            path,
            unit: MILLIMETRE,
            nothing_from: 9.0,
            lens: None,
        }
    }

    #[test]
    fn every_kind_of_file_gives_the_same_depths() {
        let folder = folder();
        let expected = (3, 2, vec![1.0, 2.0, 0.0, 0.0, 0.5, 3.0]);
        let png = folder.path().join("a.png");
        let codes = vec![1000, 2000, 0, u16::MAX, 500, 3000];
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(3, 2, codes)
            .unwrap()
            .save(&png)
            .unwrap();
        let (width, height, depths) = file(png).read().unwrap();
        let off = depths.iter().zip(&expected.2).map(|(a, b)| (a - b).abs());
        assert!(
            (width, height) == (3, 2) && off.fold(0.0, f32::max) < 1e-5,
            "{depths:?}"
        );
        let pfm = folder.path().join("a.pfm");
        let mut bytes = b"Pf\n3 2\n-1.0\n".to_vec();
        // The lowest row first; infinity and what is far are nothing.
        for value in [f32::INFINITY, 0.5, 3.0, 1.0, 2.0, 12.0] {
            bytes.extend(value.to_le_bytes());
        }
        std::fs::write(&pfm, &bytes).unwrap();
        assert_eq!(file(pfm.clone()).read().unwrap(), expected, "pfm");
        for n in 0..bytes.len() {
            assert!(parse_pfm(&pfm, &bytes[..n]).is_err(), "cut at {n}");
        }
        let npy = folder.path().join("a.npy");
        let values = [1.0, 2.0, f64::NAN, -1.0, 0.5, 3.0];
        std::fs::write(&npy, npy_of(&[2, 3], &values)).unwrap();
        assert_eq!(file(npy).read().unwrap(), expected, "npy");
    }

    #[test]
    fn coloured_pictures_are_no_depth_maps() {
        let folder = folder();
        let path = folder.path().join("a.png");
        image::RgbImage::new(3, 2).save(&path).unwrap();
        assert_error(file(path).read(), &["16 bits"]);
    }

    #[test]
    fn depths_are_blended_on_a_surface_and_not_across_its_edge() {
        let camera = Camera::look_at(glam::Vec3::Z, glam::Vec3::ZERO, glam::Vec3::Y, 1.0, 2, 1);
        let map = |depths: [f32; 2]| DepthMap {
            camera,
            depths: depths.to_vec(),
        };
        let near = |found: Option<f32>, expected: f32| {
            assert!((found.unwrap() - expected).abs() < 1e-5, "{found:?}");
        };
        near(map([1.0, 1.01]).at(1.0, 0.5), 1.005);
        near(map([1.0, 2.0]).at(0.9, 0.5), 1.0);
        near(map([1.0, 2.0]).at(1.1, 0.5), 2.0);
        assert_eq!(map([0.0, 2.0]).at(0.5, 0.5), None, "not known");
        assert_eq!(map([1.0, 2.0]).at(2.0, 0.5), None, "outside");
    }
}
