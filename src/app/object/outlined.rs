//! Photos with the object's outline: what is beside the object is darkened, and the outline drawn.

use crate::app::work::opener::ScreenPhoto;
use crate::data::{Mask, View};

/// Longest side of a small picture, pixels.
const SMALL: usize = 112;
/// sRGB of the outline: seen on nearly any photo.
const OUTLINE: [u8; 3] = [255, 214, 10];
/// What is left of the light beside the object.
const BESIDE: f32 = 0.4;

/// The photo as the screen shows it, with the outline of `mask`, which has its size.
pub(super) fn outlined(view: &View, mask: &Mask) -> ScreenPhoto {
    drawn(view, Some(mask), ScreenPhoto::MAX_SIDE)
}

/// The same, small; without a mask as it is.
pub(super) fn thumbnail(view: &View, mask: Option<&Mask>) -> ScreenPhoto {
    drawn(view, mask, SMALL)
}

fn drawn(view: &View, mask: Option<&Mask>, longest: usize) -> ScreenPhoto {
    let photo = &view.photo;
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let stride = width.max(height).div_ceil(longest).max(1);
    let size = [width.div_ceil(stride), height.div_ceil(stride)];
    // A picture's pixel is the mean of those that it stands for.
    let pixel = |i: usize| {
        let (x, y) = (i % size[0] * stride, i / size[0] * stride);
        let (mut color, mut n_object, mut n) = ([0.0_f32; 3], 0, 0);
        for y in y..(y + stride).min(height) {
            for x in x..(x + stride).min(width) {
                let i = y * width + x;
                let srgb = photo.srgb(i);
                color = std::array::from_fn(|c| color[c] + srgb[c].clamp(0.0, 1.0));
                n_object += usize::from(mask.is_none_or(|mask| mask.is_object(i)));
                n += 1;
            }
        }
        (color.map(|v| v / n as f32), 2 * n_object >= n)
    };
    let pixels: Vec<([f32; 3], bool)> = (0..size[0] * size[1]).map(pixel).collect();
    let is_object = |x: usize, y: usize| pixels[y * size[0] + x].1;
    let is_outline = |i: usize| {
        let (x, y) = (i % size[0], i / size[0]);
        is_object(x, y)
            && [
                x > 0 && !is_object(x - 1, y),
                x + 1 < size[0] && !is_object(x + 1, y),
                y > 0 && !is_object(x, y - 1),
                y + 1 < size[1] && !is_object(x, y + 1),
            ]
            .contains(&true)
    };
    let shown = |(i, (color, is_object)): (usize, &([f32; 3], bool))| {
        let [r, g, b] = if is_outline(i) {
            OUTLINE
        } else {
            let share = if *is_object { 1.0 } else { BESIDE };
            color.map(|v| (255.0 * share * v).round() as u8)
        };
        [r, g, b, 255]
    };
    ScreenPhoto {
        size,
        pixels: pixels.iter().enumerate().map(shown).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::state::app_state::tests::one_photo;

    #[test]
    fn the_object_is_as_bright_as_before_and_has_an_outline() {
        let (dataset, _) = one_photo(glam::Vec3::ONE);
        let view = dataset.views().next().expect("a view");
        let (width, height) = (view.camera.width as usize, view.camera.height as usize);
        let mut mask = Mask {
            width: width as u32,
            height: height as u32,
            coverage: vec![0; width * height],
        };
        let photo = |i: usize| {
            let [r, g, b] = view.photo.srgb(i).map(|v| (255.0 * v).round() as u8);
            [r, g, b, 255]
        };
        let all_dark = outlined(view, &mask);
        assert!(all_dark.pixels[0][0] <= photo(0)[0] / 2);
        mask.coverage.fill(255);
        let all_object = outlined(view, &mask);
        assert_eq!(all_object.size, [width, height]);
        assert!((0..width * height).all(|i| all_object.pixels[i] == photo(i)));
        // The left half.
        for i in 0..width * height {
            mask.coverage[i] = if i % width < width / 2 { 255 } else { 0 };
        }
        let half = outlined(view, &mask);
        assert_eq!(half.pixels[width / 2 - 1], [255, 214, 10, 255]);
    }
}
