//! The oracle of the shading: a lobe as many thin rays through the field instead of one cone.
//!
//! Slow and without integrated lobe encoding. Rays that meet the object go on from there, as in a path tracer, so that
//! neither the cone's one colour nor the few rays that find the blocked share of a lobe are relied on.

use glam::Vec3;

use super::gbuffer::GBuffer;
use super::scene::Scene;
use super::shade::ShadeScratch;
use super::trace::MAX_VERTICES;
use crate::geometry::{Ray, sample_vmf};
use crate::neif::contraction::FieldFrame;
use crate::neif::edit::EnvironmentFromWorld;
use crate::neif::lobe::kappa_from_roughness;
use crate::neif::lobe_cones::visible_ggx_normal;
use crate::neif::object::ObjectModel;
use crate::neif::proposal::ConeRay;
use crate::neif::radiance_field::FieldRay;
use crate::neif::shading::{SurfacePoint, fresnel};

/// Concentration of a ray that counts as a lobe's, so that it does not start inside its own surface.
const THIN: f32 = 1e6;
/// Draws of a direction that leaves the surface before the last one is mirrored out of it.
const MAX_DRAWS: u32 = 8;

/// Which lobe the rays are drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LobeShape {
    /// The model's von Mises–Fisher lobe.
    #[default]
    Model,
    /// GGX with `alpha = r²`, by its visible normals (Heitz 2018): what other renderers draw.
    Ggx,
}

/// How the reference is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceOptions {
    /// Paths a pixel, at least 1.
    pub n_paths: u32,
    /// The lobe.
    pub lobe: LobeShape,
}

/// A path on its way.
#[derive(Clone, Copy, Debug)]
struct Walker {
    position: Vec3,
    normal: Vec3,
    to_eye: Vec3,
    /// Footprint of the pixel where it is, and its growth.
    base: f32,
    spread: f32,
    /// Share of what it meets next that reaches the eye.
    throughput: Vec3,
    /// Number among the pixel's paths.
    index: u32,
}

/// The object's part of each listed pixel, linear radiance, by `options.n_paths` paths each; 0 where it is not seen.
pub fn shade_object_reference(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    options: ReferenceOptions,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    out.fill([0.0; 3]);
    let Some(object) = &scene.object else { return };
    let mut walkers = Vec::new();
    for (&pixel, out) in pixels.iter().zip(out) {
        start(gbuffer, pixel, options.n_paths.max(1), &mut walkers);
        if !walkers.is_empty() {
            let share = 1.0 / walkers.len() as f32;
            let sum = walk(scene, object, pixel, options.lobe, &mut walkers, scratch);
            *out = (sum * share).to_array();
        }
    }
}

/// The paths' first points: those of the pixel, each as often as the others.
fn start(gbuffer: &GBuffer, pixel: u32, n_paths: u32, walkers: &mut Vec<Walker>) {
    walkers.clear();
    let points: Vec<SurfacePoint> = gbuffer.paths_at(pixel).map(|path| path[0].point).collect();
    if points.is_empty() {
        return;
    }
    // The points take turns, so that each sees all of the lobe.
    for _ in 0..n_paths.div_ceil(points.len() as u32) {
        for point in &points {
            walkers.push(Walker {
                position: point.position,
                normal: point.normal,
                to_eye: point.to_eye,
                base: point.base,
                spread: point.spread,
                throughput: Vec3::ONE,
                index: walkers.len() as u32,
            });
        }
    }
}

/// Follows all paths to the surroundings; the sum of what they bring.
fn walk(
    scene: &Scene,
    object: &ObjectModel,
    pixel: u32,
    lobe: LobeShape,
    walkers: &mut Vec<Walker>,
    scratch: &mut ShadeScratch,
) -> Vec3 {
    let motion = scene.transform.environment_from_world();
    let frame = *scene.environment.frame();
    let tracer = &object.tracer;
    let mut first_draws = Lattice::new(pixel);
    let mut sum = Vec3::ZERO;
    let (mut rays, mut throughputs) = (Vec::new(), Vec::new());
    for bounce in 0..MAX_VERTICES as u32 {
        let edited = scratch.surfaces(
            scene,
            object,
            walkers.iter().map(|w| (w.position, w.normal)),
        );
        let mut next = Vec::new();
        let surfaces = edited.surfaces().iter().zip(edited.specular_gain());
        for (walker, (surface, gain)) in walkers.iter().zip(surfaces) {
            let cos = walker.normal.dot(walker.to_eye).max(0.0);
            let fresnel = fresnel(surface.tint, cos);
            sum += walker.throughput * surface.diffuse * (Vec3::ONE - fresnel);
            let throughput = walker.throughput * fresnel * *gain;
            let direction = if bounce == 0 {
                draw(walker, surface.roughness, lobe, || first_draws.next())
            } else {
                let mut draws = Draws::new([pixel, bounce, walker.index]);
                draw(walker, surface.roughness, lobe, || draws.next())
            };
            let ray = Ray {
                origin: walker.position,
                direction,
            };
            let is_last = bounce as usize + 1 == MAX_VERTICES;
            let hit = (!is_last)
                .then(|| tracer.intersect(&ray, tracer.self_distance(), f32::INFINITY))
                .flatten();
            if let Some(hit) = hit {
                next.push(Walker {
                    position: hit.position,
                    normal: hit.normal,
                    to_eye: -direction,
                    base: walker.base + walker.spread * hit.t,
                    spread: walker.spread,
                    throughput,
                    index: walker.index,
                });
            } else {
                throughputs.push(throughput);
                rays.push(thin_ray(walker, direction, &motion, &frame));
            }
        }
        *walkers = next;
        if walkers.is_empty() {
            break;
        }
    }
    scratch.batch().rays = rays;
    scratch.light(scene);
    let light = scratch.batch().radiance.iter().zip(throughputs);
    sum + light
        .map(|(radiance, throughput)| Vec3::from(*radiance) * motion.gain * throughput)
        .sum::<Vec3>()
}

/// A ray as wide as the pixel alone makes it.
fn thin_ray(
    walker: &Walker,
    direction: Vec3,
    motion: &EnvironmentFromWorld,
    frame: &FieldFrame,
) -> FieldRay {
    let origin = frame.field_from_world(motion.point(walker.position));
    let direction = motion.direction(direction).to_array();
    FieldRay {
        cone: ConeRay {
            origin: origin.to_array(),
            direction,
            base: walker.base * motion.length(1.0) / frame.half_side,
            spread: walker.spread,
            lobe_variance: 0.0,
        },
        direction,
        kappa: THIN,
    }
}

/// Pairs of numbers in `[0, 1)` that fill the square evenly however many are taken, other ones in every pixel: steps by the
/// powers of the plastic number's inverse.
#[derive(Clone, Copy, Debug)]
struct Lattice([f64; 2]);

impl Lattice {
    fn new(pixel: u32) -> Self {
        let mut shift = Draws::new([pixel, 0, 0]);
        Self(shift.next().map(f64::from))
    }

    fn next(&mut self) -> [f32; 2] {
        self.0[0] = (self.0[0] + 0.754_877_666_246_693).fract();
        self.0[1] = (self.0[1] + 0.569_840_290_998_053).fract();
        // Rounding to single precision may reach 1.
        self.0.map(|v| (v as f32).min(1.0 - f32::EPSILON))
    }
}

/// Pairs of numbers in `[0, 1)` that look random.
#[derive(Clone, Copy, Debug)]
struct Draws(u32);

impl Draws {
    fn new(words: [u32; 3]) -> Self {
        Self(hash(words))
    }

    fn next(&mut self) -> [f32; 2] {
        [(); 2].map(|()| {
            self.0 = hash([self.0, 1, 2]);
            (self.0 >> 8) as f32 / (1 << 24) as f32
        })
    }
}

/// A direction of the lobe that leaves the surface.
fn draw(
    walker: &Walker,
    roughness: f32,
    lobe: LobeShape,
    mut uniform: impl FnMut() -> [f32; 2],
) -> Vec3 {
    let (normal, to_eye) = (walker.normal, walker.to_eye);
    let mut direction = normal;
    for _ in 0..MAX_DRAWS {
        let u = uniform();
        direction = match lobe {
            LobeShape::Model => {
                let axis = 2.0 * normal.dot(to_eye) * normal - to_eye;
                sample_vmf(kappa_from_roughness(roughness), axis, u)
            }
            LobeShape::Ggx => {
                let h = visible_ggx_normal(normal, to_eye, roughness * roughness, u);
                (2.0 * h.dot(to_eye) * h - to_eye).normalize_or_zero()
            }
        };
        if direction.dot(normal) > 0.0 {
            return direction;
        }
    }
    (direction - 2.0 * direction.dot(normal) * normal).normalize_or_zero()
}

/// Mixes three words (a round of PCG each).
fn hash(words: [u32; 3]) -> u32 {
    words.into_iter().fold(0x9e37_79b9, |state, word| {
        let x = (state ^ word)
            .wrapping_mul(747_796_405)
            .wrapping_add(2_891_336_453);
        let x = ((x >> ((x >> 28) + 4)) ^ x).wrapping_mul(277_803_737);
        (x >> 22) ^ x
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::render::{Layer, render, render_reference, test_scene};

    fn reference(scene: &Scene, n_paths: u32, lobe: LobeShape) -> crate::render::Picture {
        let camera = test_scene::camera(24, 16);
        let options = ReferenceOptions { n_paths, lobe };
        let cancel = AtomicBool::new(false);
        render_reference(scene, &camera, options, &cancel, &|_| {}).expect("not cancelled")
    }

    #[test]
    fn a_mirror_needs_one_ray_only() {
        let mut scene = test_scene::scene();
        scene.edit.roughness = RoughnessEdit::Constant(0.0);
        let camera = test_scene::camera(24, 16);
        let cancel = AtomicBool::new(false);
        let cones = render(&scene, &camera, Layer::Final, &cancel, &|_| {}).expect("not cancelled");
        for lobe in [LobeShape::Model, LobeShape::Ggx] {
            let rays = reference(&scene, 4, lobe);
            let difference: f32 = cones
                .pixels
                .iter()
                .zip(&rays.pixels)
                .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>())
                .sum();
            // The footprint of a second mirror image is simpler here.
            let mean = difference / (3 * cones.pixels.len()) as f32;
            assert!(mean < 0.01, "{lobe:?}: {mean} a colour");
        }
    }

    #[test]
    fn more_paths_settle() {
        let mut scene = test_scene::scene();
        scene.edit.roughness = RoughnessEdit::Constant(0.5);
        let difference = |a: &crate::render::Picture, b: &crate::render::Picture| -> f32 {
            let pairs = a.pixels.iter().zip(&b.pixels);
            pairs
                .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>())
                .sum()
        };
        for lobe in [LobeShape::Model, LobeShape::Ggx] {
            let [few, some, many] = [4, 64, 1024].map(|n| reference(&scene, n, lobe));
            let (far, near) = (difference(&few, &many), difference(&some, &many));
            assert!(near < 0.5 * far, "{lobe:?}: {far} then {near}");
        }
    }
}
