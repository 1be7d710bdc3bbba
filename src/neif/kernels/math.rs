//! Branch-free elementary functions that vectorise inside a kernel.

use super::{Baseline, Isa, fma};

/// Largest argument of [`exp`]: `exp(88.0)` is still finite in `f32`.
const EXP_MAX: f32 = 88.0;
/// Smallest argument of [`exp`]; below it the result would be denormal and slow.
const EXP_MIN: f32 = -87.0;

/// `e^x` for `x` clamped to `[-87, 88]`, relative error below 3e-7.
///
/// Range reduction by `ln 2` in two parts and a degree-5 polynomial (Cephes `expf`). NaN gives `exp(-87)`.
#[inline(always)]
#[expect(
    clippy::manual_clamp,
    reason = "`clamp` keeps NaN, these map it to the lower end"
)]
pub fn exp<I: Isa>(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    // Adding and subtracting 1.5·2^23 rounds to the nearest integer without a library call.
    const ROUND: f32 = 12_582_912.0;
    let x = x.max(EXP_MIN).min(EXP_MAX);
    let n = fma::<I>(x, LOG2_E, ROUND) - ROUND;
    let r = fma::<I>(n, -LN2_HIGH, x);
    let r = fma::<I>(n, -LN2_LOW, r);
    let mut p = 1.987_569_1e-4;
    p = fma::<I>(p, r, 1.398_199_9e-3);
    p = fma::<I>(p, r, 8.333_452e-3);
    p = fma::<I>(p, r, 4.166_579_6e-2);
    p = fma::<I>(p, r, 1.666_666_5e-1);
    p = fma::<I>(p, r, 5e-1);
    let y = fma::<I>(p, r * r, r) + 1.0;
    // n is in [-126, 127], so the biased exponent stays in range; `to_int_unchecked` is not needed
    // because the value is read off the mantissa of n + ROUND.
    let bits = (n + ROUND).to_bits() << 23;
    y * f32::from_bits(bits.wrapping_add(127 << 23))
}

/// `floor(x)` for `x` in `[0, 2^22)`, as a float and as an integer, without the scalar code that a saturating cast becomes.
///
/// Adding 2^23 leaves the rounded integer in the mantissa's low bits.
#[inline(always)]
pub fn floor_small(x: f32) -> (f32, u32) {
    const SHIFT: f32 = 8_388_608.0;
    let rounded = (x + SHIFT) - SHIFT;
    let floor = if rounded > x { rounded - 1.0 } else { rounded };
    (floor, (floor + SHIFT).to_bits() & 0x007f_ffff)
}

/// A bf16, the upper half of an `f32`, as one.
#[inline(always)]
pub fn f32_from_bf16(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << 16)
}

/// The nearest bf16.
#[inline(always)]
pub fn bf16_from_f32(value: f32) -> u16 {
    (value.to_bits().wrapping_add(0x8000) >> 16) as u16
}

/// The cube root of a positive normal `x`, relative error below 1e-6: a guess from the exponent, two Newton steps.
#[inline(always)]
pub fn cbrt(x: f32) -> f32 {
    // A third of the biased exponent, with the bias put right (Kahan's constant for single precision).
    let mut y = f32::from_bits(x.to_bits() / 3 + 0x2a51_19f2);
    for _ in 0..2 {
        y = (2.0 * y + x / (y * y)) * (1.0 / 3.0);
    }
    y
}

/// Whether no value is infinite or NaN. Sixteen at a time: a sum one after another waits for each addition.
pub fn all_finite(values: &[f32]) -> bool {
    let (blocks, rest) = values.as_chunks::<16>();
    let mut sums = [0.0; 16];
    for block in blocks {
        for (sum, value) in sums.iter_mut().zip(block) {
            *sum += value * 0.0;
        }
    }
    sums.iter().chain(rest).all(|v| v.is_finite())
}

/// `1 / (1 + e^-x)`, in `[0, 1]`; NaN stays NaN.
pub fn sigmoid(x: f32) -> f32 {
    let y = 1.0 / (1.0 + exp::<Baseline>(-x));
    // `exp` maps NaN to its lower end: a broken network would look like a white, rough surface.
    if x.is_nan() { x } else { y }
}

/// `ln(1 + e^x)`, positive, without overflow.
pub fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::super::Avx2;
    use super::*;

    #[test]
    fn exp_agrees_with_the_library_over_its_range() {
        for i in -8700..=8800 {
            let x = i as f32 * 0.01;
            for y in [exp::<Baseline>(x), exp::<Avx2>(x)] {
                let relative = (y as f64 / (x as f64).exp() - 1.0).abs();
                assert!(relative < 3e-7, "exp({x}) = {y}, off by {relative}");
            }
        }
    }

    #[test]
    fn what_is_not_finite_is_found_wherever_it_is() {
        for at in 0..37 {
            let mut values = [f32::MAX; 37];
            assert!(all_finite(&values), "of finite ones");
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                values[at] = bad;
                assert!(!all_finite(&values), "{bad} at {at}");
            }
        }
        assert!(all_finite(&[]), "of none");
    }

    #[test]
    fn cbrt_agrees_with_the_library() {
        for i in 0..10_000 {
            let x = (f64::from(i - 5000) * 0.0013).exp() as f32;
            let relative = (f64::from(cbrt(x)) / f64::from(x).cbrt() - 1.0).abs();
            assert!(relative < 2e-6, "cbrt({x}) is off by {relative}");
        }
    }

    #[test]
    fn floor_agrees_with_the_library() {
        for i in 0..100_000 {
            let x = i as f32 * 0.37;
            assert_eq!(floor_small(x), (x.floor(), x as u32), "{x}");
        }
        assert_eq!(floor_small(4_194_303.0), (4_194_303.0, 4_194_303));
    }

    #[test]
    fn exp_is_finite_and_positive_for_any_input() {
        for x in [
            f32::NEG_INFINITY,
            f32::MIN,
            -1e4,
            0.0,
            -0.0,
            1e4,
            f32::MAX,
            f32::INFINITY,
            f32::NAN,
        ] {
            let y = exp::<Baseline>(x);
            assert!(y.is_finite() && y > 0.0, "exp({x}) = {y}");
        }
    }
}
