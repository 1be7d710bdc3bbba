//! The part of a photo around the object, at a resolution that is worth its time.

use glam::Vec2;

use crate::data::Photo;

/// A grid of samples over a rectangle of a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// The rectangle's first corner, photo pixels.
    pub(super) start: Vec2,
    /// Photo pixels from a sample to the next.
    pub(super) step: f32,
    /// Samples along x.
    pub(super) width: usize,
    /// Samples along y.
    pub(super) height: usize,
}

impl Window {
    /// Over `min..max` (photo pixels, whole), with at most so many samples and no more than one a pixel.
    pub(super) fn over(min: Vec2, max: Vec2, most: usize) -> Self {
        let size = (max - min).max(Vec2::ONE);
        let step = (size.x * size.y / most as f32).sqrt().max(1.0);
        Self {
            start: min,
            step,
            width: (size.x / step).ceil() as usize,
            height: (size.y / step).ceil() as usize,
        }
    }

    /// The same rectangle with at most so many samples.
    pub(super) fn coarser(&self, most: usize) -> Self {
        let [start, end] = self.corners();
        Self::over(start, end, most)
    }

    /// The first corner and the one across, photo pixels.
    pub(super) fn corners(&self) -> [Vec2; 2] {
        let size = self.step * Vec2::new(self.width as f32, self.height as f32);
        [self.start, self.start + size]
    }

    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }

    /// Where sample `i` lies in the photo, pixels.
    pub(super) fn place(&self, i: usize) -> Vec2 {
        let (x, y) = (i % self.width, i / self.width);
        self.start + self.step * (Vec2::new(x as f32, y as f32) + 0.5)
    }

    /// The photo's values as the display shows them (sRGB, 0..1), means over each sample's pixels.
    pub(super) fn colors(&self, photo: &Photo) -> Vec<[f32; 3]> {
        let (width, height) = (photo.width() as usize, photo.height() as usize);
        let half = 0.5 * self.step;
        let range = |at: f32, end: usize| {
            let first = ((at - half).round().max(0.0) as usize).min(end - 1);
            let last = ((at + half).round() as usize).clamp(first + 1, end);
            first..last
        };
        let mean = |i: usize| {
            let at = self.place(i);
            let (columns, rows) = (range(at.x, width), range(at.y, height));
            let n = (columns.len() * rows.len()) as f32;
            let mut sum = [0.0; 3];
            for y in rows {
                for x in columns.clone() {
                    let color = photo.srgb(y * width + x);
                    sum = std::array::from_fn(|c| sum[c] + color[c].clamp(0.0, 1.0));
                }
            }
            sum.map(|v| v / n)
        };
        (0..self.len()).map(mean).collect()
    }

    /// The value of `values`, one a sample, at a place in the photo; linear between samples.
    pub(super) fn sample<const N: usize>(&self, values: &[[f32; N]], at: Vec2) -> [f32; N] {
        let at = (at - self.start) / self.step - 0.5;
        let axis = |at: f32, n: usize| {
            let at = at.clamp(0.0, (n - 1) as f32);
            let first = (at as usize).min(n.saturating_sub(2));
            (first, at - first as f32)
        };
        let ((x, u), (y, v)) = (axis(at.x, self.width), axis(at.y, self.height));
        let right = usize::from(self.width > 1);
        let below = if self.height > 1 { self.width } else { 0 };
        let i = y * self.width + x;
        let mix = |a: f32, b: f32, t: f32| a + t * (b - a);
        std::array::from_fn(|c| {
            let top = mix(values[i][c], values[i + right][c], u);
            let low = mix(values[i + below][c], values[i + below + right][c], u);
            mix(top, low, v)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_window_has_a_sample_a_pixel_and_a_large_one_fewer() {
        let (min, max) = (Vec2::new(3.0, 5.0), Vec2::new(43.0, 25.0));
        let fine = Window::over(min, max, 10_000);
        assert_eq!((fine.width, fine.height, fine.step), (40, 20, 1.0));
        assert_eq!(fine.place(41), Vec2::new(4.5, 6.5));
        let coarse = fine.coarser(200);
        assert_eq!((coarse.width, coarse.height, coarse.step), (20, 10, 2.0));
        assert_eq!(coarse.place(0), Vec2::new(4.0, 6.0));
    }

    #[test]
    fn samples_are_means_of_their_pixels_and_linear_between() {
        let photo = Photo::Rgb8 {
            width: 8,
            height: 4,
            pixels: (0..32).map(|i| [(i % 8) as u8 * 10; 3]).collect(),
            chroma_block: [1, 1],
        };
        let window = Window::over(Vec2::ZERO, Vec2::new(8.0, 4.0), 8);
        let colors = window.colors(&photo);
        assert_eq!((window.width, window.height), (4, 2));
        let values: Vec<f32> = colors.iter().map(|c| c[0] * 255.0).collect();
        for (value, truth) in values.iter().zip([5.0, 25.0, 45.0, 65.0, 5.0]) {
            assert!((value - truth).abs() < 1e-3, "{values:?}");
        }
        let [red, ..] = window
            .sample(&colors, Vec2::new(2.0, 1.0))
            .map(|v| v * 255.0);
        assert!((red - 15.0).abs() < 1e-3, "{red}");
    }
}
