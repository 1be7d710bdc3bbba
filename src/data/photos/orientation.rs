//! Photos that are stored on their side, with a note in the file (EXIF) of how to hold them.
//!
//! Poses describe the pixels as stored (COLMAP) or as shown (tools that convert the photos first).
//! The declared size determines which: where it is that of the photo on its side, the photo is turned.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::metadata::Orientation;
use image::{ImageDecoder, ImageReader};

use crate::data::{Mask, Photo};

/// How a photo is to be held; as it is stored where the file does not say or cannot be read.
pub(super) fn orientation_of(path: &Path) -> Orientation {
    decoder_of(path)
        .and_then(|mut decoder| decoder.orientation().ok())
        .unwrap_or(Orientation::NoTransforms)
}

/// What the camera noted in a photo's file (EXIF), if anything.
pub(super) fn metadata_of(path: &Path) -> Option<Vec<u8>> {
    decoder_of(path)?.exif_metadata().ok()?
}

fn decoder_of(path: &Path) -> Option<impl ImageDecoder> {
    let file = BufReader::new(File::open(path).ok()?);
    let reader = ImageReader::new(file).with_guessed_format().ok()?;
    reader.into_decoder().ok()
}

/// Whether width and height change places.
pub(super) fn lies_on_its_side(orientation: Orientation) -> bool {
    matches!(
        orientation,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    )
}

/// The photo as it is to be held.
pub(super) fn turned_photo(photo: Photo, orientation: Orientation) -> Photo {
    let (w, h) = (photo.width(), photo.height());
    match photo {
        Photo::Rgb8 {
            pixels,
            chroma_block,
            ..
        } => {
            let (width, height, pixels) = turned(w, h, &pixels, orientation);
            Photo::Rgb8 {
                width,
                height,
                pixels,
                chroma_block: turned_block((w, h), chroma_block, orientation),
            }
        }
        Photo::Ldr { pixels, .. } => {
            let (width, height, pixels) = turned(w, h, &pixels, orientation);
            Photo::Ldr {
                width,
                height,
                pixels,
            }
        }
        Photo::Hdr { pixels, .. } => {
            let (width, height, pixels) = turned(w, h, &pixels, orientation);
            Photo::Hdr {
                width,
                height,
                pixels,
            }
        }
    }
}

/// [`Photo::chroma_block`] of a turned `w` x `h` photo. Blocks that do not fill it may begin with a part of one then; such
/// photos go without.
fn turned_block(
    (w, h): (u32, u32),
    [columns, rows]: [u32; 2],
    orientation: Orientation,
) -> [u32; 2] {
    if w % columns != 0 || h % rows != 0 {
        [1, 1]
    } else if lies_on_its_side(orientation) {
        [rows, columns]
    } else {
        [columns, rows]
    }
}

/// The mask as it is to be held.
pub(super) fn turned_mask(mask: &Mask, orientation: Orientation) -> Mask {
    let (width, height, coverage) = turned(mask.width, mask.height, &mask.coverage, orientation);
    Mask {
        width,
        height,
        coverage,
    }
}

/// Pixels of a `w` x `h` picture, turned: new width, new height, pixels.
fn turned<T: Copy>(w: u32, h: u32, pixels: &[T], orientation: Orientation) -> (u32, u32, Vec<T>) {
    let (width, height) = if lies_on_its_side(orientation) {
        (h, w)
    } else {
        (w, h)
    };
    let source = |x: u32, y: u32| match orientation {
        Orientation::NoTransforms => (x, y),
        Orientation::FlipHorizontal => (w - 1 - x, y),
        Orientation::Rotate180 => (w - 1 - x, h - 1 - y),
        Orientation::FlipVertical => (x, h - 1 - y),
        // Mirrored along a diagonal, and clockwise turns.
        Orientation::Rotate90FlipH => (y, x),
        Orientation::Rotate90 => (y, h - 1 - x),
        Orientation::Rotate270FlipH => (w - 1 - y, h - 1 - x),
        Orientation::Rotate270 => (w - 1 - y, x),
    };
    let turned = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let (x, y) = source(x, y);
            pixels[y as usize * w as usize + x as usize]
        })
        .collect();
    (width, height, turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_orientation_turns_as_the_image_crate_does() {
        let picture = image::GrayImage::from_fn(3, 2, |x, y| image::Luma([(10 * y + x) as u8]));
        for exif in 1..=8 {
            let orientation = Orientation::from_exif(exif).unwrap();
            let mut expected = image::DynamicImage::ImageLuma8(picture.clone());
            expected.apply_orientation(orientation);
            let expected = expected.to_luma8();
            let (width, height, pixels) = turned(3, 2, picture.as_raw(), orientation);
            assert_eq!((width, height), expected.dimensions(), "{orientation:?}");
            assert_eq!(&pixels, expected.as_raw(), "{orientation:?}");
        }
    }

    #[test]
    fn blocks_of_chroma_turn_with_their_photo() {
        let block = |size, orientation| turned_block(size, [2, 1], orientation);
        assert_eq!(block((4, 3), Orientation::Rotate180), [2, 1]);
        assert_eq!(block((4, 3), Orientation::Rotate90), [1, 2]);
        assert_eq!(block((5, 4), Orientation::Rotate90), [1, 1], "half a block");
    }
}
