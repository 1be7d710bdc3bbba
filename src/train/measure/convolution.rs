//! Convolution and pooling of feature maps, forward only: what the networks of LPIPS are made of.
//!
//! A convolution gathers the neighbourhoods of a few hundred output pixels as rows of a matrix
//! (im2col) and multiplies them by the weights with the kernel of the fields' own networks.

use rayon::prelude::*;

use crate::neif::kernels::matmul::{Epilogue, LANES, linear};

/// Side of the window of [`max_pool`], in pixels.
const POOL_SIDE: usize = 3;
/// Distance between two of its windows, in pixels.
const POOL_STRIDE: usize = 2;
/// Floats of a tile of gathered neighbourhoods: with the weights of 16 outputs it stays in a
/// second-level cache of 512 KiB.
const TILE_FLOATS: usize = 48 * 1024;
/// Most output pixels of a tile, so that small pictures still give every thread something to do.
const MAX_TILE_PIXELS: usize = 192;
/// The matrix kernel works on groups of six rows.
const ROW_GROUP: usize = 6;

/// A picture of any number of channels.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::train) struct FeatureMap {
    /// Columns.
    pub(in crate::train) width: usize,
    /// Values of a pixel.
    pub(in crate::train) channels: usize,
    /// `[height][width][channels]`.
    pub(in crate::train) values: Vec<f32>,
}

impl FeatureMap {
    /// Rows.
    pub(in crate::train) fn height(&self) -> usize {
        self.values.len() / (self.width * self.channels)
    }

    /// The pixels of both maps, which have one size, with the channels of `self` first.
    pub(in crate::train) fn beside(&self, other: &Self) -> Self {
        let pixels = self.values.chunks_exact(self.channels);
        let others = other.values.chunks_exact(other.channels);
        let mut values = Vec::with_capacity(self.values.len() + other.values.len());
        for (a, b) in pixels.zip(others) {
            values.extend_from_slice(a);
            values.extend_from_slice(b);
        }
        Self {
            width: self.width,
            channels: self.channels + other.channels,
            values,
        }
    }
}

/// Sizes of a convolution with square windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) struct ConvolutionShape {
    /// Channels that go in.
    pub(in crate::train) n_in: usize,
    /// Channels that come out, a multiple of 16.
    pub(in crate::train) n_out: usize,
    /// Side of the window, in pixels.
    pub(in crate::train) side: usize,
    /// Distance between two windows, in pixels.
    pub(in crate::train) stride: usize,
    /// Zeros around the picture, in pixels.
    pub(in crate::train) padding: usize,
}

impl ConvolutionShape {
    /// Rows (or columns) of the output for so many of the input; none when no window fits.
    pub(super) fn output_side(&self, input: usize) -> Option<usize> {
        let room = (input + 2 * self.padding).checked_sub(self.side)?;
        Some(room / self.stride + 1)
    }

    /// Values under a window.
    fn window_len(&self) -> usize {
        self.side * self.side * self.n_in
    }
}

/// A convolution and the `max(0, x)` behind it.
#[derive(Clone, Debug)]
pub(in crate::train) struct Convolution {
    /// Its sizes.
    pub(in crate::train) shape: ConvolutionShape,
    /// `[n_out / 16][side][side][n_in][16]`: the weights of 16 outputs lie together, as rows of
    /// all outputs (a power of two of floats apart) would fall on few sets of the caches.
    panels: Vec<f32>,
    /// `[n_out]`.
    bias: Vec<f32>,
}

impl Convolution {
    /// From weights `[n_out][n_in][side][side]` and biases `[n_out]`.
    pub(in crate::train) fn new(shape: ConvolutionShape, weights: &[f32], bias: &[f32]) -> Self {
        let (n_in, n_out, area) = (shape.n_in, shape.n_out, shape.side * shape.side);
        assert!(
            n_out.is_multiple_of(LANES)
                && weights.len() == n_out * n_in * area
                && bias.len() == n_out,
            "convolution: shapes disagree"
        );
        let mut panels = Vec::with_capacity(weights.len());
        for panel in (0..n_out).step_by(LANES) {
            for at in 0..area {
                for i in 0..n_in {
                    panels.extend(
                        (panel..panel + LANES).map(|o| weights[(o * n_in + i) * area + at]),
                    );
                }
            }
        }
        Self {
            shape,
            panels,
            bias: bias.to_vec(),
        }
    }

    /// `max(0, conv(input) + bias)`; none when the input is smaller than a window.
    pub(super) fn forward_relu(&self, input: &FeatureMap) -> Option<FeatureMap> {
        let shape = &self.shape;
        assert_eq!(input.channels, shape.n_in, "channels of the input");
        let width = shape.output_side(input.width)?;
        let height = shape.output_side(input.height())?;
        let mut values = vec![0.0; height * width * shape.n_out];
        let tile = (TILE_FLOATS / shape.window_len()).min(MAX_TILE_PIXELS) / ROW_GROUP;
        let tile = tile.max(1) * ROW_GROUP;
        values
            .par_chunks_mut(tile * shape.n_out)
            .enumerate()
            .for_each_init(
                || (Vec::new(), vec![0.0; tile * LANES]),
                |(windows, panel_out), (i, out)| {
                    windows.clear();
                    for pixel in i * tile..i * tile + out.len() / shape.n_out {
                        self.gather(input, pixel % width, pixel / width, windows);
                    }
                    self.multiply(windows, panel_out, out);
                },
            );
        Some(FeatureMap {
            width,
            channels: shape.n_out,
            values,
        })
    }

    /// Appends the values under the window of output pixel `x, y`: `[side][side][n_in]`.
    fn gather(&self, input: &FeatureMap, x: usize, y: usize, windows: &mut Vec<f32>) {
        let ConvolutionShape {
            n_in,
            side,
            stride,
            padding,
            ..
        } = self.shape;
        let (left, top) = (x * stride, y * stride);
        // Columns of the window before, inside and behind the picture.
        let before = padding.saturating_sub(left).min(side);
        let inside = (input.width + padding).saturating_sub(left).min(side);
        for row in top..top + side {
            let end = windows.len() + side * n_in;
            if (padding..input.height() + padding).contains(&row) && before < inside {
                windows.extend(std::iter::repeat_n(0.0, before * n_in));
                let first = (row - padding) * input.width + left + before - padding;
                windows
                    .extend_from_slice(&input.values[first * n_in..][..(inside - before) * n_in]);
            }
            windows.resize(end, 0.0);
        }
    }

    /// `out` (`[n][n_out]`) from `windows` (`[n][window]`), 16 outputs at a time.
    fn multiply(&self, windows: &[f32], panel_out: &mut [f32], out: &mut [f32]) {
        let n_out = self.shape.n_out;
        let panel_out = &mut panel_out[..out.len() / n_out * LANES];
        let panels = self.panels.chunks_exact(self.shape.window_len() * LANES);
        for ((p, panel), bias) in panels.enumerate().zip(self.bias.chunks_exact(LANES)) {
            linear(windows, panel, bias, Epilogue::Relu, panel_out);
            for (pixel, values) in out
                .chunks_exact_mut(n_out)
                .zip(panel_out.chunks_exact(LANES))
            {
                pixel[p * LANES..][..LANES].copy_from_slice(values);
            }
        }
    }
}

/// What becomes of the last window of a pooling that hangs over the picture's edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::train) enum LastWindow {
    /// It is left out.
    Dropped,
    /// It is cut at the edge (`ceil_mode`).
    Cut,
}

/// Rows (or columns) of [`max_pool`]'s output for so many of the input; none for too few.
pub(super) fn pooled_side(input: usize, last: LastWindow) -> Option<usize> {
    let overhang = match last {
        LastWindow::Dropped => 0,
        LastWindow::Cut => POOL_STRIDE - 1,
    };
    let room = (input + overhang).checked_sub(POOL_SIDE)?;
    Some(room / POOL_STRIDE + 1)
}

/// The maximum by channel over windows of 3 x 3 pixels, 2 apart; none for too small an input.
pub(super) fn max_pool(input: &FeatureMap, last: LastWindow) -> Option<FeatureMap> {
    let (width, height) = (
        pooled_side(input.width, last)?,
        pooled_side(input.height(), last)?,
    );
    let n = input.channels;
    let mut values = vec![f32::NEG_INFINITY; height * width * n];
    let rows = values.par_chunks_exact_mut(width * n).enumerate();
    rows.for_each(|(y, row)| {
        let window =
            |at: usize, end: usize| at * POOL_STRIDE..(at * POOL_STRIDE + POOL_SIDE).min(end);
        for (x, out) in row.chunks_exact_mut(n).enumerate() {
            for sy in window(y, input.height()) {
                for sx in window(x, input.width) {
                    let source = &input.values[(sy * input.width + sx) * n..][..n];
                    for (max, value) in out.iter_mut().zip(source) {
                        *max = max.max(*value);
                    }
                }
            }
        }
    });
    Some(FeatureMap {
        width,
        channels: n,
        values,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize, phase: f32) -> Vec<f32> {
        (0..n).map(|i| (i as f32 * 0.37 + phase).sin()).collect()
    }

    fn map(width: usize, height: usize, channels: usize) -> FeatureMap {
        let values = wave(width * height * channels, 0.4);
        FeatureMap {
            width,
            channels,
            values,
        }
    }

    fn naive(shape: ConvolutionShape, w: &[f32], bias: &[f32], input: &FeatureMap) -> Vec<f32> {
        let pad = shape.padding as i64;
        let at = |x: i64, y: i64, c: usize| {
            let (width, height) = (input.width as i64, input.height() as i64);
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            let value = || input.values[(y * width + x) as usize * shape.n_in + c];
            if inside { f64::from(value()) } else { 0.0 }
        };
        let mut out = Vec::new();
        for y in 0..=(input.height() + 2 * shape.padding - shape.side) / shape.stride {
            for x in 0..=(input.width + 2 * shape.padding - shape.side) / shape.stride {
                let outputs = w.chunks_exact(w.len() / shape.n_out);
                for (w, bias) in outputs.zip(bias) {
                    let mut sum = f64::from(*bias);
                    for (i, weight) in w.iter().enumerate() {
                        let (c, k) = (i / shape.side.pow(2), i % shape.side.pow(2));
                        let sx = (x * shape.stride + k % shape.side) as i64 - pad;
                        let sy = (y * shape.stride + k / shape.side) as i64 - pad;
                        sum += f64::from(*weight) * at(sx, sy, c);
                    }
                    out.push(sum.max(0.0) as f32);
                }
            }
        }
        out
    }

    #[test]
    fn convolutions_agree_with_plain_loops() {
        for (side, stride, padding, n_in, n_out) in [
            (11, 4, 2, 3, 16),
            (5, 1, 2, 16, 32),
            (3, 1, 1, 7, 48),
            (3, 2, 0, 3, 64),
            (1, 1, 0, 16, 16),
            (3, 1, 5, 2, 16),
        ] {
            let shape = ConvolutionShape {
                n_in,
                n_out,
                side,
                stride,
                padding,
            };
            let weights = wave(n_out * n_in * side * side, 0.1);
            let bias = wave(n_out, 0.7);
            let convolution = Convolution::new(shape, &weights, &bias);
            for (width, height) in [(11, 11), (23, 14), (40, 12)] {
                let input = map(width, height, n_in);
                let found = convolution.forward_relu(&input).unwrap();
                let expected = naive(shape, &weights, &bias, &input);
                assert_eq!(found.values.len(), expected.len(), "{shape:?}");
                assert_eq!(Some(found.width), shape.output_side(width), "{shape:?}");
                for (a, b) in found.values.iter().zip(&expected) {
                    assert!((a - b).abs() < 1e-4 * (1.0 + b), "{shape:?}: {a}, not {b}");
                }
            }
        }
    }

    #[test]
    fn an_input_smaller_than_the_window_has_no_output() {
        let shape = ConvolutionShape {
            n_in: 1,
            n_out: 16,
            side: 5,
            stride: 2,
            padding: 1,
        };
        let convolution = Convolution::new(shape, &[0.0; 16 * 25], &[0.0; 16]);
        assert!(convolution.forward_relu(&map(2, 9, 1)).is_none());
        assert!(convolution.forward_relu(&map(3, 3, 1)).is_some());
        assert!(max_pool(&map(2, 9, 1), LastWindow::Dropped).is_none());
        assert!(max_pool(&map(1, 9, 1), LastWindow::Cut).is_none());
    }

    #[test]
    fn pooling_agrees_with_plain_loops_with_and_without_a_cut_window() {
        for (width, height) in [(3, 3), (4, 7), (9, 6), (2, 5)] {
            for last in [LastWindow::Dropped, LastWindow::Cut] {
                // Windows start at 0, 2, 4, …: those that fit, and with `Cut` the first that does not.
                let starts = |side: usize| -> Vec<usize> {
                    let fitting = (0..side).step_by(2).filter(|s| s + 3 <= side).count();
                    let cut = usize::from(
                        last == LastWindow::Cut && (side < 3 || side.is_multiple_of(2)),
                    );
                    (0..fitting + cut).map(|i| 2 * i).collect()
                };
                let input = map(width, height, 2);
                let mut expected = Vec::new();
                for y in starts(height) {
                    for x in starts(width) {
                        for c in 0..2 {
                            let inside = (y..height.min(y + 3))
                                .flat_map(|sy| (x..width.min(x + 3)).map(move |sx| (sx, sy)));
                            let values =
                                inside.map(|(sx, sy)| input.values[(sy * width + sx) * 2 + c]);
                            expected.push(values.fold(f32::MIN, f32::max));
                        }
                    }
                }
                let found = max_pool(&input, last);
                let found = found.map_or(Vec::new(), |map| map.values);
                assert_eq!(found, expected, "{width} x {height}, {last:?}");
            }
        }
    }

    #[test]
    fn maps_beside_each_other_keep_their_pixels() {
        let both = map(2, 1, 1).beside(&map(2, 1, 2));
        let (a, b) = (map(2, 1, 1).values, map(2, 1, 2).values);
        assert_eq!(both.channels, 3);
        assert_eq!(both.values, [a[0], b[0], b[1], a[1], b[2], b[3]]);
    }
}
