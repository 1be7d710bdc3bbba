//! Does the background stand still in the picture while the camera goes around the object?
//!
//! Light is learned from an environment that stays where it is while the camera moves. On a turntable, or before a
//! backdrop that is carried along, the background stays where it is in the picture instead. Two photos from clearly
//! different sides distinguish the two: their backgrounds are alike in place, and less alike when one is shifted.
//!
//! What lenses do to all photos (light falling off to the corners) is taken off first, and faint things count as much as
//! strong ones, so that a turning plate does not drown out a faint wall. What goes along the picture, such as horizons,
//! is as alike when shifted along itself and is no evidence.

use rayon::prelude::*;

use super::thumb::Thumb;
use crate::data::{Dataset, Problem, Severity};

/// Least angle between two cameras' views for their backgrounds to have to differ, cosine of 40 degrees.
const WIDE_COSINE: f32 = 0.766;
/// How alike two backgrounds are in place at least that are the same one (correlation), and by how much more than at any
/// shift. The same faint one (6 codes of blurred structure) reaches 0.66 and 0.27 in the mean under noise of 5 codes, 0.52
/// and 0.18 beside a plate that turns; different ones reach 0.5 in up to one pair of 50 of a real capture. Bands around a
/// room reach 1.0, but 0.04 more than shifted along themselves.
const SAME: f32 = 0.5;
const MORE_THAN_SHIFTED: f32 = 0.1;
/// How far backgrounds are shifted, of the longer side: further than blurred things are wide, yet most of the picture is
/// still shared.
const SHIFT: f32 = 0.15;
/// Share of such pairs from which the background stands still. Composites of turntables have the same background in all
/// pairs, in 61 % where a plate that turns is stronger than all else, and in 31 % with photos from three heights; real
/// captures that somebody walked around in up to 1 %, invented ones in up to 9 % (a white table before a blurred room).
const SAME_SHARE: f32 = 0.2;
/// Standard deviation of a background, encoded, beside what lenses make of any, below which nothing is to be seen in it.
const PLAIN: f32 = 0.02;
/// Share of photos with such a background from which the environment counts as plain.
const PLAIN_SHARE: f32 = 0.5;
/// Contrast, encoded, from which things count as much as stronger ones: one code, several times the noise that is left in
/// a small picture.
const FAINT: f32 = 1.0 / 255.0;
/// Pixels on each side of one that its contrast is estimated from.
const NEAR: usize = 5;
/// Fewest pixels that both photos must show of the background.
const MIN_SHARED: usize = 60;
/// Fewest pairs that allow a conclusion.
const MIN_PAIRS: usize = 10;
/// Pairs compared at most: the share is then known to 2 %.
const MAX_PAIRS: usize = 1000;

/// What the backgrounds of the training photos have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Backdrop {
    /// The share of pairs from different sides with the same background in the picture, 0 to 1; `None` where too few
    /// are conclusive.
    pub(super) same_share: Option<f32>,
    /// Photos, and those of them in whose background nothing is to be seen.
    n_photos: usize,
    n_plain: usize,
}

impl Backdrop {
    /// Compares the backgrounds of the capture's training photos.
    pub(super) fn of(dataset: &Dataset, thumbs: &[Thumb]) -> Self {
        if !dataset.environment_visible {
            return Self::default();
        }
        let details: Vec<Detail> = thumbs.iter().map(Detail::new).collect();
        let mut backdrop = Self {
            same_share: None,
            n_photos: thumbs.len(),
            n_plain: details.iter().filter(|detail| detail.is_plain).count(),
        };
        backdrop.same_share = same_share(thumbs, &details)
            // Of nothing that is to be seen it cannot be said that it differs.
            .filter(|share| *share > SAME_SHARE || !backdrop.is_plain());
        backdrop
    }

    /// Whether it stands still in the picture.
    pub(super) fn stands_still(&self) -> bool {
        self.same_share.is_some_and(|share| share > SAME_SHARE)
    }

    fn is_plain(&self) -> bool {
        self.n_photos > 0 && self.n_plain as f32 >= PLAIN_SHARE * self.n_photos as f32
    }

    /// What is wrong with it, if anything is.
    pub(super) fn problem(&self) -> Option<Problem> {
        if let Some(share) = self.same_share.filter(|_| self.stands_still()) {
            let what = format!(
                "the background stands still in the picture while the camera goes around the object (the same in {:.0} \
                 % of photos from different sides): a turntable, or a backdrop that is carried along",
                100.0 * share
            );
            let advice = "its light cannot be learned: training leaves the background out; leave the object where it \
                          is and walk around it";
            return Some(Problem::new(Severity::Error, what, advice));
        }
        self.is_plain().then(|| {
            let what = format!(
                "the background is plain in {} of {} photos",
                self.n_plain, self.n_photos
            );
            let advice = "light is learned from an environment that can be seen: photograph without a backdrop";
            Problem::new(Severity::Warning, what, advice)
        })
    }
}

/// The share of pairs from different sides that have the same background in the picture.
fn same_share(thumbs: &[Thumb], details: &[Detail]) -> Option<f32> {
    let pairs = wide_pairs(thumbs);
    let stride = pairs.len().div_ceil(MAX_PAIRS).max(1);
    let is_same: Vec<bool> = pairs
        .par_iter()
        .step_by(stride)
        .filter_map(|(a, b)| details[*a].is_same(&details[*b]))
        .collect();
    let n_same = is_same.iter().filter(|is_same| **is_same).count();
    (is_same.len() >= MIN_PAIRS).then(|| n_same as f32 / is_same.len() as f32)
}

/// Pairs of photos of one size from clearly different sides, neighbours in the list first.
fn wide_pairs(thumbs: &[Thumb]) -> Vec<(usize, usize)> {
    let n = thumbs.len();
    let pairs = (1..n).flat_map(move |step| (0..n - step).map(move |a| (a, a + step)));
    let is_wide = |(a, b): &(usize, usize)| {
        let (a, b) = (&thumbs[*a].camera, &thumbs[*b].camera);
        (a.width, a.height) == (b.width, b.height) && a.forward().dot(b.forward()) < WIDE_COSINE
    };
    pairs.filter(is_wide).collect()
}

/// The places of the pixels that show the background of a small picture, and their values, encoded.
fn encoded(thumb: &Thumb) -> (Vec<usize>, Vec<f32>) {
    let encode = |v: f32| crate::color::srgb_from_linear(v.clamp(0.0, 1.0));
    let known = |(i, value): (usize, &Option<f32>)| value.map(|value| (i, encode(value)));
    thumb
        .background
        .iter()
        .enumerate()
        .filter_map(known)
        .unzip()
}

/// Shapes that hardly any background is without, at the pixels of those places: three of a lens, whose light falls off to
/// the corners, then two of a bright sky over a dark floor. Each less its part along those before: their parts can be
/// taken off one after the other.
fn common_shapes(thumb: &Thumb, places: &[usize]) -> [Vec<f32>; 5] {
    let (width, height) = (thumb.camera.width as usize, thumb.camera.height as usize);
    let mut shapes: [Vec<f32>; 5] = Default::default();
    for k in 0..shapes.len() {
        let at = |i: &usize| {
            let x = ((i % width) as f32 + 0.5 - 0.5 * width as f32) / width as f32;
            let y = ((i / width) as f32 + 0.5 - 0.5 * height as f32) / width as f32;
            let squared = x * x + y * y;
            [1.0, squared, squared * squared, x, y][k]
        };
        let mut along: Vec<f32> = places.iter().map(at).collect();
        for former in &shapes[..k] {
            take_off(&mut along, former);
        }
        shapes[k] = along;
    }
    shapes
}

/// Takes off what `values` have along `shape`.
fn take_off(values: &mut [f32], shape: &[f32]) {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    // A few pixels in a row leave nothing of a shape beside those before.
    let share = dot(values, shape) / dot(shape, shape).max(1e-9);
    for (value, shape) in values.iter_mut().zip(shape) {
        *value -= share * shape;
    }
}

/// The standard deviation of values whose mean is zero.
fn spread(values: &[f32]) -> f32 {
    (values.iter().map(|v| v * v).sum::<f32>() / values.len().max(1) as f32).sqrt()
}

/// A background without what hardly any is without, in which faint things are as strong as others.
#[derive(Debug)]
struct Detail {
    width: usize,
    /// `[height * width]`; `None` where the object is.
    values: Vec<Option<f32>>,
    /// Whether there is nothing to be seen in it.
    is_plain: bool,
}

impl Detail {
    fn new(thumb: &Thumb) -> Self {
        let (places, mut rest) = encoded(thumb);
        let [lens @ .., across, down] = common_shapes(thumb, &places);
        for shape in &lens {
            take_off(&mut rest, shape);
        }
        let is_plain = spread(&rest) < PLAIN;
        for shape in [across, down] {
            take_off(&mut rest, &shape);
        }
        let mut values = vec![None; thumb.background.len()];
        for (i, value) in places.into_iter().zip(rest) {
            values[i] = Some(value);
        }
        let width = thumb.camera.width as usize;
        Self {
            width,
            values: over_contrast(&values, width),
            is_plain,
        }
    }

    /// Whether two backgrounds of one size are the same in the picture; `None` where too little is seen of both.
    fn is_same(&self, other: &Self) -> Option<bool> {
        let in_place = self.correlation(other, [0, 0])?;
        let height = self.values.len() / self.width.max(1);
        let shift = (SHIFT * self.width.max(height) as f32).round() as isize;
        let around = [-shift, 0, shift];
        let shifts = around.iter().flat_map(|x| around.map(|y| [*x, y]));
        let shifted = shifts
            .filter(|shift| *shift != [0, 0])
            .filter_map(|shift| self.correlation(other, shift))
            .reduce(f32::max)?;
        Some(in_place > SAME && in_place > shifted + MORE_THAN_SHIFTED)
    }

    /// How alike the background is to another that is shifted by so many columns and rows, -1 to 1; `None` where too
    /// little is seen of both.
    fn correlation(&self, other: &Self, [columns, rows]: [isize; 2]) -> Option<f32> {
        let width = self.width as isize;
        let (mut n, mut sums, mut products) = (0, [0.0_f32; 2], [0.0_f32; 3]);
        for (i, a) in self.values.iter().enumerate() {
            let (x, y) = (i as isize % width + columns, i as isize / width + rows);
            if !(0..width).contains(&x) || y < 0 {
                continue;
            }
            let b = other.values.get((y * width + x) as usize);
            if let (Some(a), Some(Some(b))) = (a, b) {
                n += 1;
                sums = [sums[0] + a, sums[1] + b];
                products = [
                    products[0] + a * a,
                    products[1] + b * b,
                    products[2] + a * b,
                ];
            }
        }
        let [mean_a, mean_b] = sums.map(|sum| sum / n.max(1) as f32);
        let [aa, bb, ab] = products.map(|product| product / n.max(1) as f32);
        let variance = (aa - mean_a * mean_a) * (bb - mean_b * mean_b);
        // Two pictures of one value are alike everywhere: 0 says that this is no evidence.
        (n >= MIN_SHARED).then(|| (ab - mean_a * mean_b) / variance.max(1e-9).sqrt())
    }
}

/// Each value over the contrast around it.
fn over_contrast(values: &[Option<f32>], width: usize) -> Vec<Option<f32>> {
    let height = values.len() / width.max(1);
    let near = |at: usize, n: usize| at.saturating_sub(NEAR)..(at + NEAR + 1).min(n);
    let scaled = |(i, value): (usize, &Option<f32>)| {
        let rows = near(i / width, height);
        let around = rows.flat_map(|y| &values[y * width..][near(i % width, width)]);
        let add = |(sum, n): (f32, f32), v: &f32| (sum + v * v, n + 1.0);
        let (sum, n) = around.flatten().fold((0.0, 0.0), add);
        value.map(|value| value / (sum / n + FAINT * FAINT).sqrt())
    };
    values.iter().enumerate().map(scaled).collect()
}
