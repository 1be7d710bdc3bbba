//! From linear radiance to display values: the sRGB curve with a learned exponent (Eq. 7's gamma).

use crate::color::srgb_from_linear;

/// `srgb(x)^gamma` per colour; 1 is plain sRGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// The exponent, positive.
    pub gamma: f32,
}

impl Display {
    /// Display value of a linear one: not clipped above, as far as floats go; below zero the curve is odd.
    pub fn value(&self, linear: f32) -> f32 {
        let srgb = srgb_from_linear(linear);
        // The power costs as much as the curve and is often 1.
        if self.gamma == 1.0 {
            srgb
        } else {
            // A negative value has no power, and radiance of 1e30 none that a float holds; NaN stays NaN.
            let shown = srgb.abs().powf(self.gamma);
            let shown = if shown > f32::MAX { f32::MAX } else { shown };
            shown.copysign(srgb)
        }
    }
}
