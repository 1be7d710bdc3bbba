//! How well the gradient of a whole step agrees with finite differences of its loss.

use std::ops::Range;

/// Cosine, and ratio of the lengths, of a gradient's entries and the slopes of the loss there: of those in `range` every
/// `every`-th, from the largest on, `n` in all. `loss(i, by)` is the loss with the `i`-th parameter shifted, by up to `h`.
pub(super) fn agreement(
    gradient: &[f32],
    range: Range<usize>,
    (every, n): (usize, usize),
    h: f32,
    mut loss: impl FnMut(usize, f32) -> f64,
) -> (f64, f64) {
    let mut order: Vec<usize> = range.collect();
    order.sort_by(|&a, &b| gradient[b].abs().total_cmp(&gradient[a].abs()));
    let (mut dot, mut analytic2, mut numeric2) = (0.0, 0.0, 0.0);
    for i in order.into_iter().step_by(every).take(n) {
        let analytic = f64::from(gradient[i]);
        let numeric = (loss(i, h) - loss(i, -h)) / f64::from(2.0 * h);
        dot += analytic * numeric;
        analytic2 += analytic * analytic;
        numeric2 += numeric * numeric;
    }
    let cosine = dot / (analytic2 * numeric2).sqrt();
    (cosine, (analytic2 / numeric2).sqrt())
}
