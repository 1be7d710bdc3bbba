//! Pictures as files for looking hold them: 8 bits a channel, with transparency.

use std::path::Path;

use image::ExtendedColorType;

use super::image::encode_png;
use crate::data::{DataError, write_atomically};

/// A display-referred picture (sRGB), row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgba8 {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` red, green, blue and alpha; colours are not multiplied by alpha.
    pub pixels: Vec<[u8; 4]>,
}

impl Rgba8 {
    /// Writes a PNG, without an alpha channel where nothing is transparent; whole or not at all.
    pub fn write_png(&self, path: &Path) -> Result<(), DataError> {
        let is_opaque = self.pixels.iter().all(|pixel| pixel[3] == 255);
        let (bytes, color) = if is_opaque {
            (self.rgb(), ExtendedColorType::Rgb8)
        } else {
            (
                self.pixels.as_flattened().to_vec(),
                ExtendedColorType::Rgba8,
            )
        };
        write_atomically(path, |file| {
            encode_png(file, self.width, self.height, &bytes, color)
        })
        .map_err(|e| DataError::io(path, e))
    }

    /// Red, green and blue of each pixel, without alpha.
    pub fn rgb(&self) -> Vec<u8> {
        let colors = self.pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]);
        colors.flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_is_written_only_where_something_is_transparent() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut picture = Rgba8 {
            width: 2,
            height: 1,
            pixels: vec![[10, 20, 30, 255], [40, 50, 60, 255]],
        };
        for (alpha, color) in [(255, image::ColorType::Rgb8), (7, image::ColorType::Rgba8)] {
            picture.pixels[1][3] = alpha;
            picture.write_png(&path).unwrap();
            let read = image::open(&path).unwrap();
            assert_eq!(read.color(), color);
            assert_eq!(read.to_rgba8().get_pixel(1, 0).0, picture.pixels[1]);
        }
    }
}
