//! Colour: the sRGB transfer curve in both directions, its slope, luminance and exposure.
//!
//! Photos are stored sRGB-encoded, light is computed linearly (scene-linear Rec. 709). Every
//! crossing between the two goes through this file. The curve is the exact piecewise one of
//! IEC 61966-2-1; below its foot it is continued as the straight line, so negative values keep
//! their sign, and nothing finite becomes infinite.

pub mod map;

use glam::Vec3;

/// Linear value at which the curve changes from a line to a power.
const LINEAR_KNEE: f32 = 0.003_130_8;
/// The same point, sRGB-encoded.
const SRGB_KNEE: f32 = 0.040_45;
/// Smallest linear value whose encoded one is still a finite `f32`.
const LINEAR_MIN: f32 = -2.6e37;
/// Largest encoded magnitude whose linear value is still a finite `f32`.
const SRGB_LIMIT: f32 = 1e16;

/// The sRGB-encoded value of a linear one (both nominally 0..1, any finite value accepted).
///
/// `12.92 x` up to 0.0031308, then `1.055 x^(1/2.4) - 0.055` (IEC 61966-2-1). Values below -2.6e37 are clamped there:
/// their encoded value would overflow. NaN stays NaN.
#[inline]
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= LINEAR_KNEE {
        12.92 * linear.max(LINEAR_MIN)
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// The linear value of an sRGB-encoded one; the inverse of [`srgb_from_linear`].
///
/// Magnitudes above 1e16 are clamped there: their linear value would overflow.
#[inline]
pub fn linear_from_srgb(srgb: f32) -> f32 {
    let srgb = srgb.clamp(-SRGB_LIMIT, SRGB_LIMIT);
    if srgb <= SRGB_KNEE {
        srgb / 12.92
    } else {
        ((srgb + 0.055) / 1.055).powf(2.4)
    }
}

/// The derivative of [`srgb_from_linear`] at `linear`.
#[inline]
pub fn srgb_slope(linear: f32) -> f32 {
    if linear <= LINEAR_KNEE {
        12.92
    } else {
        (1.055 / 2.4) * linear.powf(1.0 / 2.4 - 1.0)
    }
}

/// The relative luminance of a linear Rec. 709 colour.
#[inline]
pub fn luminance(linear: Vec3) -> f32 {
    linear.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The factor by which an exposure of `ev` stops multiplies light: `2^ev`.
#[inline]
pub fn exposure_gain(ev: f32) -> f32 {
    ev.exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Any finite float: half of them over all exponents, half of them in `[-4, 4]`.
    fn finite() -> impl Strategy<Value = f32> {
        use proptest::num::f32::{NORMAL, SUBNORMAL, ZERO};
        prop_oneof![NORMAL | SUBNORMAL | ZERO, -4.0_f32..4.0]
    }

    proptest! {
        #[test]
        fn both_curves_are_finite_and_grow(a in finite(), b in finite()) {
            for curve in [srgb_from_linear, linear_from_srgb] {
                let (low, high) = (curve(a.min(b)), curve(a.max(b)));
                prop_assert!(low.is_finite() && high.is_finite(), "{low} and {high}");
                // The standard's two pieces meet to seven digits.
                prop_assert!(low <= high + 1e-6 * high.abs(), "{low} above {high}");
                prop_assert!(curve(f32::NAN).is_nan());
            }
            prop_assert!(srgb_slope(a) >= 0.0 && srgb_slope(a).is_finite());
        }

        #[test]
        fn decoding_undoes_encoding_over_all_exponents(x in finite()) {
            // Beyond these the encoded value is clamped.
            let linear = x.clamp(-1e14, 1e38);
            let back = linear_from_srgb(srgb_from_linear(linear));
            prop_assert!((back - linear).abs() <= 1e-5 * linear.abs(), "{back}");
        }
    }

    #[test]
    fn encoding_and_decoding_are_inverse() {
        for i in -200..=2000 {
            let linear = i as f32 / 1000.0;
            let back = linear_from_srgb(srgb_from_linear(linear));
            assert!((back - linear).abs() < 2e-6, "{linear} came back as {back}");
        }
    }

    #[test]
    fn known_values_of_the_standard_hold() {
        assert!((srgb_from_linear(0.5) - 0.735_357).abs() < 1e-5, "mid grey");
        assert!(
            (linear_from_srgb(0.5) - 0.214_041).abs() < 1e-5,
            "half code"
        );
        assert!((srgb_from_linear(1.0) - 1.0).abs() < 1e-6, "white");
        assert_eq!(srgb_from_linear(0.0), 0.0, "black");
    }

    #[test]
    fn every_finite_value_stays_finite() {
        for magnitude in [0.0, 1e-38, 1e-3, 1.0, 1e5, 1e30, f32::MAX / 20.0] {
            for x in [magnitude, -magnitude] {
                assert!(srgb_from_linear(x).is_finite(), "encode {x}");
                assert!(linear_from_srgb(x).is_finite(), "decode {x}");
                assert!(srgb_slope(x).is_finite(), "slope {x}");
            }
        }
        assert!(linear_from_srgb(f32::MAX).is_finite(), "the largest value");
    }

    #[test]
    fn slope_agrees_with_finite_differences() {
        for x in [-0.1_f32, 0.001, 0.01, 0.2, 0.9, 3.0] {
            let h = 1e-3 * x.abs().max(1e-2);
            let d = (srgb_from_linear(x + h) - srgb_from_linear(x - h)) / (2.0 * h);
            let slope = srgb_slope(x);
            assert!(
                (d - slope).abs() < 2e-3 * slope,
                "at {x}: {d} against {slope}"
            );
        }
    }

    #[test]
    fn luminance_of_white_is_one_and_a_stop_doubles() {
        assert!(
            (luminance(Vec3::ONE) - 1.0).abs() < 1e-6,
            "weights sum to one"
        );
        assert_eq!(exposure_gain(1.0), 2.0, "one stop");
    }
}
