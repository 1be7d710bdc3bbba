//! How much brighter photos are than one another, from points that several of them show.

use glam::Vec3;
use rayon::prelude::*;

use crate::train::statistics::median;

/// Fewest points that two photos must both show.
const LEAST_SHARED: usize = 50;
/// Most photos that one photo is compared with.
const MOST_PARTNERS: usize = 64;
/// Rounds of reweighting, and of relaxation in each.
const ROUNDS: usize = 10;
const SWEEPS: usize = 50;
/// Error of a pair, logarithm, up to which its pull grows with it.
const NOISE: f32 = 0.03;
/// Pull towards 0, in pairs: photos that none is compared with have the mean exposure.
const PULL: f32 = 1e-3;

/// Two photos, and by how much the first is brighter: a logarithm a colour.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct Pair {
    pub(in crate::train) photos: [usize; 2],
    log_ratio: Vec3,
}

impl Pair {
    /// From the logarithms of the ratios of their colours at points that both show; `None` where these are too few.
    fn of(photos: [usize; 2], log_ratios: &[Vec3]) -> Option<Self> {
        (log_ratios.len() >= LEAST_SHARED).then(|| Self {
            photos,
            log_ratio: median(log_ratios),
        })
    }
}

/// Pairs of photos among `n`, each with some others and in the order of `compare`, for which that gives enough ratios.
pub(in crate::train) fn pairs_of(
    n: usize,
    compare: impl Fn([usize; 2]) -> Vec<Vec3> + Sync,
) -> Vec<Pair> {
    let stride = n.div_ceil(MOST_PARTNERS).max(1);
    (0..n)
        .into_par_iter()
        .flat_map_iter(|a| (a + 1..n).step_by(stride).map(move |b| [a, b]))
        .filter_map(|photos| Pair::of(photos, &compare(photos)))
        .collect()
}

/// Pairs of photos from the logarithms of each photo's colours at the same points, where it shows them.
pub(in crate::train) fn pairs_at_points(seen: &[Vec<Option<Vec3>>]) -> Vec<Pair> {
    pairs_of(seen.len(), |[a, b]| {
        let both = seen[a].iter().zip(&seen[b]);
        both.filter_map(|(a, b)| Some((*a)? - (*b)?)).collect()
    })
}

/// The logarithm of each of `n` photos' gains a colour, of mean 0, that explain the pairs with about the least sum of
/// absolute errors, by reweighted least squares.
pub(in crate::train) fn relative_log_gains(n: usize, pairs: &[Pair]) -> Vec<Vec3> {
    let mut gains = vec![Vec3::ZERO; n];
    let mut around: Vec<Vec<(usize, Vec3)>> = vec![Vec::new(); n];
    for pair in pairs {
        let [a, b] = pair.photos;
        around[a].push((b, pair.log_ratio));
        around[b].push((a, -pair.log_ratio));
    }
    for _ in 0..ROUNDS {
        let weight = |i: usize, (j, ratio): &(usize, Vec3)| {
            let error = (gains[i] - gains[*j] - *ratio).abs();
            NOISE / error.max(Vec3::splat(NOISE))
        };
        let of_photo = |(i, around): (usize, &Vec<(usize, Vec3)>)| -> Vec<Vec3> {
            around.iter().map(|pair| weight(i, pair)).collect()
        };
        let weights: Vec<Vec<Vec3>> = around.iter().enumerate().map(of_photo).collect();
        for _ in 0..SWEEPS {
            for i in 0..n {
                let (mut sum, mut total) = (Vec3::ZERO, Vec3::splat(PULL));
                for ((j, ratio), weight) in around[i].iter().zip(&weights[i]) {
                    sum += *weight * (gains[*j] + *ratio);
                    total += *weight;
                }
                gains[i] = sum / total;
            }
        }
    }
    let mean = gains.iter().sum::<Vec3>() / n.max(1) as f32;
    for gain in &mut gains {
        *gain -= mean;
    }
    gains
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_found_through_outliers_and_in_chains() {
        let truth = |photo: usize| Vec3::new(0.3, -0.1, 0.2) * (photo as f32 - 5.5);
        // Each photo shows a window of the points; a fifth of what it shows is something else.
        let color = |photo: usize, point: usize| {
            let is_other = (photo * 7 + point * 13) % 10 < 2;
            let hidden = if is_other { 1.0 } else { 0.0 };
            let own = Vec3::splat((point as f32 * 0.37).sin());
            own + truth(photo) + hidden * Vec3::splat((photo as f32 * 1.7).cos())
        };
        let seen: Vec<Vec<Option<Vec3>>> = (0..12)
            .map(|photo| {
                let window = 40 * photo..40 * photo + 200;
                let at = |point| window.contains(&point).then(|| color(photo, point));
                (0..700).map(at).collect()
            })
            .collect();
        let found = relative_log_gains(12, &pairs_at_points(&seen));
        for (photo, found) in found.iter().enumerate() {
            let apart = (*found - truth(photo)).abs().max_element();
            assert!(apart < 0.1, "photo {photo}: {found}, not {}", truth(photo));
        }
    }

    #[test]
    fn photos_that_share_nothing_are_alike() {
        assert!(Pair::of([0, 1], &[Vec3::ONE; LEAST_SHARED - 1]).is_none());
        assert_eq!(relative_log_gains(2, &[]), [Vec3::ZERO; 2]);
    }
}
