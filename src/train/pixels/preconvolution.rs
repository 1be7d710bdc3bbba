//! Pre-convolved backgrounds: each photo's background blurred in linear light, the object left out.
//!
//! The ladder of the paper's "multiscale pre-convolved representation" with standard deviations 1, 2, 4, 8, 16
//! pixels. The paper prints a cone of `3 sigma r0`; matching the blurred pixel needs the variance of both, `sigma²` and
//! that of what a pixel averages. Levels from 4 pixels on are stored at half the resolution each.

use glam::{Vec3, Vec4};

use super::pixel_set::PixelSet;
use super::srgb_codes::SrgbCodes;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::data::Photo;
use crate::render::path::trace::PIXEL_STD;
use crate::train::step::loss::{CLIPPED, unclipped};

/// Least share of background under the kernel for a blurred pixel to count.
const MIN_WEIGHT: f32 = 0.25;
/// Largest of the sRGB codes by which linear values are looked up.
const CODE_MAX: f32 = 65534.0;

/// One level of one photo's background: samples, every `stride` pixels, of the photo blurred by `sigma_px`.
#[derive(Clone, Debug)]
pub(super) struct BlurredImage {
    width: u32,
    stride: u32,
    sigma_px: f32,
    /// The samples that hold background and were kept.
    kept: PixelSet,
    /// Their colours, in the same order.
    colors: SrgbCodes,
}

/// Linear radiance times weight, and the weight.
type Weighted = Vec4;

/// The pixels of `photo` that are background, sharp and at up to `n_blurred` levels of blur, in which clipped colours count as
/// [`unclipped`] has them. `keep(level)` is asked for each sample that holds background, in order.
pub(super) fn blurred_images(
    photo: &Photo,
    is_background: &[bool],
    n_blurred: usize,
    clipped_radiance: f32,
    mut keep: impl FnMut(usize) -> bool,
) -> Vec<BlurredImage> {
    let (mut width, mut height) = (photo.width(), photo.height());
    let sharp = |i: usize| is_background[i].then(|| photo.srgb(i));
    let mut image = BlurredImage {
        width,
        stride: 1,
        sigma_px: 0.0,
        kept: PixelSet::default(),
        colors: SrgbCodes::like(photo),
    };
    let mut levels = vec![image.filled(is_background.len(), sharp, || keep(0))];
    if n_blurred == 0 {
        return levels;
    }
    let linear = linear_by_code();
    let weigh = |srgb| weigh(srgb, unclipped(srgb, clipped_radiance), &linear);
    let mut weighted: Vec<Weighted> = (0..is_background.len())
        .map(|i| sharp(i).map_or(Weighted::ZERO, weigh))
        .collect();
    for level in 1..=n_blurred {
        let next = (1 << (level - 1)) as f32;
        if level > 2 {
            weighted = halve(&weighted, width, height);
            (width, height, image.stride) = (width / 2, height / 2, image.stride * 2);
        }
        if width < 4 || height < 4 {
            break;
        }
        let step = (next * next - image.sigma_px * image.sigma_px).sqrt() / image.stride as f32;
        weighted = blur(&weighted, width, height, step);
        (image.width, image.sigma_px) = (width, next);
        levels.push(image.filled(weighted.len(), |i| unweigh(weighted[i]), || keep(level)));
    }
    levels
}

impl BlurredImage {
    /// This level with those of `n` samples that have a colour and are to be kept.
    fn filled(
        &self,
        n: usize,
        srgb: impl Fn(usize) -> Option<[f32; 3]>,
        mut keep: impl FnMut() -> bool,
    ) -> Self {
        let mut colors = self.colors.clone();
        let kept = PixelSet::new(n, |i| {
            let color = srgb(i).filter(|_| keep());
            colors.extend(color);
            color.is_some()
        });
        colors.shrink();
        Self {
            kept,
            colors,
            ..*self
        }
    }

    /// Number of samples kept.
    pub(super) fn len(&self) -> usize {
        self.kept.len()
    }

    /// Centre of the `k`-th sample in pixels of the photo.
    pub(super) fn position_px(&self, k: usize) -> (f32, f32) {
        let sample = self.kept.nth(k);
        let middle = |i: u32| (i as f32 + 0.5) * self.stride as f32;
        (middle(sample % self.width), middle(sample / self.width))
    }

    /// The slope of the grey value at the `k`-th sample to the right and downwards, by pixels of the photo; `None` where a
    /// neighbour holds no background or was not kept.
    pub(super) fn slope(&self, k: usize) -> Option<[f32; 2]> {
        let sample = self.kept.nth(k);
        let grey = |i: u32| {
            let color = self.colors.srgb(self.kept.rank(i)?);
            Some(color.iter().sum::<f32>() / 3.0)
        };
        let column = sample % self.width;
        let is_inside = column > 0 && column + 1 < self.width && sample >= self.width;
        let slope = |step: u32| {
            let difference = grey(sample + step)? - grey(sample - step)?;
            Some(difference / (2 * self.stride) as f32)
        };
        is_inside.then_some(())?;
        Some([slope(1)?, slope(self.width)?])
    }

    /// Standard deviation of what a sample averages, pixels of the photo: the blur and the pixel itself.
    pub(super) fn std_px(&self) -> f32 {
        self.sigma_px.hypot(PIXEL_STD)
    }

    /// The `k`-th sample, sRGB in `[0, 1]`.
    pub(super) fn srgb(&self, k: usize) -> [f32; 3] {
        self.colors.srgb(k)
    }
}

/// Linear value of every 16th code: the photos have 8 bits, and 4096 steps are finer.
fn linear_by_code() -> Vec<f32> {
    (0..=4096)
        .map(|i| linear_from_srgb(i as f32 * 16.0 / CODE_MAX))
        .collect()
}

fn weigh(srgb: [f32; 3], clipped: f32, linear: &[f32]) -> Weighted {
    let radiance = srgb.map(|v| {
        if v >= CLIPPED {
            return clipped;
        }
        let code = (v.clamp(0.0, 1.0) * CODE_MAX + 0.5) as usize;
        linear[code.div_ceil(16)]
    });
    Vec3::from(radiance).extend(1.0)
}

/// The colour, sRGB, where there is enough background.
fn unweigh(weighted: Weighted) -> Option<[f32; 3]> {
    let [r, g, b, weight] = weighted.to_array();
    (weight >= MIN_WEIGHT).then(|| [r, g, b].map(|v| srgb_from_linear(v / weight)))
}

/// Averages of 2 x 2 samples; an odd last row or column is dropped.
fn halve(image: &[Weighted], width: u32, height: u32) -> Vec<Weighted> {
    let (width, height) = (width as usize, height as usize);
    let average = |(x, y): (usize, usize)| {
        let i = 2 * (y * width + x);
        0.25 * (image[i] + image[i + 1] + image[i + width] + image[i + width + 1])
    };
    let places = (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| (x, y)));
    places.map(average).collect()
}

/// Separable Gaussian; beyond the border there is no weight.
fn blur(image: &[Weighted], width: u32, height: u32, sigma: f32) -> Vec<Weighted> {
    let (width, height) = (width as usize, height as usize);
    let reach = (3.0 * sigma).ceil() as usize;
    let raw: Vec<f32> = (0..=2 * reach)
        .map(|i| (-0.5 * ((i as f32 - reach as f32) / sigma).powi(2)).exp())
        .collect();
    let total: f32 = raw.iter().sum();
    let kernel: Vec<f32> = raw.iter().map(|k| k / total).collect();
    let along_x = convolve(image, width, height, &kernel, 1);
    convolve(&along_x, width, height, &kernel, width)
}

/// Convolves along rows (`step == 1`) or columns (`step == width`).
fn convolve(
    image: &[Weighted],
    width: usize,
    height: usize,
    kernel: &[f32],
    step: usize,
) -> Vec<Weighted> {
    let reach = kernel.len() / 2;
    let mut out = vec![Weighted::ZERO; image.len()];
    for y in 0..height {
        for x in 0..width {
            let (at, end) = if step == 1 { (x, width) } else { (y, height) };
            let (first, last) = (at.saturating_sub(reach), (at + reach).min(end - 1));
            let start = y * width + x - (at - first) * step;
            let mut sum = Weighted::ZERO;
            for (k, i) in (first..=last).enumerate() {
                sum += kernel[i + reach - at] * image[start + k * step];
            }
            out[y * width + x] = sum;
        }
    }
    out
}
