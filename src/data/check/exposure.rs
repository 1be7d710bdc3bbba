//! Was the exposure the same in all photos? Determined from what the camera noted, else from the pictures.
//!
//! Photos that look in nearly the same direction show nearly the same background: where one is brighter than all of
//! its neighbours, it is exposure; parallax goes either way.

use glam::Vec3;

use super::coverage::shows_object;
use super::sharpness::median;
use super::thumb::Thumb;
use crate::data::{Dataset, Problem, Severity};

/// Cosine of the largest angle between neighbours, 25 degrees.
const NEIGHBOUR_COSINE: f32 = 0.906;
/// Fewest pixels that both photos must show of the background.
const MIN_SHARED: usize = 100;
/// Fewest neighbours that a photo is compared with.
const MIN_NEIGHBOURS: usize = 3;
/// Fewest photos with so many.
const MIN_PHOTOS: usize = 8;
/// Jitter, stops, that parallax alone may bring about: up to 0.3 in captures of fixed exposure.
const FAIR_EV: f32 = 0.4;
/// Spread of noted exposures, stops from least to most, that is rounding.
const NOTED_FAIR_EV: f32 = 0.1;

/// How the exposure varies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Exposures {
    /// From the shortest to the longest that the cameras noted (EXIF), stops.
    pub(super) noted_range_ev: Option<f32>,
    /// How much photos differ from their neighbours, stops.
    pub(super) seen_jitter_ev: Option<f32>,
}

/// Measures the exposures of the training photos. Cameras that stand anywhere in a room, and look at no `center`, see its
/// walls from everywhere: brightness says nothing then.
pub(super) fn measure(dataset: &Dataset, thumbs: &[Thumb], center: Vec3) -> Exposures {
    let comparable = if shows_object(dataset, center) {
        thumbs
    } else {
        &[]
    };
    let noted = dataset.origin.noted_exposure_ev;
    Exposures {
        noted_range_ev: noted.map(|[least, most]| most - least),
        seen_jitter_ev: jitter(comparable.len(), &neighbours(comparable)),
    }
}

impl Exposures {
    /// What is wrong with them, if anything is.
    pub(super) fn problem(&self) -> Option<Problem> {
        const ADVICE: &str = "one light is learned for all photos: training finds what each photo's exposure and white balance are; \
             fixed by the camera they are surer";
        let noted = self.noted_range_ev.filter(|range| *range > NOTED_FAIR_EV);
        let seen = self.seen_jitter_ev.filter(|seen| *seen > FAIR_EV);
        let what = match (noted, seen) {
            (Some(range), _) => format!(
                "the camera changed its exposure between photos, by up to {range:.1} stops (EXIF)"
            ),
            (None, Some(seen)) => format!(
                "the exposure changes from photo to photo, by {seen:.2} stops (standard deviation)"
            ),
            (None, None) => return None,
        };
        Some(Problem::new(Severity::Warning, what, ADVICE))
    }
}

/// Two photos of the same background and by how many stops the first is brighter.
#[derive(Clone, Copy, Debug)]
struct Pair {
    first: usize,
    second: usize,
    stops: f32,
}

fn neighbours(thumbs: &[Thumb]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for first in 0..thumbs.len() {
        let looks = |i: usize| thumbs[i].camera.forward();
        let mut near: Vec<(f32, usize)> = (0..thumbs.len())
            .filter(|other| *other != first)
            .map(|other| (looks(first).dot(looks(other)), other))
            .filter(|(cosine, _)| *cosine > NEIGHBOUR_COSINE)
            .collect();
        // The nearest ones show most of the same.
        near.sort_by(|a, b| b.0.total_cmp(&a.0));
        near.truncate(6);
        for (_, second) in near {
            if let Some(stops) = difference(&thumbs[first], &thumbs[second]) {
                pairs.push(Pair {
                    first,
                    second,
                    stops,
                });
            }
        }
    }
    pairs
}

/// By how many stops the first is brighter, in the mean over what both see far away.
fn difference(first: &Thumb, second: &Thumb) -> Option<f32> {
    /// Below this a pixel is noise, above that it clips.
    const USABLE: std::ops::Range<f32> = 0.005..0.9;
    let (mut sum, mut n) = (0.0, 0);
    let camera = &first.camera;
    let reach = 1e3 * (1.0 + camera.position().distance(second.camera.position()));
    for (i, value) in first.background.iter().enumerate() {
        let Some(value) = value.filter(|v| USABLE.contains(v)) else {
            continue;
        };
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let direction = camera.ray(x as f32 + 0.5, y as f32 + 0.5).direction;
        let point = second.camera.position() + reach * direction;
        let other = second
            .camera
            .project(point)
            .and_then(|p| second.at(p.x, p.y))
            .filter(|v| USABLE.contains(v));
        if let Some(other) = other {
            sum += (value / other).log2();
            n += 1;
        }
    }
    (n >= MIN_SHARED).then(|| sum / n as f32)
}

/// How much photos differ from their neighbours, stops: the standard deviation that the median of the differences has in
/// a normal distribution. `None` where most photos have no neighbour.
///
/// A photo that is brighter than those on all sides of it was exposed longer. Exposure that drifts evenly along the way
/// cannot be distinguished from a background that comes nearer.
fn jitter(n: usize, pairs: &[Pair]) -> Option<f32> {
    const DEVIATION_OF_MEDIAN: f32 = 1.48;
    let mut around: Vec<Vec<f32>> = vec![Vec::new(); n];
    for pair in pairs {
        around[pair.first].push(pair.stops);
        around[pair.second].push(-pair.stops);
    }
    let apart: Vec<f32> = around
        .into_iter()
        .filter(|stops| stops.len() >= MIN_NEIGHBOURS)
        .map(|stops| median(stops).abs())
        .collect();
    let enough = apart.len() >= MIN_PHOTOS && 2 * apart.len() >= n;
    enough.then(|| DEVIATION_OF_MEDIAN * median(apart))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_that_jump_differ_from_those_that_drift() {
        let pairs = |gain: &dyn Fn(usize) -> f32| -> Vec<Pair> {
            (0..20)
                .flat_map(|i| [1, 2, 3].map(|step| (i, i + step)))
                .filter(|(_, second)| *second < 20)
                .map(|(first, second)| Pair {
                    first,
                    second,
                    stops: gain(first) - gain(second),
                })
                .collect()
        };
        let jumps = jitter(20, &pairs(&|i| 0.4 * ((i * 7 % 5) as f32 - 2.0))).unwrap();
        assert!(jumps > 0.3, "{jumps}");
        let drift = jitter(20, &pairs(&|i| 0.05 * i as f32)).unwrap();
        assert!(drift < 0.1, "{drift}");
        assert_eq!(jitter(3, &[]), None, "no pairs");
    }
}
