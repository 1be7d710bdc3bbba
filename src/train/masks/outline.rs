//! The object's outline in one photo: where it differs from the environment alone, along the photo's edges, near where the
//! region is.

use glam::Vec2;

use super::agreed::Expected;
use super::colors::Histogram;
use super::seen::look;
use super::selection::Stroke;
use super::total_variation::segment;
use super::window::Window;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::data::{Mask, View};
use crate::geometry::Camera;
use crate::neif::Environment;
use crate::train::pixels::mask_outline::MaskOutline;
use crate::train::statistics::{mean_121, middle_or, with_neighbours};

/// Samples of a photo that are cut, at most.
const MOST_SAMPLES: usize = 150_000;
/// Rays that predict a photo without the object, at most.
const MOST_RAYS: usize = 30_000;
/// How far the outline may be from that of the region, as a share of the object's size, and in pixels at least.
const BAND: f32 = 0.04;
const LEAST_BAND_PX: f32 = 1.5;
/// Bands around the object in which colours are those of what is beside it.
const BESIDE: f32 = 6.0;
/// Weights of what the region, the prediction and the colours say.
const REGION: f32 = 1.0;
const PREDICTION: f32 = 0.9;
const COLORS: f32 = 0.3;
/// The most that each of them says.
const MOST_BANDS: f32 = 1.5;
const MOST_PREDICTION: f32 = 2.0;
const MOST_COLORS: f32 = 2.0;
/// Mean difference of two colours of which nothing is known (sum of the channels, sRGB).
const UNKNOWN_DIFFERENCE: f32 = 1.5;
/// The least error of a prediction.
const LEAST_ERROR: f32 = 0.01;
/// Half the width of a mask's soft edge, bands: as far as an outline that was cut is usually off. Training takes those pixels for
/// neither the object's nor the background's.
const SOFT: f32 = 0.5;
/// Weight of what the strokes in other photos say of space, for each band from the shape's outline: more than all others together.
const SAID: f32 = 4.0;
/// What a stroke in the photo itself says: more than any outline costs.
const STROKE: f32 = 20.0;
/// Cost of a pixel of outline where there is no edge, and the share of it on the sharpest edge.
const LENGTH: f32 = 6.0;
const LENGTH_ON_EDGE: f32 = 0.12;
/// Rounds of the cut, and cuts: the second knows the colours that the first found.
const ROUNDS: usize = 200;
const CUTS: usize = 2;
/// Added to both sides of a ratio of radiances: dark pixels have no say in a photo's exposure.
const DARK: f32 = 0.01;

/// A photo ready to be cut: the part of it around the object, and what that would show without it.
#[derive(Debug)]
pub(super) struct Photo {
    window: Window,
    /// The window at the resolution of the prediction.
    coarse: Window,
    /// Linear radiance of its samples; NaN where none was asked for.
    radiance: Vec<[f32; 3]>,
}

impl Photo {
    /// Around the object of `prior`, a mask of any resolution, with what `empty`, the environment without the object, shows there;
    /// `None` where the prior shows no outline. `camera` is the view's as it was corrected; all strokes are in the window.
    pub(super) fn new(
        (view, camera): (&View, &Camera),
        prior: &Mask,
        strokes: &[&Stroke],
        empty: &Environment,
    ) -> Option<Self> {
        let prior = Prior::new(view, prior)?;
        let window = prior.window(view, strokes);
        let coarse = window.coarser(MOST_RAYS);
        let bands = prior.bands(&coarse);
        // Far within the object nothing else could be there.
        let is_asked = |i: &usize| (-BESIDE..BESIDE).contains(&bands[*i]);
        let asked: Vec<usize> = (0..coarse.len()).filter(is_asked).collect();
        let places: Vec<Vec2> = asked.iter().map(|i| coarse.place(*i)).collect();
        let mut radiance = vec![[f32::NAN; 3]; coarse.len()];
        for (i, look) in asked.iter().zip(look(empty, camera, &places)) {
            radiance[*i] = look.radiance;
        }
        Some(Self {
            window,
            coarse,
            radiance,
        })
    }

    /// Whether a stroke lies in the part that can be cut.
    pub(super) fn has_all_of(&self, view: &View, stroke: &Stroke) -> bool {
        let [min, max] = stroke.bounds();
        let size = Vec2::new(view.camera.width as f32, view.camera.height as f32);
        let [start, end] = self.window.corners();
        start.cmple(min.max(Vec2::ZERO)).all() && end.cmpge(max.min(size)).all()
    }

    /// Where the photo shows the object, near where it is expected and as its strokes say: a mask of the photo's size.
    pub(super) fn cut(&self, view: &View, expected: &Expected, strokes: &[&Stroke]) -> Mask {
        let cut = Cut::new(self, view, expected, strokes);
        cut.map_or_else(|| nothing(view), |cut| cut.mask(view))
    }

    /// Display colours of the window's samples without the object, in the photo's exposure and white balance: those that fit it
    /// best beside the object. NaN where nothing is known.
    fn predicted(&self, colors: &[[f32; 3]], bands: &[f32]) -> Vec<[f32; 3]> {
        let sampled = |i: usize| self.coarse.sample(&self.radiance, self.window.place(i));
        let radiance: Vec<[f32; 3]> = (0..self.window.len()).map(sampled).collect();
        let gain: [f32; 3] = std::array::from_fn(|c| {
            let beside = (0..radiance.len()).filter(|i| is_beside(bands[*i]));
            let ratio =
                |i: usize| (linear_from_srgb(colors[i][c]) + DARK) / (radiance[i][c] + DARK);
            let ratios = beside.map(ratio).filter(|ratio| ratio.is_finite());
            middle_or(1.0, ratios.collect())
        });
        let shown = |radiance: &[f32; 3]| {
            std::array::from_fn(|c| srgb_from_linear((gain[c] * radiance[c]).clamp(0.0, 1.0)))
        };
        radiance.iter().map(shown).collect()
    }
}

/// A mask that shows none of the object.
pub(super) fn nothing(view: &View) -> Mask {
    Mask {
        width: view.camera.width,
        height: view.camera.height,
        coverage: vec![0; view.photo.n_pixels()],
    }
}

/// Where the object is expected in a photo.
struct Prior<'a> {
    mask: &'a Mask,
    outline: MaskOutline,
    /// Photo pixels a pixel of the mask.
    scale: f32,
    /// How far off its outline may be, photo pixels.
    band: f32,
}

impl<'a> Prior<'a> {
    fn new(view: &View, mask: &'a Mask) -> Option<Self> {
        let scale = view.camera.width as f32 / mask.width as f32;
        let n_object = (0..mask.coverage.len())
            .filter(|i| mask.is_object(*i))
            .count();
        let band = (BAND * (n_object as f32).sqrt() * scale).max(LEAST_BAND_PX);
        let outline = MaskOutline::new(mask, BESIDE * band / scale + 1.0)?;
        Some(Self {
            mask,
            outline,
            scale,
            band,
        })
    }

    /// The part of the photo that shows the object and what is beside it, and the strokes.
    fn window(&self, view: &View, strokes: &[&Stroke]) -> Window {
        let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for i in (0..self.mask.coverage.len()).filter(|i| self.mask.is_object(*i)) {
            let i = i as u32;
            let at = Vec2::new((i % self.mask.width) as f32, (i / self.mask.width) as f32);
            min = min.min(at * self.scale);
            max = max.max((at + 1.0) * self.scale);
        }
        let margin = BESIDE * self.band + 4.0;
        (min, max) = (min - margin, max + margin);
        for [start, end] in strokes.iter().map(|stroke| stroke.bounds()) {
            (min, max) = (min.min(start), max.max(end));
        }
        let size = Vec2::new(view.camera.width as f32, view.camera.height as f32);
        Window::over(
            min.floor().max(Vec2::ZERO),
            max.ceil().min(size),
            MOST_SAMPLES,
        )
    }

    /// Distances of a window's samples to the outline, in bands, positive on the object.
    fn bands(&self, window: &Window) -> Vec<f32> {
        let distance = |i| self.outline.distance_at(window.place(i) / self.scale);
        let bands = (0..window.len()).map(|i| distance(i) * self.scale / self.band);
        bands.collect()
    }
}

/// What is known of the samples of a window.
struct Cut<'a> {
    window: &'a Window,
    /// Display colours.
    colors: Vec<[f32; 3]>,
    /// Distances to the prior's outline in bands, positive on the object.
    bands: Vec<f32>,
    /// Costs of the object by the prior and the prediction.
    costs: Vec<f32>,
    /// Costs of outline.
    edges: Vec<f32>,
    /// Half the width of the mask's soft edge, photo pixels.
    soft: f32,
    /// Samples that a stroke covers, and whether they are the object's.
    strokes: Vec<(usize, bool)>,
}

impl<'a> Cut<'a> {
    fn new(
        photo: &'a Photo,
        view: &View,
        expected: &Expected,
        strokes: &[&Stroke],
    ) -> Option<Self> {
        let prior = Prior::new(view, &expected.outline)?;
        let window = &photo.window;
        let bands = prior.bands(window);
        let colors = window.colors(&view.photo);
        let mut costs = costs(&colors, &photo.predicted(&colors, &bands), &bands);
        let says = |mask: &Option<Mask>, i: usize| {
            let mask = mask.as_ref()?;
            let at = (window.place(i) / prior.scale).as_uvec2();
            let at = at.min(glam::UVec2::new(mask.width, mask.height) - 1);
            Some(mask.is_object((at.y * mask.width + at.x) as usize))
        };
        for (i, (cost, band)) in costs.iter_mut().zip(&bands).enumerate() {
            let is_removed = *band < 0.0 && says(&expected.removed, i) == Some(true);
            let is_added = *band > 0.0 && says(&expected.added, i) == Some(true);
            if is_removed || is_added {
                *cost -= SAID * band.clamp(-MOST_BANDS, MOST_BANDS);
            }
        }
        // A later stroke covers an earlier one.
        let stroke_at = |i| {
            let mut covering = strokes.iter().rev();
            let stroke = covering.find(|stroke| stroke.covers(window.place(i)))?;
            Some((i, stroke.adds))
        };
        let strokes: Vec<(usize, bool)> = if strokes.is_empty() {
            Vec::new()
        } else {
            (0..window.len()).filter_map(stroke_at).collect()
        };
        for (i, adds) in &strokes {
            costs[*i] = if *adds { -STROKE } else { STROKE };
        }
        let edges = edges(&colors, window.width, &bands);
        Some(Self {
            window,
            colors,
            bands,
            costs,
            edges,
            soft: SOFT * prior.band,
            strokes,
        })
    }

    fn mask(&self, view: &View) -> Mask {
        let mut share: Vec<f32> = self.bands.iter().map(|d| f32::from(*d > 0.0)).collect();
        for _ in 0..CUTS {
            let costs = self.with_colors(&share);
            segment(&mut share, self.window.width, &self.edges, &costs, ROUNDS);
        }
        tidy(&mut share, self.window.width, &self.bands, &self.strokes);
        for (i, adds) in &self.strokes {
            share[*i] = f32::from(*adds);
        }
        self.drawn(view, &share)
    }

    /// The costs with what the colours say that a cut found on the object and beside it.
    fn with_colors(&self, share: &[f32]) -> Vec<f32> {
        let samples = || self.colors.iter().zip(share).zip(&self.bands);
        let object = samples().filter(|((_, share), _)| **share > 0.5);
        let beside = samples().filter(|((_, share), band)| **share <= 0.5 && **band > -BESIDE);
        let object = Histogram::of(object.map(|((color, _), _)| *color));
        let beside = Histogram::of(beside.map(|((color, _), _)| *color));
        let cost = |(color, cost): (&[f32; 3], &f32)| {
            let odds = (beside.share(*color) / object.share(*color)).ln();
            cost + COLORS * odds.clamp(-MOST_COLORS, MOST_COLORS)
        };
        self.colors.iter().zip(&self.costs).map(cost).collect()
    }

    /// A mask of the photo's size.
    fn drawn(&self, view: &View, share: &[f32]) -> Mask {
        let (width, height) = (view.camera.width, view.camera.height);
        let share: Vec<[f32; 1]> = share.iter().map(|v| [*v]).collect();
        let [start, end] = self.window.corners();
        let coverage = (0..width * height).map(|i| {
            let at = Vec2::new((i % width) as f32, (i / width) as f32) + 0.5;
            let is_near = at.cmpge(start).all() && at.cmple(end).all();
            let [share] = if is_near {
                self.window.sample(&share, at)
            } else {
                [0.0]
            };
            (255.0 * share).round() as u8
        });
        let coverage = coverage.collect();
        let mask = Mask {
            width,
            height,
            coverage,
        };
        softened(mask, self.soft)
    }
}

/// With an edge of that half width, pixels, about the same outline.
fn softened(mut mask: Mask, half_width: f32) -> Mask {
    if let Some(outline) = MaskOutline::new(&mask, half_width + 1.0) {
        for (coverage, distance) in mask.coverage.iter_mut().zip(&outline.distance) {
            let share = (0.5 + 0.5 * distance / half_width).clamp(0.0, 1.0);
            *coverage = (255.0 * share).round() as u8;
        }
    }
    mask
}

/// Whether a place is safely beside the object and near it.
fn is_beside(band: f32) -> bool {
    (-BESIDE..-1.0).contains(&band)
}

/// What each sample costs on the object, by how far it is within the region and how unlike the prediction.
fn costs(colors: &[[f32; 3]], predicted: &[[f32; 3]], bands: &[f32]) -> Vec<f32> {
    let difference = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>();
    let pairs = colors.iter().zip(predicted);
    let differences: Vec<f32> = pairs.map(|(a, b)| difference(a, b)).collect();
    let is_known = |(difference, band): &(&f32, &f32)| is_beside(**band) && difference.is_finite();
    let beside = differences.iter().zip(bands).filter(is_known);
    let (sum, n) = beside.fold((0.0, 0.0), |(sum, n), (d, _)| (sum + d, n + 1.0));
    // The mean beside the object is the prediction's error (an exponential distribution).
    let error = (sum / f32::max(n, 1.0)).max(LEAST_ERROR);
    let cost = |(difference, band): (&f32, &f32)| {
        let odds = (UNKNOWN_DIFFERENCE / error).ln() - difference / error;
        // Where nothing was predicted, nothing is known.
        let odds = if odds.is_finite() { odds } else { 0.0 };
        PREDICTION * odds.clamp(-MOST_PREDICTION, MOST_PREDICTION)
            - REGION * band.clamp(-MOST_BANDS, MOST_BANDS)
    };
    differences.iter().zip(bands).map(cost).collect()
}

/// What a pixel of outline costs at each sample: less, the more the photo changes there.
fn edges(colors: &[[f32; 3]], width: usize, bands: &[f32]) -> Vec<f32> {
    let smooth = smoothed(colors, width);
    let n = smooth.len();
    let change = |i: usize, j: usize| {
        let square = |c: usize| (smooth[i][c] - smooth[j][c]).powi(2);
        (0..3).map(square).sum::<f32>()
    };
    let changes: Vec<f32> = (0..n)
        .map(|i| {
            let right = if (i + 1) % width == 0 {
                0.0
            } else {
                change(i, i + 1)
            };
            let below = if i + width < n {
                change(i, i + width)
            } else {
                0.0
            };
            (right + below).sqrt()
        })
        .collect();
    let near = changes
        .iter()
        .zip(bands)
        .filter(|(_, band)| band.abs() < 4.0);
    let (sum, n_near) = near.fold((0.0, 0.0), |(sum, n), (change, _)| (sum + change, n + 1.0));
    let usual = (sum / f32::max(n_near, 1.0)).max(1e-6);
    let cost = |change: &f32| LENGTH * ((-change / usual).exp() + LENGTH_ON_EDGE);
    changes.iter().map(cost).collect()
}

/// Gives up pieces of the object that lie mostly beside the prior, and holes that lie mostly within it: lines of the background
/// that the prediction has in the wrong place, and spots of the object that look like what is behind. Those that a stroke is in
/// stay.
fn tidy(share: &mut [f32], width: usize, bands: &[f32], strokes: &[(usize, bool)]) {
    let n = share.len();
    let mut is_drawn = vec![false; n];
    for (i, _) in strokes {
        is_drawn[*i] = true;
    }
    let is_object = |v: f32| v > 0.5;
    let mut is_taken = vec![false; n];
    for first in 0..n {
        if is_taken[first] {
            continue;
        }
        is_taken[first] = true;
        let kind = is_object(share[first]);
        let mut piece = vec![first];
        let mut next = 0;
        while let Some(&i) = piece.get(next) {
            next += 1;
            let beside = [
                (i % width > 0).then(|| i - 1),
                ((i + 1) % width > 0).then_some(i + 1),
                i.checked_sub(width),
                Some(i + width),
            ];
            for j in beside.into_iter().flatten().filter(|j| *j < n) {
                if !is_taken[j] && is_object(share[j]) == kind {
                    is_taken[j] = true;
                    piece.push(j);
                }
            }
        }
        let n_within = piece.iter().filter(|i| bands[**i] > 0.0).count();
        let is_wanted = piece.iter().any(|i| is_drawn[*i]);
        if (2 * n_within > piece.len()) != kind && !is_wanted {
            for i in piece {
                share[i] = f32::from(!kind);
            }
        }
    }
}

/// Colours blurred by 1, 2, 1 along both axes: about 0.7 samples.
fn smoothed(colors: &[[f32; 3]], width: usize) -> Vec<[f32; 3]> {
    let height = colors.len() / width;
    let blurred = |before: [f32; 3], color: [f32; 3], after: [f32; 3]| {
        std::array::from_fn(|c| mean_121(before[c], color[c], after[c]))
    };
    let across = with_neighbours(colors, (width, 1), blurred);
    with_neighbours(&across, (height, width), blurred)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specks_beside_the_object_go_and_holes_in_it_close() {
        const SIDE: usize = 40;
        let radius = |i: usize, x0: f32| {
            let [x, y] = [i % SIDE, i / SIDE].map(|v| v as f32 - 19.5);
            (x - x0).hypot(y)
        };
        let bands: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| 0.2 * (12.0 - radius(i, 0.0)))
            .collect();
        // A disc a little beside the expected one, with a hole, and a speck.
        let disc = |i: usize| radius(i, 2.0) < 12.0;
        let mut share: Vec<f32> = (0..SIDE * SIDE).map(|i| f32::from(disc(i))).collect();
        share[20 * SIDE + 20] = 0.0;
        share[2 * SIDE + 3] = 1.0;
        tidy(&mut share, SIDE, &bands, &[]);
        let is_disc = (0..SIDE * SIDE).all(|i| (share[i] > 0.5) == disc(i));
        assert!(is_disc, "the piece itself stays where it is");
    }

    #[test]
    fn a_soft_edge_keeps_the_outline() {
        const SIDE: u32 = 40;
        let is_in = |i: u32| (i % SIDE) as f32 + 0.5 < 20.0;
        let hard = Mask {
            width: SIDE,
            height: SIDE,
            coverage: (0..SIDE * SIDE).map(|i| 255 * u8::from(is_in(i))).collect(),
        };
        let soft = softened(hard.clone(), 3.0);
        let n = hard.coverage.len();
        assert!((0..n).all(|i| soft.is_object(i) == hard.is_object(i)));
        let row = &soft.coverage[..SIDE as usize];
        assert_eq!(
            (row[16], row[23]),
            (255, 0),
            "half a width further nothing is unsure"
        );
        assert!(row[17..23].is_sorted_by(|a, b| a > b), "{row:?}");
    }

    #[test]
    fn what_differs_from_the_prediction_costs_less_on_the_object() {
        let colors = vec![[0.5; 3]; 100];
        let mut predicted = vec![[0.52, 0.5, 0.5]; 100];
        predicted[50] = [0.9, 0.1, 0.5];
        predicted[60] = [f32::NAN; 3];
        // Beside the object but for three samples on its outline.
        let mut bands = vec![-3.0; 100];
        for i in [50, 55, 60] {
            bands[i] = 0.0;
        }
        let costs = costs(&colors, &predicted, &bands);
        assert!(costs[50] < -1.0, "unlike what is behind: {}", costs[50]);
        assert!(costs[55] > 1.0, "like what is behind: {}", costs[55]);
        assert_eq!(costs[60], 0.0, "nothing was predicted");
        assert!(costs[0] > costs[55], "the prior counts too");
    }
}
