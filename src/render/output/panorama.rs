//! Equirectangular panoramas: the environment as a point inside it sees it.

use std::f32::consts::{PI, TAU};
use std::sync::atomic::AtomicBool;

use glam::{Quat, Vec2, Vec3};

use super::raster::Picture;
use crate::neif::field::proposal::ConeRay;
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::environment::EnvironmentField;
use crate::neif::light::lobe::Lobe;
use crate::render::irradiance::TrainedLight;
use crate::render::lamps::{Lamps, PanoramaPixel};
use crate::render::path::scratch::ShadeScratch;
use crate::render::scene::Scene;

/// Standard deviation of a panorama's pixels along an axis, pixels: `1/sqrt(12)`. They are boxes beside each other, as panoramas
/// are lamps for other programs.
const BOX_STD: f32 = 0.288_675_13;

/// What a panorama shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PanoramaView {
    /// The point around which it is, world coordinates.
    pub at: Vec3,
    /// The unit direction at its top edge.
    pub up: Vec3,
    /// 0 is sharp, else every pixel is the lobe of that roughness.
    pub roughness: f32,
    /// Pixels per row; half as many rows.
    pub width: u32,
}

impl PanoramaView {
    /// The unit world direction shown at a place of the picture, `[0, 1]` from the top left.
    ///
    /// Azimuth `2π (0.5 - u)`, elevation `π (0.5 - v)`, direction `(cos el cos az, cos el sin az, sin el)` where z is up.
    pub fn direction(&self, place: Vec2) -> Vec3 {
        let (azimuth, elevation) = (TAU * (0.5 - place.x), PI * (0.5 - place.y));
        let (sin_el, cos_el) = elevation.sin_cos();
        let upright = Vec3::new(cos_el * azimuth.cos(), cos_el * azimuth.sin(), sin_el);
        self.world_from_upright() * upright
    }

    /// Undoes [`Self::direction`].
    pub fn place(&self, direction: Vec3) -> Vec2 {
        let d = self.world_from_upright().inverse() * direction;
        let elevation = d.z.clamp(-1.0, 1.0).asin();
        Vec2::new(0.5 - d.y.atan2(d.x) / TAU, 0.5 - elevation / PI)
    }

    fn world_from_upright(&self) -> Quat {
        Quat::from_rotation_arc(Vec3::Z, self.up.normalize_or(Vec3::Z))
    }
}

/// Linear radiance of a scene's environment around the world point `at`, z up, the centre looking along +x:
/// [`panorama_of`] with `width` x `width / 2` pixels; `None` when cancelled.
pub fn panorama(
    scene: &Scene,
    at: Vec3,
    roughness: f32,
    width: u32,
    cancel: &AtomicBool,
) -> Option<Picture> {
    let view = PanoramaView {
        at,
        up: Vec3::Z,
        roughness,
        width,
    };
    panorama_of(scene, &view, cancel)
}

/// Linear radiance of a scene's environment as `view` says, each pixel's middle by [`PanoramaView::direction`]; `None`
/// when cancelled.
pub fn panorama_of(scene: &Scene, view: &PanoramaView, cancel: &AtomicBool) -> Option<Picture> {
    let width = view.width.max(1);
    let height = (width / 2).max(1);
    Picture::by_rows(
        (width, height),
        1,
        cancel,
        |scratch: &mut ShadeScratch, y, row| {
            panorama_row(scene, view, (y, height), row, scratch);
        },
    )
}

/// A sharp [`panorama`] for programs that light something with it: the environment without the object of its scene and the traces
/// that this left, its lamps as bright as the object's shading and reflections say, where `light` is known (the light that the
/// object was trained in, [`trained_light`](crate::render::trained_light)), and without specks.
pub fn environment_map(
    scene: &Scene,
    light: Option<&TrainedLight>,
    at: Vec3,
    width: u32,
    cancel: &AtomicBool,
) -> Option<Picture> {
    let view = PanoramaView {
        at,
        up: Vec3::Z,
        roughness: 0.0,
        width,
    };
    let mut picture = panorama_of(&scene.emptied_of(light), &view, cancel)?;
    if matches!(scene.environment.field(), EnvironmentField::Distant(_)) {
        // It is a picture already.
        return Some(picture);
    }
    let motion = scene.transform.environment_from_world();
    let (width, height) = (picture.width, picture.height);
    let pixel = |i: usize| {
        let (x, y) = (i % width as usize, i / width as usize);
        let place = middle((x as u32, y as u32), (width, height));
        let row = (PI * place.y).sin() * PI / height as f32;
        PanoramaPixel {
            direction: motion.direction(view.direction(place)),
            solid_angle: row * TAU / width as f32,
        }
    };
    let expose = |seen: &mut [[f32; 3]], gain: Vec3| {
        for value in seen {
            *value = (Vec3::from(*value) * gain).to_array();
        }
    };
    let learned;
    let lamps = if let Some(light) = light {
        light.lamps()
    } else {
        learned = Lamps::of(&scene.environment, cancel)?;
        &learned
    };
    expose(&mut picture.pixels, motion.gain.recip());
    lamps.show_in(motion.point(at), pixel, &mut picture.pixels);
    expose(&mut picture.pixels, motion.gain);
    Some(picture)
}

/// The middle of a pixel, `[0, 1]` from the top left.
fn middle((x, y): (u32, u32), (width, height): (u32, u32)) -> Vec2 {
    Vec2::new(
        (x as f32 + 0.5) / width as f32,
        (y as f32 + 0.5) / height as f32,
    )
}

fn panorama_row(
    scene: &Scene,
    view: &PanoramaView,
    (y, height): (u32, u32),
    row: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    let motion = scene.transform.environment_from_world();
    let frame = scene.environment.frame();
    let origin = frame.field_from_world(motion.point(view.at)).to_array();
    let width = row.len();
    let lobe = (view.roughness > 0.0).then(|| Lobe::from_roughness(view.roughness));
    let spread = PI / height as f32 * BOX_STD;
    scratch.rays.clear();
    for x in 0..width {
        let place = middle((x as u32, y), (width as u32, height));
        let direction = motion.direction(view.direction(place));
        scratch.rays.push(FieldRay {
            cone: ConeRay {
                origin,
                direction: (direction * lobe.map_or(1.0, |l| l.mean_length)).to_array(),
                base: 0.0,
                spread,
                lobe_variance: lobe.map_or(0.0, |l| l.variance),
            },
            direction: direction.to_array(),
            kappa: lobe.map_or(f32::INFINITY, |l| l.kappa),
        });
    }
    scratch.light(scene);
    for (out, radiance) in row.iter_mut().zip(&scratch.radiance) {
        *out = (Vec3::from(*radiance) * motion.gain).to_array();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::data::{ExrSample, write_exr};
    use crate::neif::EnvironmentTransform;
    use crate::neif::distant::{ImportOptions, import_environment};
    use crate::render::test_scene::NEVER;

    #[test]
    fn places_and_directions_undo_each_other_whatever_is_up() {
        for up in [Vec3::Z, Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, 0.0, 0.8)] {
            let view = PanoramaView {
                at: Vec3::ZERO,
                up,
                roughness: 0.0,
                width: 2,
            };
            for (u, v) in [(0.1, 0.2), (0.5, 0.5), (0.9, 0.7)] {
                let place = Vec2::new(u, v);
                let back = view.place(view.direction(place));
                assert!((back - place).length() < 1e-4, "{up}: {back}");
            }
            assert!((view.direction(Vec2::new(0.3, 0.0)) - up).length() < 1e-5);
        }
    }

    #[test]
    fn an_imported_picture_s_panorama_is_the_picture_bit_for_bit() {
        let (width, height) = (256, 128);
        let value = |i: u32| ((i * 7919 + 13) % 1009) as f32;
        let mut pixels: Vec<[f32; 3]> = (0..width * height)
            .map(|i| [value(i), 0.01 * value(i + 5), 0.3])
            .collect();
        pixels[77 * 256 + 3] = [4e4, 1e5, 1e-4];
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.exr");
        write_exr(&file, width, height, &pixels, ExrSample::Float).unwrap();
        let imported = import_environment(&file, &ImportOptions::default()).unwrap();
        let environment = Arc::new(imported.environment);
        let still = EnvironmentTransform::default();
        // Moved and scaled: a far environment does not care.
        let moved = EnvironmentTransform {
            translate: Vec3::new(1.0, -2.0, 0.5),
            scale: 3.0,
            ..still
        };
        for (transform, at) in [(still, Vec3::ZERO), (moved, Vec3::splat(7.0))] {
            let scene = Scene {
                transform,
                ..Scene::new(None, Arc::clone(&environment))
            };
            let seen = panorama(&scene, at, 0.0, width, &NEVER).unwrap();
            assert_eq!((seen.width, seen.height), (width, height), "size");
            assert!(seen.pixels == pixels, "pixels");
            let map = environment_map(&scene, None, at, width, &NEVER).unwrap();
            assert!(map.pixels == pixels, "a picture has no specks");
        }
    }
}
