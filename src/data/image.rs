//! Photos and masks from PNG, JPEG, EXR and Radiance HDR files, and 8-bit PNG writing.
//!
//! Sizes are checked before anything is decoded, so a small file that claims to be huge costs
//! nothing. EXIF rotation is ignored on purpose: camera poses describe the pixels as stored.

use std::io::BufReader;
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder as _, ImageReader};

use super::exr_image::read_exr_linear;
use super::{DataError, Mask, Photo, write_atomically};

/// The longest side accepted.
const MAX_SIDE: u32 = 16384;
/// The most pixels accepted.
const MAX_PIXELS: u64 = 256 << 20;

/// A photo and what its alpha channel says.
#[derive(Clone, Debug)]
pub(super) struct Decoded {
    pub(super) photo: Photo,
    /// The alpha channel, where it is not opaque all over.
    pub(super) alpha: Option<Mask>,
}

/// Reads a photo (`.png .jpg .jpeg .exr .hdr`); transparency is ignored, colour kept straight.
pub fn read_photo(path: &Path) -> Result<Photo, DataError> {
    decode(path).map(|decoded| decoded.photo)
}

/// Reads an object mask: the grey value of an opaque picture, the alpha of a transparent one.
///
/// Masks stored as 0 and 1 are stretched to 0 and 255.
pub fn read_mask(path: &Path) -> Result<Mask, DataError> {
    if is_exr(path) {
        let (width, height, pixels) = read_exr_linear(path)?;
        let coverage = pixels
            .iter()
            .map(|[r, ..]| (r.clamp(0.0, 1.0) * 255.0).round() as u8)
            .collect();
        return Ok(Mask {
            width,
            height,
            coverage,
        });
    }
    let picture = open(path)?;
    let mut mask = alpha_of(&picture).unwrap_or_else(|| Mask {
        width: picture.width(),
        height: picture.height(),
        coverage: picture.to_luma8().into_raw(),
    });
    if mask.coverage.iter().all(|c| *c <= 1) {
        for c in &mut mask.coverage {
            *c *= 255;
        }
    }
    Ok(mask)
}

/// Reads a photo with its alpha channel.
pub(super) fn decode(path: &Path) -> Result<Decoded, DataError> {
    if is_exr(path) {
        let (width, height, pixels) = read_exr_linear(path)?;
        return Ok(Decoded {
            photo: Photo::Hdr {
                width,
                height,
                pixels,
            },
            alpha: None,
        });
    }
    let picture = open(path)?;
    let (width, height) = (picture.width(), picture.height());
    let alpha = alpha_of(&picture);
    let photo = match picture {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let pixels = picture.to_rgb32f().pixels().map(|p| p.0).collect();
            check_finite(path, width, &pixels)?;
            Photo::Hdr {
                width,
                height,
                pixels,
            }
        }
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => Photo::Ldr {
            width,
            height,
            pixels: picture.to_rgb16().pixels().map(|p| p.0).collect(),
        },
        _ => Photo::Ldr {
            width,
            height,
            pixels: picture
                .to_rgb8()
                .pixels()
                .map(|p| p.0.map(|c| u16::from(c) * 257))
                .collect(),
        },
    };
    Ok(Decoded { photo, alpha })
}

/// Refuses pictures that are empty or too large, before their pixels are decoded.
pub(super) fn check_size(path: &Path, width: u64, height: u64) -> Result<(), DataError> {
    let too_large = width > u64::from(MAX_SIDE)
        || height > u64::from(MAX_SIDE)
        || width.saturating_mul(height) > MAX_PIXELS;
    if too_large || width == 0 || height == 0 {
        return Err(DataError::image(
            path,
            format!(
                "picture of {width} x {height} pixels; sides of 1 to {MAX_SIDE} and at most \
                 {} megapixels are supported",
                MAX_PIXELS >> 20
            ),
        ));
    }
    Ok(())
}

/// Refuses NaN and infinite pixels, naming the first.
pub(super) fn check_finite(
    path: &Path,
    width: u32,
    pixels: &Vec<[f32; 3]>,
) -> Result<(), DataError> {
    match pixels.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        None => Ok(()),
        Some(i) => {
            let (x, y) = (i % width as usize, i / width as usize);
            Err(DataError::image(
                path,
                format!("pixel ({x}, {y}) is not finite: {:?}", pixels[i]),
            ))
        }
    }
}

fn is_exr(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// Decodes any picture that the `image` crate was built for.
fn open(path: &Path) -> Result<DynamicImage, DataError> {
    let reader = || {
        ImageReader::open(path)
            .and_then(ImageReader::<BufReader<_>>::with_guessed_format)
            .map_err(|e| DataError::io(path, e))
    };
    let unreadable = |e| DataError::image(path, format!("cannot be decoded: {e}"));
    let (width, height) = reader()?.into_dimensions().map_err(unreadable)?;
    check_size(path, u64::from(width), u64::from(height))?;
    let mut reader = reader()?;
    // The size was judged above; the crate's own limit would refuse large 16-bit pictures.
    reader.no_limits();
    reader.decode().map_err(unreadable)
}

/// The alpha channel, unless it is absent or opaque everywhere.
fn alpha_of(picture: &DynamicImage) -> Option<Mask> {
    if !picture.color().has_alpha() {
        return None;
    }
    let coverage: Vec<u8> = picture.to_rgba8().pixels().map(|p| p.0[3]).collect();
    coverage.iter().any(|a| *a < 255).then(|| Mask {
        width: picture.width(),
        height: picture.height(),
        coverage,
    })
}

/// Writes sRGB-encoded colours (0..1, clamped; NaN becomes 0) as an 8-bit RGB PNG, atomically.
///
/// `pixels_srgb`: `[height * width]`, row-major. Panics if the count is wrong.
pub fn write_png_srgb(
    path: &Path,
    width: u32,
    height: u32,
    pixels_srgb: &[[f32; 3]],
) -> Result<(), DataError> {
    assert_eq!(
        pixels_srgb.len(),
        width as usize * height as usize,
        "one colour a pixel"
    );
    let bytes: Vec<u8> = pixels_srgb
        .iter()
        .flatten()
        .map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
        .collect();
    write_atomically(path, |file| {
        PngEncoder::new_with_quality(file, CompressionType::Default, FilterType::Adaptive)
            .write_image(&bytes, width, height, ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)
    })
    .map_err(|e| DataError::io(path, e))
}
