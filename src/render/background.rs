//! What stands behind the object in a picture; the light that it throws is the same in every case.

use serde::{Deserialize, Serialize};

use super::named::unknown;

/// How the environment is seen directly; its reflections and its light stay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(strum::Display, strum::EnumString, strum::VariantArray)]
#[strum(serialize_all = "lowercase", parse_err_ty = String, parse_err_fn = unknown_background)]
pub enum Background {
    /// As sharp as it is where photos showed it; blurred where none did, and it is known by its reflections alone.
    #[default]
    Auto,
    /// As sharp as it is.
    Shown,
    /// Through the field with a wide cone, [`BLUR_STD`].
    Blurred,
    /// Black, as behind the layers without an environment.
    Hidden,
}

/// Standard deviation of the cone through which a blurred background is seen, radians: 6 degrees.
pub const BLUR_STD: f32 = 0.105;

impl Background {
    /// The next one that looks different, around the end.
    pub fn next(self) -> Self {
        match self {
            Self::Auto | Self::Shown => Self::Blurred,
            Self::Blurred => Self::Hidden,
            Self::Hidden => Self::Auto,
        }
    }
}

fn unknown_background(text: &str) -> String {
    unknown::<Background>("background", text)
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Layer, Scene};
    use super::*;
    use crate::neif::field::seen_grid::SeenGrid;
    use crate::render::output::raster::Picture;
    use crate::render::test_scene::{self, camera, scene};

    fn picture(background: Background, display_ev: f32, layer: Layer) -> Picture {
        let scene = Scene {
            background,
            display_ev,
            ..scene()
        };
        test_scene::picture(&scene, &camera(40, 30), layer)
    }

    /// Mean square difference between neighbours in a row of the environment.
    fn roughness_of(picture: &Picture) -> f32 {
        let pairs = picture.pixels.windows(2);
        pairs.map(|pair| (pair[0][1] - pair[1][1]).powi(2)).sum()
    }

    #[test]
    fn what_no_photo_showed_is_blurred_by_itself() {
        let mut seen = SeenGrid::default();
        let unseen = seen.clone();
        seen.see(0, 0);
        let as_shown = |background, seen| {
            let scene = Scene {
                background,
                environment: test_scene::environment_seen(5, seen),
                ..scene()
            };
            scene.shown_background()
        };
        let auto = |seen| as_shown(Background::Auto, seen);
        let unknown = [auto(None), auto(Some(seen))];
        assert_eq!(unknown, [Background::Shown; 2]);
        assert_eq!(auto(Some(unseen.clone())), Background::Blurred);
        let asked = as_shown(Background::Shown, Some(unseen));
        assert_eq!(asked, Background::Shown, "as a person wants it");
    }

    #[test]
    fn a_hidden_background_is_black_and_leaves_the_object() {
        let shown = picture(Background::Shown, 0.0, Layer::Final);
        let hidden = picture(Background::Hidden, 0.0, Layer::Final);
        let n_black = hidden.pixels.iter().filter(|p| **p == [0.0; 3]).count();
        let n_same = (shown.pixels.iter().zip(&hidden.pixels))
            .filter(|(shown, hidden)| shown == hidden)
            .count();
        assert!(n_black > 400, "{n_black} pixels of the environment");
        assert!(n_same > 100, "{n_same} pixels of the object");
        let alone = |background| picture(background, 0.0, Layer::Environment);
        assert_eq!(
            alone(Background::Hidden),
            alone(Background::Shown),
            "the environment alone is never hidden"
        );
    }

    #[test]
    fn a_blurred_background_is_smoother() {
        let of = |background| roughness_of(&picture(background, 0.0, Layer::Environment));
        let (sharp, blurred) = (of(Background::Shown), of(Background::Blurred));
        assert!(blurred < 0.97 * sharp && blurred > 0.0, "{blurred} {sharp}");
    }

    #[test]
    fn the_display_s_exposure_brightens_light_and_nothing_else() {
        let dark = picture(Background::Shown, -30.0, Layer::Final);
        let brightest = dark.pixels.iter().flatten().fold(0.0_f32, |a, &b| a.max(b));
        assert!(brightest < 1e-4, "{brightest}");
        for layer in [Layer::Normal, Layer::Roughness, Layer::Tint] {
            let (plain, bright) = [0.0, 2.0]
                .map(|ev| picture(Background::Shown, ev, layer))
                .into();
            assert_eq!(plain, bright, "{layer}");
        }
    }
}
