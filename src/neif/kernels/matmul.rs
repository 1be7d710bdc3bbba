//! Small dense products of the tiny networks, sample-major, without horizontal reductions.
//!
//! Every product is "broadcast one scalar, multiply a row": the forward pass uses `w`, the input gradient a
//! transposed copy of `w`, the weight gradient is an outer product summed over the samples. Rows of the
//! right-hand matrix are [`LANES`] wide, so every width is padded to a multiple of it.

use super::{dispatch, fma};

/// Width of a column block; layer widths are multiples of it.
pub const LANES: usize = 16;
/// Samples (or weight rows) a register block holds: 6 x 16 floats are 12 of the 16 AVX2 registers.
const ROWS: usize = 6;
/// Weight rows a block of the weight gradient holds; every input width is a multiple of it.
const OUTER_ROWS: usize = 4;

/// What happens to a sum before it is stored.
#[derive(Clone, Copy, Debug)]
pub enum Epilogue<'a> {
    /// Store as it is.
    Linear,
    /// `max(0, y)`.
    Relu,
    /// Zero where the kept activation (`[n][m]`) is zero: the backward pass of [`Epilogue::Relu`].
    MaskBy(&'a [f32]),
}

dispatch! {
    /// `y = epilogue(x·w + bias)`; `x`: `[n][k]`, `w`: `[k][m]`, `bias`: `[m]`, `y`: `[n][m]`, row-major, `m` a multiple of 16.
    pub fn linear(x: &[f32], w: &[f32], bias: &[f32], epilogue: Epilogue<'_>, y: &mut [f32]) = linear_body
}

dispatch! {
    /// `d_w += xᵀ·d_y`, `d_bias += Σ d_y`; `x`: `[n][k]`, `d_y`: `[n][m]`, `d_w`: `[k][m]`, `d_bias`: `[m]`; `k` a multiple of 4.
    pub fn linear_backward_weights(x: &[f32], d_y: &[f32], d_w: &mut [f32], d_bias: &mut [f32]) = outer_body
}

/// `w` (`[k][m]`) transposed into `w_t` (`[m][k]`).
pub fn transpose(w: &[f32], m: usize, w_t: &mut [f32]) {
    let k = w.len() / m;
    assert_eq!(w_t.len(), w.len(), "transpose: sizes differ");
    for (i, row) in w.chunks_exact(m).enumerate() {
        for (j, &value) in row.iter().enumerate() {
            w_t[j * k + i] = value;
        }
    }
}

#[inline(always)]
fn linear_body<const FMA: bool>(
    x: &[f32],
    w: &[f32],
    bias: &[f32],
    epilogue: Epilogue<'_>,
    y: &mut [f32],
) {
    let m = bias.len();
    let n = y.len() / m;
    let k = w.len() / m;
    assert!(
        m.is_multiple_of(LANES) && w.len() == k * m && x.len() == n * k && y.len() == n * m,
        "linear: shapes disagree"
    );
    let full = n / ROWS * ROWS;
    for j in (0..m).step_by(LANES) {
        let init = first_lanes(&bias[j..]);
        for i in (0..full).step_by(ROWS) {
            let rows: [&[f32]; ROWS] = std::array::from_fn(|r| &x[(i + r) * k..][..k]);
            let sums = linear_block::<FMA, ROWS>(rows, w, m, j, init);
            for (r, sum) in sums.into_iter().enumerate() {
                store((i + r) * m + j, sum, epilogue, y);
            }
        }
        for i in full..n {
            let [sum] = linear_block::<FMA, 1>([&x[i * k..][..k]], w, m, j, init);
            store(i * m + j, sum, epilogue, y);
        }
    }
}

/// Sums of `R` samples times columns `j..j + 16`.
#[inline(always)]
fn linear_block<const FMA: bool, const R: usize>(
    rows: [&[f32]; R],
    w: &[f32],
    m: usize,
    j: usize,
    init: [f32; LANES],
) -> [[f32; LANES]; R] {
    let mut sums = [init; R];
    for (p, w_row) in w.chunks_exact(m).enumerate() {
        let w_block = first_lanes(&w_row[j..]);
        for r in 0..R {
            let a = rows[r][p];
            for c in 0..LANES {
                sums[r][c] = fma::<FMA>(a, w_block[c], sums[r][c]);
            }
        }
    }
    sums
}

#[inline(always)]
fn store(at: usize, mut sum: [f32; LANES], epilogue: Epilogue<'_>, y: &mut [f32]) {
    match epilogue {
        Epilogue::Linear => {}
        Epilogue::Relu => {
            for value in &mut sum {
                // `max` would turn NaN into 0 and hide it from the non-finite check.
                *value = if *value < 0.0 { 0.0 } else { *value };
            }
        }
        Epilogue::MaskBy(kept) => {
            let kept = first_lanes(&kept[at..]);
            for c in 0..LANES {
                sum[c] = if kept[c] > 0.0 { sum[c] } else { 0.0 };
            }
        }
    }
    y[at..at + LANES].copy_from_slice(&sum);
}

#[inline(always)]
fn outer_body<const FMA: bool>(x: &[f32], d_y: &[f32], d_w: &mut [f32], d_bias: &mut [f32]) {
    let m = d_bias.len();
    let k = d_w.len() / m;
    let n = d_y.len() / m;
    assert!(
        m.is_multiple_of(LANES)
            && k.is_multiple_of(OUTER_ROWS)
            && x.len() == n * k
            && d_y.len() == n * m,
        "linear_backward_weights: shapes disagree"
    );
    for j in (0..m).step_by(LANES) {
        let mut i = 0;
        while i < k {
            // Twelve sums hide the latency of the fused units; what sixes do not fill, fours do.
            if (k - i).is_multiple_of(OUTER_ROWS) && k - i < 3 * OUTER_ROWS {
                outer_block::<FMA, OUTER_ROWS>(x, d_y, d_w, k, m, i, j);
                i += OUTER_ROWS;
            } else {
                outer_block::<FMA, ROWS>(x, d_y, d_w, k, m, i, j);
                i += ROWS;
            }
        }
        let mut sum = first_lanes(&d_bias[j..]);
        for d_row in d_y.chunks_exact(m) {
            let d = first_lanes(&d_row[j..]);
            for c in 0..LANES {
                sum[c] += d[c];
            }
        }
        d_bias[j..j + LANES].copy_from_slice(&sum);
    }
}

/// Adds rows `i..i + R` and columns `j..j + 16` of `xᵀ·d_y` to `d_w`.
#[inline(always)]
fn outer_block<const FMA: bool, const R: usize>(
    x: &[f32],
    d_y: &[f32],
    d_w: &mut [f32],
    k: usize,
    m: usize,
    i: usize,
    j: usize,
) {
    let mut sums: [[f32; LANES]; R] = std::array::from_fn(|r| first_lanes(&d_w[(i + r) * m + j..]));
    for (x_row, d_row) in x.chunks_exact(k).zip(d_y.chunks_exact(m)) {
        let a = &x_row[i..i + R];
        let d = first_lanes(&d_row[j..]);
        for r in 0..R {
            for c in 0..LANES {
                sums[r][c] = fma::<FMA>(a[r], d[c], sums[r][c]);
            }
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        d_w[(i + r) * m + j..][..LANES].copy_from_slice(&sum);
    }
}

#[inline(always)]
fn first_lanes(values: &[f32]) -> [f32; LANES] {
    let mut block = [0.0; LANES];
    block.copy_from_slice(&values[..LANES]);
    block
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize, phase: f32) -> Vec<f32> {
        (0..n).map(|i| (i as f32 * 0.37 + phase).sin()).collect()
    }

    fn naive_linear(x: &[f32], w: &[f32], bias: &[f32], k: usize) -> Vec<f32> {
        let m = bias.len();
        x.chunks_exact(k)
            .flat_map(|row| {
                (0..m).map(|j| {
                    bias[j] as f64
                        + (0..k)
                            .map(|p| row[p] as f64 * w[p * m + j] as f64)
                            .sum::<f64>()
                })
            })
            .map(|v| v as f32)
            .collect()
    }

    fn assert_close(a: &[f32], b: &[f32], tolerance: f32) {
        assert_eq!(a.len(), b.len(), "lengths");
        for (i, (x, y)) in a.iter().zip(b).enumerate() {
            assert!(
                (x - y).abs() <= tolerance * (1.0 + y.abs()),
                "element {i}: {x} against {y}"
            );
        }
    }

    #[test]
    fn linear_agrees_with_a_plain_loop_for_every_tail_length() {
        for (k, m) in [(16, 16), (32, 64), (64, 16)] {
            for n in 0..20 {
                let (x, w, bias) = (wave(n * k, 0.1), wave(k * m, 0.2), wave(m, 0.3));
                let mut y = vec![0.0; n * m];
                linear(&x, &w, &bias, Epilogue::Linear, &mut y);
                let expected = naive_linear(&x, &w, &bias, k);
                assert_close(&y, &expected, 1e-4);
                linear(&x, &w, &bias, Epilogue::Relu, &mut y);
                let clipped: Vec<f32> = expected.iter().map(|v| v.max(0.0)).collect();
                assert_close(&y, &clipped, 1e-4);
            }
        }
    }

    #[test]
    fn weight_gradient_agrees_with_a_plain_loop() {
        let (n, k, m) = (13, 32, 64);
        let (x, d_y) = (wave(n * k, 0.5), wave(n * m, 0.9));
        let mut d_w = vec![0.5; k * m];
        let mut d_bias = vec![0.25; m];
        linear_backward_weights(&x, &d_y, &mut d_w, &mut d_bias);
        for i in 0..k {
            for j in 0..m {
                let expected = 0.5 + (0..n).map(|s| x[s * k + i] * d_y[s * m + j]).sum::<f32>();
                assert!((d_w[i * m + j] - expected).abs() < 1e-4, "d_w[{i}][{j}]");
            }
        }
        let expected = 0.25 + (0..n).map(|s| d_y[s * m + 3]).sum::<f32>();
        assert!((d_bias[3] - expected).abs() < 1e-4, "d_bias");
    }

    #[test]
    fn relu_keeps_nan_visible() {
        let mut y = [0.0; 16];
        linear(&[f32::NAN], &[1.0; 16], &[0.0; 16], Epilogue::Relu, &mut y);
        assert!(y[0].is_nan(), "a NaN input must reach the non-finite check");
    }
}
