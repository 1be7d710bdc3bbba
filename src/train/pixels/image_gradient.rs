//! How a photo's colours change from pixel to pixel, by central differences.

use crate::data::View;

/// Codes of a slope of 1 a pixel, the largest that central differences give.
pub(super) const SLOPE_CODES: f32 = 127.0;

/// `exp(-|image gradient|)` at pixel `i`, in 255ths.
pub(super) fn smoothness(view: &View, i: usize) -> u8 {
    ((-image_gradient(view, i)).exp() * f32::from(u8::MAX)).round() as u8
}

/// Length of the grey image's gradient at pixel `i`, central differences, per pixel.
fn image_gradient(view: &View, i: usize) -> f32 {
    let (width, height) = (view.photo.width() as usize, view.photo.height() as usize);
    let (x, y) = (i % width, i / width);
    let grey = |x: usize, y: usize| view.photo.srgb(y * width + x).iter().sum::<f32>() / 3.0;
    let dx = grey((x + 1).min(width - 1), y) - grey(x.saturating_sub(1), y);
    let dy = grey(x, (y + 1).min(height - 1)) - grey(x, y.saturating_sub(1));
    0.5 * dx.hypot(dy)
}

/// Slopes of the colours at pixel `i` by central differences, in [`SLOPE_CODES`]; 0 where a neighbour is not all object.
pub(super) fn slopes(view: &View, i: usize, is_object: &[bool]) -> [[i8; 2]; 3] {
    let (width, n) = (view.photo.width() as usize, view.photo.n_pixels());
    let column = i % width;
    let is_inside = column > 0 && column + 1 < width && i >= width && i + width < n;
    let along = |step: usize| {
        let is_known = is_inside && is_object[i - step] && is_object[i + step];
        let ends = is_known.then(|| [i - step, i + step].map(|i| view.photo.srgb(i)));
        ends.unwrap_or_default()
    };
    let (right, down) = (along(1), along(width));
    let code = |[before, after]: [[f32; 3]; 2], color: usize| {
        (0.5 * (after[color] - before[color]) * SLOPE_CODES).round() as i8
    };
    std::array::from_fn(|color| [code(right, color), code(down, color)])
}
