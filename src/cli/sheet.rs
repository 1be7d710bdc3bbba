//! Pictures put together for looking: differences, pairs, contact sheets.

use std::path::Path;

use neif::data::{DataError, View, write_png_srgb};
use neif::render::Picture;

/// Pixels between two pictures of a sheet.
const GAP_PX: u32 = 4;
/// Colour of the paper.
const PAPER: [f32; 3] = [0.12; 3];

/// The photo of a view as a picture.
pub(crate) fn photo(view: &View) -> Picture {
    let photo = &view.photo;
    Picture {
        width: photo.width(),
        height: photo.height(),
        pixels: (0..photo.n_pixels()).map(|i| photo.srgb(i)).collect(),
    }
}

/// `gain` times the absolute difference of two pictures of one size.
pub(crate) fn difference(a: &Picture, b: &Picture, gain: f32) -> Picture {
    let pixels = a.pixels.iter().zip(&b.pixels);
    let pixel = |a: &[f32; 3], b: &[f32; 3]| -> [f32; 3] {
        std::array::from_fn(|c| (gain * (a[c] - b[c]).abs()).min(1.0))
    };
    Picture {
        width: a.width,
        height: a.height,
        pixels: pixels.map(|(a, b)| pixel(a, b)).collect(),
    }
}

/// Pictures side by side, from the left, top edges aligned.
pub(crate) fn beside(pictures: &[&Picture]) -> Picture {
    let width = pictures.iter().map(|p| p.width + GAP_PX).sum::<u32>();
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(1);
    let mut sheet = blank(width.saturating_sub(GAP_PX).max(1), height);
    let mut x = 0;
    for picture in pictures {
        paste(&mut sheet, picture, x, 0);
        x += picture.width + GAP_PX;
    }
    sheet
}

/// Pictures in rows of `n_columns`.
pub(crate) fn grid(pictures: &[Picture], n_columns: usize) -> Picture {
    let rows: Vec<Picture> = pictures
        .chunks(n_columns.max(1))
        .map(|row| beside(&row.iter().collect::<Vec<_>>()))
        .collect();
    let width = rows.iter().map(|row| row.width).max().unwrap_or(1);
    let height = rows.iter().map(|row| row.height + GAP_PX).sum::<u32>();
    let mut sheet = blank(width, height.saturating_sub(GAP_PX).max(1));
    let mut y = 0;
    for row in &rows {
        paste(&mut sheet, row, 0, y);
        y += row.height + GAP_PX;
    }
    sheet
}

/// The picture at most `max_width` wide: whole-number reduction, each pixel the mean of its block.
pub(crate) fn thumbnail(picture: &Picture, max_width: u32) -> Picture {
    let block = picture.width.div_ceil(max_width.max(1)).max(1);
    let (width, height) = (
        (picture.width / block).max(1),
        (picture.height / block).max(1),
    );
    let mean = |x: u32, y: u32| -> [f32; 3] {
        let mut sum = [0.0; 3];
        let mut count = 0.0;
        for v in (y * block)..((y + 1) * block).min(picture.height) {
            for u in (x * block)..((x + 1) * block).min(picture.width) {
                let pixel = picture.pixels[(v * picture.width + u) as usize];
                (0..3).for_each(|c| sum[c] += pixel[c]);
                count += 1.0;
            }
        }
        sum.map(|s| s / count)
    };
    let pixels = (0..width * height).map(|i| mean(i % width, i / width));
    Picture {
        width,
        height,
        pixels: pixels.collect(),
    }
}

/// Writes a display-referred picture as an 8-bit PNG, whole or not at all.
pub(crate) fn save(path: &Path, picture: &Picture) -> Result<(), DataError> {
    write_png_srgb(path, picture.width, picture.height, &picture.pixels)
}

fn blank(width: u32, height: u32) -> Picture {
    Picture {
        width,
        height,
        pixels: vec![PAPER; width as usize * height as usize],
    }
}

/// Copies a picture that fits into the sheet at (x, y).
fn paste(sheet: &mut Picture, picture: &Picture, x: u32, y: u32) {
    let (from_width, to_width) = (picture.width as usize, sheet.width as usize);
    for (row, pixels) in picture.pixels.chunks_exact(from_width).enumerate() {
        let start = (y as usize + row) * to_width + x as usize;
        sheet.pixels[start..start + from_width].copy_from_slice(pixels);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(width: u32, height: u32, value: f32) -> Picture {
        Picture {
            width,
            height,
            pixels: vec![[value; 3]; (width * height) as usize],
        }
    }

    #[test]
    fn pictures_keep_their_pixels_on_a_sheet() {
        let sheet = grid(&[plain(3, 2, 0.5), plain(4, 1, 1.0), plain(2, 2, 0.0)], 2);
        assert_eq!(
            (sheet.width, sheet.height),
            (3 + 4 + GAP_PX, 2 + 2 + GAP_PX)
        );
        let count = |value: f32| sheet.pixels.iter().filter(|p| p[0] == value).count();
        assert_eq!((count(0.5), count(1.0), count(0.0)), (6, 4, 4));
    }

    #[test]
    fn thumbnails_keep_the_mean() {
        let mut picture = plain(4, 4, 0.0);
        picture.pixels[0] = [1.0; 3];
        let small = thumbnail(&picture, 2);
        assert_eq!((small.width, small.height), (2, 2));
        assert_eq!(small.pixels[0], [0.25; 3]);
        assert_eq!(
            thumbnail(&picture, 100).pixels,
            picture.pixels,
            "never enlarged"
        );
    }

    #[test]
    fn differences_are_absolute_amplified_and_clipped() {
        let amplified = difference(&plain(1, 1, 0.2), &plain(1, 1, 0.3), 4.0);
        assert!((amplified.pixels[0][0] - 0.4).abs() < 1e-6);
        assert_eq!(
            difference(&plain(1, 1, 0.0), &plain(1, 1, 1.0), 4.0).pixels[0],
            [1.0; 3]
        );
    }
}
