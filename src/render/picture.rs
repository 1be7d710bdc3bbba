//! Full images, row bands in parallel on the current thread pool.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use rayon::prelude::*;

use super::gbuffer::{GBuffer, PathOptions};
use super::reference::{ReferenceOptions, shade_object_reference};
use super::scene::{Layer, Scene};
use super::shade::{ShadeScratch, compose, shade_background, shade_object};
use crate::geometry::Camera;

/// Rows of a task.
const BAND: u32 = 4;

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

/// The final picture by [`shade_object_reference`], the oracle of [`render`].
pub fn render_reference(
    scene: &Scene,
    camera: &Camera,
    options: ReferenceOptions,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    let scene = &scene.lit(cancel)?;
    let shade: &ShadeObject<'_> = &|gbuffer, pixels, out, scratch| {
        shade_object_reference(scene, gbuffer, pixels, options, out, scratch);
    };
    let job = Job {
        scene,
        camera,
        layer: Layer::Final,
        options: PathOptions::FINE,
        shade,
    };
    job.run(cancel, on_progress)
}

/// Shades the object's part of listed pixels.
type ShadeObject<'a> = dyn Fn(&GBuffer, &[u32], &mut [[f32; 3]], &mut ShadeScratch) + Sync + 'a;

/// [`render`] with as many paths a pixel as asked for.
pub fn render_with(
    scene: &Scene,
    camera: &Camera,
    layer: Layer,
    options: PathOptions,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Picture> {
    let lit;
    let scene = if layer.is_lit() {
        lit = scene.lit(cancel)?;
        &lit
    } else {
        scene
    };
    let shade: &ShadeObject<'_> = &|gbuffer, pixels, out, scratch| {
        shade_object(scene, gbuffer, pixels, layer, out, scratch);
    };
    let job = Job {
        scene,
        camera,
        layer,
        options,
        shade,
    };
    job.run(cancel, on_progress)
}

/// What is rendered, and how.
#[derive(Clone, Copy)]
struct Job<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    layer: Layer,
    options: PathOptions,
    shade: &'a ShadeObject<'a>,
}

impl Job<'_> {
    fn run(self, cancel: &AtomicBool, on_progress: &(dyn Fn(f32) + Sync)) -> Option<Picture> {
        let (width, height) = (self.camera.width, self.camera.height);
        let mut pixels = vec![[0.0; 3]; (width * height) as usize];
        let done = AtomicU32::new(0);
        pixels
            .par_chunks_mut((BAND * width) as usize)
            .enumerate()
            .for_each_init(ShadeScratch::default, |scratch, (band, out)| {
                if cancel.load(Ordering::Relaxed) {
                    return;
                }
                let first = band as u32 * BAND;
                render_rows(self, first..(first + BAND).min(height), out, scratch);
                let rows = done.fetch_add(BAND, Ordering::Relaxed) + BAND;
                on_progress(rows.min(height) as f32 / height as f32);
            });
        (!cancel.load(Ordering::Relaxed)).then_some(Picture {
            width,
            height,
            pixels,
        })
    }
}

fn render_rows(
    job: Job<'_>,
    rows: std::ops::Range<u32>,
    out: &mut [[f32; 3]],
    scratch: &mut ShadeScratch,
) {
    let Job {
        scene,
        camera,
        layer,
        options,
        shade,
    } = job;
    let tracer = scene
        .object
        .as_ref()
        .filter(|_| layer.shows_object())
        .map(|object| &*object.tracer);
    let gbuffer = GBuffer::trace(tracer, camera, rows.clone(), options);
    let first = rows.start * camera.width;
    let list = |keep: &dyn Fn(f32) -> bool| -> Vec<u32> {
        gbuffer
            .coverage()
            .iter()
            .enumerate()
            .filter(|(_, c)| keep(**c))
            .map(|(i, _)| first + i as u32)
            .collect()
    };
    let covered = list(&|c| c > 0.0);
    let open = if scene.shows_background(layer) {
        list(&|c| c < 1.0)
    } else {
        Vec::new()
    };
    let mut object = vec![[0.0; 3]; covered.len()];
    shade(&gbuffer, &covered, &mut object, scratch);
    let mut background = vec![[0.0; 3]; open.len()];
    shade_background(scene, camera, &open, &mut background, scratch);

    let mut objects = vec![[0.0; 3]; out.len()];
    for (pixel, value) in covered.iter().zip(object) {
        objects[(pixel - first) as usize] = value;
    }
    let mut backgrounds = vec![[0.0; 3]; out.len()];
    for (pixel, value) in open.iter().zip(background) {
        backgrounds[(pixel - first) as usize] = value;
    }
    for (i, out) in out.iter_mut().enumerate() {
        *out = compose(
            scene,
            layer,
            gbuffer.coverage()[i],
            objects[i],
            backgrounds[i],
        );
    }
}
