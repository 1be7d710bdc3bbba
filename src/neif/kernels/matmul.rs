//! Small dense products of the tiny networks, sample-major, without horizontal reductions.
//!
//! Every product is "broadcast one scalar, multiply a row": the forward pass uses `w`, the input gradient a
//! transposed copy of `w`, the weight gradient is an outer product summed over the samples. Rows of the
//! right-hand matrix are [`LANES`] wide, so every width is padded to a multiple of it.

use super::{Isa, dispatch, fma};

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
fn linear_body<I: Isa>(x: &[f32], w: &[f32], bias: &[f32], epilogue: Epilogue<'_>, y: &mut [f32]) {
    let m = bias.len();
    let n = y.len() / m;
    let k = w.len() / m;
    assert!(
        m.is_multiple_of(LANES) && w.len() == k * m && x.len() == n * k && y.len() == n * m,
        "linear: shapes disagree"
    );
    let mut j = 0;
    while j < m {
        let columns = if I::WIDE && j + 2 * LANES <= m { 2 } else { 1 };
        let init = first(&bias[j..]);
        let mut i = 0;
        while i < n {
            if n >= ROWS {
                // The last block goes back to rows that are done already: they cost less than rows one by one.
                i = i.min(n - ROWS);
            }
            let x = &x[i * k..];
            let at = i * m + j;
            if n < ROWS {
                let end = j + columns * LANES;
                for j in (j..end).step_by(LANES) {
                    let sums = linear_block::<I, 1>(x, w, m, j, first(&bias[j..]));
                    store_block(sums, i * m + j, m, epilogue, y);
                }
                i += 1;
            } else if columns == 2 {
                let init = [init, first(&bias[j + LANES..])];
                let [left, right] = linear_pair::<I>(x, w, m, j, init);
                store_block(left, at, m, epilogue, y);
                store_block(right, at + LANES, m, epilogue, y);
                i += ROWS;
            } else {
                store_block(
                    linear_block::<I, ROWS>(x, w, m, j, init),
                    at,
                    m,
                    epilogue,
                    y,
                );
                i += ROWS;
            }
        }
        j += columns * LANES;
    }
}

/// Sums of the first `R` samples of `x` times columns `j..j + 16`.
#[inline(always)]
fn linear_block<I: Isa, const R: usize>(
    x: &[f32],
    w: &[f32],
    m: usize,
    j: usize,
    init: [f32; LANES],
) -> [[f32; LANES]; R] {
    let k = w.len() / m;
    let rows: [&[f32]; R] = std::array::from_fn(|r| &x[r * k..][..k]);
    let mut sums = [init; R];
    for (p, w_row) in w.chunks_exact(m).enumerate() {
        let scalars = std::array::from_fn(|r| rows[r][p]);
        add_scaled::<I, R>(&mut sums, scalars, first(&w_row[j..]));
    }
    sums
}

/// [`linear_block`] of [`ROWS`] samples for columns `j..j + 16` and the next sixteen: two short loops, since a long one
/// would not be unrolled and its sums would leave the registers.
#[inline(always)]
fn linear_pair<I: Isa>(
    x: &[f32],
    w: &[f32],
    m: usize,
    j: usize,
    init: [[f32; LANES]; 2],
) -> [[[f32; LANES]; ROWS]; 2] {
    let k = w.len() / m;
    let rows: [&[f32]; ROWS] = std::array::from_fn(|r| &x[r * k..][..k]);
    let (mut left, mut right) = ([init[0]; ROWS], [init[1]; ROWS]);
    for (p, w_row) in w.chunks_exact(m).enumerate() {
        let scalars = std::array::from_fn(|r| rows[r][p]);
        add_scaled::<I, ROWS>(&mut left, scalars, first(&w_row[j..]));
        add_scaled::<I, ROWS>(&mut right, scalars, first(&w_row[j + LANES..]));
    }
    [left, right]
}

/// `sums[r] += scalars[r] row`.
#[inline(always)]
fn add_scaled<I: Isa, const R: usize>(
    sums: &mut [[f32; LANES]; R],
    scalars: [f32; R],
    row: [f32; LANES],
) {
    for r in 0..R {
        for c in 0..LANES {
            sums[r][c] = fma::<I>(scalars[r], row[c], sums[r][c]);
        }
    }
}

/// Stores rows `m` apart, the first at `y[at..]`.
#[inline(always)]
fn store_block<const R: usize>(
    sums: [[f32; LANES]; R],
    at: usize,
    m: usize,
    epilogue: Epilogue<'_>,
    y: &mut [f32],
) {
    for (r, mut sum) in sums.into_iter().enumerate() {
        let at = at + r * m;
        match epilogue {
            Epilogue::Linear => {}
            Epilogue::Relu => {
                for value in &mut sum {
                    // `max` would turn NaN into 0 and hide it from the non-finite check.
                    *value = if *value < 0.0 { 0.0 } else { *value };
                }
            }
            Epilogue::MaskBy(kept) => {
                let kept: [f32; LANES] = first(&kept[at..]);
                for c in 0..LANES {
                    sum[c] = if kept[c] > 0.0 { sum[c] } else { 0.0 };
                }
            }
        }
        y[at..at + LANES].copy_from_slice(&sum);
    }
}

#[inline(always)]
fn outer_body<I: Isa>(x: &[f32], d_y: &[f32], d_w: &mut [f32], d_bias: &mut [f32]) {
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
    let mut j = 0;
    while j < m {
        let columns = if I::WIDE && j + 2 * LANES <= m { 2 } else { 1 };
        let mut i = 0;
        while i < k {
            // Twelve registers of sums hide the latency of the fused units; what sixes do not fill, fours do.
            let fours = (k - i).is_multiple_of(OUTER_ROWS) && k - i < 3 * OUTER_ROWS;
            match (fours, columns) {
                (true, 1) => outer_block::<I, OUTER_ROWS>(x, d_y, d_w, k, m, i, j),
                (true, _) => outer_pair::<I, OUTER_ROWS>(x, d_y, d_w, k, m, i, j),
                (false, 1) => outer_block::<I, ROWS>(x, d_y, d_w, k, m, i, j),
                (false, _) => outer_pair::<I, ROWS>(x, d_y, d_w, k, m, i, j),
            }
            i += if fours { OUTER_ROWS } else { ROWS };
        }
        j += columns * LANES;
    }
    for (j, sum) in d_bias.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        for d_row in d_y.chunks_exact(m) {
            let d: [f32; LANES] = first(&d_row[j * LANES..]);
            for c in 0..LANES {
                sum[c] += d[c];
            }
        }
    }
}

/// Adds rows `i..i + R` and columns `j..j + 16` of `xᵀ·d_y` to `d_w`.
#[inline(always)]
fn outer_block<I: Isa, const R: usize>(
    x: &[f32],
    d_y: &[f32],
    d_w: &mut [f32],
    k: usize,
    m: usize,
    i: usize,
    j: usize,
) {
    let mut sums = load_rows::<R>(d_w, m, i, j);
    for (x_row, d_row) in x.chunks_exact(k).zip(d_y.chunks_exact(m)) {
        let d = first(&d_row[j..]);
        add_scaled::<I, R>(&mut sums, first(&x_row[i..]), d);
    }
    store_rows(sums, d_w, m, i, j);
}

/// [`outer_block`] for columns `j..j + 16` and the next sixteen, as [`linear_pair`].
#[inline(always)]
fn outer_pair<I: Isa, const R: usize>(
    x: &[f32],
    d_y: &[f32],
    d_w: &mut [f32],
    k: usize,
    m: usize,
    i: usize,
    j: usize,
) {
    let mut left = load_rows::<R>(d_w, m, i, j);
    let mut right = load_rows::<R>(d_w, m, i, j + LANES);
    for (x_row, d_row) in x.chunks_exact(k).zip(d_y.chunks_exact(m)) {
        let scalars = first(&x_row[i..]);
        add_scaled::<I, R>(&mut left, scalars, first(&d_row[j..]));
        add_scaled::<I, R>(&mut right, scalars, first(&d_row[j + LANES..]));
    }
    store_rows(left, d_w, m, i, j);
    store_rows(right, d_w, m, i, j + LANES);
}

#[inline(always)]
fn load_rows<const R: usize>(d_w: &[f32], m: usize, i: usize, j: usize) -> [[f32; LANES]; R] {
    std::array::from_fn(|r| first(&d_w[(i + r) * m + j..]))
}

#[inline(always)]
fn store_rows<const R: usize>(
    sums: [[f32; LANES]; R],
    d_w: &mut [f32],
    m: usize,
    i: usize,
    j: usize,
) {
    for (r, sum) in sums.into_iter().enumerate() {
        d_w[(i + r) * m + j..][..LANES].copy_from_slice(&sum);
    }
}

#[inline(always)]
fn first<const N: usize>(values: &[f32]) -> [f32; N] {
    let mut block = [0.0; N];
    block.copy_from_slice(&values[..N]);
    block
}

#[cfg(test)]
mod tests {
    use super::super::{Avx2, Avx512};
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
    fn wide_registers_give_the_same_bits() {
        for (n, k, m) in [(13, 48, 64), (24, 32, 16), (7, 20, 48)] {
            let (x, w, bias) = (wave(n * k, 0.1), wave(k * m, 0.2), wave(m, 0.3));
            let (mut narrow, mut wide) = (vec![0.0; n * m], vec![1.0; n * m]);
            linear_body::<Avx2>(&x, &w, &bias, Epilogue::Relu, &mut narrow);
            linear_body::<Avx512>(&x, &w, &bias, Epilogue::Relu, &mut wide);
            assert_eq!(narrow, wide, "linear, {n} x {k} x {m}");
            let mut gradients = [(w.clone(), bias.clone()), (w, bias)];
            let [narrow, wide] = &mut gradients;
            outer_body::<Avx2>(&x, &wave(n * m, 0.4), &mut narrow.0, &mut narrow.1);
            outer_body::<Avx512>(&x, &wave(n * m, 0.4), &mut wide.0, &mut wide.1);
            assert_eq!(narrow, wide, "linear_backward_weights, {n} x {k} x {m}");
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
