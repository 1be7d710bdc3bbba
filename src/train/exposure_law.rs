//! Automatic exposure and white balance: how a photo's gain follows from the light that its camera sees.

use std::sync::atomic::AtomicBool;

use glam::{DMat4, DVec3, DVec4, Vec3};

use crate::color::linear_from_srgb;
use crate::data::Photo;
use crate::geometry::Camera;
use crate::neif::display::Display;
use crate::render::{Layer, Scene, render};

/// Fewest photos that tell the law's twelve numbers.
const LEAST_PHOTOS: usize = 16;
/// Pull of the slopes towards 0, in photos whose light is e times that of the mean.
const PULL: f64 = 0.1;
/// The longer side of the picture that is metered, pixels.
const METERED_SIDE: u32 = 32;
/// Least mean light that is metered, of a photo's white: a black picture has no logarithm.
const LEAST_LIGHT: f32 = 1e-4;
/// Stops that the metered picture is darkened by, so that no light is clipped that the photo's gain would not clip.
const HEADROOM: f32 = 8.0;

/// What a photo shows: the mean of its colours in linear light.
pub(super) fn mean_color(photo: &Photo) -> Vec3 {
    let n = photo.width() as usize * photo.height() as usize;
    // A few thousand pixels are as good as all.
    let stride = n.div_ceil(1 << 14).max(1) | 1;
    let colors = (0..n).step_by(stride).map(|i| Vec3::from(photo.linear(i)));
    colors.sum::<Vec3>() / n.div_ceil(stride).max(1) as f32
}

/// The logarithm of the light that a photo with such a mean and gain was taken in.
pub(super) fn log_light(mean: Vec3, gain: Vec3) -> Vec3 {
    (mean.max(Vec3::splat(LEAST_LIGHT)) / gain).map(f32::ln)
}

/// Logarithms of gains a colour, as an affine function of the logarithms of the mean light a colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExposureLaw([DVec4; 3]);

impl ExposureLaw {
    /// The logarithm of the gain for a logarithm of light.
    pub(super) fn log_gain(&self, log_light: Vec3) -> Vec3 {
        let light = log_light.as_dvec3().extend(1.0);
        DVec3::from(self.0.map(|row| row.dot(light))).as_vec3()
    }
}

/// Sums over photos from which the law follows by least squares.
#[derive(Clone, Copy, Debug)]
pub(super) struct LawSums {
    n: usize,
    moments: DMat4,
    products: [DVec4; 3],
}

impl LawSums {
    /// Of no photo.
    pub(super) const NONE: Self = Self {
        n: 0,
        moments: DMat4::ZERO,
        products: [DVec4::ZERO; 3],
    };

    /// With a photo; with `-1.0` as its weight, without it.
    pub(super) fn with(mut self, (log_light, log_gain): (Vec3, Vec3), weight: f64) -> Self {
        let light = log_light.as_dvec3().extend(1.0);
        self.n = if weight > 0.0 { self.n + 1 } else { self.n - 1 };
        let outer = DMat4::from_cols(
            light * light.x,
            light * light.y,
            light * light.z,
            light * light.w,
        );
        self.moments += weight * outer;
        for (product, gain) in self.products.iter_mut().zip(log_gain.as_dvec3().to_array()) {
            *product += weight * gain * light;
        }
        self
    }

    /// The law; `None` where too few photos tell it.
    pub(super) fn law(&self) -> Option<ExposureLaw> {
        if self.n < LEAST_PHOTOS {
            return None;
        }
        let pull = DMat4::from_diagonal(DVec4::new(PULL, PULL, PULL, 0.0));
        let inverse = (self.moments + pull).inverse();
        let law = ExposureLaw(self.products.map(|product| inverse * product));
        law.0.iter().all(|row| row.is_finite()).then_some(law)
    }
}

/// What a camera would meter in a scene, at any gain.
#[derive(Debug)]
pub(super) struct Meter {
    /// Linear light of a small picture's pixels.
    light: Vec<Vec3>,
    display: Display,
}

impl Meter {
    /// Of a scene of mean exposure.
    pub(super) fn of(scene: &Scene, camera: &Camera) -> Self {
        let small = camera.within(METERED_SIDE);
        let mut dark = scene.clone();
        dark.display_ev = -HEADROOM;
        let never = AtomicBool::new(false);
        let picture = render(&dark, &small, Layer::Final, &never, &|_| ());
        let display = Display {
            gamma: scene.environment.gamma(),
        };
        let light =
            |shown: f32| linear_from_srgb(shown.powf(1.0 / display.gamma)) * HEADROOM.exp2();
        let pixels = picture.map_or_else(Vec::new, |picture| picture.pixels);
        Self {
            light: pixels.iter().map(|p| Vec3::from(p.map(light))).collect(),
            display,
        }
    }

    /// The mean colour of the photo at a gain, as [`mean_color`] would find it.
    pub(super) fn mean_color(&self, gain: Vec3) -> Vec3 {
        let shown = |v: f32| linear_from_srgb(self.display.value(v).clamp(0.0, 1.0));
        let sum: Vec3 = self
            .light
            .iter()
            .map(|light| (light * gain).map(shown))
            .sum();
        sum / self.light.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::{camera, fog};

    /// Photo `i`: the logarithms of its light and of the gain that a camera of constant brightness takes.
    fn photo(i: usize) -> (Vec3, Vec3) {
        let turn = i as f32;
        let light = Vec3::new(turn.sin(), (1.7 * turn).cos(), (0.6 * turn).sin());
        (light, Vec3::new(0.2, 0.0, -0.1) - 0.8 * light)
    }

    #[test]
    fn the_law_of_a_camera_is_found() {
        let sums = (0..40).fold(LawSums::NONE, |sums, i| sums.with(photo(i), 1.0));
        let law = sums.law().expect("forty photos");
        for i in 40..50 {
            let (light, gain) = photo(i);
            assert!((law.log_gain(light) - gain).abs().max_element() < 0.02);
        }
        let few = (0..15).fold(LawSums::NONE, |sums, i| sums.with(photo(i), 1.0));
        assert_eq!(few.law(), None);
        let left_out = sums.with(photo(39), -1.0).law().expect("39 photos");
        let without = (0..39).fold(LawSums::NONE, |sums, i| sums.with(photo(i), 1.0));
        let (a, b) = (
            left_out.log_gain(Vec3::ONE),
            without.law().unwrap().log_gain(Vec3::ONE),
        );
        assert!((a - b).abs().max_element() < 1e-6);
    }

    #[test]
    fn photos_of_one_light_have_the_mean_gain() {
        let same = |i: usize| {
            (
                Vec3::splat(-1.0),
                Vec3::splat(if i.is_multiple_of(2) { 0.3 } else { -0.1 }),
            )
        };
        let sums = (0..20).fold(LawSums::NONE, |sums, i| sums.with(same(i), 1.0));
        let gain = sums
            .law()
            .expect("twenty photos")
            .log_gain(Vec3::splat(-1.0));
        assert!((gain - 0.1).abs().max_element() < 1e-3, "{gain}");
    }

    #[test]
    fn a_meter_sees_the_light_that_a_photo_would_show() {
        let grey = 0.3_f32;
        let scene = Scene::new(None, fog(grey.ln(), 0.0));
        let meter = Meter::of(&scene, &camera(64, 48));
        for (gain, shown) in [(1.0, 0.3), (2.0, 0.6), (5.0, 1.0)] {
            let mean = meter.mean_color(Vec3::splat(gain));
            assert!(
                (mean - shown).abs().max_element() < 0.01,
                "{mean} at {gain}"
            );
        }
    }
}
