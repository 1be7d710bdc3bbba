//! Radiance of pixels: the surroundings through a pixel's cone, the object by the pixel equation.

use glam::Vec3;

use super::gbuffer::GBuffer;
use super::scene::{Layer, Scene};
use super::trace::TracedPoint;
use crate::geometry::Camera;
use crate::neif::EnvironmentFromWorld;
use crate::neif::display::Display;
use crate::neif::lobe::Lobe;
use crate::neif::material::{MaterialBatch, Surface};
use crate::neif::object::ObjectModel;
use crate::neif::proposal::ConeRay;
use crate::neif::radiance_field::{FieldBatch, FieldRay};
use crate::neif::shading::{fresnel, outgoing};

/// Pixels shaded together: their samples stay in the core's cache.
const TILE: usize = 64;
/// Standard deviation of a uniform pixel, pixels.
const PIXEL_STD: f32 = 0.288_675_13;
/// Uniform share of the sample placement when rendering: the density cache has settled.
const UNIFORM_SHARE: f32 = 0.05;
/// Blocked or free shares of a lobe below this are not worth a ray.
const SHARE_MARGIN: f32 = 0.01;

/// Working memory of one thread, reused from call to call.
#[derive(Debug, Default)]
pub struct ShadeScratch {
    batch: FieldBatch,
    material: MaterialBatch,
    points: Vec<Vec3>,
    encoded: Vec<f32>,
}

/// Linear radiance of the surroundings through each listed pixel (`y * width + x` of `camera`); `out`: one a pixel.
pub fn shade_background(
    scene: &Scene,
    camera: &Camera,
    pixels: &[u32],
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    let motion = scene.transform.environment_from_world();
    let frame = scene.environment.frame();
    let spread = camera.pixel_angle() * PIXEL_STD;
    for (pixels, out) in pixels.chunks(TILE).zip(out.chunks_mut(TILE)) {
        scratch.batch.rays.clear();
        for &pixel in pixels {
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            let direction = motion.direction(ray.direction).to_array();
            let origin = frame.field_from_world(motion.point(ray.origin)).to_array();
            let cone = ConeRay {
                origin,
                direction,
                base: 0.0,
                spread,
                lobe_variance: 0.0,
            };
            scratch.batch.rays.push(FieldRay {
                cone,
                direction,
                kappa: f32::INFINITY,
            });
        }
        scratch.light(scene);
        for (out, radiance) in out.iter_mut().zip(&scratch.batch.radiance) {
            *out = (Vec3::from(*radiance) * motion.gain).to_array();
        }
    }
}

/// The object's part of each listed pixel: linear radiance, or the layer's value; 0 where the object is not seen.
pub fn shade_object(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    layer: Layer,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    out.fill([0.0; 3]);
    let Some(object) = &scene.object else { return };
    for (pixels, out) in pixels.chunks(TILE).zip(out.chunks_mut(TILE)) {
        let seen: Vec<(usize, &TracedPoint)> = pixels
            .iter()
            .enumerate()
            .filter_map(|(i, &pixel)| Some((i, gbuffer.point_at(pixel)?)))
            .collect();
        let points: Vec<&TracedPoint> = seen.iter().map(|s| s.1).collect();
        for ((i, _), value) in seen
            .iter()
            .zip(shade_points(scene, object, &points, layer, scratch))
        {
            out[*i] = value.to_array();
        }
    }
}

/// A point's edited surface and its rays.
#[derive(Clone, Copy)]
struct Lit {
    surface: Surface,
    share: f32,
    free: Option<usize>,
    /// The ray and the surface of the point the lobe meets.
    met: Option<(usize, Surface)>,
}

fn shade_points(
    scene: &Scene,
    object: &ObjectModel,
    points: &[&TracedPoint],
    layer: Layer,
    scratch: &mut ShadeScratch,
) -> Vec<Vec3> {
    let seconds: Vec<usize> = (0..points.len())
        .filter(|&i| points[i].second.is_some())
        .collect();
    scratch.points.clear();
    scratch
        .points
        .extend(points.iter().map(|p| p.point.position));
    scratch.points.extend(
        seconds
            .iter()
            .filter_map(|&i| points[i].second.map(|s| s.point.position)),
    );
    object
        .material
        .forward(&scratch.points, &mut scratch.material, &mut scratch.encoded);
    let surfaces: Vec<Surface> = scratch
        .material
        .surfaces
        .iter()
        .map(|s| scene.edit.apply(*s))
        .collect();
    if let Some(values) = unlit(scene, points, &surfaces, layer) {
        return values;
    }
    let motion = scene.transform.environment_from_world();
    let mut met = seconds.iter().zip(&surfaces[points.len()..]).peekable();
    scratch.batch.rays.clear();
    let lit: Vec<Lit> = points
        .iter()
        .enumerate()
        .map(|(i, point)| {
            let second = met
                .next_if(|(at, _)| **at == i)
                .map(|(_, surface)| *surface);
            aim(
                scene,
                point,
                surfaces[i],
                second,
                &motion,
                &mut scratch.batch.rays,
            )
        })
        .collect();
    scratch.light(scene);
    let light = |ray: usize| Vec3::from(scratch.batch.radiance[ray]) * motion.gain;
    let gain = scene.edit.specular_gain();
    lit.iter()
        .zip(points)
        .map(|(lit, point)| {
            let free = lit.free.map_or(Vec3::ZERO, light);
            let met = lit
                .met
                .zip(point.second)
                .map_or(Vec3::ZERO, |((ray, surface), second)| {
                    outgoing(&surface, second.point.n_dot_v(), gain, light(ray))
                });
            let incoming = free * (1.0 - lit.share) + met * lit.share;
            let cos = point.point.n_dot_v();
            let part = match layer {
                Layer::Diffuse => Surface { ..lit.surface },
                Layer::Specular => Surface {
                    diffuse: Vec3::ZERO,
                    ..lit.surface
                },
                _ => lit.surface,
            };
            let incoming = if layer == Layer::Diffuse {
                Vec3::ZERO
            } else {
                incoming
            };
            outgoing(&part, cos, gain, incoming)
        })
        .collect()
}

/// Layers that need no light.
fn unlit(
    scene: &Scene,
    points: &[&TracedPoint],
    surfaces: &[Surface],
    layer: Layer,
) -> Option<Vec<Vec3>> {
    let value = |point: &TracedPoint, surface: &Surface| match layer {
        Layer::Roughness => Some(Vec3::splat(surface.roughness)),
        Layer::Tint => Some(fresnel(surface.tint, 1.0) * scene.edit.specular_gain()),
        Layer::Normal => Some(point.point.normal * 0.5 + Vec3::splat(0.5)),
        Layer::Environment => Some(Vec3::ZERO),
        Layer::Final | Layer::Diffuse | Layer::Specular => None,
    };
    points
        .iter()
        .zip(surfaces)
        .map(|(point, surface)| value(point, surface))
        .collect()
}

/// Adds the rays that a point's lobe needs.
fn aim(
    scene: &Scene,
    traced: &TracedPoint,
    surface: Surface,
    second: Option<Surface>,
    motion: &EnvironmentFromWorld,
    rays: &mut Vec<FieldRay>,
) -> Lit {
    let frame = scene.environment.frame();
    let lobe = Lobe::from_roughness(surface.roughness);
    let share = if second.is_some() {
        traced.blocked.share(lobe.kappa).0
    } else {
        0.0
    };
    let mut push = |ray| {
        rays.push(ray);
        rays.len() - 1
    };
    let free = (share < 1.0 - SHARE_MARGIN)
        .then(|| push(traced.point.lobe_ray(&lobe, 0.0, motion, frame)));
    let met = second
        .zip(traced.second)
        .filter(|_| share > SHARE_MARGIN)
        .map(|(surface, second)| {
            let second_lobe = Lobe::from_roughness(surface.roughness);
            let seen = second.point.seen_through(lobe.variance, second.distance);
            (
                push(seen.lobe_ray(&second_lobe, lobe.variance, motion, frame)),
                surface,
            )
        });
    Lit {
        surface,
        share,
        free,
        met,
    }
}

impl ShadeScratch {
    /// Evaluates the environment along the batch's rays.
    pub(super) fn light(&mut self, scene: &Scene) {
        let environment = &scene.environment;
        self.batch.place(
            &environment.density,
            environment.n_samples(),
            UNIFORM_SHARE,
            |_| [0.0; 2],
        );
        environment.field.encode(&mut self.batch, &mut self.encoded);
        environment.field.forward(&mut self.batch);
    }

    /// Rays to evaluate, and after [`Self::light`] their radiance.
    pub(super) fn batch(&mut self) -> &mut FieldBatch {
        &mut self.batch
    }
}

/// Object over background by coverage, in linear light, then the display transform; in `[0, 1]`.
pub fn compose(
    scene: &Scene,
    layer: Layer,
    coverage: f32,
    object: [f32; 3],
    background: [f32; 3],
) -> [f32; 3] {
    let behind = if layer.shows_background() {
        background
    } else {
        [0.0; 3]
    };
    let mixed: [f32; 3] =
        std::array::from_fn(|c| object[c] * coverage + behind[c] * (1.0 - coverage));
    match layer {
        Layer::Roughness | Layer::Normal => mixed.map(|v| v.clamp(0.0, 1.0)),
        _ => {
            let display = Display {
                gamma: scene.environment.gamma(),
            };
            mixed.map(|v| display.value(v.max(0.0)).min(1.0))
        }
    }
}
