//! Where the two passes of a ray sample: stratified, then by the inverse CDF of what the first pass found.
//!
//! Distances are even in `s(t) = t/2` up to 1 and `1 - 1/(2t)` beyond (field units; the paper names no bounds), as
//! mip-NeRF 360's code spaces unbounded scenes. All intervals of a pass are shifted together.

/// Nearest distance, field units: a lobe must not find its light on the surface it starts from.
const NEAR: f32 = 0.006;
/// Farthest distance, field units.
const FAR: f32 = 64.0;

fn distance(s: f32) -> f32 {
    if s < 0.5 { 2.0 * s } else { 0.5 / (1.0 - s) }
}

fn s_of(distance: f32) -> f32 {
    if distance < 1.0 {
        0.5 * distance
    } else {
        1.0 - 0.5 / distance
    }
}

/// Writes the edges of the first pass, `[n + 1]` increasing distances; `shift` in `[-0.5, 0.5]` intervals.
pub fn coarse_edges(shift: f32, edges: &mut [f32]) {
    let n = edges.len() - 1;
    let (near, far) = (s_of(NEAR), s_of(FAR));
    for (i, edge) in edges.iter_mut().enumerate() {
        let u = if i == 0 || i == n {
            i as f32
        } else {
            i as f32 + shift
        };
        *edge = distance(near + (far - near) * u / n as f32);
    }
}

/// Writes the edges of the second pass from the first one's edges and weights (`[n]`).
///
/// Weights are blurred as in mip-NeRF's `resample_along_rays` (mean of the larger one of each two neighbours) and
/// mixed with an even density of total `uniform_share`.
pub fn fine_edges(
    coarse: &[f32],
    weights: &[f32],
    uniform_share: f32,
    shift: f32,
    edges: &mut [f32],
) {
    let n = weights.len();
    assert_eq!(coarse.len(), n + 1, "fine_edges: one weight an interval");
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    let blurred = |i: usize| {
        let (before, after) = (weights[i.saturating_sub(1)], weights[(i + 1).min(n - 1)]);
        0.5 * (larger(before, weights[i]) + larger(weights[i], after))
    };
    let total: f32 = (0..n).map(blurred).sum();
    // A ray through nothing says nothing: sample it evenly.
    let share = if total > 1e-6 { uniform_share } else { 1.0 };
    let factor = (1.0 - share) / total.max(1e-6);
    let probability = |i: usize| factor * blurred(i) + share / n as f32;
    let n_out = edges.len() - 1;
    edges[0] = coarse[0];
    edges[n_out] = coarse[n];
    let (mut interval, mut before, mut mass) = (0, 0.0, probability(0));
    for (j, edge) in edges[..n_out].iter_mut().enumerate().skip(1) {
        let u = (j as f32 + shift) / n_out as f32;
        while before + mass < u && interval + 1 < n {
            before += mass;
            interval += 1;
            mass = probability(interval);
        }
        // Rounding at the last interval may leave a little more than it has.
        let inside = ((u - before) / mass).clamp(0.0, 1.0);
        let (a, b) = (s_of(coarse[interval]), s_of(coarse[interval + 1]));
        *edge = distance(a + inside * (b - a));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_increasing(edges: &[f32]) -> bool {
        edges.windows(2).all(|pair| pair[0] <= pair[1])
    }

    #[test]
    fn first_pass_covers_the_ray_whatever_the_shift() {
        for shift in [-0.5, 0.0, 0.5] {
            let mut edges = [0.0; 33];
            coarse_edges(shift, &mut edges);
            assert!(is_increasing(&edges), "{edges:?}");
            assert!((edges[0] - NEAR).abs() < 1e-6 && (edges[32] / FAR - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn second_pass_goes_where_the_weight_is() {
        let mut coarse = [0.0; 33];
        coarse_edges(0.0, &mut coarse);
        let mut weights = [0.0; 32];
        weights[10] = 0.9;
        let mut fine = [0.0; 65];
        for shift in [-0.5, 0.0, 0.5] {
            fine_edges(&coarse, &weights, 0.25, shift, &mut fine);
            assert!(is_increasing(&fine), "{fine:?}");
            let near = fine
                .iter()
                .filter(|t| (coarse[9]..=coarse[12]).contains(t))
                .count();
            // Three quarters, and the three intervals' part of the even share.
            assert!((47..=53).contains(&near), "{near} of 64 at the weight");
        }
    }

    #[test]
    fn a_ray_through_nothing_is_sampled_evenly() {
        let mut coarse = [0.0; 17];
        coarse_edges(0.0, &mut coarse);
        let mut fine = [0.0; 17];
        fine_edges(&coarse, &[0.0; 16], 0.1, 0.0, &mut fine);
        for (a, b) in coarse.iter().zip(fine) {
            assert!((a - b).abs() < 1e-3 * a, "{a} against {b}");
        }
    }

    #[test]
    fn weights_that_are_not_finite_end_the_search() {
        let mut coarse = [0.0; 9];
        coarse_edges(0.0, &mut coarse);
        fine_edges(&coarse, &[f32::NAN; 8], 0.1, 0.0, &mut [0.0; 9]);
    }
}
