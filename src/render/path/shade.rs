//! Radiance of pixels: the environment through a pixel's cone, the object by the pixel equation.

use glam::Vec3;

use super::aim::aim_lobes;
use super::gbuffer::GBuffer;
use super::more_cones::{STEPS, times};
use super::scratch::{Contribution, FAR, PIECE, SeenLight, ShadeScratch, TILE, light_surfaces};
use crate::geometry::Camera;
use crate::neif::EditedSurfaces;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::light::light_path::{self, PathVertex};
use crate::neif::light::lobe_cones::PathOfPixel;
use crate::neif::light::shading::{fresnel, outgoing};
use crate::neif::surface::object::ObjectModel;
use crate::render::diagnostic::{depth_share, diagnostic_color, visibility};
use crate::render::scene::{Layer, Scene};

/// Most samples a ray in a picture in motion.
pub(in crate::render) const MOTION_SAMPLES: usize = 8;
const _: () = assert!(
    TILE <= PIECE,
    "see_background asks for the samples of a whole tile"
);

/// Linear radiance of the environment, blurred if the scene says so, through each listed pixel (`y * width + x` of `camera`); `out`: one a pixel.
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
        let is_near = scene.environment.has_surfaces();
        for (i, out) in out.iter_mut().enumerate() {
            let t = if is_near {
                median_distance(batch, i)
            } else {
                FAR
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
    let weights = &batch.weights()[samples.clone()];
    let half = 0.5 * weights.iter().sum::<f32>();
    let mut before = 0.0;
    let median = weights.iter().position(|weight| {
        before += weight;
        before >= half && before > 0.0
    });
    median.map_or(FAR, |i| batch.distances()[samples.start + i])
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
    let errors = shade_object_once(scene, gbuffer, pixels, layer, 1, out, scratch);
    shade_uncertain(scene, gbuffer, pixels, layer, (out, &errors), scratch);
}

/// [`shade_object`] with `times` as many cones of split lobes as usual in every pixel; returns each pixel's standard
/// error as estimated from its cones, in display values.
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
    let mut std_errors = vec![0.0; pixels.len()];
    let Some(object) = &scene.object else {
        return std_errors;
    };
    let tiles = out.chunks_mut(TILE).zip(std_errors.chunks_mut(TILE));
    for (pixels, (out, std_errors)) in pixels.chunks(TILE).zip(tiles) {
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
            variances[i] += path.std_error * path.std_error;
        }
        scratch.pixel_of_path = pixel_of_path;
        // Costs add up over a pixel's paths; everything else is their mean.
        if layer == Layer::Samples {
            continue;
        }
        let results = out.iter_mut().zip(std_errors).zip(counts).zip(variances);
        for (((out, error), n), variance) in results {
            let share = 1.0 / n.max(1) as f32;
            *out = out.map(|v| v * share);
            *error = shown_error(scene, Vec3::from(*out), variance.map(f32::sqrt) * share);
        }
    }
    std_errors
}

/// How much an error of a linear value shows in the picture, the worst colour.
fn shown_error(scene: &Scene, value: Vec3, error: Vec3) -> f32 {
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
    /// Its standard error as estimated from the cones of a split lobe.
    pub(in crate::render) std_error: Vec3,
    /// Linear radiance that its lobe gathers, where the layer needs that.
    pub(in crate::render) incoming: Vec3,
}

impl From<Vec3> for PathLight {
    fn from(value: Vec3) -> Self {
        Self {
            value,
            ..Self::default()
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
    light_surfaces(&mut scratch.edited, scene, object, points, is_first);
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
        .map(|(path, (start, (incoming, error)))| {
            let mut surface = edited.surfaces()[start];
            if view.layer == Layer::Specular {
                surface.diffuse = Vec3::ZERO;
            }
            let (cos, gain) = (path[0].point.n_dot_v(), edited.specular_gain()[start]);
            PathLight {
                value: outgoing(&surface, cos, gain, incoming),
                std_error: fresnel(surface.tint, cos) * gain * error,
                incoming,
            }
        });
    lit.collect()
}

/// What a path, the only one of a settled picture's pixel, sends to the eye; leaves its surfaces in the scratch.
pub(in crate::render) fn settled_path(
    scene: &Scene,
    object: &ObjectModel,
    path: &[PathVertex],
    scratch: &mut ShadeScratch,
) -> PathLight {
    let view = PathView {
        layer: Layer::Final,
        // Depth alone asks for it.
        eye: Vec3::ZERO,
    };
    let mut seen = |times: u32| {
        let alone = |_| PathOfPixel {
            times,
            ..PathOfPixel::ALONE
        };
        shade_paths(scene, object, &[path], alone, view, scratch)[0]
    };
    let usual = seen(1);
    match times(shown_error(scene, usual.value, usual.std_error)) {
        1 => usual,
        more => seen(more),
    }
}

/// What the lobe at the first vertex of each path gathers and its standard error; `starts` are the indices of the
/// paths' surfaces in the scratch.
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
            if let Some(split) = &mut scratch.lit[lit.start].split {
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
            (
                light,
                vertices.first().map_or(Vec3::ZERO, |v| v.standard_error),
            )
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
    let (tracer, surfaces, gains) = (&object.tracer, edited.surfaces(), edited.specular_gain());
    let value = |number: usize, path: &[PathVertex], i: usize| {
        let point = &path[0].point;
        let light = || scene.surface_light((point.position, point.normal), surfaces[i].diffuse);
        Some(match view.layer {
            Layer::Diffuse => outgoing(&surfaces[i], point.n_dot_v(), gains[i], Vec3::ZERO),
            Layer::Irradiance => light()[0],
            Layer::Albedo => light()[1],
            Layer::Roughness => Vec3::splat(surfaces[i].roughness),
            Layer::Tint => fresnel(surfaces[i].tint, 1.0) * gains[i],
            Layer::Normal => point.normal * 0.5 + Vec3::splat(0.5),
            Layer::Environment => Vec3::ZERO,
            Layer::Depth => Vec3::splat(depth_share(tracer, view.eye, point.position)),
            Layer::Visibility => Vec3::splat(visibility(tracer, point, number as f32)),
            Layer::Final | Layer::Specular | Layer::Samples | Layer::Seen => return None,
        })
    };
    paths
        .iter()
        .zip(starts)
        .enumerate()
        .map(|(number, (path, &start))| value(number, path, start))
        .collect()
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

/// Shades those of the listed pixels again whose standard errors ask for it; leaves the others' values. Returns how many.
pub(in crate::render) fn shade_uncertain(
    scene: &Scene,
    gbuffer: &GBuffer,
    pixels: &[u32],
    layer: Layer,
    (out, std_errors): (&mut [[f32; 3]], &[f32]),
    scratch: &mut ShadeScratch,
) -> usize {
    let mut n_shaded = 0;
    for (n_times, _) in STEPS {
        let is_chosen = |i: &usize| times(std_errors[*i]) == n_times;
        let chosen: Vec<usize> = (0..pixels.len()).filter(is_chosen).collect();
        let theirs: Vec<u32> = chosen.iter().map(|&i| pixels[i]).collect();
        let mut values = vec![[0.0; 3]; theirs.len()];
        let into = &mut values;
        shade_object_once(scene, gbuffer, &theirs, layer, n_times, into, scratch);
        for (&i, value) in chosen.iter().zip(&values) {
            out[i] = *value;
        }
        n_shaded += chosen.len();
    }
    n_shaded
}
