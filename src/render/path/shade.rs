//! Radiance of pixels: the surroundings through a pixel's cone, the object by the pixel equation.

use glam::Vec3;

use super::aim::aim_lobes;
use super::blocked_cones::{BlockedCone, Contribution};
use super::gbuffer::GBuffer;
use super::more_cones;
use super::trace::PIXEL_STD;
use crate::geometry::Camera;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::{EnvironmentField, LightScratch};
use crate::neif::light::light_path::{self, LitVertex, PathVertex};
use crate::neif::light::lobe_cones::PathOfPixel;
use crate::neif::light::shading::{fresnel, outgoing};
use crate::neif::surface::material::Surface;
use crate::neif::surface::object::ObjectModel;
use crate::neif::{EditedSurfaces, Environment};
use crate::render::background::{BLUR_STD, Background};
use crate::render::diagnostic::{depth_share, diagnostic_color, visibility};
use crate::render::scene::{Layer, Scene};

/// Most samples a ray in a picture in motion.
pub(in crate::render) const MOTION_SAMPLES: usize = 8;
/// Pixels shaded together: their samples stay in the core's cache.
pub(in crate::render) const TILE: usize = 64;
/// Rays evaluated together: split lobes have thousands in a tile, whose samples would take gigabytes.
const PIECE: usize = 128;
const _: () = assert!(
    TILE <= PIECE,
    "see_background asks for the samples of a whole tile"
);

/// Working memory of one thread, reused from call to call.
#[derive(Debug, Default)]
pub struct ShadeScratch {
    /// Rays to evaluate, and their radiance.
    pub(in crate::render) rays: Vec<FieldRay>,
    radiance: Vec<[f32; 3]>,
    /// Those that were evaluated last, with their samples.
    batch: FieldBatch,
    pub(in crate::render) edited: EditedSurfaces,
    light: LightScratch,
    /// Of each path, its pixel in the tile.
    pixel_of_path: Vec<usize>,
    pub(in crate::render) lit: Vec<LitVertex>,
    /// Cones of split lobes that meet the object, the surfaces there, and the rays that go on.
    pub(in crate::render) blocked: Vec<BlockedCone>,
    pub(in crate::render) beyond: EditedSurfaces,
    pub(super) contributions: Vec<Contribution>,
    /// Most samples a ray; none leaves the number to the surroundings.
    most_samples: Option<usize>,
}

/// What a pixel sees of the surroundings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::render) struct SeenLight {
    /// Where, in the field's coordinates; far away where nothing is met.
    pub(in crate::render) position: Vec3,
    /// Linear radiance before the transform's gain.
    pub(in crate::render) radiance: [f32; 3],
}

/// What light that no photo showed looks like where that is marked, linear: rare in photos of things.
const UNSEEN: Vec3 = Vec3::new(0.6, 0.05, 0.5);
/// Where light comes from that has no place, in half sides of the inner box.
const FAR: f32 = 1e5;

/// Linear radiance of the surroundings, blurred if the scene says so, through each listed pixel (`y * width + x` of `camera`); `out`: one a pixel.
pub fn shade_background(
    scene: &Scene,
    camera: &Camera,
    pixels: &[u32],
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    let gain = scene.transform.environment_from_world().gain;
    for (pixels, out) in pixels.chunks(TILE).zip(out.chunks_mut(TILE)) {
        scratch.aim_at_background(scene, camera, pixels);
        scratch.light(scene);
        for (out, radiance) in out.iter_mut().zip(&scratch.radiance) {
            *out = (Vec3::from(*radiance) * gain).to_array();
        }
    }
}

/// [`shade_background`] with where the light comes from.
pub(in crate::render) fn see_background(
    scene: &Scene,
    camera: &Camera,
    pixels: &[u32],
    out: &mut [SeenLight],
    scratch: &mut ShadeScratch,
) {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    for (pixels, out) in pixels.chunks(TILE).zip(out.chunks_mut(TILE)) {
        scratch.aim_at_background(scene, camera, pixels);
        scratch.light(scene);
        let batch = &scratch.batch;
        for (i, out) in out.iter_mut().enumerate() {
            let t = match scene.environment.field() {
                EnvironmentField::Grid { .. } if !scene.environment.is_far() => {
                    median_distance(batch, i)
                }
                _ => FAR,
            };
            *out = SeenLight {
                position: batch.rays[i].cone.at(t).into(),
                radiance: batch.radiance[i],
            };
        }
    }
}

/// Where half of what a ray of the batch meets lies before.
fn median_distance(batch: &FieldBatch, ray: usize) -> f32 {
    let n = batch.weights().len() / batch.rays.len().max(1);
    let samples = ray * n..(ray + 1) * n;
    let (weights, distances) = (
        &batch.weights()[samples.clone()],
        &batch.distances()[samples],
    );
    let half = 0.5 * weights.iter().sum::<f32>();
    let mut before = 0.0;
    for (weight, distance) in weights.iter().zip(distances) {
        before += weight;
        if before >= half && before > 0.0 {
            return *distance;
        }
    }
    FAR
}

/// The object's part of each listed pixel: linear radiance, or the layer's value; 0 where the object is not seen. What a
/// settled picture shows: more cones where they disagree.
pub fn shade_object(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    layer: Layer,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    let doubts = shade_object_once(scene, gbuffer, pixels, layer, 1, out, scratch);
    more_cones::shade_doubtful(scene, gbuffer, pixels, layer, (out, &doubts), scratch);
}

/// [`shade_object`] with `times` as many cones of split lobes as usual in every pixel; returns each pixel's standard
/// error as far as its cones tell, in display values.
pub(in crate::render) fn shade_object_once(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    layer: Layer,
    times: u32,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) -> Vec<f32> {
    assert_eq!(pixels.len(), out.len(), "one result a pixel");
    out.fill([0.0; 3]);
    let mut doubts = vec![0.0; pixels.len()];
    let Some(object) = &scene.object else {
        return doubts;
    };
    let tiles = out.chunks_mut(TILE).zip(doubts.chunks_mut(TILE));
    for (pixels, (out, doubts)) in pixels.chunks(TILE).zip(tiles) {
        let mut pixel_of_path = std::mem::take(&mut scratch.pixel_of_path);
        pixel_of_path.clear();
        let mut paths: Vec<&[PathVertex]> = Vec::new();
        for (i, &pixel) in pixels.iter().enumerate() {
            paths.extend(gbuffer.paths_at(pixel));
            pixel_of_path.resize(paths.len(), i);
        }
        let mut counts = [0_u32; TILE];
        let mut numbers = Vec::with_capacity(paths.len());
        for &i in &pixel_of_path {
            numbers.push(counts[i]);
            counts[i] += 1;
        }
        let of_pixel = |path: usize| PathOfPixel {
            index: numbers[path],
            of: counts[pixel_of_path[path]],
            times,
        };
        let view = PathView {
            layer,
            eye: gbuffer.eye(),
        };
        let values = shade_paths(scene, object, &paths, of_pixel, view, scratch);
        let mut variances = [Vec3::ZERO; TILE];
        for (&i, path) in pixel_of_path.iter().zip(&values) {
            out[i] = (Vec3::from(out[i]) + path.value).to_array();
            variances[i] += path.doubt * path.doubt;
        }
        scratch.pixel_of_path = pixel_of_path;
        // Costs add up over a pixel's paths; everything else is their mean.
        if layer == Layer::Samples {
            continue;
        }
        let results = out.iter_mut().zip(doubts).zip(counts).zip(variances);
        for (((out, doubt), n), variance) in results {
            let share = 1.0 / n.max(1) as f32;
            *out = out.map(|v| v * share);
            *doubt = shown_doubt(scene, Vec3::from(*out), variance.map(f32::sqrt) * share);
        }
    }
    doubts
}

/// How much an error of a linear value shows in the picture, the worst colour.
fn shown_doubt(scene: &Scene, value: Vec3, error: Vec3) -> f32 {
    if error == Vec3::ZERO {
        return 0.0;
    }
    let shown = |v: Vec3| Vec3::from(compose(scene, Layer::Final, 1.0, v.to_array(), [0.0; 3]));
    (shown(value + error) - shown(value)).max_element()
}

/// What is wanted of a path, and from where it is seen.
#[derive(Clone, Copy)]
pub(in crate::render) struct PathView {
    pub(in crate::render) layer: Layer,
    pub(in crate::render) eye: Vec3,
}

/// What a path sends to the eye.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::render) struct PathLight {
    /// The layer's value at the first vertex.
    pub(in crate::render) value: Vec3,
    /// Its standard error as far as the cones of a split lobe tell.
    pub(in crate::render) doubt: Vec3,
}

impl From<Vec3> for PathLight {
    fn from(value: Vec3) -> Self {
        Self {
            value,
            doubt: Vec3::ZERO,
        }
    }
}

/// The layer's value at the first vertex of each path.
pub(in crate::render) fn shade_paths(
    scene: &Scene,
    object: &ObjectModel,
    paths: &[&[PathVertex]],
    of_pixel: impl Fn(usize) -> PathOfPixel,
    view: PathView,
    scratch: &mut ShadeScratch,
) -> Vec<PathLight> {
    let vertices = paths.iter().flat_map(|path| path.iter());
    let points = vertices.map(|vertex| (vertex.point.position, vertex.point.normal));
    let mut starts = Vec::with_capacity(paths.len());
    let mut start = 0;
    for path in paths {
        starts.push(start);
        start += path.len();
    }
    let is_first = |i: usize| starts.binary_search(&i).is_ok();
    scratch.surfaces(scene, object, points, is_first);
    let edited = &scratch.edited;
    if let Some(values) = unlit(scene, object, (paths, &starts), edited, view) {
        return values.into_iter().map(PathLight::from).collect();
    }
    if view.layer == Layer::Samples {
        let (lit, mut n_rays) = aim_lobes(scene, object, (paths, &starts), of_pixel, scratch);
        for Contribution { owner, .. } in &scratch.contributions {
            if let Ok(path) = lit.binary_search_by_key(owner, |lit| lit.start) {
                n_rays[path] += 1;
            }
        }
        let n_samples = scene.environment.n_samples();
        let samples = |n: usize| PathLight::from(Vec3::splat((n * n_samples) as f32));
        return n_rays.into_iter().map(samples).collect();
    }
    let light = lobe_light(scene, object, (paths, &starts), of_pixel, scratch);
    let edited = &scratch.edited;
    let starts = starts.into_iter().zip(light);
    let lit = paths
        .iter()
        .zip(starts)
        .map(|(path, (start, (light, doubt)))| {
            let surface = edited.surfaces()[start];
            let surface = match view.layer {
                Layer::Specular => Surface {
                    diffuse: Vec3::ZERO,
                    ..surface
                },
                _ => surface,
            };
            let gain = edited.specular_gain()[start];
            let cos = path[0].point.n_dot_v();
            PathLight {
                value: outgoing(&surface, cos, gain, light),
                doubt: fresnel(surface.tint, cos) * gain * doubt,
            }
        });
    lit.collect()
}

/// What a path, the only one of a settled picture's pixel, sends to the eye, and what its first lobe gathers for that,
/// linear radiance; leaves the path's surfaces in the scratch.
pub(in crate::render) fn settled_path(
    scene: &Scene,
    object: &ObjectModel,
    path: &[PathVertex],
    scratch: &mut ShadeScratch,
) -> (Vec3, Vec3) {
    let points = path.iter();
    let points = points.map(|vertex| (vertex.point.position, vertex.point.normal));
    scratch.surfaces(scene, object, points, |i| i == 0);
    let mut seen = |times: u32| {
        let alone = |_| PathOfPixel {
            times,
            ..PathOfPixel::ALONE
        };
        let (light, doubt) = lobe_light(scene, object, (&[path], &[0]), alone, scratch)[0];
        let (surface, gain) = (
            scratch.edited.surfaces()[0],
            scratch.edited.specular_gain()[0],
        );
        let cos = path[0].point.n_dot_v();
        let doubt = fresnel(surface.tint, cos) * gain * doubt;
        (outgoing(&surface, cos, gain, light), light, doubt)
    };
    let (value, light, doubt) = seen(1);
    let times = more_cones::times(shown_doubt(scene, value, doubt));
    if times == 1 {
        return (value, light);
    }
    let (value, light, _) = seen(times);
    (value, light)
}

/// What the lobe at the first vertex of each path gathers and the doubt of it; `starts` are the indices of its surfaces in the scratch.
fn lobe_light(
    scene: &Scene,
    object: &ObjectModel,
    (paths, starts): (&[&[PathVertex]], &[usize]),
    of_pixel: impl Fn(usize) -> PathOfPixel,
    scratch: &mut ShadeScratch,
) -> Vec<(Vec3, Vec3)> {
    let motion = scene.transform.environment_from_world();
    let (lit, _) = aim_lobes(scene, object, (paths, starts), of_pixel, scratch);
    scratch.light(scene);
    for Contribution {
        owner,
        ray,
        throughput,
    } in &scratch.contributions
    {
        let radiance = Vec3::from(scratch.radiance[*ray]) * motion.gain;
        scratch.lit[*owner].add_from_object(*throughput * radiance);
    }
    if let Some(highlights) = scene.highlights() {
        for ((path, &start), lit) in paths.iter().zip(starts).zip(&lit) {
            let roughness = scratch.edited.surfaces()[start].roughness;
            if let Some(split) = scratch.lit[lit.start].split() {
                let cones = &mut scratch.radiance[split.rays()];
                let at = (&path[0].point, roughness);
                split.from_lamps = highlights.take(&object.tracer, at, cones) * motion.gain;
            }
        }
    }
    let (edited, radiance, vertices) = (&scratch.edited, &scratch.radiance, &mut scratch.lit);
    let gain = |surface: usize| edited.specular_gain()[surface];
    let incoming = |ray: usize| Vec3::from(radiance[ray]) * motion.gain;
    lit.into_iter()
        .map(|lit| {
            let vertices = &mut vertices[lit];
            let light = light_path::gather(vertices, gain, incoming);
            (light, vertices.first().map_or(Vec3::ZERO, LitVertex::doubt))
        })
        .collect()
}

/// Layers that need no light along lobes.
fn unlit(
    scene: &Scene,
    object: &ObjectModel,
    (paths, starts): (&[&[PathVertex]], &[usize]),
    edited: &EditedSurfaces,
    view: PathView,
) -> Option<Vec<Vec3>> {
    let (tracer, surfaces) = (&object.tracer, edited.surfaces());
    let value = |number: usize, path: &[PathVertex], i: usize| match view.layer {
        Layer::Diffuse => {
            let (cos, gain) = (path[0].point.n_dot_v(), edited.specular_gain()[i]);
            Some(outgoing(&surfaces[i], cos, gain, Vec3::ZERO))
        }
        Layer::Albedo | Layer::Irradiance => {
            let point = &path[0].point;
            let at = (point.position, point.normal);
            let [light, albedo] = scene.surface_light(at, surfaces[i].diffuse);
            Some(match view.layer {
                Layer::Albedo => albedo,
                _ => light,
            })
        }
        Layer::Roughness => Some(Vec3::splat(surfaces[i].roughness)),
        Layer::Tint => Some(fresnel(surfaces[i].tint, 1.0) * edited.specular_gain()[i]),
        Layer::Normal => Some(path[0].point.normal * 0.5 + Vec3::splat(0.5)),
        Layer::Environment => Some(Vec3::ZERO),
        Layer::Depth => Some(Vec3::splat(depth_share(
            tracer,
            view.eye,
            path[0].point.position,
        ))),
        Layer::Visibility => Some(Vec3::splat(visibility(
            tracer,
            &path[0].point,
            number as f32,
        ))),
        Layer::Final | Layer::Specular | Layer::Samples | Layer::Seen => None,
    };
    paths
        .iter()
        .zip(starts)
        .enumerate()
        .map(|(number, (path, &start))| value(number, path, start))
        .collect()
}

impl ShadeScratch {
    /// For pictures in motion: at most so many samples a ray.
    pub(in crate::render) fn with_most_samples(n: usize) -> Self {
        Self {
            most_samples: Some(n),
            ..Self::default()
        }
    }

    /// The rays of pixels (`y * width + x` of `camera`) into the surroundings.
    fn aim_at_background(&mut self, scene: &Scene, camera: &Camera, pixels: &[u32]) {
        let motion = scene.transform.environment_from_world();
        let frame = scene.environment.frame();
        let spread = camera.pixel_angle() * PIXEL_STD;
        let is_blurred = scene.background == Background::Blurred;
        self.rays.clear();
        for &pixel in pixels {
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
            let direction = motion.direction(ray.direction).to_array();
            let origin = frame.field_from_world(motion.point(ray.origin)).to_array();
            self.rays.push(if is_blurred {
                let variance = BLUR_STD * BLUR_STD;
                FieldRay::of_cone(origin.into(), direction.into(), variance, 0.0)
            } else {
                FieldRay::of_pixel(origin, direction, 0.0, spread)
            });
        }
    }

    /// Evaluates the environment along the rays, [`PIECE`] at a time.
    pub(in crate::render) fn light(&mut self, scene: &Scene) {
        let environment = &scene.environment;
        let most = self.most_samples.unwrap_or(usize::MAX);
        self.radiance.clear();
        for rays in self.rays.chunks(PIECE) {
            self.batch.rays.clear();
            self.batch.rays.extend_from_slice(rays);
            environment.light_by(most, &mut self.batch, &mut self.light);
            if let Some(ground) = &scene.ground {
                ground.apply(&mut self.batch);
            }
            if scene.marks_unseen {
                mark_unseen(environment, &mut self.batch);
            }
            self.radiance.extend_from_slice(&self.batch.radiance);
        }
    }

    /// [`light_surfaces`] of a path's vertices or others.
    pub(in crate::render) fn surfaces(
        &mut self,
        scene: &Scene,
        object: &ObjectModel,
        points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
        is_seen: impl Fn(usize) -> bool,
    ) -> &EditedSurfaces {
        light_surfaces(&mut self.edited, scene, object, points, is_seen);
        &self.edited
    }

    /// The surfaces that were last evaluated.
    pub(in crate::render) fn edited(&mut self) -> &mut EditedSurfaces {
        &mut self.edited
    }

    /// Rays to evaluate.
    pub(in crate::render) fn rays(&mut self) -> &mut Vec<FieldRay> {
        &mut self.rays
    }

    /// Linear radiance of each of the rays before the transform's gain, after [`Self::light`].
    pub(in crate::render) fn radiance(&self) -> &[[f32; 3]] {
        &self.radiance
    }
}

/// Evaluates the edited surfaces at world points with unit normals, their diffuse part in the light of the scene: with
/// the edges of shadows where the point of that number `is_seen` directly, as far as the probes tell elsewhere.
pub(super) fn light_surfaces(
    edited: &mut EditedSurfaces,
    scene: &Scene,
    object: &ObjectModel,
    points: impl Iterator<Item = (Vec3, Vec3)> + Clone,
    is_seen: impl Fn(usize) -> bool,
) {
    edited.evaluate(object, &scene.edit, &scene.regions, points.clone());
    let gain = scene.transform.environment_from_world().gain;
    let surfaces = edited.surfaces_mut().iter_mut();
    for (i, (surface, at)) in surfaces.zip(points).enumerate() {
        surface.diffuse *= scene.diffuse_response(at, gain, is_seen(i));
    }
}

/// Gives the signal colour to light of an evaluated batch that no photo showed.
fn mark_unseen(environment: &Environment, batch: &mut FieldBatch) {
    for ray in 0..batch.rays.len() {
        let share = environment.seen_share(batch, ray);
        let seen = Vec3::from(batch.radiance[ray]);
        batch.radiance[ray] = UNSEEN.lerp(seen, share).to_array();
    }
}

/// Factor of an exposure of the picture; finite, so that black stays black.
pub(in crate::render) fn display_gain(ev: f32) -> f32 {
    ev.clamp(-60.0, 60.0).exp2()
}

/// Object over background by coverage, in linear light, then the display transform; in `[0, 1]`.
pub fn compose(
    scene: &Scene,
    layer: Layer,
    coverage: f32,
    object: [f32; 3],
    background: [f32; 3],
) -> [f32; 3] {
    if let Some(color) = diagnostic_color(scene, layer, coverage, object[0]) {
        return color;
    }
    let behind = if scene.shows_background(layer) {
        background
    } else {
        [0.0; 3]
    };
    let mixed: [f32; 3] =
        std::array::from_fn(|c| object[c] * coverage + behind[c] * (1.0 - coverage));
    scene.shown(layer).values(mixed.map(|v| v.max(0.0)))
}
