//! How a step is cut and its gradients are put together again: always into the same chunks, whichever thread takes them, and
//! summed in order, so that the result does not depend on the number of threads.

use std::ops::Range;

/// The share of the `index`-th of `n_chunks` chunks in `n` slots.
pub(in crate::train) fn share(n: usize, index: usize, n_chunks: usize) -> Range<usize> {
    n * index / n_chunks..n * (index + 1) / n_chunks
}

/// First slot of the random numbers with which the `index`-th chunk places samples: beyond those of the pixels, and a million
/// rays apart.
pub(in crate::train) fn jitter_slot(index: usize) -> u64 {
    (1 << 40) + ((index as u64) << 20)
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
