//! Equirectangular panoramas: the environment as a point inside it sees it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::picture::Picture;
use super::scene::Scene;
use super::shade::ShadeScratch;
use crate::neif::lobe::Lobe;
use crate::neif::proposal::ConeRay;
use crate::neif::radiance_field::FieldRay;
use crate::neif::{Environment, EnvironmentTransform};

/// Linear radiance around the world point `at`, `width` x `width / 2`; `None` when cancelled.
///
/// `u = (x + 0.5)/w`, `v = (y + 0.5)/h`, azimuth `2π (0.5 - u)`, elevation `π (0.5 - v)`, direction
/// `(cos el cos az, cos el sin az, sin el)`: z is up, the centre looks along +x. Roughness 0 is sharp, else every pixel is the
/// lobe of that roughness.
pub fn panorama(
    environment: &Arc<Environment>,
    transform: &EnvironmentTransform,
    at: Vec3,
    roughness: f32,
    width: u32,
    cancel: &AtomicBool,
) -> Option<Picture> {
    let height = (width / 2).max(1);
    let scene = Scene {
        transform: *transform,
        ..Scene::new(None, Arc::clone(environment))
    };
    let mut pixels = vec![[0.0; 3]; (width * height) as usize];
    pixels
        .par_chunks_mut(width as usize)
        .enumerate()
        .for_each_init(ShadeScratch::default, |scratch, (y, row)| {
            if !cancel.load(Ordering::Relaxed) {
                panorama_row(&scene, at, roughness, (y as u32, height), row, scratch);
            }
        });
    (!cancel.load(Ordering::Relaxed)).then_some(Picture {
        width,
        height,
        pixels,
    })
}

fn panorama_row(
    scene: &Scene,
    at: Vec3,
    roughness: f32,
    (y, height): (u32, u32),
    row: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    let motion = scene.transform.environment_from_world();
    let origin = scene
        .environment
        .frame()
        .field_from_world(motion.point(at))
        .to_array();
    let width = row.len();
    let elevation = std::f32::consts::PI * (0.5 - (y as f32 + 0.5) / height as f32);
    let lobe = (roughness > 0.0).then(|| Lobe::from_roughness(roughness));
    // A pixel is a box of π/height radians.
    let spread = std::f32::consts::PI / height as f32 * 0.288_675_13;
    scratch.batch().rays.clear();
    for x in 0..width {
        let azimuth = std::f32::consts::TAU * (0.5 - (x as f32 + 0.5) / width as f32);
        let (sin_el, cos_el) = elevation.sin_cos();
        let d_world = Vec3::new(cos_el * azimuth.cos(), cos_el * azimuth.sin(), sin_el);
        let direction = motion.direction(d_world);
        let cone = ConeRay {
            origin,
            direction: (direction * lobe.map_or(1.0, |l| l.mean_length)).to_array(),
            base: 0.0,
            spread,
            lobe_variance: lobe.map_or(0.0, |l| l.variance),
        };
        let kappa = lobe.map_or(f32::INFINITY, |l| l.kappa);
        scratch.batch().rays.push(FieldRay {
            cone,
            direction: direction.to_array(),
            kappa,
        });
    }
    scratch.light(scene);
    for (out, radiance) in row.iter_mut().zip(&scratch.batch().radiance) {
        *out = (Vec3::from(*radiance) * motion.gain).to_array();
    }
}
