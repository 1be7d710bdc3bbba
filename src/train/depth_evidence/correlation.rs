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

/// The correlation where photos do not tell.
pub(super) const UNKNOWN: f32 = -2.0;

/// A row of the picture for each of the [`TERMS`].
type Row = [Vec<f32>; TERMS];

/// Sums over the window around each pixel of a photo and of another.
pub(super) struct Correlator {
    width: usize,
    /// The photo's values and ones, 0 where not known.
    grey: Vec<f32>,
    known: Vec<f32>,
    /// Terms of a row.
    line: Row,
    /// Sums over columns of the last rows, in turn.
    columns: [Row; WINDOW],
    /// Sums over windows.
    windows: Row,
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
            line: row(),
            columns: std::array::from_fn(|_| row()),
            windows: row(),
        }
    }

    /// Keeps the larger two of `first`, `second` and the correlation with `warped`, for every pixel.
    pub(super) fn add(&mut self, warped: &[f32], first: &mut [f32], second: &mut [f32]) {
        let width = self.width;
        if width < WINDOW {
            return;
        }
        for (y, warped) in warped.chunks_exact(width).enumerate() {
            self.sum_columns(y, warped);
            if y + 1 < WINDOW {
                continue;
            }
            self.sum_windows();
            let inner = (y - REACH) * width + REACH..(y - REACH + 1) * width - REACH;
            let n = width - WINDOW + 1;
            let (first, second) = (&mut first[inner.clone()], &mut second[inner]);
            let sums = self.windows.each_ref().map(|sums| &sums[..n]);
            for x in 0..n {
                let value = correlation(sums.map(|sums| sums[x]));
                second[x] = second[x].max(value.min(first[x]));
                first[x] = first[x].max(value);
            }
        }
    }

    /// Terms of row `y`, and their sums over the columns of the windows.
    fn sum_columns(&mut self, y: usize, warped: &[f32]) {
        let width = self.width;
        let own = y * width..(y + 1) * width;
        let (grey, is_known) = (&self.grey[own.clone()], &self.known[own]);
        let [ns, a_s, bs, aas, bbs, abs] = self.line.each_mut().map(|line| &mut line[..width]);
        for x in 0..width {
            let (b, n) = known(warped[x]);
            let n = n * is_known[x];
            let (a, b) = (n * grey[x], n * b);
            (ns[x], a_s[x], bs[x]) = (n, a, b);
            (aas[x], bbs[x], abs[x]) = (a * a, b * b, a * b);
        }
        let inner = width - WINDOW + 1;
        for (line, sums) in self.line.iter().zip(&mut self.columns[y % WINDOW]) {
            sums[..inner].copy_from_slice(&line[..inner]);
            for step in 1..WINDOW {
                add(&mut sums[..inner], &line[step..step + inner]);
            }
        }
    }

    /// The sums over windows that end with the last row.
    fn sum_windows(&mut self) {
        let [first, others @ ..] = &self.columns;
        for (term, sums) in self.windows.iter_mut().enumerate() {
            sums.copy_from_slice(&first[term]);
            for row in others {
                add(sums, &row[term]);
            }
        }
    }
}

#[inline(always)]
fn add(sums: &mut [f32], values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
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
    let tells = n >= LEAST_SHOWN * (WINDOW * WINDOW) as f32
        && of_a > least(LEAST_CONTRAST)
        && of_b > least(LEAST_CONTRAST_THERE);
    let value = (n * ab - a * b) / (of_a * of_b).max(f32::MIN_POSITIVE).sqrt();
    if tells { value } else { UNKNOWN }
}
