//! The picture convolved with von Mises–Fisher lobes of growing width, on the sphere.
//!
//! Levels are a factor of `2^(2/3)` in concentration apart and between a quarter and half a lobe's deviation fine, so
//! that cubics between pixels and between levels are good to a percent. A level is made from a sharper one by the lobe
//! whose mean length makes up the difference: exact for the first moment, and for all while lobes are narrow. The wide
//! ones come from one a quarter or an eighth as wide.

use rayon::prelude::*;

use super::equirect::Equirect;
use crate::neif::kernels::{Isa, dispatch, fma};

/// Widest picture that is convolved.
pub(super) const MAX_WIDTH: usize = 1024;
/// Narrowest: pixels of 22 degrees hold any lobe that is left.
const MIN_WIDTH: usize = 16;
/// Levels for a halving of the concentration's root, which halves the resolution.
const LEVELS_PER_HALVING: usize = 3;
/// Concentration at which lobes are near enough to even.
const LEAST_KAPPA: f64 = 0.2;
/// Below this concentration levels are made from one that is much sharper: a chain of lobes tends to the sphere's heat
/// kernel, whose peak is lower by a share of `1/(3 kappa)`.
const WIDE_KAPPA: f64 = 40.0;
/// How much sharper, as a factor of the concentration, up to which concentration: what is dear for narrow lobes is
/// needed for the widest.
const WIDE_FACTORS: [(f64, f64); 2] = [(8.0, 64.0), (WIDE_KAPPA, 16.0)];
/// Lobes are cut off where they have fallen to `e^-16`.
const CUT_OFF: f64 = 16.0;

/// The ratio of concentrations from level to level, logarithm.
pub(super) const LOG_RATIO: f64 = std::f64::consts::LN_2 * 2.0 / LEVELS_PER_HALVING as f64;

/// Levels from narrow to wide.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    /// Concentration of the first; the next ones' fall by `e^LOG_RATIO`.
    pub(super) kappa: f64,
    /// At least four.
    pub(super) levels: Vec<Equirect>,
}

impl Pyramid {
    /// Convolves a picture: about a second on two cores for the widest (2 s of processor time).
    pub(super) fn new(base: &Equirect) -> Self {
        let width = base.width().next_power_of_two().clamp(MIN_WIDTH, MAX_WIDTH);
        let base = base.resampled(width, width / 2);
        let pitch = std::f64::consts::TAU / width as f64;
        // The first lobe's deviation is a pixel.
        let kappa = 1.0 / (pitch * pitch);
        let kappa_of = |level: usize| kappa * (-LOG_RATIO * level as f64).exp();
        let n_levels = ((kappa / LEAST_KAPPA).ln() / LOG_RATIO).ceil() as usize + 1;
        let mut levels: Vec<Equirect> = Vec::with_capacity(n_levels);
        for level in 0..n_levels.max(4) {
            let target = kappa_of(level);
            let factor = WIDE_FACTORS.iter().find(|(most, _)| target <= *most);
            let source = match factor {
                Some((_, factor)) => (0..level).rev().find(|&l| kappa_of(l) >= factor * target),
                None => level.checked_sub(2).filter(|_| level >= LEVELS_PER_HALVING),
            };
            let blurred = source.map_or(1.0, |source| mean_length(kappa_of(source)));
            let rest = kappa_from_mean_length(mean_length(target) / blurred);
            let halvings = (level / LEVELS_PER_HALVING).saturating_sub(1);
            let width = (width >> halvings.min(usize::BITS as usize - 1)).max(MIN_WIDTH);
            let made = convolved(source.map_or(&base, |l| &levels[l]), rest, width);
            levels.push(made);
        }
        Self { kappa, levels }
    }
}

/// `coth kappa - 1/kappa`.
fn mean_length(kappa: f64) -> f64 {
    1.0 / kappa.tanh() - 1.0 / kappa
}

/// The concentration of a mean length in `(0, 1)`: Newton's method from the start of Banerjee et al. 2005, Eq. 4.4.
fn kappa_from_mean_length(a: f64) -> f64 {
    // Here coth is 1 to the last bit.
    if a > 0.95 {
        return 1.0 / (1.0 - a);
    }
    let mut kappa = a * (3.0 - a * a) / (1.0 - a * a);
    for _ in 0..4 {
        let found = mean_length(kappa);
        kappa -= (found - a) / (1.0 - found * found - 2.0 * found / kappa);
    }
    kappa
}

/// Rows split by channel and by column modulo the reduction, each twice in a row, so that any shift is one slice.
struct Planes {
    reduction: usize,
    width: usize,
    values: Vec<f32>,
}

impl Planes {
    fn new(source: &Equirect, width: usize) -> Self {
        let reduction = source.width() / width;
        let mut values = Vec::with_capacity(source.pixels().len() * 6);
        for row in source.pixels().chunks_exact(source.width()) {
            for channel in 0..3 {
                for phase in 0..reduction {
                    let plane = || row[phase..].iter().step_by(reduction).map(|p| p[channel]);
                    values.extend(plane());
                    values.extend(plane());
                }
            }
        }
        Self {
            reduction,
            width,
            values,
        }
    }

    /// `[width]` values of a row and channel, every `reduction`th column from column `start` on.
    fn shifted(&self, row: usize, channel: usize, start: usize) -> &[f32] {
        let (phase, offset) = (start % self.reduction, start / self.reduction);
        let plane = (row * 3 + channel) * self.reduction + phase;
        &self.values[plane * 2 * self.width + offset..][..self.width]
    }
}

/// The picture convolved with a lobe, at a width that divides its own; constants stay as they are.
fn convolved(source: &Equirect, kappa: f64, width: usize) -> Equirect {
    // A level is never finer than its source.
    let width = width.min(source.width());
    let height = width / 2;
    let planes = Planes::new(source, width);
    let mut pixels = vec![[0.0_f32; 3]; width * height];
    pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            let elevation = std::f64::consts::PI * (0.5 - (y as f64 + 0.5) / height as f64);
            convolve_row(source, &planes, kappa, elevation, row);
        });
    Equirect::new(width, height, pixels).expect("an even width and all pixels")
}

fn convolve_row(
    source: &Equirect,
    planes: &Planes,
    kappa: f64,
    elevation: f64,
    out: &mut [[f32; 3]],
) {
    let n_in = source.width() as f64;
    // A column's middle lies this far, in source columns, from the middle of source column 0 of its group.
    let center = 0.5 * (planes.reduction as f64 - 1.0);
    let mut sums = [(); 3].map(|()| vec![0.0_f32; planes.width]);
    let mut whole = 0.0;
    for y in 0..source.height() {
        let from = source.elevation(y);
        // 1 - cos of the angle = 2 sin²(Δel/2) + 2 cos el cos el' sin²(Δaz/2), without cancellation.
        let across = 2.0 * kappa * (0.5 * (elevation - from)).sin().powi(2);
        let along = 2.0 * kappa * elevation.cos() * from.cos();
        if across > CUT_OFF {
            continue;
        }
        let reach =
            ((CUT_OFF - across) / along).min(1.0).sqrt().asin() * n_in / std::f64::consts::PI;
        let (first, last) = if reach >= 0.5 * n_in {
            (0, source.width() as i64 - 1)
        } else {
            (
                (center - reach).ceil() as i64,
                (center + reach).floor() as i64,
            )
        };
        let solid_angle = source.solid_angle(y);
        for x in first..=last {
            let half_angle = std::f64::consts::PI * (x as f64 - center) / n_in;
            let weight = solid_angle * (-across - along * half_angle.sin().powi(2)).exp();
            whole += weight;
            let start = x.rem_euclid(source.width() as i64) as usize;
            for (channel, sum) in sums.iter_mut().enumerate() {
                add_scaled(sum, weight as f32, planes.shifted(y, channel, start));
            }
        }
    }
    for (x, pixel) in out.iter_mut().enumerate() {
        *pixel = [0, 1, 2].map(|c| (f64::from(sums[c][x]) / whole) as f32);
    }
}

dispatch! {
    /// `sum += weight * values`.
    fn add_scaled(sum: &mut [f32], weight: f32, values: &[f32]) = add_scaled_body
}

#[inline(always)]
fn add_scaled_body<I: Isa>(sum: &mut [f32], weight: f32, values: &[f32]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum = fma::<I>(weight, *value, *sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concentrations_follow_from_mean_lengths() {
        for kappa in [0.1, 0.35, 1.0, 4.0, 19.0, 25.0, 1e3, 1e6] {
            let back = kappa_from_mean_length(mean_length(kappa));
            assert!((back / kappa - 1.0).abs() < 1e-6, "{kappa}: {back}");
        }
    }

    #[test]
    fn all_levels_keep_the_light() {
        let value = |i: usize| ((i * 7919 + 13) % 1009) as f32;
        let mut pixels: Vec<[f32; 3]> = (0..64 * 32).map(|i| [value(i), 1.0, 0.0]).collect();
        // One lamp near a pole, one on the seam.
        pixels[2 * 64 + 17][2] = 1e6;
        pixels[20 * 64][2] = 1e5;
        let base = Equirect::new(64, 32, pixels).unwrap();
        let pyramid = Pyramid::new(&base);
        for (l, level) in pyramid.levels.iter().enumerate() {
            let (mean, expected) = (level.mean(), base.mean());
            assert!(
                (mean.y - 1.0).abs() < 1e-5,
                "level {l}: a constant is {}",
                mean.y
            );
            assert!(
                (mean.x / expected.x - 1.0).abs() < 2e-3,
                "level {l}: {mean}"
            );
            assert!(
                (mean.z / expected.z - 1.0).abs() < 2e-2,
                "level {l}: {mean}, not {expected}"
            );
        }
        assert_eq!(
            pyramid.levels.last().unwrap().width(),
            MIN_WIDTH,
            "the widest"
        );
    }
}
