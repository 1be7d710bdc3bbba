//! Full images for the screen, row bands in parallel on the current thread pool.

use std::sync::atomic::AtomicBool;

use super::gbuffer::PathOptions;
use super::parts::{PartsOptions, render_parts};
use super::reference::ReferenceOptions;
use super::scene::{Layer, Scene};
use crate::geometry::Camera;

/// An image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` colours; which space, the maker says.
    pub pixels: Vec<[f32; 3]>,
}

/// The display-referred picture (sRGB, `[0, 1]`) of a scene; `None` when cancelled. `on_progress` gets 0..1.
///
/// The light at the surface of moved surroundings is made first; for several pictures, do it once with [`Scene::lit`].
pub fn render(
    scene: &Scene,
    camera: &Camera,
    layer: Layer,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    render_with(scene, camera, layer, PathOptions::FINE, cancel, on_progress)
}

/// The final picture by [`super::reference::shade_object_reference`], the oracle of [`render`].
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
