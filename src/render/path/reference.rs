//! The oracle of the shading: a lobe as many thin rays through the field instead of one cone.
//!
//! Slow and without integrated lobe encoding: rays are as thin as the environment resolves, which for the fast field is
//! the cone of a mirror. Rays that meet the object go on from there, as in a path tracer, so that
//! neither the cone's one colour nor the few rays that find the blocked share of a lobe are relied on.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::aim::untaught_share;
use super::blocked_cones::arrive;
use super::gbuffer::GBuffer;
use super::importance::{Importance, hilbert, systematic};
use super::scratch::{ShadeScratch, light_surfaces};
use super::trace::MAX_VERTICES;
use crate::geometry::sample_vmf;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::radiance_field::FieldRay;
use crate::neif::light::light_path::{PathVertex, first_lobe_ray};
use crate::neif::light::lobe::{Lobe, kappa_from_roughness};
use crate::neif::light::lobe_cones::visible_ggx_normal;
use crate::neif::light::shading::{SurfacePoint, fresnel};
use crate::neif::surface::edit::EnvironmentFromWorld;
use crate::neif::surface::object::ObjectModel;
use crate::render::scene::Scene;

/// Draws of a direction that leaves the surface before the last one is mirrored out of it.
const MAX_DRAWS: u32 = 8;
/// Directions drawn from the lobe for each that is followed.
const CANDIDATES: u32 = 16;

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

/// What the reference needs to know of a scene beforehand.
#[derive(Clone, Debug)]
pub(in crate::render) struct Reference {
    options: ReferenceOptions,
    /// None without an object.
    importance: Option<Importance>,
}

impl Reference {
    /// Looks at the environment; `None` when cancelled.
    pub(in crate::render) fn new(
        scene: &Scene,
        options: ReferenceOptions,
        cancel: &AtomicBool,
    ) -> Option<Self> {
        let importance = match &scene.object {
            Some(object) => {
                let ball = object.tracer.bounding_ball();
                Some(Importance::new(scene, ball, cancel)?)
            }
            None => None,
        };
        Some(Self {
            options,
            importance,
        })
    }
}

/// A point that a path has reached.
#[derive(Clone, Copy, Debug)]
struct Walker {
    point: SurfacePoint,
    /// Share of what it meets next that reaches the eye.
    throughput: Vec3,
    /// Number among the pixel's paths.
    index: u32,
}

/// The object's part of each listed pixel, linear radiance, by as many paths each as the options say; 0 where it is not
/// seen.
///
/// The first directions are drawn from the lobe many times over, and resampled by what light comes from there (Talbot et
/// al. 2005, "Importance Resampling for Global Illumination").
pub(in crate::render) fn shade_object_reference(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    reference: &Reference,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    out.fill([0.0; 3]);
    let (Some(object), Some(importance)) = (&scene.object, &reference.importance) else {
        return;
    };
    let mut paths = Paths {
        scene,
        object,
        importance,
        options: reference.options,
        motion: scene.transform.environment_from_world(),
        frame: *scene.environment.frame(),
        rays: Vec::new(),
        throughputs: Vec::new(),
    };
    for (&pixel, out) in pixels.iter().zip(out) {
        let share = 1.0 / gbuffer.paths_at(pixel).count().max(1) as f32;
        let point = |path: &[PathVertex]| Walker {
            point: path[0].point,
            throughput: Vec3::splat(share),
            index: 0,
        };
        let points: Vec<Walker> = gbuffer.paths_at(pixel).map(point).collect();
        if !points.is_empty() {
            *out = paths.light(pixel, &points, scratch).to_array();
        }
    }
}

/// A direction drawn from the lobe of one of a pixel's points.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    point: usize,
    direction: Vec3,
}

/// The paths of a pixel, and those of their rays that reach the environment.
struct Paths<'a> {
    scene: &'a Scene,
    object: &'a ObjectModel,
    importance: &'a Importance,
    options: ReferenceOptions,
    motion: EnvironmentFromWorld,
    frame: FieldFrame,
    rays: Vec<FieldRay>,
    throughputs: Vec<Vec3>,
}

impl Paths<'_> {
    /// Follows all paths of a pixel to the environment; the sum of what they bring.
    fn light(&mut self, pixel: u32, points: &[Walker], scratch: &mut ShadeScratch) -> Vec3 {
        self.rays.clear();
        self.throughputs.clear();
        let (mut sum, lobes) = self.emitted(points, scratch);
        let mut walkers = Vec::new();
        let picks = self.first_directions(pixel, points, &lobes);
        for (index, (candidate, share)) in picks.into_iter().enumerate() {
            let mut walker = points[candidate.point];
            walker.index = index as u32;
            let throughput = lobes[candidate.point].throughput * share;
            let ray = (candidate.direction, lobes[candidate.point].thin);
            walkers.extend(self.send(&walker, ray, throughput, true));
        }
        for bounce in 1..MAX_VERTICES as u32 {
            if walkers.is_empty() {
                break;
            }
            let (emitted, lobes) = self.emitted(&walkers, scratch);
            sum += emitted;
            let may_meet = bounce as usize + 1 < MAX_VERTICES;
            let mut next = Vec::new();
            for (walker, lobe) in walkers.iter().zip(lobes) {
                let mut draws = Draws::new([pixel, bounce, walker.index]);
                let (direction, share) = self.next_direction(walker, lobe.roughness, &mut draws);
                let ray = (direction, lobe.thin);
                next.extend(self.send(walker, ray, lobe.throughput * share, may_meet));
            }
            walkers = next;
        }
        std::mem::swap(&mut scratch.rays, &mut self.rays);
        scratch.light(self.scene);
        let light = scratch.radiance.iter().zip(&self.throughputs);
        sum + light
            .map(|(radiance, throughput)| Vec3::from(*radiance) * self.motion.gain * *throughput)
            .sum::<Vec3>()
    }

    /// What the walkers' diffuse parts bring together, and their lobes.
    fn emitted(&self, walkers: &[Walker], scratch: &mut ShadeScratch) -> (Vec3, Vec<WalkerLobe>) {
        let points = walkers.iter().map(|w| (w.point.position, w.point.normal));
        let edited = &mut scratch.edited;
        light_surfaces(edited, self.scene, self.object, points, |_| true);
        let surfaces = edited.surfaces().iter().zip(edited.specular_gain());
        let surfaces = surfaces.zip(edited.learned_roughness());
        let sharpest = self.scene.environment.sharpest_variance();
        let mut sum = Vec3::ZERO;
        let lobes = walkers
            .iter()
            .zip(surfaces)
            .map(|(walker, ((surface, gain), learned))| {
                let cos = walker.point.n_dot_v();
                let fresnel = fresnel(surface.tint, cos);
                sum += walker.throughput * surface.diffuse * (Vec3::ONE - fresnel);
                WalkerLobe {
                    roughness: surface.roughness,
                    throughput: walker.throughput
                        * fresnel
                        * *gain
                        * self.scene.wide_gain(*learned),
                    thin: thin_ray(self.object, surface.roughness, *learned, sharpest),
                }
            })
            .collect();
        (sum, lobes)
    }

    /// The directions of a pixel's paths, each with its share of its point's lobe.
    fn first_directions(
        &self,
        pixel: u32,
        points: &[Walker],
        lobes: &[WalkerLobe],
    ) -> Vec<(Candidate, f32)> {
        let n_paths = self.options.n_paths.max(1);
        let n = n_paths.max(points.len() as u32) * CANDIDATES;
        let side = n.isqrt().next_power_of_two();
        let mut draws = Draws::new([pixel, 0, 0]);
        let [shift, [start, _]] = [draws.next(), draws.next()];
        let mut candidates = Vec::with_capacity((side * side) as usize);
        let mut n_leaving = vec![0_u32; points.len()];
        for i in 0..side * side {
            // Along the curve the points take turns, so that each sees all of its lobe, and by no period that a regular
            // choice of candidates could fall in step with.
            let turn = (f64::from(i) * 0.618_033_988_749_895).fract();
            let point = (turn * points.len() as f64) as usize;
            let (cell, jitter) = (hilbert(side, i), Draws::new([pixel, i, 1]).next());
            let u = [0, 1].map(|k| {
                let u = (cell[k] as f32 + jitter[k]) / side as f32 + shift[k];
                u.fract().min(1.0 - f32::EPSILON)
            });
            let direction = draw_once(&points[point], lobes[point].roughness, self.options.lobe, u);
            if direction.dot(points[point].point.normal) > 0.0 {
                n_leaving[point] += 1;
                candidates.push(Candidate { point, direction });
            }
        }
        for (point, count) in n_leaving.iter_mut().enumerate() {
            // A point seen from behind its shading normal may send nothing out of its surface.
            if *count == 0 {
                *count = 1;
                let direction = points[point].point.normal;
                candidates.push(Candidate { point, direction });
            }
        }
        let share = |candidate: &Candidate| 1.0 / n_leaving[candidate.point] as f32;
        let weights: Vec<f32> = candidates
            .iter()
            .map(|candidate| {
                let roughness = lobes[candidate.point].roughness;
                share(candidate) * self.importance.of(candidate.direction, roughness)
            })
            .collect();
        let sum: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
        let step = (sum / f64::from(n_paths)) as f32;
        systematic(&weights, n_paths, start)
            .map(|(i, times)| {
                let candidate = candidates[i];
                let expected = weights[i] / step;
                (candidate, share(&candidate) * times as f32 / expected)
            })
            .collect()
    }

    /// A direction of a walker's lobe, picked from several by what light comes from there, and its share of the lobe.
    fn next_direction(&self, walker: &Walker, roughness: f32, draws: &mut Draws) -> (Vec3, f32) {
        let mut sum = 0.0;
        let mut picked = (Vec3::ZERO, 1.0);
        for _ in 0..CANDIDATES {
            let direction = draw(walker, roughness, self.options.lobe, draws);
            let weight = self.importance.of(direction, roughness);
            sum += weight;
            // The first is taken for certain, each later one in proportion to its weight.
            if draws.next()[0] * sum < weight {
                picked = (direction, weight);
            }
        }
        let (direction, weight) = picked;
        (direction, sum / (CANDIDATES as f32 * weight))
    }

    /// Sends a ray on; where it meets the object, `may_meet` given, the walker there.
    fn send(
        &mut self,
        walker: &Walker,
        (direction, thin): (Vec3, Lobe),
        throughput: Vec3,
        may_meet: bool,
    ) -> Option<Walker> {
        let met = may_meet.then(|| arrive(self.object, &walker.point, direction, 0.0));
        let Some(point) = met.flatten() else {
            self.throughputs.push(throughput);
            let ray = first_lobe_ray(&walker.point, direction, &thin, &self.motion, &self.frame);
            self.rays.push(ray);
            return None;
        };
        Some(Walker {
            point,
            throughput,
            ..*walker
        })
    }
}

/// The lobe where a path is.
#[derive(Clone, Copy, Debug)]
struct WalkerLobe {
    roughness: f32,
    /// Share of what comes along it that reaches the eye.
    throughput: Vec3,
    /// The thinnest ray from there.
    thin: Lobe,
}

/// The thinnest ray of a lobe, in an environment that was taught none sharper than of variance `sharpest`: narrower only
/// where photos taught it this very surface's.
fn thin_ray(object: &ObjectModel, roughness: f32, learned: f32, sharpest: f32) -> Lobe {
    let taught = Lobe::from_roughness(learned).variance.min(sharpest);
    let untaught = untaught_share(object, roughness, learned);
    Lobe::from_variance(taught + (sharpest - taught) * untaught)
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
fn draw(walker: &Walker, roughness: f32, lobe: LobeShape, draws: &mut Draws) -> Vec3 {
    let normal = walker.point.normal;
    let mut direction = normal;
    for _ in 0..MAX_DRAWS {
        direction = draw_once(walker, roughness, lobe, draws.next());
        if direction.dot(normal) > 0.0 {
            return direction;
        }
    }
    (direction - 2.0 * direction.dot(normal) * normal).normalize_or_zero()
}

/// A direction of the lobe, by two numbers in `[0, 1)`; it may point into the surface.
fn draw_once(walker: &Walker, roughness: f32, lobe: LobeShape, u: [f32; 2]) -> Vec3 {
    let SurfacePoint { normal, to_eye, .. } = walker.point;
    match lobe {
        LobeShape::Model => {
            let axis = 2.0 * normal.dot(to_eye) * normal - to_eye;
            sample_vmf(kappa_from_roughness(roughness), axis, u)
        }
        LobeShape::Ggx => {
            let h = visible_ggx_normal(normal, to_eye, roughness * roughness, u);
            (2.0 * h.dot(to_eye) * h - to_eye).normalize_or_zero()
        }
    }
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
    use super::*;
    use crate::neif::RoughnessEdit;
    use crate::render::test_scene::{self, NEVER, camera, squared_difference};
    use crate::render::{Layer, Picture, render_reference};

    fn reference(scene: &Scene, n_paths: u32, lobe: LobeShape) -> Picture {
        let options = ReferenceOptions { n_paths, lobe };
        let picture = render_reference(scene, &camera(24, 16), options, &NEVER, &|_| {});
        picture.expect("not cancelled")
    }

    #[test]
    fn a_mirror_needs_one_ray_only() {
        let mut scene = test_scene::scene();
        scene.edit.roughness = RoughnessEdit::Constant(0.0);
        let cones = test_scene::picture(&scene, &camera(24, 16), Layer::Final);
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
        for lobe in [LobeShape::Model, LobeShape::Ggx] {
            let [few, some, many] = [4, 64, 1024].map(|n| reference(&scene, n, lobe));
            let [far, near] = [few, some].map(|picture| squared_difference(&picture, &many));
            assert!(near < 0.5 * far, "{lobe:?}: {far} then {near}");
        }
    }

    #[test]
    fn few_paths_are_right_on_average() {
        let mut scene = test_scene::scene();
        scene.environment = test_scene::fog(0.0, 2.0);
        scene.trained_in = None;
        scene.edit.roughness = RoughnessEdit::Constant(0.7);
        for lobe in [LobeShape::Model, LobeShape::Ggx] {
            let [few, many] = [2, 1024].map(|n| {
                let pixels = reference(&scene, n, lobe).pixels;
                let linear = pixels.iter().flatten().map(|v| f64::from(v.powf(2.2)));
                linear.sum::<f64>() / (3 * pixels.len()) as f64
            });
            assert!((few / many - 1.0).abs() < 0.01, "{lobe:?}: {few}, {many}");
        }
    }
}
