//! Photos that are stored on their side, with a note in the file (EXIF) of how to hold them.
//!
//! Poses describe the pixels as stored (COLMAP) or as shown (tools that convert the photos first).
//! The declared size determines which: where it is that of the photo on its side, the photo is turned.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::metadata::Orientation;
use image::{ImageDecoder, ImageReader};

/// What the camera noted in a photo's file (EXIF), if anything.
pub(super) fn metadata_of(path: &Path) -> Option<Vec<u8>> {
    decoder_of(path)?.exif_metadata().ok()?
}

fn decoder_of(path: &Path) -> Option<impl ImageDecoder> {
    let file = BufReader::new(File::open(path).ok()?);
    let reader = ImageReader::new(file).with_guessed_format().ok()?;
    reader.into_decoder().ok()
}

/// How a photo must be turned for its size to be the declared one: not at all, unless that is the size of the upright photo
/// and EXIF says that the stored one lies on its side.
pub(super) fn orientation_to_apply(
    path: &Path,
    stored: (u32, u32),
    declared: (u32, u32),
) -> Option<Orientation> {
    if declared.0.cmp(&declared.1) == stored.0.cmp(&stored.1) {
        return None;
    }
    let orientation = decoder_of(path)?.orientation().ok();
    orientation.filter(|orientation| lies_on_its_side(*orientation))
}

/// Whether width and height change places.
fn lies_on_its_side(orientation: Orientation) -> bool {
    matches!(
        orientation,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    )
}

/// [`crate::data::Photo::chroma_block`] of a turned `w` x `h` photo. Blocks that do not fill it may begin with a part of one then; such
/// photos go without.
pub(super) fn turned_block(
    (w, h): (u32, u32),
    [columns, rows]: [u32; 2],
    orientation: Option<Orientation>,
) -> [u32; 2] {
    if orientation.is_some() && (w % columns != 0 || h % rows != 0) {
        [1, 1]
    } else if orientation.is_some_and(lies_on_its_side) {
        [rows, columns]
    } else {
        [columns, rows]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_chroma_turn_with_their_photo() {
        let block = |size, orientation| turned_block(size, [2, 1], Some(orientation));
        assert_eq!(block((4, 3), Orientation::Rotate180), [2, 1]);
        assert_eq!(block((4, 3), Orientation::Rotate90), [1, 2]);
        assert_eq!(block((5, 4), Orientation::Rotate90), [1, 1], "half a block");
    }
}
