//! Middle and scatter of numbers, some of which are off.

use glam::Vec3;

/// A normal distribution's standard deviation over the median distance from its median.
const STD_OVER_MAD: f32 = 1.4826;

/// The median of each coordinate.
///
/// # Panics
/// When there is no value.
pub(super) fn median(values: &[Vec3]) -> Vec3 {
    let of_axis = |axis: usize| {
        let mut values: Vec<f32> = values.iter().map(|v| v[axis]).collect();
        middle(&mut values)
    };
    Vec3::new(of_axis(0), of_axis(1), of_axis(2))
}

/// The median of numbers, which are put into another order.
///
/// # Panics
/// When there are none.
pub(super) fn middle(values: &mut [f32]) -> f32 {
    let half = values.len() / 2;
    *values.select_nth_unstable_by(half, f32::total_cmp).1
}

/// The same, or `none` where there are none.
pub(super) fn middle_or(none: f32, mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return none;
    }
    middle(&mut values)
}

/// Share of a sum of squares that is more than the errors' own, 0 to 1 (James and Stein 1961).
pub(super) fn share_beyond(found: f32, errors: f32) -> f32 {
    (1.0 - errors / found.max(f32::MIN_POSITIVE)).max(0.0)
}

/// Weight of an error in a least sum of squares that outliers do not bend (a Cauchy loss): 1 of none, a half of `scale`.
pub(super) fn cauchy_weight(error: f32, scale: f32) -> f32 {
    1.0 / (1.0 + (error / scale).powi(2))
}

/// Of each value with those before and after it along an axis of `n` values, `stride` apart; at the ends the value itself stands for
/// the one that is missing.
pub(super) fn with_neighbours<T: Copy>(
    values: &[T],
    (n, stride): (usize, usize),
    of: impl Fn(T, T, T) -> T,
) -> Vec<T> {
    let at_index = |i: usize| {
        let at = i / stride % n;
        let before = values[if at > 0 { i - stride } else { i }];
        let after = values[if at + 1 < n { i + stride } else { i }];
        of(before, values[i], after)
    };
    (0..values.len()).map(at_index).collect()
}

/// The mean of three values that weighs the middle one twice: a blur of 0.7 values' width.
pub(super) fn mean_121(before: f32, value: f32, after: f32) -> f32 {
    0.25 * (before + 2.0 * value + after)
}

/// The standard deviation of the normal distribution that `values` are of, but for fewer than half of them; 0 of none.
pub(super) fn scatter(mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let median = middle(&mut values);
    for value in &mut values {
        *value = (*value - median).abs();
    }
    STD_OVER_MAD * middle(&mut values)
}
