//! A field under training, with all that its updates need.

use super::adam::Adam;

/// A field under training: its moments, gradient and transposed weights.
#[derive(Debug)]
pub(in crate::train) struct Learned<F, T> {
    pub(in crate::train) value: F,
    pub(in crate::train) adam: Adam,
    /// Zero between steps: [`Adam::update`] clears it.
    pub(in crate::train) gradient: Vec<f32>,
    pub(in crate::train) transposed: T,
}

impl<F, T: Default> Learned<F, T> {
    /// With zero moments; `n_params(&value)` is how many parameters it has.
    pub(in crate::train) fn new(value: F, n_params: impl Fn(&F) -> usize) -> Self {
        let n = n_params(&value);
        Self {
            value,
            adam: Adam::new(n),
            gradient: vec![0.0; n],
            transposed: T::default(),
        }
    }
}

/// Adds the parts to the total, one after the other: floats depend on the order.
pub(in crate::train) fn sum_in_order<'a>(
    total: &mut [f32],
    parts: impl Iterator<Item = &'a [f32]>,
) {
    for part in parts {
        for (sum, value) in total.iter_mut().zip(part) {
            *sum += value;
        }
    }
}
