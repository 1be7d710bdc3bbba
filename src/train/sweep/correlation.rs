//! Normalised cross-correlation of a photo with others warped onto it, around every pixel at once.

use super::small_photo::SmallPhoto;

/// Pixels on each side of one that are compared with it.
const REACH: usize = 2;
const WINDOW: usize = 2 * REACH + 1;
/// Share of the window's pixels that both photos must show.
const LEAST_SHOWN: f32 = 0.6;
/// Least standard deviation of the grey values in a window, sRGB, and in the other photo's: below it there is only noise.
const LEAST_CONTRAST: f32 = 0.015;
const LEAST_CONTRAST_THERE: f32 = 0.5 * LEAST_CONTRAST;
/// Sums over a window: the number of pixels that both show, the values a and b, their squares and their product.
const TERMS: usize = 6;

/// The correlation where the photos do not determine it.
pub(super) const UNKNOWN: f32 = -2.0;

/// A row of the picture for each of the [`TERMS`].
type Row = [Vec<f32>; TERMS];

/// Sums over the window around each pixel of a photo and of another.
pub(super) struct Correlator {
    width: usize,
    /// The photo's values and ones, 0 where not known.
    grey: Vec<f32>,
    known: Vec<f32>,
    /// Terms of the last rows, in turn, and their sums.
    rows: [Row; WINDOW],
    sums: Row,
}

impl Correlator {
    pub(super) fn new(photo: &SmallPhoto) -> Self {
        let width = photo.camera.width as usize;
        let (grey, known) = photo.grey.iter().map(|v| known(*v)).unzip();
        let row = || std::array::from_fn(|_| vec![0.0; width]);
        Self {
            width,
            grey,
            known,
            rows: std::array::from_fn(|_| row()),
            sums: row(),
        }
    }

    /// Keeps the larger two of `first`, `second` and the correlation with `warped`, for every pixel.
    #[inline(always)]
    pub(super) fn add(&mut self, warped: &[f32], first: &mut [f32], second: &mut [f32]) {
        let width = self.width;
        if width < WINDOW {
            return;
        }
        for (y, warped) in warped.chunks_exact(width).enumerate() {
            self.take_up(y, warped);
            if y + 1 < WINDOW {
                continue;
            }
            self.sum_rows();
            let inner = (y - REACH) * width + REACH..(y - REACH + 1) * width - REACH;
            self.keep_best(&mut first[inner.clone()], &mut second[inner]);
        }
    }

    /// Terms of row `y`.
    #[inline(always)]
    fn take_up(&mut self, y: usize, warped: &[f32]) {
        let width = self.width;
        let own = y * width..(y + 1) * width;
        let (grey, is_known) = (&self.grey[own.clone()], &self.known[own]);
        let row = &mut self.rows[y % WINDOW];
        let [ns, a_s, bs, aas, bbs, abs] = row.each_mut().map(|line| &mut line[..width]);
        for x in 0..width {
            let (b, n) = known(warped[x]);
            let n = n * is_known[x];
            let (a, b) = (n * grey[x], n * b);
            (ns[x], a_s[x], bs[x]) = (n, a, b);
            (aas[x], bbs[x], abs[x]) = (a * a, b * b, a * b);
        }
    }

    /// Sums over the last rows.
    #[inline(always)]
    fn sum_rows(&mut self) {
        let n = self.width;
        for (term, sums) in self.sums.iter_mut().enumerate() {
            let [a, b, c, d, e] = self.rows.each_ref().map(|row| &row[term][..n]);
            for (x, sum) in sums[..n].iter_mut().enumerate() {
                *sum = a[x] + b[x] + c[x] + d[x] + e[x];
            }
        }
    }

    /// Keeps the larger two of `first`, `second` and the correlation in windows of the last rows.
    #[inline(always)]
    fn keep_best(&self, first: &mut [f32], second: &mut [f32]) {
        let n = first.len();
        let second = &mut second[..n];
        let [ns, a, b, aa, bb, ab] = self.sums.each_ref().map(|sums| &sums[..n + WINDOW - 1]);
        for x in 0..n {
            let sum = |of: &[f32]| of[x] + of[x + 1] + of[x + 2] + of[x + 3] + of[x + 4];
            let value = correlation([sum(ns), sum(a), sum(b), sum(aa), sum(bb), sum(ab)]);
            let best = first[x];
            let lesser = if value < best { value } else { best };
            first[x] = if value > best { value } else { best };
            second[x] = if lesser > second[x] {
                lesser
            } else {
                second[x]
            };
        }
    }
}

/// A value and 1, or nothing where it is not known.
#[inline(always)]
fn known(value: f32) -> (f32, f32) {
    if value.is_nan() {
        (0.0, 0.0)
    } else {
        (value, 1.0)
    }
}

/// Normalised cross-correlation from the sums over a window; [`UNKNOWN`] where too little is shown, or nothing but noise.
#[inline(always)]
fn correlation([n, a, b, aa, bb, ab]: [f32; TERMS]) -> f32 {
    let (of_a, of_b) = (n * aa - a * a, n * bb - b * b);
    let least = |contrast: f32| (n * contrast) * (n * contrast);
    // Without branches, so that it vectorises.
    let is_known = (n >= LEAST_SHOWN * (WINDOW * WINDOW) as f32)
        & (of_a > least(LEAST_CONTRAST))
        & (of_b > least(LEAST_CONTRAST_THERE));
    let value = (n * ab - a * b) / (of_a * of_b).sqrt();
    if is_known { value } else { UNKNOWN }
}
