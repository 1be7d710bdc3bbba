//! Colours in as few bytes as their photo has.

use crate::data::Photo;

/// sRGB colours in `[0, 1]`, quantised.
#[derive(Clone, Debug)]
pub(super) enum SrgbCodes {
    /// Of a photo with 8 bits a colour, exact; blurred ones are rounded to them.
    Eight(Vec<[u8; 3]>),
    /// Of any other photo.
    Sixteen(Vec<[u16; 3]>),
}

impl SrgbCodes {
    /// No colours yet, for those of `photo`.
    pub(super) fn like(photo: &Photo) -> Self {
        match photo {
            Photo::Rgb8 { .. } => Self::Eight(Vec::new()),
            Photo::Ldr { .. } | Photo::Hdr { .. } => Self::Sixteen(Vec::new()),
        }
    }

    /// Adds colours, sRGB. Linear photos are cut where a display would cut them, as 8-bit ones were.
    pub(super) fn extend(&mut self, colors: impl IntoIterator<Item = [f32; 3]>) {
        // Casts cut, which is quicker than rounding.
        let code = |v: f32, largest: f32| v.clamp(0.0, 1.0) * largest + 0.5;
        let colors = colors.into_iter();
        match self {
            Self::Eight(codes) => {
                codes.extend(colors.map(|c| c.map(|v| code(v, f32::from(u8::MAX)) as u8)));
            }
            Self::Sixteen(codes) => {
                codes.extend(colors.map(|c| c.map(|v| code(v, f32::from(u16::MAX)) as u16)));
            }
        }
    }

    /// Gives back memory that was reserved for more.
    pub(super) fn shrink(&mut self) {
        match self {
            Self::Eight(codes) => codes.shrink_to_fit(),
            Self::Sixteen(codes) => codes.shrink_to_fit(),
        }
    }

    /// The `k`-th colour.
    #[inline]
    pub(super) fn srgb(&self, k: usize) -> [f32; 3] {
        match self {
            Self::Eight(codes) => codes[k].map(|c| f32::from(c) / f32::from(u8::MAX)),
            Self::Sixteen(codes) => codes[k].map(|c| f32::from(c) / f32::from(u16::MAX)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_photo_s_own_colours_are_exact() {
        let photos = [
            Photo::Rgb8 {
                width: 256,
                height: 1,
                pixels: (0..=u8::MAX).map(|c| [c; 3]).collect(),
                chroma_block: [1, 1],
            },
            Photo::Ldr {
                width: 256,
                height: 1,
                pixels: (0..=255_u16).map(|c| [c * 251 + 3; 3]).collect(),
            },
        ];
        for photo in photos {
            let mut codes = SrgbCodes::like(&photo);
            codes.extend((0..256).map(|i| photo.srgb(i)));
            for i in 0..256 {
                assert_eq!(codes.srgb(i), photo.srgb(i), "colour {i}");
            }
        }
    }
}
