//! Photos and masks made smaller: each new pixel is the mean of the area that it covers, in linear light.
//!
//! Pixel `(x, y)` of the result covers `[x, x + 1) * width / new_width` of the source's columns and rows alike, so a
//! camera scaled by the same two factors ([`crate::geometry::Camera::resized`]) sees exactly the same.

use crate::color::srgb_from_linear;
use crate::data::{Mask, Photo};

/// The share of a source pixel in one or two pixels of the result, along one axis.
#[derive(Clone, Copy, Debug)]
struct Span {
    /// The first pixel of the result.
    first: usize,
    /// Shares of it and of the next, in pixels of the result.
    shares: [f32; 2],
}

/// The photo with `width` columns and `height` rows, neither more than it has.
///
/// `weights`: what each pixel counts, where not all count alike (what is transparent shows nothing). Panics if there
/// are not as many as pixels.
pub(super) fn shrunk_photo(
    photo: &Photo,
    weights: Option<&Mask>,
    width: u32,
    height: u32,
) -> Photo {
    let size = (photo.width() as usize, photo.height() as usize);
    let new_size = (width as usize, height as usize);
    let weight = |i: usize| weights.map_or(1.0, |mask| mask.share(i));
    let linear = |i: usize| photo.linear(i);
    let encoded = |c: f32, top: f32| (srgb_from_linear(c) * top + 0.5).clamp(0.0, top);
    match photo {
        Photo::Rgb8 { pixels, .. } => {
            let decoded: Vec<f32> = (0..=u8::MAX)
                .map(|code| crate::color::linear_from_srgb(f32::from(code) / 255.0))
                .collect();
            let linear = |i: usize| pixels[i].map(|code: u8| decoded[usize::from(code)]);
            Photo::Rgb8 {
                width,
                height,
                pixels: means(size, new_size, weight, linear, |c| encoded(c, 255.0) as u8),
                chroma_block: [1, 1],
            }
        }
        Photo::Ldr { .. } => Photo::Ldr {
            width,
            height,
            pixels: means(size, new_size, weight, linear, |c| {
                encoded(c, 65535.0) as u16
            }),
        },
        Photo::Hdr { .. } => Photo::Hdr {
            width,
            height,
            pixels: means(size, new_size, weight, linear, |c| c),
        },
    }
}

/// The weighted means of the new pixels' areas, stored by `encode`.
fn means<T>(
    size: (usize, usize),
    new_size: (usize, usize),
    weight: impl Fn(usize) -> f32,
    linear: impl Fn(usize) -> [f32; 3],
    encode: impl Fn(f32) -> T,
) -> Vec<[T; 3]> {
    // What only weightless pixels fall on keeps their colour.
    let rest = 1e-6;
    let value = |i: usize| {
        let (w, [r, g, b]) = (weight(i) + rest, linear(i));
        [w * r, w * g, w * b, w]
    };
    let mut pixels = Vec::with_capacity(new_size.0 * new_size.1);
    for_each_row(size, new_size, value, |row| {
        pixels.extend(
            row.iter()
                .map(|[r, g, b, w]| [r / w, g / w, b / w].map(&encode)),
        );
    });
    pixels
}

/// The mask with `width` columns and `height` rows, neither more than it has.
pub(super) fn shrunk_mask(mask: &Mask, width: u32, height: u32) -> Mask {
    let size = (mask.width as usize, mask.height as usize);
    let new_size = (width as usize, height as usize);
    let mut coverage = Vec::with_capacity(new_size.0 * new_size.1);
    let value = |i: usize| [f32::from(mask.coverage[i]), 1.0, 0.0, 0.0];
    for_each_row(size, new_size, value, |row| {
        coverage.extend(row.iter().map(|[sum, n, ..]| (sum / n + 0.5) as u8));
    });
    Mask {
        width,
        height,
        coverage,
    }
}

/// Calls `on_row` with the sums of `value` over the areas of each row of new pixels, from above. Two rows are in memory.
fn for_each_row(
    (width, height): (usize, usize),
    (new_width, new_height): (usize, usize),
    value: impl Fn(usize) -> [f32; 4],
    mut on_row: impl FnMut(&[[f32; 4]]),
) {
    let (columns, rows) = (spans(width, new_width), spans(height, new_height));
    // The row that is being filled, and the next.
    let mut sums = [(); 2].map(|()| vec![[0.0_f32; 4]; new_width]);
    let mut current = 0;
    // One more column takes the empty second share of the last one.
    let mut line = vec![[0.0_f32; 4]; new_width + 1];
    for (y, row) in rows.iter().enumerate() {
        if row.first > current {
            on_row(&sums[0]);
            sums.swap(0, 1);
            sums[1].fill([0.0; 4]);
            current = row.first;
        }
        line.fill([0.0; 4]);
        for (x, column) in columns.iter().enumerate() {
            let v = value(y * width + x);
            for (i, share) in column.shares.into_iter().enumerate() {
                for (sum, v) in line[column.first + i].iter_mut().zip(v) {
                    *sum += share * v;
                }
            }
        }
        for (sums, share) in sums.iter_mut().zip(row.shares) {
            for (sums, values) in sums.iter_mut().zip(&line) {
                for (sum, v) in sums.iter_mut().zip(values) {
                    *sum += share * v;
                }
            }
        }
    }
    on_row(&sums[0]);
}

/// Where each of `n` source pixels falls among `n_new`, at most as many.
fn spans(n: usize, n_new: usize) -> Vec<Span> {
    assert!(
        (1..=n).contains(&n_new),
        "{n} pixels cannot shrink to {n_new}"
    );
    let scale = n_new as f64 / n as f64;
    (0..n)
        .map(|i| {
            let (begin, end) = (scale * i as f64, scale * (i + 1) as f64);
            let first = (begin as usize).min(n_new - 1);
            let inside = end.min((first + 1) as f64) - begin;
            Span {
                first,
                shares: [inside as f32, (end - begin - inside) as f32],
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::linear_from_srgb;
    use crate::geometry::Camera;
    use glam::Vec3;

    /// A photo whose linear value is a plane over the pixels' centres.
    fn plane(width: u32, height: u32) -> Photo {
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                [0.001 * x, 0.002 * y, 0.5]
            })
            .collect();
        Photo::Hdr {
            width,
            height,
            pixels,
        }
    }

    #[test]
    fn a_plane_of_light_stays_where_the_resized_camera_sees_it() {
        // The value at a point is linear in the picture's coordinates, so a pixel's mean is the value at its centre; up
        // to the steps between the source's pixels, an eighth of one, which go either way.
        const STEP_PX: f32 = 0.126;
        let (width, height) = (97, 61);
        let photo = plane(width, height);
        for (new_width, new_height) in [(96, 60), (33, 20), (7, 61), (1, 1)] {
            let small = shrunk_photo(&photo, None, new_width, new_height);
            let full = Camera::look_at(Vec3::ONE, Vec3::ZERO, Vec3::Z, 0.8, width, height);
            let camera = full.resized(new_width, new_height);
            let (n, mut sum) = (new_width * new_height, [0.0_f64; 2]);
            for i in 0..n {
                let (x, y) = ((i % new_width) as f32 + 0.5, (i / new_width) as f32 + 0.5);
                let point = full.project(camera.ray(x, y).at(3.0)).unwrap();
                let [r, g, b] = small.linear(i as usize);
                let apart = [r / 0.001 - point.x, g / 0.002 - point.y];
                assert!(
                    apart.iter().all(|px| px.abs() < STEP_PX),
                    "{apart:?} at {point}"
                );
                sum = [0, 1].map(|axis| sum[axis] + f64::from(apart[axis]));
                assert!((b - 0.5).abs() < 1e-5, "{b}");
            }
            let mean = sum.map(|sum| sum / f64::from(n));
            assert!(
                mean.iter().all(|px| px.abs() < 1e-3),
                "{mean:?} px at {new_width}"
            );
        }
    }

    #[test]
    fn means_are_those_of_light_and_leave_out_what_is_transparent() {
        let photo = Photo::Rgb8 {
            width: 2,
            height: 1,
            pixels: vec![[255; 3], [0; 3]],
            chroma_block: [2, 1],
        };
        let shrunk = shrunk_photo(&photo, None, 1, 1);
        assert_eq!(
            shrunk.chroma_block(),
            [1, 1],
            "blocks are no longer whole pixels"
        );
        let mean = shrunk.srgb(0)[0];
        assert!((linear_from_srgb(mean) - 0.5).abs() < 0.01, "{mean}");
        let mask = Mask {
            width: 2,
            height: 1,
            coverage: vec![255, 0],
        };
        let mean = shrunk_photo(&photo, Some(&mask), 1, 1).srgb(0)[0];
        assert!(mean > 0.99, "{mean}");
        assert_eq!(shrunk_mask(&mask, 1, 1).coverage, [128], "coverage");
    }
}
