//! From linear radiance to display values: the sRGB curve with a learned exponent (Eq. 7's gamma).

use crate::color::srgb_from_linear;

/// `srgb(x)^gamma` per colour; 1 is plain sRGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// The exponent, positive.
    pub gamma: f32,
}

impl Display {
    /// Display value of a linear one, not clipped above.
    pub fn value(&self, linear: f32) -> f32 {
        let srgb = srgb_from_linear(linear);
        // The power costs as much as the curve and is often 1.
        if self.gamma == 1.0 {
            srgb
        } else {
            srgb.powf(self.gamma)
        }
    }
}
