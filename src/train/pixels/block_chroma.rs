//! The mean chroma of the blocks of pixels that have it in common in their photo's file.
//!
//! The decoder interpolates: along an axis with two pixels a block, three quarters of a pixel's chroma are its own block's and
//! a quarter the next one's, so that of a block's mean three quarters are its own and an eighth either neighbour's.

use glam::Vec3;

use crate::data::Photo;
use crate::train::step::loss::LUMA;

/// A block's share of its decoded mean, and that of either neighbour.
const OWN: f32 = 0.75;
const NEIGHBOUR: f32 = 0.125;
/// Rounds of undoing that. A pattern as fine as the blocks, of which a quarter is left, comes back to nine tenths.
const N_ROUNDS: usize = 8;

/// What the decoded chroma of each block lacks for its mean to be the file's.
#[derive(Debug)]
pub(super) struct BlockChroma {
    /// Columns and rows of a block.
    size: [usize; 2],
    /// Pixels a row.
    width: usize,
    /// sRGB, without luma.
    lacking: Vec<Vec3>,
}

impl BlockChroma {
    /// Of a photo with such blocks; `None` where each pixel has its own chroma.
    pub(super) fn of(photo: &Photo) -> Option<Self> {
        let size = photo.chroma_block().map(|n| n as usize);
        if size == [1, 1] {
            return None;
        }
        let width = photo.width() as usize;
        let mut blocks = Self {
            size,
            width,
            lacking: Vec::new(),
        };
        let n_blocks = blocks.columns() * (photo.height() as usize).div_ceil(size[1]);
        let mut sums = vec![(Vec3::ZERO, 0.0); n_blocks];
        for i in 0..photo.n_pixels() {
            let color = Vec3::from(photo.srgb(i));
            let (sum, n) = &mut sums[blocks.block(i)];
            *sum += color - LUMA.dot(color);
            *n += 1.0;
        }
        let decoded: Vec<Vec3> = sums.into_iter().map(|(sum, n)| sum / n).collect();
        blocks.lacking = vec![Vec3::ZERO; n_blocks];
        for _ in 0..N_ROUNDS {
            let stored = decoded.iter().zip(&blocks.lacking).map(|(a, b)| a + b);
            let again = blocks.decoded_means(stored.collect());
            for (i, lacking) in blocks.lacking.iter_mut().enumerate() {
                *lacking += decoded[i] - again[i];
            }
        }
        Some(blocks)
    }

    /// Pixel `i` of the photo, sRGB, such that its block's mean chroma is the file's.
    pub(super) fn srgb(&self, photo: &Photo, i: usize) -> [f32; 3] {
        (Vec3::from(photo.srgb(i)) + self.lacking[self.block(i)]).to_array()
    }

    /// Blocks a row.
    fn columns(&self) -> usize {
        self.width.div_ceil(self.size[0])
    }

    /// The block of pixel `i`.
    fn block(&self, i: usize) -> usize {
        i / self.width / self.size[1] * self.columns() + i % self.width / self.size[0]
    }

    /// Means over the blocks of what the decoder makes of their `chroma`.
    fn decoded_means(&self, chroma: Vec<Vec3>) -> Vec<Vec3> {
        let columns = self.columns();
        let axes = [(columns, 1), (chroma.len() / columns, columns)];
        let mut means = chroma;
        for ((n, stride), size) in axes.into_iter().zip(self.size) {
            if size != 2 {
                continue;
            }
            let along = |i: usize| {
                let at = i / stride % n;
                let before = means[if at > 0 { i - stride } else { i }];
                let after = means[if at + 1 < n { i + stride } else { i }];
                OWN * means[i] + NEIGHBOUR * (before + after)
            };
            means = (0..means.len()).map(along).collect();
        }
        means
    }
}

/// The pixels of the block around pixel `i` of a picture with `width` columns, ascending; some may lie below the last row.
pub(super) fn block_around(
    i: u32,
    width: u32,
    [columns, rows]: [u32; 2],
) -> impl Iterator<Item = u32> {
    let (left, top) = (i % width / columns * columns, i / width / rows * rows);
    let right = (left + columns).min(width);
    (top..top + rows).flat_map(move |y| (left..right).map(move |x| y * width + x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::read_photo;

    #[test]
    fn blocks_get_the_chroma_that_their_file_has() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let jpeg = include_bytes!("../../../tests/pictures/shared_chroma.jpg");
        std::fs::write(&path, jpeg).unwrap();
        let photo = read_photo(&path).unwrap();
        assert_eq!((photo.width(), photo.height()), (32, 24));
        let blocks = BlockChroma::of(&photo).unwrap();
        let mut worst = [0.0_f32; 2];
        for (x, y) in (0..16).flat_map(|x| (0..12).map(move |y| (x, y))) {
            // As it was drawn.
            let color = [100 + 60 * ((x + y) % 2), 110, 120 - 40 * (x * y % 3 % 2)];
            let color = Vec3::from(color.map(|v| v as f32 / 255.0));
            let mut means = [Vec3::ZERO; 2];
            for i in block_around(2 * y * 32 + 2 * x, 32, [2, 2]) {
                let i = i as usize;
                let pixels = [photo.srgb(i), blocks.srgb(&photo, i)];
                for (mean, v) in means.iter_mut().zip(pixels) {
                    *mean += 0.25 * Vec3::from(v);
                }
            }
            for (worst, mean) in worst.iter_mut().zip(means) {
                let chroma = |v: Vec3| v - LUMA.dot(v);
                *worst = worst.max((chroma(mean) - chroma(color)).abs().max_element());
            }
        }
        let [decoded, undone] = worst;
        assert!(decoded > 0.08 && undone < 0.04, "{worst:?}");
    }

    #[test]
    fn blocks_are_cut_at_the_right_border_and_begin_at_the_top_left() {
        let around = |i, block| block_around(i, 5, block).collect::<Vec<_>>();
        assert_eq!(around(6, [2, 2]), [0, 1, 5, 6]);
        assert_eq!(around(14, [2, 2]), [14, 19]);
        assert_eq!(around(14, [1, 2]), [14, 19]);
        assert_eq!(around(13, [2, 1]), [12, 13]);
        assert_eq!(around(13, [1, 1]), [13]);
    }
}
