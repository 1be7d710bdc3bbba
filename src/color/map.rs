//! Colours for numbers: one map for amounts, one for differences of either sign.
//!
//! Both are dark where nothing is and grow lighter from there, so that they read the same in grey, and neither puts red
//! against green: they serve every kind of colour vision.

/// Stops of matplotlib's magma (Smith and van der Walt, CC0), at equal distances.
const MAGMA: [[u8; 3]; 9] = [
    [0, 0, 4],
    [29, 17, 71],
    [81, 18, 124],
    [130, 38, 129],
    [182, 54, 121],
    [230, 81, 100],
    [251, 136, 97],
    [254, 194, 135],
    [252, 253, 191],
];
/// Blue below, orange above, grey between.
const BLUE_ORANGE: [[u8; 3]; 7] = [
    [150, 205, 255],
    [52, 140, 220],
    [22, 70, 125],
    NEUTRAL,
    [140, 70, 10],
    [225, 135, 40],
    [255, 214, 150],
];
/// No difference.
pub const NEUTRAL: [u8; 3] = [32, 32, 32];

/// From numbers to colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorMap {
    /// For amounts: 0 is nearly black, 1 nearly white.
    Sequential,
    /// For differences: 0 is blue, one half [`NEUTRAL`], 1 orange.
    Diverging,
}

impl ColorMap {
    /// The sRGB colour of `t`, which is clamped to `[0, 1]`; what is no number is as dark as nothing.
    pub fn srgb8(self, t: f32) -> [u8; 3] {
        let (stops, nothing): (&[[u8; 3]], f32) = match self {
            Self::Sequential => (&MAGMA, 0.0),
            Self::Diverging => (&BLUE_ORANGE, 0.5),
        };
        let t = if t.is_nan() { nothing } else { t };
        let at = t.clamp(0.0, 1.0) * (stops.len() - 1) as f32;
        let below = (at as usize).min(stops.len() - 2);
        let share = at - below as f32;
        std::array::from_fn(|c| {
            let (a, b) = (f32::from(stops[below][c]), f32::from(stops[below + 1][c]));
            (a + (b - a) * share).round() as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{linear_from_srgb, luminance};
    use glam::Vec3;

    /// Luminance at `n + 1` equal steps.
    fn luminances(map: ColorMap, n: usize) -> Vec<f32> {
        let linear = |c: u8| linear_from_srgb(f32::from(c) / 255.0);
        let at = |i: usize| map.srgb8(i as f32 / n as f32).map(linear);
        (0..=n).map(|i| luminance(Vec3::from(at(i)))).collect()
    }

    #[test]
    fn more_is_lighter() {
        let steps = luminances(ColorMap::Sequential, 40);
        assert!(steps.windows(2).all(|w| w[0] < w[1]), "{steps:?}");
    }

    #[test]
    fn differences_grow_lighter_from_a_grey_zero_to_both_sides() {
        let steps = luminances(ColorMap::Diverging, 40);
        assert!(steps[..=20].windows(2).all(|w| w[0] > w[1]), "{steps:?}");
        assert!(steps[20..].windows(2).all(|w| w[0] < w[1]), "{steps:?}");
        assert_eq!(ColorMap::Diverging.srgb8(0.5), NEUTRAL);
    }

    #[test]
    fn odd_numbers_have_colours_too() {
        for map in [ColorMap::Sequential, ColorMap::Diverging] {
            assert_eq!(map.srgb8(f32::INFINITY), map.srgb8(1.0));
            assert_eq!(map.srgb8(-7.0), map.srgb8(0.0));
        }
        assert_eq!(ColorMap::Diverging.srgb8(f32::NAN), NEUTRAL);
    }
}
