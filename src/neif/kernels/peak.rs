//! What this machine can do at most, measured: the denominator of the kernels' efficiency.

use std::hint::black_box;
use std::time::Instant;

use super::{dispatch, fma};

/// Independent sums: enough to hide the latency of two fused units of eight lanes.
const SUMS: usize = 12 * 8;
/// Fused steps in one call.
const STEPS: usize = 1 << 14;

dispatch! {
    fn fused_steps(x: f32, sums: &mut [f32; SUMS]) = fused_body
}

#[inline(always)]
fn fused_body<const FMA: bool>(x: f32, sums: &mut [f32; SUMS]) {
    let mut local = *sums;
    for _ in 0..STEPS {
        for sum in &mut local {
            *sum = fma::<FMA>(*sum, x, 1e-7);
        }
    }
    *sums = local;
}

/// Multiply-adds in registers of one thread, in GFLOP/s (two operations each): the best of ten tries.
pub fn gflops() -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..10 {
        let mut sums = [0.5; SUMS];
        let start = Instant::now();
        for _ in 0..16 {
            fused_steps(black_box(0.999), &mut sums);
        }
        best = best.min(start.elapsed().as_secs_f64());
        black_box(sums);
    }
    (16 * STEPS * SUMS * 2) as f64 / best * 1e-9
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
