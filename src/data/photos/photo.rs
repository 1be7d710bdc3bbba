//! Pixels in memory: photos and object masks.

use crate::color::{linear_from_srgb, srgb_from_linear};

/// A picture, row-major from the top left; index `i = y * width + x`.
#[derive(Clone, Debug)]
pub enum Photo {
    /// From PNG or JPEG of 8 bits a colour: sRGB-encoded, `0..=255` for 0..1.
    Rgb8 {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// `[height * width]` RGB.
        pixels: Vec<[u8; 3]>,
        /// Columns and rows of the blocks, from the top left, whose pixels have their chroma in common, as JPEG files of most
        /// cameras store it; 1 and 1: each pixel has its own.
        chroma_block: [u32; 2],
    },
    /// From PNG of 16 bits a colour: sRGB-encoded, `0..=65535` for 0..1.
    Ldr {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// `[height * width]` RGB.
        pixels: Vec<[u16; 3]>,
    },
    /// From EXR or HDR: scene-linear Rec. 709, unbounded, finite.
    Hdr {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// `[height * width]` RGB.
        pixels: Vec<[f32; 3]>,
    },
}

impl Photo {
    /// Columns.
    pub fn width(&self) -> u32 {
        match self {
            Self::Rgb8 { width, .. } | Self::Ldr { width, .. } | Self::Hdr { width, .. } => *width,
        }
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        match self {
            Self::Rgb8 { height, .. } | Self::Ldr { height, .. } | Self::Hdr { height, .. } => {
                *height
            }
        }
    }

    /// Pixels in all.
    pub fn n_pixels(&self) -> usize {
        self.width() as usize * self.height() as usize
    }

    /// Columns and rows of the blocks whose pixels have their chroma in common; 1 and 1: each pixel has its own.
    pub fn chroma_block(&self) -> [u32; 2] {
        match self {
            Self::Rgb8 { chroma_block, .. } => *chroma_block,
            Self::Ldr { .. } | Self::Hdr { .. } => [1, 1],
        }
    }

    /// Pixel `i`, sRGB-encoded; above 1 only for [`Photo::Hdr`].
    #[inline]
    pub fn srgb(&self, i: usize) -> [f32; 3] {
        match self {
            Self::Rgb8 { pixels, .. } => pixels[i].map(|c| f32::from(c) / 255.0),
            Self::Ldr { pixels, .. } => pixels[i].map(|c| f32::from(c) / 65535.0),
            Self::Hdr { pixels, .. } => pixels[i].map(srgb_from_linear),
        }
    }

    /// Pixel `i`, scene-linear.
    #[inline]
    pub fn linear(&self, i: usize) -> [f32; 3] {
        match self {
            Self::Rgb8 { .. } | Self::Ldr { .. } => self.srgb(i).map(linear_from_srgb),
            Self::Hdr { pixels, .. } => pixels[i],
        }
    }

    /// Whether pixels are linear and may exceed 1.
    pub fn is_linear_hdr(&self) -> bool {
        matches!(self, Self::Hdr { .. })
    }
}

/// How much of each pixel the object covers, row-major like the photo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]`; 255 = all object.
    pub coverage: Vec<u8>,
}

impl Mask {
    /// The covered share of pixel `i`, 0..1.
    #[inline]
    pub fn share(&self, i: usize) -> f32 {
        f32::from(self.coverage[i]) / 255.0
    }

    /// Whether more than half of pixel `i` is object.
    #[inline]
    pub fn is_object(&self, i: usize) -> bool {
        self.coverage[i] > 127
    }

    /// The covered share of the whole picture, 0..1.
    pub fn mean(&self) -> f32 {
        let sum: u64 = self.coverage.iter().map(|c| u64::from(*c)).sum();
        (sum as f64 / (255.0 * self.coverage.len().max(1) as f64)) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bit_codes_are_the_same_in_either_storage() {
        let narrow = Photo::Rgb8 {
            width: 256,
            height: 1,
            pixels: (0..=u8::MAX).map(|c| [c; 3]).collect(),
            chroma_block: [1, 1],
        };
        let wide = Photo::Ldr {
            width: 256,
            height: 1,
            pixels: (0..=255_u16).map(|c| [c * 257; 3]).collect(),
        };
        for i in 0..256 {
            let [r, ..] = narrow.srgb(i);
            assert!((r - i as f32 / 255.0).abs() < 1e-6, "code {i} became {r}");
            assert_eq!(narrow.srgb(i), wide.srgb(i), "code {i}");
        }
    }

    #[test]
    fn hdr_pixels_keep_their_range() {
        let photo = Photo::Hdr {
            width: 1,
            height: 1,
            pixels: vec![[0.0, 1.0, 1e5]],
        };
        assert_eq!(photo.linear(0), [0.0, 1.0, 1e5], "linear");
        assert!(photo.srgb(0)[2] > 100.0, "encoded above one");
    }
}
