//! What becomes of light that is brighter than white in a picture.

use serde::{Deserialize, Serialize};

use crate::render::named::unknown;

/// Where compression begins: 0.8 less the reflectance of plastic seen straight on.
const START: f32 = 0.8 - F0;
/// Reflectance of plastic seen straight on, which is taken off so that base colours look as they are.
const F0: f32 = 0.04;
/// How fast what is far brighter than white loses its colour.
const DESATURATION: f32 = 0.15;
/// Brighter light is taken for this.
const BRIGHTEST: f32 = 1e6;

/// How a picture's linear light, exposed, is brought below 1 before the display curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(strum::Display, strum::EnumString, strum::VariantArray)]
#[strum(serialize_all = "lowercase", parse_err_ty = String, parse_err_fn = unknown_tone_map)]
pub enum ToneMap {
    /// Clipped at white, colour by colour, as the photos are: the picture that training compares.
    #[default]
    Photo,
    /// Khronos PBR Neutral: colours below 0.8 as they are but for 0.04, lamps with their shape.
    Neutral,
}

impl ToneMap {
    /// Linear light that is not negative, brought towards 0 to 1; [`Self::Photo`] leaves the clipping to the display.
    pub fn apply(self, light: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Photo => light,
            Self::Neutral => neutral(light),
        }
    }
}

/// Khronos PBR Neutral tone mapper (Khronos Group 2024, specification 1.0).
fn neutral(light: [f32; 3]) -> [f32; 3] {
    let light = light.map(|v| v.min(BRIGHTEST));
    let least = light[0].min(light[1]).min(light[2]);
    let offset = if least < 2.0 * F0 {
        least - 6.25 * least * least
    } else {
        F0
    };
    let color = light.map(|v| v - offset);
    let peak = color[0].max(color[1]).max(color[2]);
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    color.map(|v| {
        let compressed = v * new_peak / peak;
        compressed + (new_peak - compressed) * white
    })
}

fn unknown_tone_map(text: &str) -> String {
    unknown::<ToneMap>("tone map", text)
}

/// Factor of an exposure of the picture; finite, so that black stays black.
pub(in crate::render) fn display_gain(ev: f32) -> f32 {
    ev.clamp(-60.0, 60.0).exp2()
}

#[cfg(test)]
mod tests {
    use strum::VariantArray as _;

    use super::*;

    #[test]
    fn names_are_read_back() {
        for &map in ToneMap::VARIANTS {
            assert_eq!(map.to_string().parse(), Ok(map));
        }
        assert!("filmic".parse::<ToneMap>().unwrap_err().contains("neutral"));
    }

    #[test]
    fn base_colours_lose_what_plastic_reflects_and_lamps_stay_below_white() {
        let plain = ToneMap::Neutral.apply([0.5, 0.3, 0.2]);
        for (given, shown) in [0.5, 0.3, 0.2].into_iter().zip(plain) {
            assert!((given - F0 - shown).abs() < 1e-6, "{given}: {shown}");
        }
        let mut last = 0.0;
        for light in [
            0.5_f32,
            0.79,
            0.81,
            1.0,
            3.0,
            50.0,
            1e5,
            f32::MAX,
            f32::INFINITY,
        ] {
            let [r, g, b] = ToneMap::Neutral.apply([light, 0.5 * light, 0.1 * light]);
            assert!(
                (0.0..=1.0).contains(&r) && r >= g && g >= b && b >= 0.0,
                "{light}"
            );
            assert!(r >= last, "{light}: {r} after {last}");
            last = r;
        }
        assert_eq!(ToneMap::Neutral.apply([0.0; 3]), [0.0; 3]);
    }
}
