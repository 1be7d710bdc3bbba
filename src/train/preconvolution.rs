//! Pre-convolved backgrounds: each photo's surroundings blurred in linear light, the object left out.
//!
//! The ladder of the paper's "multiscale pre-convolved representation" with standard deviations 1, 2, 4, 8, 16
//! pixels. The paper prints a cone of `3 sigma r0`; matching the blurred pixel needs `r0 sqrt(1 + 12 sigma²)`, i.e. a
//! variance of `sigma² + 1/12` pixels². Levels from 4 pixels on are stored at half the resolution each.

use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::data::Photo;

/// Least share of background under the kernel for a blurred pixel to count.
const MIN_WEIGHT: f32 = 0.25;
/// sRGB codes; the last marks a pixel without background.
const CODE_MAX: f32 = 65534.0;
const INVALID: u16 = u16::MAX;

/// One photo's surroundings at all blur levels, sharp first.
#[derive(Clone, Debug)]
pub(super) struct BlurredView {
    /// The levels.
    pub levels: Vec<BlurredImage>,
}

/// One level: a grid of samples, every `stride` pixels, of the photo blurred by `sigma_px`.
#[derive(Clone, Debug)]
pub(super) struct BlurredImage {
    width: u32,
    stride: u32,
    sigma_px: f32,
    pixels: Vec<[u16; 3]>,
}

/// Linear radiance times weight, and the weight.
#[derive(Clone, Copy, Default)]
struct Weighted([f32; 4]);

impl BlurredView {
    /// Blurs the pixels of `photo` that are background.
    pub(super) fn new(photo: &Photo, is_background: &[bool], n_blurred: usize) -> Self {
        let (mut width, mut height) = (photo.width(), photo.height());
        let sharp = is_background.iter().enumerate().map(|(i, &b)| {
            if b {
                encode(photo.srgb(i))
            } else {
                [INVALID; 3]
            }
        });
        let mut levels = vec![BlurredImage {
            width,
            stride: 1,
            sigma_px: 0.0,
            pixels: sharp.collect(),
        }];
        if n_blurred == 0 {
            return Self { levels };
        }
        let linear = linear_by_code();
        let mut image: Vec<Weighted> = levels[0]
            .pixels
            .iter()
            .map(|code| weigh(*code, &linear))
            .collect();
        let (mut stride, mut sigma_px) = (1, 0.0_f32);
        for level in 1..=n_blurred {
            let next = (1 << (level - 1)) as f32;
            if level > 2 {
                image = halve(&image, width, height);
                (width, height, stride) = (width / 2, height / 2, stride * 2);
            }
            if width < 4 || height < 4 {
                break;
            }
            let step = (next * next - sigma_px * sigma_px).sqrt() / stride as f32;
            image = blur(&image, width, height, step);
            sigma_px = next;
            levels.push(BlurredImage {
                width,
                stride,
                sigma_px,
                pixels: image.iter().map(unweigh).collect(),
            });
        }
        Self { levels }
    }
}

impl BlurredImage {
    /// Samples that hold background.
    pub(super) fn valid_pixels(&self) -> impl Iterator<Item = u32> + '_ {
        self.pixels
            .iter()
            .enumerate()
            .filter(|(_, p)| p[0] != INVALID)
            .map(|(i, _)| i as u32)
    }

    /// Centre of a sample in pixels of the photo.
    pub(super) fn position_px(&self, sample: u32) -> (f32, f32) {
        let (x, y) = (sample % self.width, sample / self.width);
        (
            (x as f32 + 0.5) * self.stride as f32,
            (y as f32 + 0.5) * self.stride as f32,
        )
    }

    /// Standard deviation of what a sample averages, pixels of the photo: the blur and the pixel itself.
    pub(super) fn std_px(&self) -> f32 {
        (self.sigma_px * self.sigma_px + 1.0 / 12.0).sqrt()
    }

    /// The sample, sRGB in `[0, 1]`.
    pub(super) fn srgb(&self, sample: u32) -> [f32; 3] {
        self.pixels[sample as usize].map(|code| f32::from(code) / CODE_MAX)
    }
}

fn encode(srgb: [f32; 3]) -> [u16; 3] {
    srgb.map(|v| (v.clamp(0.0, 1.0) * CODE_MAX).round() as u16)
}

/// Linear value of every 16th code: the photos have 8 bits, and 4096 steps are finer.
fn linear_by_code() -> Vec<f32> {
    (0..=4096)
        .map(|i| linear_from_srgb(i as f32 * 16.0 / CODE_MAX))
        .collect()
}

fn weigh(code: [u16; 3], linear: &[f32]) -> Weighted {
    if code[0] == INVALID {
        return Weighted::default();
    }
    let [r, g, b] = code.map(|c| linear[usize::from(c).div_ceil(16)]);
    Weighted([r, g, b, 1.0])
}

fn unweigh(w: &Weighted) -> [u16; 3] {
    let [r, g, b, weight] = w.0;
    if weight < MIN_WEIGHT {
        [INVALID; 3]
    } else {
        encode([r, g, b].map(|v| srgb_from_linear(v / weight)))
    }
}

/// Averages of 2 x 2 samples; an odd last row or column is dropped.
fn halve(image: &[Weighted], width: u32, height: u32) -> Vec<Weighted> {
    let (width, height) = (width as usize, height as usize);
    let at = |x: usize, y: usize, c: usize| image[y * width + x].0[c];
    let mut out = Vec::with_capacity(image.len() / 4);
    for y in 0..height / 2 {
        for x in 0..width / 2 {
            let average = |c| {
                0.25 * (at(2 * x, 2 * y, c)
                    + at(2 * x + 1, 2 * y, c)
                    + at(2 * x, 2 * y + 1, c)
                    + at(2 * x + 1, 2 * y + 1, c))
            };
            out.push(Weighted(std::array::from_fn(average)));
        }
    }
    out
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
    let mut out = vec![Weighted::default(); image.len()];
    for y in 0..height {
        for x in 0..width {
            let (at, end) = if step == 1 { (x, width) } else { (y, height) };
            let (first, last) = (at.saturating_sub(reach), (at + reach).min(end - 1));
            let start = y * width + x - (at - first) * step;
            let mut sum = [0.0; 4];
            for (k, i) in (first..=last).enumerate() {
                let weight = kernel[i + reach - at];
                let value = image[start + k * step].0;
                for c in 0..4 {
                    sum[c] += weight * value[c];
                }
            }
            out[y * width + x] = Weighted(sum);
        }
    }
    out
}
