//! A held-out photo measured as training photos are learned: with its own exposure, white balance and pose.
//!
//! Nobody can predict them. Each half of a picture, left and right, is measured with those that fit the other half, so that
//! nothing is measured where it was fitted.

use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::metrics::{ImageMetrics, compare, mean};
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::data::View;
use crate::render::{Layer, Picture, Scene, environment_at, render};
use crate::train::photos::pose_step::{Correction, PoseRow, Sums, slope_by_direction};
use crate::train::statistics::{middle, share_beyond};

/// Photo value from which a pixel counts as clipped.
const CLIPPED: f32 = 0.998;
/// Most pixels that a pose is fitted to.
const MAX_POSE_PIXELS: usize = 1 << 13;
/// Root mean square of what is found of the rotation, and of the translation, of a photo that is right, pixels.
const NOISE_PX: f32 = 0.4;
/// How often a pose is corrected by what is left.
const POSE_STEPS: usize = 3;

/// What is fitted to a held-out photo besides its exposure and white balance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseFit {
    /// Nothing: the training photos' poses are used as they are given.
    Given,
    /// Its pose, as those of the training photos were corrected.
    Corrected,
}

/// Measures a view whose unexposed picture is given after the exposure, the white balance and, if asked for, the pose that
/// bring it nearest to the photo. Where no photo showed the environment the object alone says so. `None` when cancelled.
pub fn fitted(
    scene: &Scene,
    view: &View,
    picture: &Picture,
    pose: PoseFit,
    cancel: &AtomicBool,
) -> Option<ImageMetrics> {
    let width = picture.width as usize;
    let by_side = |is_left: bool| {
        let side = Side { is_left, width };
        let picture = match pose {
            PoseFit::Corrected if scene.environment.is_seen() => {
                posed(scene, view, picture, side, cancel)?
            }
            _ => Cow::Borrowed(picture),
        };
        let gain = gain(scene, view, &picture, side);
        Some((side, picture, gain))
    };
    let ((left, by_left, left_gain), (_, by_right, right_gain)) = (by_side(true)?, by_side(false)?);
    let own = |i: usize| {
        if left.has(i) {
            exposed(by_right.pixels[i], right_gain)
        } else {
            exposed(by_left.pixels[i], left_gain)
        }
    };
    let pixels: Vec<[f32; 3]> = (0..picture.pixels.len()).map(own).collect();
    let (truth, mask) = truth_and_mask(view, pixels.len());
    Some(compare(&pixels, &truth, mask.as_deref(), width))
}

/// One half of a picture.
#[derive(Clone, Copy, Debug)]
struct Side {
    is_left: bool,
    /// Of the picture, pixels.
    width: usize,
}

impl Side {
    fn has(self, pixel: usize) -> bool {
        (pixel % self.width < self.width / 2) == self.is_left
    }
}

/// The gain a colour that one half of the picture asks for.
fn gain(scene: &Scene, view: &View, picture: &Picture, side: Side) -> [f32; 3] {
    let (views, pictures) = (std::slice::from_ref(view), std::slice::from_ref(picture));
    let is_seen = scene.environment.is_seen();
    nearest_gain(views, pictures, |view, i| {
        side.has(i) && (is_seen || is_object(view, i))
    })
}

/// Whether a pixel shows the object; without a mask any may.
fn is_object(view: &View, pixel: usize) -> bool {
    view.mask.as_ref().is_none_or(|m| m.share(pixel) > 0.5)
}

/// The picture from where one half of the photo shows the environment to be.
fn posed<'a>(
    scene: &Scene,
    view: &View,
    picture: &'a Picture,
    side: Side,
    cancel: &AtomicBool,
) -> Option<Cow<'a, Picture>> {
    let informative = informative_pixels(view, side);
    let pixels: Vec<u32> = informative.iter().map(|pixel| pixel.index).collect();
    if pixels.is_empty() {
        return Some(Cow::Borrowed(picture));
    }
    let gain = gain(scene, view, picture, side);
    let mut seen = environment_at(scene, &view.camera, &pixels);
    let mut away: Vec<f32> = seen.iter().map(|seen| seen.distance).collect();
    let unit = middle(&mut away).max(f32::MIN_POSITIVE);
    let mut correction = Correction::default();
    for _ in 0..POSE_STEPS {
        let mut sums = Sums::ZERO;
        for (pixel, seen) in informative.iter().zip(&seen) {
            let difference = grey(exposed(seen.srgb, gain)) - pixel.grey;
            let end = (seen.distance / unit, 1.0);
            let row = PoseRow::new(0, pixel.direction, pixel.slope, difference, end);
            if let Some(row) = row {
                sums.add(&row);
            }
        }
        let step = sums.solve(correction, &view.camera, 1.0);
        if !(step.turn.is_finite() && step.shift.is_finite()) {
            break;
        }
        correction.turn += step.turn;
        correction.shift += step.shift;
        seen = environment_at(scene, &correction.corrected(&view.camera, unit), &pixels);
    }
    let share = known_share(correction, view.camera.pixel_angle());
    if share == 0.0 {
        return Some(Cow::Borrowed(picture));
    }
    correction.turn *= f64::from(share);
    correction.shift *= f64::from(share);
    let camera = correction.corrected(&view.camera, unit);
    render(scene, &camera, Layer::Final, cancel, &|_| {}).map(Cow::Owned)
}

/// How much of a correction is no error of what is found, 0 to 1.
fn known_share(correction: Correction, pixel_angle: f32) -> f32 {
    let square_px = [correction.turn, correction.shift]
        .map(|by| (by.as_vec3() / pixel_angle).length_squared())
        .iter()
        .sum();
    share_beyond(square_px, 2.0 * NOISE_PX * NOISE_PX)
}

/// A pixel that constrains the photo's pose.
struct InformativePixel {
    /// `y * width + x`.
    index: u32,
    direction: Vec3,
    /// What the photo shows, sRGB grey, and its slope by the direction.
    grey: f32,
    slope: Vec3,
}

/// The pixels of a half amid unclipped background.
fn informative_pixels(view: &View, side: Side) -> Vec<InformativePixel> {
    let camera = &view.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let is_background = |i: usize| view.mask.as_ref().is_none_or(|m| m.share(i) == 0.0);
    let value = |i: usize| {
        let value = grey(view.photo.srgb(i));
        (is_background(i) && value < CLIPPED).then_some(value)
    };
    let informative = |i: usize| {
        let (x, y) = (i % width, i / width);
        let is_inside = (1..width - 1).contains(&x) && (1..height - 1).contains(&y);
        if !is_inside || !side.has(i) {
            return None;
        }
        let slope = |step: usize| Some(0.5 * (value(i + step)? - value(i - step)?));
        let by_pixel = [slope(1)?, slope(width)?];
        let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
        Some(InformativePixel {
            index: i as u32,
            direction: camera.ray(x, y).direction,
            grey: value(i)?,
            slope: slope_by_direction(camera, x, y, by_pixel),
        })
    };
    let all: Vec<_> = (0..width * height).filter_map(informative).collect();
    // Odd, so that it is no divisor of most widths.
    let stride = all.len().div_ceil(MAX_POSE_PIXELS) | 1;
    all.into_iter().skip(stride - 1).step_by(stride).collect()
}

fn grey(srgb: [f32; 3]) -> f32 {
    srgb.iter().sum::<f32>() / 3.0
}

/// Measures pictures of views after the gain a colour, one for all views, that brings the object's pixels (all pixels
/// without masks) nearest to the photos in linear light. Clipped photo pixels have no say in the gain.
///
/// # Panics
/// When there are not as many pictures as views: a bug of the caller.
pub fn after_one_gain(views: &[View], pictures: &[Picture]) -> ImageMetrics {
    assert_eq!(views.len(), pictures.len(), "one picture a view");
    let gain = nearest_gain(views, pictures, is_object);
    let pairs = views.iter().zip(pictures);
    let metrics: Vec<ImageMetrics> = pairs
        .map(|(view, picture)| {
            let pixels = picture.pixels.iter().map(|srgb| exposed(*srgb, gain));
            let pixels: Vec<[f32; 3]> = pixels.collect();
            let (truth, mask) = truth_and_mask(view, pixels.len());
            compare(&pixels, &truth, mask.as_deref(), picture.width as usize)
        })
        .collect();
    mean(&metrics)
}

/// The gain a colour that brings the pictures nearest to the photos in linear light, over unclipped pixels that are
/// asked for.
pub(in crate::train) fn nearest_gain(
    views: &[View],
    pictures: &[Picture],
    is_asked: impl Fn(&View, usize) -> bool,
) -> [f32; 3] {
    let mut sums = [[0.0_f64; 2]; 3];
    for (view, picture) in views.iter().zip(pictures) {
        for (i, shown) in picture.pixels.iter().enumerate() {
            if !is_asked(view, i) {
                continue;
            }
            let truth = view.photo.srgb(i);
            for c in 0..3 {
                if truth[c] < CLIPPED {
                    let shown = f64::from(linear_from_srgb(shown[c]));
                    sums[c][0] += shown * f64::from(linear_from_srgb(truth[c]));
                    sums[c][1] += shown * shown;
                }
            }
        }
    }
    // A black picture stays black whatever the gain.
    sums.map(|[a, b]| if b > 0.0 { (a / b) as f32 } else { 1.0 })
}

/// A pixel in sRGB with a gain a colour in linear light.
fn exposed(srgb: [f32; 3], gain: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| srgb_from_linear((linear_from_srgb(srgb[c]) * gain[c]).clamp(0.0, 1.0)))
}

/// The photo's first `n` pixels, sRGB, and the object's share of each where there is a mask.
pub(super) fn truth_and_mask(view: &View, n: usize) -> (Vec<[f32; 3]>, Option<Vec<f32>>) {
    let truth = (0..n).map(|i| view.photo.srgb(i)).collect();
    let mask = view.mask.as_ref();
    let shares = mask.map(|mask| (0..n).map(|i| mask.share(i)).collect());
    (truth, shares)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Mat3A, Quat};

    use super::*;
    use crate::data::{Photo, Split};
    use crate::neif::Environment;
    use crate::neif::distant::{DistantConfig, DistantLight};
    use crate::neif::field::seen_grid::SeenGrid;
    use crate::render::test_scene::{camera, environment_seen, fog};

    /// A picture that no camera needs to take again.
    fn exposed_as_photo(view: &View, picture: &Picture) -> ImageMetrics {
        let (scene, cancel) = (Scene::new(None, fog(0.0, 0.0)), AtomicBool::new(false));
        fitted(&scene, view, picture, PoseFit::Given, &cancel).expect("nobody cancels")
    }

    /// A view's photo with a gain a colour for each pixel.
    fn gained(view: &View, gain: impl Fn(usize) -> [f32; 3]) -> Picture {
        let pixel = |i: usize| {
            let (srgb, gain) = (view.photo.srgb(i), gain(i));
            std::array::from_fn(|c| srgb_from_linear(linear_from_srgb(srgb[c]) * gain[c]))
        };
        Picture {
            width: view.camera.width,
            height: view.camera.height,
            pixels: (0..view.photo.n_pixels()).map(pixel).collect(),
        }
    }

    /// An environment far away with waves all over.
    fn waves() -> Scene {
        let config = DistantConfig {
            width: 256,
            height: 128,
            world_from_picture: Quat::IDENTITY,
            has_floor: false,
        };
        let wave = |i: usize| {
            let (x, y) = ((i % 256) as f32, (i / 256) as f32);
            0.3 + 0.1 * (0.5 * x).sin() + 0.1 * (0.4 * y + 0.2 * x).cos()
        };
        let pixels: Vec<f32> = (0..256 * 128).flat_map(|i| [wave(i); 3]).collect();
        let light = DistantLight::new(config, &pixels).expect("a sane picture");
        Scene::new(
            None,
            Arc::new(Environment::of_distant("waves".to_owned(), Vec3::Z, light)),
        )
    }

    #[test]
    fn a_camera_that_is_off_is_put_right_and_a_right_one_left() {
        let (scene, cancel) = (waves(), AtomicBool::new(false));
        let camera = camera(96, 72);
        let taken = |turn_px: f32| {
            let turn =
                Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), turn_px * camera.pixel_angle());
            let mut taken = camera;
            taken.world_from_camera.matrix3 =
                Mat3A::from_quat(turn) * taken.world_from_camera.matrix3;
            let photo = render(&scene, &taken, Layer::Final, &cancel, &|_| {}).expect("a photo");
            View {
                name: "off".to_owned(),
                file: std::path::PathBuf::new(),
                split: Split::Test,
                camera,
                photo: Photo::Ldr {
                    width: camera.width,
                    height: camera.height,
                    pixels: photo
                        .pixels
                        .iter()
                        .map(|p| p.map(|v| (v * 65_535.0) as u16))
                        .collect(),
                },
                mask: None,
            }
        };
        let picture = render(&scene, &camera, Layer::Final, &cancel, &|_| {}).expect("a picture");
        let psnr = |view: &View, pose: PoseFit| {
            let measured = fitted(&scene, view, &picture, pose, &cancel).expect("nobody cancels");
            measured.psnr.expect("not equal to the bit")
        };
        let off = taken(2.5);
        let (given, corrected) = (psnr(&off, PoseFit::Given), psnr(&off, PoseFit::Corrected));
        assert!(corrected > given + 10.0, "{corrected} dB, as given {given}");
        let right = taken(0.0);
        assert_eq!(
            psnr(&right, PoseFit::Corrected),
            psnr(&right, PoseFit::Given)
        );
    }

    #[test]
    fn one_gain_undoes_a_darker_exposure_and_nothing_else() {
        let capture = crate::train::test_scene::sphere_in_a_box(4, 16);
        let views = &capture.train[..2];
        let dark = |v| gained(v, |_| [0.5, 0.4, 0.3]);
        let dark: Vec<Picture> = views.iter().map(dark).collect();
        let psnr = after_one_gain(views, &dark)
            .psnr
            .expect("not equal to the bit");
        assert!(psnr > 60.0, "one exposure: {psnr}");
        let gains = [[0.5; 3], [0.25; 3]];
        let uneven: Vec<Picture> = views
            .iter()
            .zip(gains)
            .map(|(view, gain)| gained(view, |_| gain))
            .collect();
        let psnr = after_one_gain(views, &uneven).psnr.expect("far from equal");
        assert!(psnr < 40.0, "two exposures: {psnr}");
        for (view, picture) in views.iter().zip(&uneven) {
            let psnr = exposed_as_photo(view, picture).psnr;
            assert!(psnr.is_some_and(|psnr| psnr > 60.0), "its own: {psnr:?}");
        }
    }

    #[test]
    fn the_object_has_its_own_gain_where_no_photo_showed_the_environment() {
        let capture = crate::train::test_scene::sphere_in_a_box(4, 16);
        let view = &capture.train[0];
        let gain = |i| [if is_object(view, i) { 0.5 } else { 0.05 }; 3];
        let picture = gained(view, gain);
        let object_psnr = |seen| {
            let scene = Scene::new(None, environment_seen(1, seen));
            let cancel = AtomicBool::new(false);
            let metrics = fitted(&scene, view, &picture, PoseFit::Corrected, &cancel);
            metrics.and_then(|m| m.psnr_object).expect("an object")
        };
        let [unseen, unknown] = [Some(SeenGrid::default()), None].map(object_psnr);
        assert!(unseen > 45.0 && unknown < 30.0, "{unseen} and {unknown}");
    }

    #[test]
    fn a_gain_is_not_measured_on_the_half_that_it_was_fitted_to() {
        let capture = crate::train::test_scene::sphere_in_a_box(4, 16);
        let view = &capture.train[0];
        let picture = gained(view, |i| [if i % 16 < 8 { 0.5 } else { 0.25 }; 3]);
        // A gain for each half would make them equal, and one for both nearly.
        let psnr = exposed_as_photo(view, &picture).psnr.expect("not equal");
        let views = std::slice::from_ref(view);
        let own = after_one_gain(views, std::slice::from_ref(&picture)).psnr;
        assert!(psnr < own.expect("not equal") - 3.0, "{psnr}, {own:?}");
    }
}
