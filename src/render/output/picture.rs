//! Full images for the screen, row bands in parallel on the current thread pool.

use std::sync::atomic::AtomicBool;

use glam::Vec3;
use rayon::prelude::*;

use super::parts::{PartsOptions, render_parts};
use super::raster::Picture;
use crate::geometry::Camera;
use crate::render::path::gbuffer::PathOptions;
use crate::render::path::reference::ReferenceOptions;
use crate::render::path::scratch::{SeenLight, ShadeScratch, TILE};
use crate::render::path::shade::{compose, see_background};
use crate::render::scene::{Layer, Scene};

/// The display-referred picture (sRGB, `[0, 1]`) of a scene; `None` when cancelled. `on_progress` gets 0..1.
///
/// The light at the surface in a moved environment is made first; for several pictures, do it once with [`Scene::lit`].
pub fn render(
    scene: &Scene,
    camera: &Camera,
    layer: Layer,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    render_with(scene, camera, layer, PathOptions::FINE, cancel, on_progress)
}

/// The final picture by [`crate::render::path::reference::shade_object_reference`], the oracle of [`render`].
pub fn render_reference(
    scene: &Scene,
    camera: &Camera,
    options: ReferenceOptions,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    let options = PartsOptions {
        reference: Some(options),
        ..PartsOptions::new(&[Layer::Final])
    };
    composed(scene, camera, &options, cancel, on_progress)
}

/// What a pixel shows of the environment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeenThere {
    /// Display-referred colour (sRGB, `[0, 1]`).
    pub srgb: [f32; 3],
    /// How far away it is, world units: half of the ray's light begins before; very far for light without a place.
    pub distance: f32,
}

/// The environment through each listed pixel (`y * width + x` of `camera`), whether or not the object hides them.
pub fn environment_at(scene: &Scene, camera: &Camera, pixels: &[u32]) -> Vec<SeenThere> {
    let eye = camera.position();
    let gain = scene.transform.environment_from_world().gain;
    let there = |light: SeenLight| {
        let radiance = (Vec3::from(light.radiance) * gain).to_array();
        SeenThere {
            srgb: compose(scene, Layer::Environment, 0.0, [0.0; 3], radiance),
            distance: light.position.distance(eye),
        }
    };
    let of_tile = |scratch: &mut ShadeScratch, pixels: &[u32]| {
        let mut seen = vec![SeenLight::default(); pixels.len()];
        see_background(scene, camera, pixels, &mut seen, scratch);
        seen.into_iter().map(there).collect::<Vec<_>>()
    };
    let tiles = pixels.par_chunks(TILE);
    tiles
        .map_init(ShadeScratch::default, of_tile)
        .flatten_iter()
        .collect()
}

/// [`render`] with as many paths a pixel as asked for; only the finest settles, as a picture in motion does not.
pub fn render_with(
    scene: &Scene,
    camera: &Camera,
    layer: Layer,
    options: PathOptions,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    let layers = [layer];
    let options = PartsOptions {
        paths: options,
        settles: options == PathOptions::FINE,
        ..PartsOptions::new(&layers)
    };
    composed(scene, camera, &options, cancel, on_progress)
}

/// The first of the layers.
fn composed(
    scene: &Scene,
    camera: &Camera,
    options: &PartsOptions<'_>,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    let parts = render_parts(scene, camera, options, cancel, on_progress)?;
    Some(Picture {
        width: parts.width,
        height: parts.height,
        pixels: parts.composed(scene, options.layers[0]).collect(),
    })
}
