//! Image quality of a rendered view against its photo: PSNR in five scopes, SSIM, FLIP and LPIPS.
//!
//! Images are display-referred sRGB in `[0, 1]`, row-major, three channels. Sums are `f64`.
//! The object scope is the strict one and the headline: the masked scope, which much of the
//! literature prints, counts the black background as perfectly right and so flatters small
//! objects.

use serde::Serialize;

use super::flip;

/// Mask coverage above which a pixel belongs to the object.
pub const MASK_THRESHOLD: f32 = 0.5;

/// The highest PSNR that is reported, in dB: equal images would be infinite, which neither JSON
/// nor a mean over views can hold. 8-bit images differ by at least 48 dB or not at all.
pub const MAX_PSNR_DB: f64 = 100.0;

/// Side of the SSIM window, in pixels: Gaussian of [`SSIM_SIGMA`] cut at 3.5 sigma.
const SSIM_WINDOW: usize = 11;
/// Standard deviation of the SSIM window, in pixels.
const SSIM_SIGMA: f64 = 1.5;
/// `(K1 * range)^2` with `K1 = 0.01`, range 1 (Wang et al. 2004, Eq. 13).
const SSIM_C1: f64 = 0.01 * 0.01;
/// `(K2 * range)^2` with `K2 = 0.03`.
const SSIM_C2: f64 = 0.03 * 0.03;

/// Quality of one view, or the mean over views. `None` (JSON `null`) where a scope has no pixel
/// or the measure is not available.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ImageMetrics {
    /// Over the whole image, dB.
    pub psnr: Option<f64>,
    /// Over pixels whose mask is above one half, dB: the headline.
    pub psnr_object: Option<f64>,
    /// Over pixels whose mask is below one half, dB.
    pub psnr_background: Option<f64>,
    /// Over the whole image with everything outside the mask black in both, dB.
    pub psnr_masked: Option<f64>,
    /// Over background pixels within one projected radius of the object ([`near_object`]), dB: its shadow and what it
    /// hid.
    pub psnr_near: Option<f64>,
    /// Structural similarity, mean over pixels and channels, at most 1.
    pub ssim: Option<f64>,
    /// LPIPS v0.1 over the whole image, 0 for equal images ([`super::lpips`]); only where
    /// weights are given and the image is large enough.
    pub lpips: Option<f64>,
    /// LDR-FLIP, mean over the pixels of the whole image, 0 to 1 ([`super::flip`]).
    pub flip: Option<f64>,
}

/// Measures `render` against `truth`, both `[height][width]` of sRGB in `[0, 1]`.
/// `mask` is the object's coverage per pixel; without one only the whole-image measures exist.
/// LPIPS, which needs weights, is left to the caller.
///
/// # Panics
/// When the lengths do not agree or are no multiple of `width`: a bug of the caller.
pub fn compare(
    render: &[[f32; 3]],
    truth: &[[f32; 3]],
    mask: Option<&[f32]>,
    width: usize,
) -> ImageMetrics {
    assert_eq!(render.len(), truth.len(), "images must have one size");
    let mut metrics = ImageMetrics {
        psnr: squared_error(render, truth, |_| true).psnr(),
        ssim: ssim(render, truth, width),
        flip: flip::mean_error(truth, render, width),
        ..ImageMetrics::default()
    };
    if let Some(mask) = mask {
        let object = compare_object(render, truth, mask);
        let background = squared_error(render, truth, |i| mask[i] < MASK_THRESHOLD);
        metrics.psnr_object = object.psnr_object;
        metrics.psnr_background = background.psnr();
        metrics.psnr_masked = object.psnr_masked;
        let near = near_object(mask, width);
        let is_near = |i: usize| near[i] && mask[i] < MASK_THRESHOLD;
        metrics.psnr_near = squared_error(render, truth, is_near).psnr();
    }
    metrics
}

/// The pixels within one radius of the object's: that of the disc with as many pixels as the mask, which has to be a
/// whole number of rows of `width`.
fn near_object(mask: &[f32], width: usize) -> Vec<bool> {
    let height = mask.len() / width;
    let is_object: Vec<bool> = mask.iter().map(|share| *share > MASK_THRESHOLD).collect();
    let area = is_object.iter().filter(|is_object| **is_object).count();
    let radius = (area as f64 / std::f64::consts::PI).sqrt();
    // Distance to the object's nearest pixel of the same row, then over the rows within reach.
    let in_row: Vec<f64> = is_object
        .chunks_exact(width)
        .flat_map(row_distances)
        .collect();
    let reach = radius as usize;
    let is_near = |x: usize, y: usize| {
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
        rows.into_iter()
            .any(|row| in_row[row * width + x].hypot(row.abs_diff(y) as f64) <= radius)
    };
    (0..height * width)
        .map(|i| is_near(i % width, i / width))
        .collect()
}

/// Distance of each pixel of a row to the nearest that is set; infinite where none is.
fn row_distances(row: &[bool]) -> Vec<f64> {
    let mut distances = vec![f64::INFINITY; row.len()];
    let mut sweep = |order: &mut dyn Iterator<Item = usize>| {
        let mut distance = f64::INFINITY;
        for x in order {
            distance = if row[x] { 0.0 } else { distance + 1.0 };
            distances[x] = distances[x].min(distance);
        }
    };
    sweep(&mut (0..row.len()));
    sweep(&mut (0..row.len()).rev());
    distances
}

/// The part of [`compare`] that looks at the object alone: the object and masked scopes.
///
/// # Panics
/// When the lengths do not agree: a bug of the caller.
pub fn compare_object(render: &[[f32; 3]], truth: &[[f32; 3]], mask: &[f32]) -> ImageMetrics {
    assert_eq!(render.len(), truth.len(), "images must have one size");
    assert_eq!(mask.len(), truth.len(), "mask and image must have one size");
    let object = squared_error(render, truth, |i| mask[i] > MASK_THRESHOLD);
    let masked = SquaredError {
        sum: object.sum,
        count: truth.len(),
    };
    ImageMetrics {
        psnr_object: object.psnr(),
        psnr_masked: masked.psnr(),
        ..ImageMetrics::default()
    }
}

/// The mean of each measure over the views that have it.
pub fn mean(views: &[ImageMetrics]) -> ImageMetrics {
    let average = |pick: fn(&ImageMetrics) -> Option<f64>| {
        mean_of(&views.iter().filter_map(pick).collect::<Vec<_>>())
    };
    ImageMetrics {
        psnr: average(|m| m.psnr),
        psnr_object: average(|m| m.psnr_object),
        psnr_background: average(|m| m.psnr_background),
        psnr_masked: average(|m| m.psnr_masked),
        psnr_near: average(|m| m.psnr_near),
        ssim: average(|m| m.ssim),
        lpips: average(|m| m.lpips),
        flip: average(|m| m.flip),
    }
}

/// The mean of some values; none without any.
pub(super) fn mean_of(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// A sum of squared differences that grows pixel by pixel; validation pools several views in one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SquaredError {
    /// Sum over pixels of the mean squared difference of the three channels.
    pub sum: f64,
    /// Number of pixels.
    pub count: usize,
}

impl SquaredError {
    /// Adds one pixel.
    pub fn add(&mut self, render: [f32; 3], truth: [f32; 3]) {
        let difference = |c: usize| f64::from(render[c]) - f64::from(truth[c]);
        self.sum += (0..3).map(|c| difference(c).powi(2)).sum::<f64>() / 3.0;
        self.count += 1;
    }

    /// Both sums together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            count: self.count + other.count,
        }
    }

    /// `-10 log10(mean squared error)` in dB (peak 1), at most [`MAX_PSNR_DB`]; `None` without
    /// pixels, and where a pixel was not finite.
    pub fn psnr(&self) -> Option<f64> {
        let mse = self.sum / self.count as f64;
        (self.count > 0 && mse.is_finite()).then(|| (-10.0 * mse.log10()).min(MAX_PSNR_DB))
    }
}

/// Pools the pixels whose index `select` accepts.
pub(super) fn squared_error(
    render: &[[f32; 3]],
    truth: &[[f32; 3]],
    select: impl Fn(usize) -> bool,
) -> SquaredError {
    let mut error = SquaredError::default();
    for (i, (a, b)) in render.iter().zip(truth).enumerate() {
        if select(i) {
            error.add(*a, *b);
        }
    }
    error
}

/// Structural similarity (Wang et al. 2004, Eq. 13) with an 11x11 Gaussian window, sigma 1.5,
/// population covariance, data range 1: the mean over the pixels whose whole window lies inside
/// the image, then over the channels. Equals scikit-image's `structural_similarity` with
/// `gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1`.
/// `None` for images smaller than the window.
///
/// # Panics
/// When the lengths do not agree or are no multiple of `width`: a bug of the caller.
pub fn ssim(a: &[[f32; 3]], b: &[[f32; 3]], width: usize) -> Option<f64> {
    assert_eq!(a.len(), b.len(), "images must have one size");
    if width < SSIM_WINDOW || a.len() / width < SSIM_WINDOW {
        return None;
    }
    assert_eq!(a.len() % width, 0, "the last row must be whole");
    let sum: f64 = (0..3)
        .map(|channel| ssim_of_channel(a, b, width, channel))
        .sum();
    Some(sum / 3.0)
}

fn ssim_of_channel(a: &[[f32; 3]], b: &[[f32; 3]], width: usize, channel: usize) -> f64 {
    let plane = |pixel: fn(f64, f64) -> f64| -> Vec<f64> {
        let values = a.iter().zip(b);
        values
            .map(|(a, b)| pixel(f64::from(a[channel]), f64::from(b[channel])))
            .collect()
    };
    // Windowed means of a, b, a^2, b^2 and ab.
    let mean_a = blur(&plane(|a, _| a), width);
    let mean_b = blur(&plane(|_, b| b), width);
    let mean_aa = blur(&plane(|a, _| a * a), width);
    let mean_bb = blur(&plane(|_, b| b * b), width);
    let mean_ab = blur(&plane(|a, b| a * b), width);
    let sum: f64 = (0..mean_a.len())
        .map(|i| {
            let (mu_a, mu_b) = (mean_a[i], mean_b[i]);
            let variance_a = mean_aa[i] - mu_a * mu_a;
            let variance_b = mean_bb[i] - mu_b * mu_b;
            let covariance = mean_ab[i] - mu_a * mu_b;
            (2.0 * mu_a * mu_b + SSIM_C1) * (2.0 * covariance + SSIM_C2)
                / ((mu_a * mu_a + mu_b * mu_b + SSIM_C1) * (variance_a + variance_b + SSIM_C2))
        })
        .sum();
    sum / mean_a.len() as f64
}

/// Gaussian-weighted means over every window that lies inside the image:
/// `[height - 10][width - 10]`.
fn blur(plane: &[f64], width: usize) -> Vec<f64> {
    let height = plane.len() / width;
    let (out_width, out_height) = (width - SSIM_WINDOW + 1, height - SSIM_WINDOW + 1);
    let weights = window_weights();
    let mut rows = Vec::with_capacity(height * out_width);
    for row in plane.chunks_exact(width) {
        let windows = row.windows(SSIM_WINDOW);
        rows.extend(windows.map(|w| w.iter().zip(&weights).map(|(v, g)| v * g).sum::<f64>()));
    }
    let mut out = vec![0.0; out_width * out_height];
    for (y, out_row) in out.chunks_exact_mut(out_width).enumerate() {
        for (k, g) in weights.iter().enumerate() {
            let source = &rows[(y + k) * out_width..][..out_width];
            for (sum, value) in out_row.iter_mut().zip(source) {
                *sum += g * value;
            }
        }
    }
    out
}

/// One-dimensional window weights, which sum to 1.
fn window_weights() -> [f64; SSIM_WINDOW] {
    let centre = (SSIM_WINDOW / 2) as f64;
    let weights: [f64; SSIM_WINDOW] =
        std::array::from_fn(|i| (-0.5 * ((i as f64 - centre) / SSIM_SIGMA).powi(2)).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::measure::test_picture;

    const WIDTH: usize = 24;
    const HEIGHT: usize = 17;

    fn picture(k: usize) -> Vec<[f32; 3]> {
        test_picture::picture(k, WIDTH, HEIGHT)
    }

    fn disk() -> Vec<f32> {
        let inside = |x: i64, y: i64| (x - 12).pow(2) + (y - 8).pow(2) < 30;
        (0..WIDTH * HEIGHT)
            .map(|i| f32::from(inside((i % WIDTH) as i64, (i / WIDTH) as i64)))
            .collect()
    }

    fn assert_close(found: Option<f64>, expected: f64, what: &str) {
        let found = found.expect(what);
        assert!(
            (found - expected).abs() < 2e-6,
            "{what}: {found}, expected {expected}"
        );
    }

    /// The expected numbers were computed once with `numpy` 2 and scikit-image 0.25 on `picture(0)`,
    /// `picture(2)` and `disk()`: `structural_similarity` with the parameters that [`ssim`] names
    /// and `channel_axis=2`, `peak_signal_noise_ratio` with `data_range=1`.
    #[test]
    fn measures_equal_those_of_scikit_image() {
        let metrics = compare(&picture(0), &picture(2), Some(&disk()), WIDTH);
        assert_close(metrics.ssim, 0.775_165_640_274_810_9, "ssim");
        assert_close(metrics.psnr, 15.836_277_352_253_518, "psnr");
        assert_close(metrics.psnr_object, 13.718_620_900_655_019, "psnr_object");
        assert_close(
            metrics.psnr_background,
            16.783_724_774_350_382,
            "psnr_background",
        );
        assert_close(metrics.psnr_masked, 19.957_505_188_891_368, "psnr_masked");
    }

    #[test]
    fn near_the_object_is_within_the_radius_of_a_disc_as_large() {
        let (width, radius) = (40_usize, 6.0_f64);
        let from_center = |i: usize| (((i % width) as f64) - 20.0).hypot((i / width) as f64 - 20.0);
        let mask: Vec<f32> = (0..width * width)
            .map(|i| f32::from(u8::from(from_center(i) <= radius)))
            .collect();
        for (i, is_near) in near_object(&mask, width).into_iter().enumerate() {
            let distance = from_center(i);
            // Pixels are whole: the radius is known to about half of one.
            let is_clear = (distance - 2.0 * radius).abs() > 0.8;
            assert!(
                !is_clear || is_near == (distance < 2.0 * radius),
                "{distance}"
            );
        }
        let truth = vec![[0.5; 3]; mask.len()];
        let wrong_far = |i: usize| [if from_center(i) > 14.0 { 0.9 } else { 0.6 }; 3];
        let render: Vec<[f32; 3]> = (0..mask.len()).map(wrong_far).collect();
        let metrics = compare(&render, &truth, Some(&mask), width);
        let near = metrics.psnr_near.expect("background near the object");
        assert!((near - 20.0).abs() < 1e-4, "{near}");
        assert!(metrics.psnr_background < metrics.psnr_near, "{metrics:?}");
        assert!(
            near_object(&[0.0; 16], 4).iter().all(|near| !near),
            "no object"
        );
    }

    #[test]
    fn psnr_of_equal_images_is_the_stated_maximum() {
        let metrics = compare(&picture(1), &picture(1), Some(&disk()), WIDTH);
        assert_eq!(metrics.psnr, Some(MAX_PSNR_DB));
        assert_eq!(metrics.psnr_object, Some(MAX_PSNR_DB));
        assert_close(metrics.ssim, 1.0, "ssim");
    }

    #[test]
    fn scopes_without_pixels_have_no_value() {
        let all_object = vec![1.0; WIDTH * HEIGHT];
        let metrics = compare(&picture(0), &picture(1), Some(&all_object), WIDTH);
        assert_eq!(metrics.psnr_background, None);
        assert_eq!(metrics.psnr_object, metrics.psnr);
        let unmasked = compare(&picture(0), &picture(1), None, WIDTH);
        assert_eq!((unmasked.psnr_object, unmasked.psnr_masked), (None, None));
    }

    #[test]
    fn small_or_broken_images_give_no_value_instead_of_a_panic() {
        assert_eq!(ssim(&[[0.0; 3]; 100], &[[0.0; 3]; 100], 10), None);
        let broken = compare(&[[f32::NAN; 3]], &[[0.5; 3]], Some(&[1.0]), 1);
        assert_eq!((broken.psnr, broken.ssim, broken.flip), (None, None, None));
    }

    #[test]
    fn means_skip_views_that_lack_a_measure() {
        let one = ImageMetrics {
            psnr: Some(10.0),
            ssim: Some(0.5),
            ..ImageMetrics::default()
        };
        let two = ImageMetrics {
            psnr: Some(20.0),
            ..ImageMetrics::default()
        };
        let mean = mean(&[one, two]);
        assert_eq!(
            (mean.psnr, mean.ssim, mean.lpips),
            (Some(15.0), Some(0.5), None)
        );
    }
}
