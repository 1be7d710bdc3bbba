//! At which resolution a photo's file keeps colour: JPEGs of most cameras have one chroma for every two by two pixels.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use zune_jpeg::{JpegDecoder, SampleRatios};

/// Columns and rows of the blocks of a file's pixels that have their chroma in common; 1 and 1 where each pixel has its own, as
/// in everything but JPEG, or blocks are larger than cameras write.
pub(super) fn chroma_block_of(path: &Path) -> [u32; 2] {
    sampling_of(path).map_or([1, 1], |ratio| match ratio {
        SampleRatios::HV => [2, 2],
        SampleRatios::H => [2, 1],
        SampleRatios::V => [1, 2],
        SampleRatios::None | SampleRatios::Generic(..) => [1, 1],
    })
}

fn sampling_of(path: &Path) -> Option<SampleRatios> {
    let mut decoder = JpegDecoder::new(BufReader::new(File::open(path).ok()?));
    decoder.decode_headers().ok()?;
    Some(decoder.info()?.sample_ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::write_png_srgb;

    #[test]
    fn the_file_says_which_pixels_share_their_chroma() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let jpeg = include_bytes!("../../../tests/pictures/shared_chroma.jpg").as_slice();
        // Where a baseline frame notes luma's sampling: behind its size, precision, height, width, number of components and the
        // first one's name.
        let at = jpeg.windows(2).position(|m| m == [0xff, 0xc0]).unwrap() + 11;
        assert_eq!(jpeg[at], 0x22);
        for (noted, block) in [
            (0x22, [2, 2]),
            (0x21, [2, 1]),
            (0x12, [1, 2]),
            (0x11, [1, 1]),
        ] {
            let mut changed = jpeg.to_vec();
            changed[at] = noted;
            std::fs::write(&path, changed).unwrap();
            assert_eq!(chroma_block_of(&path), block);
        }
        std::fs::write(&path, &jpeg[..at]).unwrap();
        assert_eq!(chroma_block_of(&path), [1, 1], "cut off");
        write_png_srgb(&path, 2, 1, &[[0.1, 0.5, 0.3]; 2]).unwrap();
        assert_eq!(chroma_block_of(&path), [1, 1], "a PNG");
    }
}
