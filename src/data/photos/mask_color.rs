//! Coverage from the colours of a mask picture: grey, coloured, or two shades of anything.

use image::DynamicImage;

/// Difference of two colour channels, codes, from which a pixel counts as coloured: JPEG noise is
/// below.
const COLORED: u8 = 48;
/// Share of coloured pixels from which the picture does.
const COLORED_SHARE: f32 = 0.002;
/// Largest difference from the background, codes, that still counts as background.
const BACKGROUND: u8 = 24;

/// How much of each pixel is object, 255 for all: the grey value of a grey picture; in a coloured
/// one everything that has not the background's colour, the commonest one along the border.
pub(in crate::data) fn coverage_of(picture: &DynamicImage) -> Vec<u8> {
    if !is_colored(picture) {
        return picture.to_luma8().into_raw();
    }
    let rgb = picture.to_rgb8();
    let background = border_color(&rgb);
    let difference = |pixel: &image::Rgb<u8>| {
        let channels = pixel.0.iter().zip(background);
        channels.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
    };
    rgb.pixels()
        .map(|pixel| {
            if difference(pixel) > BACKGROUND {
                255
            } else {
                0
            }
        })
        .collect()
}

fn is_colored(picture: &DynamicImage) -> bool {
    if !picture.color().has_color() {
        return false;
    }
    let rgb = picture.to_rgb8();
    let n_colored = rgb
        .pixels()
        .filter(|pixel| {
            let [r, g, b] = pixel.0;
            r.max(g).max(b) - r.min(g).min(b) >= COLORED
        })
        .count();
    n_colored as f32 > COLORED_SHARE * (rgb.width() * rgb.height()) as f32
}

/// The commonest colour along the border, to 16 shades a channel.
fn border_color(rgb: &image::RgbImage) -> [u8; 3] {
    let (width, height) = rgb.dimensions();
    let rows = (0..width).flat_map(|x| [(x, 0), (x, height - 1)]);
    let columns = (0..height).flat_map(|y| [(0, y), (width - 1, y)]);
    let mut counts = vec![(0_u32, [0_u8; 3]); 4096];
    for (x, y) in rows.chain(columns) {
        let color = rgb.get_pixel(x, y).0;
        let key = color
            .iter()
            .fold(0, |key, c| key << 4 | usize::from(c >> 4));
        counts[key].0 += 1;
        counts[key].1 = color;
    }
    counts
        .into_iter()
        .max_by_key(|(n, _)| *n)
        .map_or([0; 3], |(_, color)| color)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coverage(background: [u8; 3], object: [u8; 3]) -> Vec<u8> {
        let picture = image::RgbImage::from_fn(5, 5, |x, y| {
            let is_object = (1..4).contains(&x) && (1..4).contains(&y);
            image::Rgb(if is_object { object } else { background })
        });
        coverage_of(&DynamicImage::ImageRgb8(picture))
    }

    #[test]
    fn any_two_colours_part_object_from_background() {
        for (background, object) in [
            ([0; 3], [255; 3]),
            ([0; 3], [255, 0, 0]),
            ([68, 1, 84], [253, 231, 37]),
            ([0, 0, 200], [0, 0, 0]),
        ] {
            let coverage = coverage(background, object);
            let sum: u32 = coverage.iter().map(|c| u32::from(*c)).sum();
            assert_eq!(
                (coverage[0], sum),
                (0, 9 * 255),
                "{object:?} on {background:?}"
            );
        }
    }

    #[test]
    fn grey_masks_keep_their_soft_edges() {
        assert_eq!(coverage([0; 3], [100; 3])[12], 100, "grey");
    }
}
