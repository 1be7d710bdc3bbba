//! The shortest outline that agrees with what each pixel says: segmentation by weighted total variation.

use crate::neif::kernels::{Isa, dispatch, fma};

/// Steps of the dual and the primal variable: their product times the gradient's squared norm, 8, is 1.
const DUAL_STEP: f32 = 0.5;
const PRIMAL_STEP: f32 = 0.25;

dispatch! {
    /// Minimises `Σ edge |∇u| + Σ cost u` over `u` in `[0, 1]`, in place from the `u` given: where `cost` is negative `u` wants to
    /// be 1, and its outline runs where `edge` (not negative) is small. Nearly all values come out as 0 or 1, whatever it began
    /// with.
    ///
    /// The primal-dual algorithm of Chambolle and Pock 2011 (section 6.3) for the convex form of Chan, Esedoglu and Nikolova 2006
    /// with the weights of Bresson et al. 2007. All slices are `[height][width]`.
    pub(super) fn segment(u: &mut [f32], width: usize, edge: &[f32], cost: &[f32], n_rounds: usize) = segment_body
}

#[inline(always)]
fn segment_body<I: Isa>(u: &mut [f32], width: usize, edge: &[f32], cost: &[f32], n_rounds: usize) {
    let n = u.len();
    let mut leading = u.to_vec();
    let (mut across, mut down) = (vec![0.0_f32; n], vec![0.0_f32; n]);
    let zeros = vec![0.0_f32; width];
    for _ in 0..n_rounds {
        for start in (0..n).step_by(width) {
            let row = start..start + width;
            let here = &leading[row.clone()];
            let below = leading
                .get(start + width..start + 2 * width)
                .unwrap_or(here);
            ascend::<I>(
                (&mut across[row.clone()], &mut down[row.clone()]),
                (here, below),
                &edge[row],
            );
        }
        for start in (0..n).step_by(width) {
            let row = start..start + width;
            let above = if start == 0 {
                &zeros
            } else {
                &down[start - width..start]
            };
            descend::<I>(
                (&mut u[row.clone()], &mut leading[row.clone()]),
                (&across[row.clone()], &down[row.clone()], above),
                &cost[row],
            );
        }
    }
}

/// A step of the dual variable in a row: towards the gradient, no longer than `edge`. It stays 0 across the picture's border.
#[inline(always)]
fn ascend<I: Isa>(
    (across, down): (&mut [f32], &mut [f32]),
    (here, below): (&[f32], &[f32]),
    edge: &[f32],
) {
    let last = here.len() - 1;
    let step = |across: &mut f32, down: &mut f32, [here, right, below]: [f32; 3], edge: f32| {
        let px = fma::<I>(DUAL_STEP, right - here, *across);
        let py = fma::<I>(DUAL_STEP, below - here, *down);
        let square = fma::<I>(px, px, py * py);
        let shrink = (edge / square.max(1e-24).sqrt()).min(1.0);
        *across = px * shrink;
        *down = py * shrink;
    };
    // Slices of one length, so that the loop has no checks in it.
    let (left, right, under) = (&here[..last], &here[1..], &below[..last]);
    let (a, d, e) = (&mut across[..last], &mut down[..last], &edge[..last]);
    for x in 0..last {
        step(&mut a[x], &mut d[x], [left[x], right[x], under[x]], e[x]);
    }
    let at_end = [here[last], here[last], below[last]];
    step(&mut across[last], &mut down[last], at_end, edge[last]);
}

/// A step of `u` in a row, and the extrapolation that leads it.
#[inline(always)]
fn descend<I: Isa>(
    (u, leading): (&mut [f32], &mut [f32]),
    (across, down, above): (&[f32], &[f32], &[f32]),
    cost: &[f32],
) {
    let step = |u: &mut f32, leading: &mut f32, divergence: f32, cost: f32| {
        let next = fma::<I>(PRIMAL_STEP, divergence - cost, *u).clamp(0.0, 1.0);
        *leading = 2.0 * next - *u;
        *u = next;
    };
    let first = across[0] + down[0] - above[0];
    step(&mut u[0], &mut leading[0], first, cost[0]);
    let n = u.len() - 1;
    let (u, leading, before) = (&mut u[1..], &mut leading[1..], &across[..n]);
    let (across, down, above, cost) = (&across[1..], &down[1..], &above[1..], &cost[1..]);
    let (down, above, cost, across) = (&down[..n], &above[..n], &cost[..n], &across[..n]);
    let leading = &mut leading[..n];
    for x in 0..n {
        let divergence = across[x] - before[x] + down[x] - above[x];
        step(&mut u[x], &mut leading[x], divergence, cost[x]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 48;

    /// Distance of a pixel from the middle.
    fn radius(i: usize) -> f32 {
        let [x, y] = [i % SIDE, i / SIDE].map(|v| v as f32 - 23.5);
        x.hypot(y)
    }

    fn share_right(u: &[f32], truth: impl Fn(usize) -> bool) -> f32 {
        let right = (0..u.len()).filter(|i| (u[*i] > 0.5) == truth(*i));
        right.count() as f32 / u.len() as f32
    }

    #[test]
    fn a_disc_is_found_in_noise_from_any_start() {
        let noise = |i: usize| ((i as f32 * 12.9898).sin() * 43758.547).fract().abs() * 3.0 - 1.5;
        let cost: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| noise(i) + if radius(i) < 15.0 { -0.5 } else { 0.5 })
            .collect();
        let edge = vec![3.0; SIDE * SIDE];
        for start in [0.0, 1.0] {
            let mut u = vec![start; SIDE * SIDE];
            segment(&mut u, SIDE, &edge, &cost, 300);
            // Noise moves the outline by a pixel here and there.
            let is_sure = |i: &usize| (radius(*i) - 15.0).abs() > 1.0;
            let wrong = (0..u.len())
                .filter(is_sure)
                .filter(|i| (u[*i] > 0.5) != (radius(*i) < 15.0));
            assert_eq!(wrong.count(), 0);
        }
    }

    #[test]
    fn the_outline_runs_along_the_edge_and_what_says_nothing_follows() {
        // Only a dot in the middle and the border say anything; the picture's edge is a circle of radius 15.
        let cost = |i: usize| match radius(i) {
            r if r < 4.0 => -2.0,
            r if r > 22.0 => 2.0,
            _ => 0.0,
        };
        let edge = |i: usize| {
            if (radius(i) - 15.0).abs() < 1.0 {
                0.05
            } else {
                1.0
            }
        };
        let of_all = |of: &dyn Fn(usize) -> f32| (0..SIDE * SIDE).map(of).collect::<Vec<_>>();
        let mut u = vec![0.5; SIDE * SIDE];
        segment(&mut u, SIDE, &of_all(&edge), &of_all(&cost), 2000);
        let right = share_right(&u, |i| radius(i) < 15.0);
        assert!(right > 0.97, "{right}");
    }
}
