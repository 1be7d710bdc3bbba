//! What this machine can do at most, measured: the denominator of the kernels' efficiency.

use std::hint::black_box;
use std::time::Instant;

use super::{Isa, dispatch, fma};

/// Independent sums, twelve registers of eight lanes: enough to hide the latency of two fused units.
const SUMS: usize = 12 * 8;
/// The same of sixteen lanes.
const WIDE_SUMS: usize = 12 * 16;
/// Fused steps in one call.
const STEPS: usize = 1 << 14;

dispatch! {
    /// Operations done.
    fn fused_steps(x: f32) -> usize = fused_body
}

#[inline(always)]
fn fused_body<I: Isa>(x: f32) -> usize {
    if I::WIDE {
        fused_block::<I, WIDE_SUMS>(x)
    } else {
        fused_block::<I, SUMS>(x)
    }
}

#[inline(always)]
fn fused_block<I: Isa, const N: usize>(x: f32) -> usize {
    let mut sums = [0.5; N];
    for _ in 0..STEPS {
        for sum in &mut sums {
            *sum = fma::<I>(*sum, x, 1e-7);
        }
    }
    black_box(sums);
    2 * STEPS * N
}

/// Multiply-adds in registers of one thread, in GFLOP/s (two operations each): the best of ten tries.
pub fn gflops() -> f64 {
    let tries = (0..10).map(|_| {
        let start = Instant::now();
        let operations: usize = (0..16).map(|_| fused_steps(black_box(0.999))).sum();
        operations as f64 / start.elapsed().as_secs_f64() * 1e-9
    });
    tries.fold(0.0, f64::max)
}

/// Sequential reading of one thread far beyond the caches, in GB/s: the best of three tries.
pub fn read_gbytes_per_sec() -> f64 {
    let data = vec![1_u64; 1 << 24];
    let mut best = f64::INFINITY;
    for _ in 0..3 {
        let start = Instant::now();
        let sum = data.iter().fold(0_u64, |sum, v| sum.wrapping_add(*v));
        black_box(sum);
        best = best.min(start.elapsed().as_secs_f64());
    }
    (data.len() * 8) as f64 / best * 1e-9
}

#[cfg(test)]
mod tests {
    #[test]
    fn peaks_are_plausible() {
        let (flops, bytes) = (super::gflops(), super::read_gbytes_per_sec());
        assert!((0.5..2000.0).contains(&flops), "{flops} GFLOP/s");
        assert!((0.2..2000.0).contains(&bytes), "{bytes} GB/s");
    }
}
