//! Photos and masks from PNG, JPEG, EXR and Radiance HDR files, and 8-bit PNG writing.
//!
//! Sizes are checked before anything is decoded, so a small file that claims to be huge costs
//! nothing. Pixels are given as stored, unless the capture says otherwise: see `orientation`.

use std::fs::File;
use std::io::{self, BufReader, Write};
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::metadata::Orientation;
use image::{DynamicImage, ExtendedColorType, ImageEncoder as _, ImageError, ImageReader, Limits};

use super::chroma::chroma_block_of;
use super::exr_image::{exr_size, read_exr_linear};
use super::limits::{check_finite, check_size};
use super::mask_color::coverage_of;
use super::orientation::{orientation_to_apply, turned_block};
use crate::data::files::capture_path::has_extension;
use crate::data::{DataError, Mask, Photo, write_atomically};

/// Bytes that decoding may take beside the pixels: profiles and other notes in the file unpack to less.
const MAX_EXTRA_BYTES: u64 = 64 << 20;

/// A photo and what its alpha channel says.
#[derive(Clone, Debug)]
pub(super) struct Decoded {
    pub(super) photo: Photo,
    /// The alpha channel, where it is not opaque all over.
    pub(super) alpha: Option<Mask>,
    /// How both were turned.
    pub(super) turned: Option<Orientation>,
}

/// Reads a photo (`.png .jpg .jpeg .exr .hdr`); transparency is ignored, colour kept straight.
pub fn read_photo(path: &Path) -> Result<Photo, DataError> {
    decode(path, None).map(|decoded| decoded.photo)
}

/// Reads an object mask: the grey value of an opaque picture, the alpha of a transparent one; in a
/// coloured picture the object is what has not the colour of the border.
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
        coverage: coverage_of(&picture),
    });
    if mask.coverage.iter().all(|c| *c <= 1) {
        for c in &mut mask.coverage {
            *c *= 255;
        }
    }
    Ok(mask)
}

/// Reads a photo with its alpha channel, turned as EXIF says where the `declared` size lies otherwise than the stored one.
pub(super) fn decode(path: &Path, declared: Option<(u32, u32)>) -> Result<Decoded, DataError> {
    if is_exr(path) {
        let (width, height, pixels) = read_exr_linear(path)?;
        return Ok(Decoded {
            photo: Photo::Hdr {
                width,
                height,
                pixels,
            },
            alpha: None,
            turned: None,
        });
    }
    let mut picture = open(path)?;
    let stored = (picture.width(), picture.height());
    let turned = declared.and_then(|declared| orientation_to_apply(path, stored, declared));
    picture.apply_orientation(turned.unwrap_or(Orientation::NoTransforms));
    let (width, height) = (picture.width(), picture.height());
    let alpha = alpha_of(&picture);
    let photo = match picture {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let pixels: Vec<[f32; 3]> = picture.to_rgb32f().pixels().map(|p| p.0).collect();
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
            pixels: in_threes(picture.into_rgb16().as_raw()),
        },
        _ => Photo::Rgb8 {
            width,
            height,
            pixels: in_threes(picture.into_rgb8().as_raw()),
            chroma_block: turned_block(stored, chroma_block_of(path), turned),
        },
    };
    Ok(Decoded {
        photo,
        alpha,
        turned,
    })
}

/// Numbers as pixels of three.
fn in_threes<T: Copy>(values: &[T]) -> Vec<[T; 3]> {
    values.as_chunks().0.to_vec()
}

/// Width and height of a picture that [`read_photo`] would try to decode, from the file's header alone.
pub(super) fn picture_size(path: &Path) -> Result<(u32, u32), DataError> {
    if !is_exr(path) {
        return header_size(path);
    }
    let (width, height) = exr_size(path)?;
    check_size(path, u64::from(width), u64::from(height))?;
    Ok((width, height))
}

fn is_exr(path: &Path) -> bool {
    has_extension(path, "exr")
}

/// Decodes any picture that the `image` crate was built for.
pub(in crate::data) fn open(path: &Path) -> Result<DynamicImage, DataError> {
    let (width, height) = header_size(path)?;
    let mut reader = reader_of(path)?;
    // The crate's own limit would refuse large 16-bit pictures; none would let a note unpack without end.
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * u64::from(width) * u64::from(height) + MAX_EXTRA_BYTES);
    reader.limits(limits);
    reader.decode().map_err(|e| unreadable(path, &e))
}

fn reader_of(path: &Path) -> Result<ImageReader<BufReader<File>>, DataError> {
    ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| DataError::io(path, e))
}

/// Width and height of such a picture, of a size that is supported.
fn header_size(path: &Path) -> Result<(u32, u32), DataError> {
    let size = reader_of(path)?.into_dimensions();
    let (width, height) = size.map_err(|e| unreadable(path, &e))?;
    check_size(path, u64::from(width), u64::from(height))?;
    Ok((width, height))
}

fn unreadable(path: &Path, error: &ImageError) -> DataError {
    DataError::unusable(path, format!("cannot be decoded: {error}"))
}

/// The alpha channel, unless it is absent or opaque everywhere.
fn alpha_of(picture: &DynamicImage) -> Option<Mask> {
    if !picture.color().has_alpha() {
        return None;
    }
    let coverage: Vec<u8> = match picture {
        // Without a copy of the whole picture.
        DynamicImage::ImageRgba8(pixels) => pixels.pixels().map(|p| p.0[3]).collect(),
        other => other.to_rgba8().pixels().map(|p| p.0[3]).collect(),
    };
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
        encode_png(file, width, height, &bytes, ExtendedColorType::Rgb8)
    })
    .map_err(|e| DataError::io(path, e))
}

/// Writes a mask as an 8-bit grey PNG, atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write_mask(path: &Path, mask: &Mask) -> Result<(), DataError> {
    write_atomically(path, |file| {
        let (width, height) = (mask.width, mask.height);
        encode_png(file, width, height, &mask.coverage, ExtendedColorType::L8)
    })
    .map_err(|e| DataError::io(path, e))
}

/// Writes a PNG of 8 bits a channel; `bytes`: `[height * width]` pixels, row-major. Panics if the count is wrong.
pub(in crate::data) fn encode_png(
    file: impl Write,
    width: u32,
    height: u32,
    bytes: &[u8],
    color: ExtendedColorType,
) -> io::Result<()> {
    PngEncoder::new_with_quality(file, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytes, width, height, color)
        .map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::test_asserts::assert_error;

    fn checkerboard() -> Vec<[f32; 3]> {
        (0..35)
            .map(|i| [i as f32 / 34.0, (i % 2) as f32, 0.25])
            .collect()
    }

    #[test]
    fn a_written_png_reads_back_to_half_a_code() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_png_srgb(&path, 7, 5, &checkerboard()).unwrap();
        let photo = read_photo(&path).unwrap();
        assert_eq!((photo.width(), photo.height()), (7, 5), "size");
        for (i, expected) in checkerboard().iter().enumerate() {
            for (a, b) in photo.srgb(i).iter().zip(expected) {
                assert!(
                    (a - b).abs() <= 0.5 / 255.0 + 1e-6,
                    "pixel {i}: {a} against {b}"
                );
            }
        }
    }

    #[test]
    fn sixteen_bit_pictures_keep_their_precision() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = image::ImageBuffer::from_fn(3, 1, |x, _| image::Rgb([x as u16 * 1001; 3]));
        DynamicImage::ImageRgb16(picture).save(&path).unwrap();
        let [r, ..] = read_photo(&path).unwrap().srgb(1);
        assert!((r - 1001.0 / 65535.0).abs() < 1e-7, "{r}");
    }

    #[test]
    fn alpha_becomes_the_mask_and_colours_stay_straight() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture =
            image::RgbaImage::from_fn(2, 1, |x, _| image::Rgba([200, 100, 50, x as u8 * 128]));
        picture.save(&path).unwrap();
        let decoded = decode(&path, None).unwrap();
        assert_eq!(decoded.alpha.unwrap().coverage, [0, 128], "alpha");
        assert!(
            (decoded.photo.srgb(1)[0] - 200.0 / 255.0).abs() < 1e-6,
            "colour"
        );
    }

    #[test]
    fn masks_of_zeros_and_ones_are_stretched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.png");
        image::GrayImage::from_raw(2, 1, vec![0, 1])
            .unwrap()
            .save(&path)
            .unwrap();
        assert_eq!(read_mask(&path).unwrap().coverage, [0, 255], "coverage");
    }

    #[test]
    fn truncated_empty_and_foreign_files_are_errors_that_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        write_png_srgb(&path, 7, 5, &checkerboard()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for bytes in [&whole[..whole.len() / 2], &[][..], b"GIF89a not a picture"] {
            std::fs::write(&path, bytes).unwrap();
            assert_error(read_photo(&path), &["broken.png"]);
        }
        let missing = read_photo(&folder.path().join("none.png")).unwrap_err();
        assert!(matches!(missing, DataError::Io { .. }), "{missing}");
    }

    #[test]
    fn a_picture_that_claims_to_be_huge_is_refused_before_decoding() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("huge.png");
        write_png_srgb(&path, 7, 5, &checkerboard()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        // IHDR: width at byte 16, then height; the checksum over 17 bytes follows at 29.
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let checksum = crc32(&bytes[12..29]).to_be_bytes();
        bytes[29..33].copy_from_slice(&checksum);
        std::fs::write(&path, bytes).unwrap();
        assert_error(read_photo(&path), &["65536 x 65536"]);
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg())
            })
        })
    }
}
