//! A picture of all directions: look-up without seams, and resampling that keeps the light.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

/// Fractions of a pixel below this are rounding of the direction: a pixel's own direction then gives the pixel exactly.
const SNAP: f32 = 5e-4;

/// Linear radiance over all directions, in the convention of rendered panoramas: z is up, the centre looks
/// along +x, the azimuth falls from left to right.
#[derive(Clone, Debug, PartialEq)]
pub struct Equirect {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Equirect {
    /// The picture of `[height * width]` pixels, row 0 on top; `None` when the count is wrong, the width odd (a row
    /// continues half a turn away beyond the poles), or the picture smaller than 4 x 2.
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Option<Self> {
        let is_sound =
            width >= 4 && height >= 2 && width.is_multiple_of(2) && pixels.len() == width * height;
        is_sound.then_some(Self {
            width,
            height,
            pixels,
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// `[height * width]`, row 0 on top.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Elevation of a row's middle, radians.
    pub fn elevation(&self, row: usize) -> f64 {
        std::f64::consts::PI * (0.5 - (row as f64 + 0.5) / self.height as f64)
    }

    /// Solid angle of a pixel in a row, steradians.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let band = sphere_above(row + 1, self.height) - sphere_above(row, self.height);
        band * std::f64::consts::TAU / self.width as f64
    }

    /// Mean radiance over the sphere.
    pub fn mean(&self) -> Vec3 {
        let mut sum = [0.0_f64; 3];
        for (y, row) in self.pixels.chunks_exact(self.width).enumerate() {
            let solid_angle = self.solid_angle(y);
            for (c, sum) in sum.iter_mut().enumerate() {
                *sum += solid_angle * row.iter().map(|p| f64::from(p[c])).sum::<f64>();
            }
        }
        Vec3::from(sum.map(|v| (v / (4.0 * std::f64::consts::PI)) as f32))
    }

    /// The radiance from direction `d` (unit), linear between pixels.
    pub fn bilinear(&self, d: Vec3) -> Vec3 {
        let ([x, y], [tx, ty]) = self.place(d);
        let row = |y| self.at(x, y) * (1.0 - tx) + self.at(x + 1, y) * tx;
        row(y) * (1.0 - ty) + row(y + 1) * ty
    }

    /// The same by Catmull and Rom's cubic, for pictures that are smooth from pixel to pixel.
    pub fn bicubic(&self, d: Vec3) -> Vec3 {
        let ([x, y], [tx, ty]) = self.place(d);
        let (wx, wy) = (catmull_rom(tx), catmull_rom(ty));
        let mut sum = Vec3::ZERO;
        for (j, wy) in (y - 1..).zip(wy) {
            let mut row = Vec3::ZERO;
            for (i, wx) in (x - 1..).zip(wx) {
                row += self.at(i, j) * wx;
            }
            sum += row * wy;
        }
        sum
    }

    /// The picture in another size: each pixel is the mean over its own solid angle.
    pub fn resampled(&self, width: usize, height: usize) -> Self {
        let columns = overlaps(self.width, width, |u| u);
        let rows = overlaps(self.height, height, |v| -(std::f64::consts::PI * v).cos());
        let mut pixels = Vec::with_capacity(width * height);
        for rows in &rows {
            let mut band = vec![[0.0_f64; 3]; self.width];
            for &(y, weight) in rows {
                let row = &self.pixels[y * self.width..][..self.width];
                for (sum, pixel) in band.iter_mut().zip(row) {
                    for c in 0..3 {
                        sum[c] += weight * f64::from(pixel[c]);
                    }
                }
            }
            pixels.extend(columns.iter().map(|columns| {
                let mut sum = [0.0_f64; 3];
                for &(x, weight) in columns {
                    for c in 0..3 {
                        sum[c] += weight * band[x][c];
                    }
                }
                sum.map(|v| v as f32)
            }));
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Where a direction lies: the pixel before it and the fraction to the next, in columns and rows.
    fn place(&self, d: Vec3) -> ([i32; 2], [f32; 2]) {
        let azimuth = d.y.atan2(d.x);
        // The arc sine would lose the poles.
        let elevation = d.z.atan2(d.x.hypot(d.y));
        let (x, tx) = split((0.5 - azimuth / TAU) * self.width as f32 - 0.5);
        let (y, ty) = split((0.5 - elevation / PI) * self.height as f32 - 0.5);
        ([x, y], [tx, ty])
    }

    /// A pixel; beyond a pole the picture goes on half a turn away.
    fn at(&self, x: i32, y: i32) -> Vec3 {
        let (width, height) = (self.width as i32, self.height as i32);
        let (x, y) = if y < 0 {
            (x + width / 2, -1 - y)
        } else if y >= height {
            (x + width / 2, 2 * height - 1 - y)
        } else {
            (x, y)
        };
        Vec3::from(self.pixels[(y * width + x.rem_euclid(width)) as usize])
    }
}

/// Share of the sphere's height, 0 to 2, above the upper edge of a row.
fn sphere_above(row: usize, height: usize) -> f64 {
    1.0 - (std::f64::consts::PI * row as f64 / height as f64).cos()
}

/// The whole part and the fraction, with fractions that are rounding snapped.
fn split(v: f32) -> (i32, f32) {
    // A direction that is NaN must not index anywhere.
    let v = if v.is_finite() { v } else { 0.0 };
    let nearest = v.round();
    if (v - nearest).abs() < SNAP {
        (nearest as i32, 0.0)
    } else {
        (v.floor() as i32, v - v.floor())
    }
}

/// Weights of the four pixels around a place, `t` of the way from the second to the third.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * (t3 - t2),
    ]
}

/// For each of `n_out` cells the cells of `n_in` that it overlaps, with weights of sum 1; `measure` grows over `[0, 1]`.
fn overlaps(n_in: usize, n_out: usize, measure: impl Fn(f64) -> f64) -> Vec<Vec<(usize, f64)>> {
    let cell = |o: usize| {
        let (low, high) = (o as f64 / n_out as f64, (o as f64 + 1.0) / n_out as f64);
        let whole = measure(high) - measure(low);
        let first = (low * n_in as f64).floor() as usize;
        let last = ((high * n_in as f64).ceil() as usize).clamp(first + 1, n_in);
        let share = |i: usize| {
            let (a, b) = (
                low.max(i as f64 / n_in as f64),
                high.min((i as f64 + 1.0) / n_in as f64),
            );
            // Rounding can leave a cell that only touches.
            let share = if b > a { measure(b) - measure(a) } else { 0.0 };
            (i, share / whole)
        };
        (first..last).map(share).filter(|(_, w)| *w > 0.0).collect()
    };
    (0..n_out).map(cell).collect()
}

/// The direction of the middle of pixel `i` in a picture of `width / 2` rows.
#[cfg(test)]
pub(super) fn pixel_direction(width: usize, i: usize) -> Vec3 {
    let (x, y) = (i % width, i / width);
    let azimuth = TAU * (0.5 - (x as f32 + 0.5) / width as f32);
    let elevation = PI * (0.5 - (y as f32 + 0.5) / (width / 2) as f32);
    let (sin, cos) = elevation.sin_cos();
    Vec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: usize, height: usize) -> Equirect {
        let value = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 7.0;
        let pixels = (0..width * height).map(|i| [0, 1, 2].map(|c| value(3 * i + c)));
        Equirect::new(width, height, pixels.collect()).unwrap()
    }

    #[test]
    fn a_pixel_s_own_direction_gives_the_pixel_exactly() {
        let mut picture = noise(1024, 512);
        picture.pixels[1024 * 300 + 1023] = [1e5; 3];
        for y in 0..512 {
            for x in [0, 1, 255, 256, 511, 512, 767, 1022, 1023] {
                let expected = Vec3::from(picture.pixels[y * 1024 + x]);
                let d = pixel_direction(1024, y * 1024 + x);
                assert_eq!(picture.bilinear(d), expected, "linear at ({x}, {y})");
                assert_eq!(picture.bicubic(d), expected, "cubic at ({x}, {y})");
            }
        }
    }

    #[test]
    fn look_ups_are_continuous_across_the_seam_and_the_poles() {
        let picture = noise(16, 8);
        for tiny in [1e-3_f32, -1e-3] {
            let pairs = [
                // Azimuth ±180°.
                [Vec3::new(-1.0, tiny, 0.3), Vec3::new(-1.0, -tiny, 0.3)],
                [Vec3::new(tiny, 0.0, 1.0), Vec3::new(-tiny, 0.0, 1.0)],
                [Vec3::new(0.0, tiny, -1.0), Vec3::new(0.0, -tiny, -1.0)],
            ];
            for [a, b] in pairs {
                for look in [Equirect::bilinear, Equirect::bicubic] {
                    let (at_a, at_b) = (look(&picture, a), look(&picture, b));
                    assert!((at_a - at_b).length() < 3.0, "{a}: {at_a}, {b}: {at_b}");
                }
            }
        }
    }

    #[test]
    fn resampling_keeps_the_mean_over_the_sphere() {
        let picture = noise(60, 30);
        let mean = picture.mean();
        for (width, height) in [(16, 8), (32, 16), (60, 30), (128, 64)] {
            let other = picture.resampled(width, height);
            let error = (other.mean() - mean).abs().max_element() / mean.max_element();
            assert!(error < 1e-5, "{width} x {height}: {error}");
        }
    }

    #[test]
    fn solid_angles_fill_the_sphere() {
        let picture = noise(32, 16);
        let whole: f64 = (0..16).map(|y| 32.0 * picture.solid_angle(y)).sum();
        assert!(
            (whole - 4.0 * std::f64::consts::PI).abs() < 1e-12,
            "{whole}"
        );
    }

    #[test]
    fn useless_sizes_are_refused() {
        for (width, height, n) in [(5, 2, 10), (2, 1, 2), (4, 2, 7)] {
            let picture = Equirect::new(width, height, vec![[0.0; 3]; n]);
            assert!(picture.is_none(), "{width} x {height}");
        }
    }
}
