//! How much brighter photos are than one another, from points whose depth is known.

use std::ops::Range;

use glam::Vec3;

use crate::train::photos::relative_exposures::{pairs_of, relative_log_gains};
use crate::train::sweep::{PhotoDepths, SmallPhoto};

/// Most points of a photo that are looked for in another.
const MOST_POINTS: usize = 1000;
/// Linear values that are neither noise nor clipped.
const USABLE: Range<f32> = 0.004..0.85;
/// Pairs that must constrain each photo.
const LEAST_PAIRS: usize = 3;

/// The logarithm of each photo's gain a colour, of mean 0; `None` where some photo cannot be compared with enough others.
pub(super) fn log_gains(photos: &[SmallPhoto], depths: &[PhotoDepths]) -> Option<Vec<Vec3>> {
    let n = photos.len();
    let points: Vec<Vec<(usize, Vec3)>> = depths.iter().map(points_of).collect();
    let pairs = pairs_of(n, |[a, b]| {
        let ratios =
            |a: usize, b: usize| log_ratios((&photos[a], &points[a]), (&photos[b], &depths[b]));
        let back = ratios(b, a).into_iter().map(|ratio| -ratio);
        ratios(a, b).into_iter().chain(back).collect()
    });
    let mut n_pairs = vec![0; n];
    for photo in pairs.iter().flat_map(|pair| pair.photos) {
        n_pairs[photo] += 1;
    }
    let are_all_constrained = n_pairs.iter().all(|n| *n >= LEAST_PAIRS);
    are_all_constrained.then(|| relative_log_gains(n, &pairs))
}

/// Points that a photo shows, world, with their pixels.
fn points_of(depths: &PhotoDepths) -> Vec<(usize, Vec3)> {
    let n_pixels = depths.nearness.len();
    let known = (0..n_pixels).filter_map(|pixel| Some((pixel, depths.point(pixel)?)));
    let known: Vec<_> = known.collect();
    let stride = known.len().div_ceil(MOST_POINTS).max(1);
    known.into_iter().step_by(stride).collect()
}

/// The logarithms of a photo's colours over another's, at those of its points that both show.
fn log_ratios(
    (photo, points): (&SmallPhoto, &[(usize, Vec3)]),
    (other, depths): (&SmallPhoto, &PhotoDepths),
) -> Vec<Vec3> {
    let other_looks = depths.looks();
    let ratio = |(pixel, point): &(usize, Vec3)| {
        let there = other_looks.pixel_of(*point)?;
        Some(log_color(photo.colors[*pixel])? - log_color(other.colors[there])?)
    };
    points.iter().filter_map(ratio).collect()
}

/// The logarithm of a linear colour; `None` where it is noise or clipped.
fn log_color(linear: Vec3) -> Option<Vec3> {
    let is_usable = linear.to_array().iter().all(|v| USABLE.contains(v));
    is_usable.then(|| linear.map(f32::ln))
}
