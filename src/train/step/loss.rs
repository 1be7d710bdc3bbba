//! The squared error of a pixel behind the display transform.

use glam::Vec3;

use crate::color::{srgb_from_linear, srgb_slope};
use crate::neif::light::display::Display;

/// Distance of the two points of a smoothness difference, in sides of the material's cube.
pub(in crate::train) const SMOOTHNESS_STEP: f32 = 0.004;

/// Target from which a pixel counts as clipped.
pub(in crate::train) const CLIPPED: f32 = 0.998;
/// Radiance of a clipped colour beside one that is not.
const PARTLY_CLIPPED: f32 = 1.2;
/// Targets between which it matters less and less how much brighter than white a pixel is predicted: JPEG leaves more than half of a
/// clipped area a little below white.
const ALMOST_CLIPPED: [f32; 2] = [0.75, 0.95];
/// Lower end of the logarithm in the exponent's gradient: `ln 0`.
const TINY: f32 = 1e-6;

/// The colours' shares in a JPEG's luma (Rec. 601).
pub(in crate::train) const LUMA: Vec3 = Vec3::new(0.299, 0.587, 0.114);

/// Error of one pixel and its gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::train) struct PixelLoss {
    /// Sum of squared differences over the colours.
    pub value: f32,
    /// What is shown less the target, and its slope by the linear radiance; 0 where a clipped target constrains nothing.
    pub difference: Vec3,
    pub slope: Vec3,
    /// Slope of what is shown by the exponent.
    gamma_slope: Vec3,
    /// Gradient of the loss by what is shown.
    d_shown: Vec3,
}

impl PixelLoss {
    /// Gradient by the linear radiance.
    pub(in crate::train) fn d_linear(&self) -> Vec3 {
        self.d_shown * self.slope
    }

    /// Gradient by the exponent.
    pub(in crate::train) fn d_gamma(&self) -> f32 {
        self.d_shown.dot(self.gamma_slope)
    }
}

/// `|srgb(C)^gamma - target|²` with its gradients (Eq. 9), clipped as photos are.
pub(in crate::train) fn pixel_loss(display: Display, linear: Vec3, target: [f32; 3]) -> PixelLoss {
    let mut loss = PixelLoss::default();
    for c in 0..3 {
        // `max` would turn NaN into 0 and hide it from the non-finite check.
        let x = if linear[c] < 0.0 { 0.0 } else { linear[c] };
        let (shown, slope, gamma_slope) = shown(display, x, target[c]);
        let difference = shown - target[c];
        loss.value += difference * difference;
        loss.difference[c] = difference;
        loss.slope[c] = slope;
        loss.gamma_slope[c] = gamma_slope;
        loss.d_shown[c] = 2.0 * difference;
    }
    loss
}

/// Turns the losses of pixels of which a photo knows each one's luma but only the mean of their chroma into what they are
/// wrong by in that: each is off by its own luma and by the mean of all chroma.
pub(in crate::train) fn share_chroma(losses: &mut [PixelLoss]) {
    let n = losses.len().max(1) as f32;
    let luma = |loss: &PixelLoss| LUMA.dot(loss.difference);
    let chroma = |loss: &PixelLoss| loss.difference - luma(loss);
    let mean = losses.iter().map(chroma).sum::<Vec3>() / n;
    // What each one's chroma does to all of them by way of the mean, which weighs luma not at all.
    let by_mean = losses.iter().map(|loss| 2.0 * (luma(loss) + mean));
    let by_mean = by_mean.sum::<Vec3>() / n;
    let by_mean = by_mean - LUMA * by_mean.element_sum();
    for loss in losses {
        loss.difference = luma(loss) + mean;
        loss.value = loss.difference.length_squared();
        loss.d_shown = 2.0 * loss.difference.element_sum() * LUMA + by_mean;
    }
}

/// Turns the losses of pixels of whose chroma a photo knows nothing into what they are wrong by in their luma.
pub(in crate::train) fn keep_luma(losses: &mut [PixelLoss]) {
    for loss in losses {
        loss.difference = Vec3::splat(LUMA.dot(loss.difference));
        loss.value = loss.difference.length_squared();
        loss.d_shown = 2.0 * loss.difference.element_sum() * LUMA;
    }
}

/// What a photo shows of the radiance `x >= 0`, and its slopes by that and by the exponent. Above white it saturates as photos
/// do: that a lamp of twenty times white lies half a pixel beside where it is predicted does not make it dim. What is left of
/// the slope there, so that a lamp can fade where there is none, goes as the target gets white itself.
fn shown(display: Display, x: f32, target: f32) -> (f32, f32, f32) {
    if x > 1.0 {
        let [from, to] = ALMOST_CLIPPED;
        let share = ((to - target) / (to - from)).clamp(0.0, 1.0);
        let slope = share * srgb_slope(1.0);
        let above = slope * (1.0 - 1.0 / x);
        let shown = 1.0 + display.gamma * above;
        return (shown, display.gamma * slope / (x * x), above);
    }
    let (srgb, shown) = (srgb_from_linear(x), display.value(x));
    // d srgb^g = g srgb^(g-1); the ratio shown/srgb is 1 where both vanish.
    let ratio = if srgb > TINY { shown / srgb } else { 1.0 };
    let slope = display.gamma * ratio * srgb_slope(x);
    (shown, slope, shown * srgb.max(TINY).ln())
}

/// Radiance that a clipped colour is taken for: `lamp` where all three are clipped. A saturated light that clips in one
/// or two is hardly brighter than white, as otherwise the rest of its colour would be bright too.
pub(in crate::train) fn unclipped(srgb: [f32; 3], lamp: f32) -> f32 {
    if srgb.iter().all(|v| *v >= CLIPPED) {
        lamp
    } else {
        lamp.min(PARTLY_CLIPPED)
    }
}

/// `ln(radiance / light)²` in the colours whose target is clipped, and its gradient by the light. What shines on an object may
/// show that a lamp is brighter: then it is pulled up only.
pub(in crate::train) fn clipped_pull(
    light: Vec3,
    target: [f32; 3],
    radiance: f32,
    is_up_only: bool,
) -> (f32, Vec3) {
    let (mut value, mut d_light) = (0.0, Vec3::ZERO);
    let radiance = unclipped(target, radiance);
    for c in 0..3 {
        // Below white the pixel's own error is at work.
        let is_free = is_up_only && light[c] > radiance;
        if target[c] >= CLIPPED && light[c] >= 0.5 && !is_free {
            let log = (radiance / light[c]).ln();
            value += log * log;
            d_light[c] = -2.0 * log / light[c];
        }
    }
    (value, d_light)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_agree_with_finite_differences() {
        for gamma in [1.0_f32, 0.8, 1.3] {
            let (linear, target) = (Vec3::new(0.3, 0.02, 1.4), [0.5, 0.1, 0.9]);
            let loss = pixel_loss(Display { gamma }, linear, target);
            let h = 1e-3;
            for c in 0..3 {
                let at = |s: f32| {
                    pixel_loss(Display { gamma }, linear + Vec3::AXES[c] * s, target).value
                };
                let numeric = (at(h) - at(-h)) / (2.0 * h);
                assert!(
                    (loss.d_linear()[c] - numeric).abs() < 1e-2 * numeric.abs() + 1e-3,
                    "gamma {gamma}, colour {c}"
                );
            }
            let at = |g: f32| pixel_loss(Display { gamma: g }, linear, target).value;
            let numeric = (at(gamma + h) - at(gamma - h)) / (2.0 * h);
            assert!(
                (loss.d_gamma() - numeric).abs() < 1e-2 * numeric.abs() + 1e-3,
                "gamma {gamma}"
            );
        }
    }

    #[test]
    fn of_shared_chroma_the_mean_is_compared_and_of_luma_all() {
        let display = Display { gamma: 0.9 };
        let targets = [[0.3, 0.4, 0.5], [0.6, 0.5, 0.2], [0.2, 0.7, 0.4]];
        let linear = [
            Vec3::new(0.1, 0.3, 0.2),
            Vec3::new(0.4, 0.2, 0.1),
            Vec3::new(0.02, 0.5, 0.3),
        ];
        let lumas = |losses: &[PixelLoss]| -> Vec<f32> {
            let luma = |loss: &PixelLoss| LUMA.dot(loss.difference);
            losses.iter().map(luma).collect()
        };
        let mean = |losses: &[PixelLoss]| losses.iter().map(|l| l.difference).sum::<Vec3>() / 3.0;
        for (change, is_shared) in [
            (share_chroma as fn(&mut [PixelLoss]), true),
            (keep_luma, false),
        ] {
            let losses = |display, linear: [Vec3; 3]| {
                let mut losses: Vec<PixelLoss> = linear
                    .into_iter()
                    .zip(targets)
                    .map(|(linear, target)| pixel_loss(display, linear, target))
                    .collect();
                let alone = losses.clone();
                change(&mut losses);
                (losses, alone)
            };
            let value = |display, linear| -> f32 {
                losses(display, linear).0.iter().map(|l| l.value).sum()
            };
            let (found, alone) = losses(display, linear);
            for (luma, before) in lumas(&found).iter().zip(lumas(&alone)) {
                assert!((luma - before).abs() < 1e-6, "{luma}, {before}");
            }
            // What is left of their colours is the same in all.
            let chroma = |loss: &PixelLoss| loss.difference - LUMA.dot(loss.difference);
            assert!(chroma(&found[0]).abs_diff_eq(chroma(&found[2]), 1e-6));
            let expected = if is_shared {
                mean(&alone)
            } else {
                Vec3::splat(LUMA.dot(mean(&alone)))
            };
            assert!(mean(&found).abs_diff_eq(expected, 1e-6), "{expected}");
            let h = 1e-3;
            for (i, loss) in found.iter().enumerate() {
                for c in 0..3 {
                    let at = |s: f32| {
                        let mut moved = linear;
                        moved[i][c] += s;
                        value(display, moved)
                    };
                    let numeric = (at(h) - at(-h)) / (2.0 * h);
                    let off = (loss.d_linear()[c] - numeric).abs();
                    assert!(off < 1e-2 * numeric.abs() + 1e-3, "{i}, colour {c}");
                }
            }
            let at = |s: f32| value(Display { gamma: 0.9 + s }, linear);
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            let d: f32 = found.iter().map(PixelLoss::d_gamma).sum();
            assert!((d - numeric).abs() < 1e-2 * numeric.abs() + 1e-3, "{d}");
        }
    }

    #[test]
    fn brighter_than_a_clipped_target_is_not_wrong() {
        let loss = pixel_loss(Display { gamma: 1.0 }, Vec3::splat(7.0), [1.0; 3]);
        assert_eq!((loss.value, loss.d_linear()), (0.0, Vec3::ZERO));
    }

    #[test]
    fn a_lamp_is_hardly_contradicted_by_what_is_almost_white_and_fades_where_there_is_none() {
        let loss = |target: f32| {
            pixel_loss(
                Display { gamma: 1.0 },
                Vec3::new(20.0, 2.0, 1.5),
                [target; 3],
            )
        };
        assert_eq!(loss(0.96).d_linear(), Vec3::ZERO);
        let (beside, rim) = (loss(0.3), loss(0.9));
        assert!(beside.d_linear().cmpgt(Vec3::ZERO).all(), "{beside:?}");
        assert!(
            rim.d_linear().cmplt(0.1 * beside.d_linear()).all(),
            "{rim:?}"
        );
        // However bright, it is wrong by little more than white is.
        assert!(beside.difference.max_element() < 1.2, "{beside:?}");
    }

    #[test]
    fn clipped_light_is_pulled_to_the_given_radiance_from_both_sides() {
        let (light, target) = (Vec3::new(0.9, 20.0, 0.3), [1.0, 1.0, 0.4]);
        let (_, d) = clipped_pull(light, target, 5.0, false);
        for c in 0..3 {
            let h = 1e-3;
            let at = |s: f32| clipped_pull(light + Vec3::AXES[c] * s, target, 5.0, false).0;
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            assert!((d[c] - numeric).abs() < 1e-2 * numeric.abs() + 1e-4, "{c}");
        }
        assert!(d.x < 0.0 && d.y > 0.0 && d.z == 0.0, "{d}");
        let (_, d) = clipped_pull(light, target, 5.0, true);
        assert!(d.x < 0.0 && d.y == 0.0, "{d}");
        let (value, d) = clipped_pull(Vec3::splat(6.0), [1.0; 3], 5.0, true);
        assert_eq!((value, d), (0.0, Vec3::ZERO), "brighter than that");
    }

    #[test]
    fn a_lamp_is_what_clips_in_all_colours() {
        let pull = |light: f32, target| clipped_pull(Vec3::splat(light), target, 5.0, false).1;
        let (lamp, neon) = (pull(2.0, [1.0; 3]), pull(2.0, [1.0, 0.5, 0.7]));
        assert!(lamp.max_element() < 0.0, "brighter: {lamp}");
        assert!(neon.x > 0.0 && neon.y == 0.0, "darker: {neon}");
    }

    #[test]
    fn nan_stays_visible() {
        assert!(
            pixel_loss(Display { gamma: 1.0 }, Vec3::splat(f32::NAN), [0.5; 3])
                .value
                .is_nan()
        );
    }
}
