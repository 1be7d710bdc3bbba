//! Pictures taken apart: what the object sends, what is behind it and how much of a pixel it covers, in linear light.
//!
//! Everything that becomes a file is made of these: pictures over their environment or over nothing, and layers.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use rayon::prelude::*;

use crate::data::{ExrChannel, ExrSample, Rgba8};
use crate::geometry::Camera;
use crate::render::path::gbuffer::{GBuffer, PathOptions};
use crate::render::path::reference::{Reference, ReferenceOptions, shade_object_reference};
use crate::render::path::scratch::ShadeScratch;
use crate::render::path::shade::{compose, shade_background, shade_object, shade_object_once};
use crate::render::scene::{Layer, Scene};

/// Rows of a task.
const BAND: u32 = 4;
/// Depth where there is no object, as Blender writes it: infinity breaks many programs.
const FAR: f32 = 1e10;

/// Whether the environment is in a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backdrop {
    /// It is.
    #[default]
    Shown,
    /// The object stands over nothing, with its coverage as alpha.
    Transparent,
}

/// What to render, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartsOptions<'a> {
    /// What is shown of the object; [`Layer::Environment`] wants the environment behind it too.
    pub layers: &'a [Layer],
    /// Whether layers that show the environment get it.
    pub backdrop: Backdrop,
    /// How many paths a pixel takes.
    pub paths: PathOptions,
    /// Whether pixels whose lobes' cones disagree get more of them.
    pub settles: bool,
    /// The object by thin rays instead, as the oracle does.
    pub reference: Option<ReferenceOptions>,
}

impl<'a> PartsOptions<'a> {
    /// These layers over the environment, as pictures that stay are rendered.
    pub fn new(layers: &'a [Layer]) -> Self {
        Self {
            layers,
            backdrop: Backdrop::Shown,
            paths: PathOptions::FINE,
            settles: true,
            reference: None,
        }
    }
}

/// A picture taken apart, all lists `[height * width]`, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Whether the environment is in it.
    pub backdrop: Backdrop,
    /// Share of each pixel that the object covers, `[0, 1]`.
    pub coverage: Vec<f32>,
    /// Distance along the camera's axis to the nearest point of the object, scene units; 1e10 where there is none.
    pub depth: Vec<f32>,
    /// Linear radiance of the environment; black where it is hidden or not shown.
    pub background: Vec<[f32; 3]>,
    /// Each layer's value over the covered share of a pixel.
    pub objects: Vec<(Layer, Vec<[f32; 3]>)>,
    /// The environment of [`Layer::Seen`] where that was rendered along with others: marked, theirs is not.
    marked: Option<Vec<[f32; 3]>>,
}

/// Renders a picture in parts; `None` when cancelled. `on_progress` gets 0..1.
///
/// The light at the surface of a moved environment is made first; for several pictures, do it once with [`Scene::lit`].
pub fn render_parts(
    scene: &Scene,
    camera: &Camera,
    options: &PartsOptions<'_>,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Parts> {
    if options.layers.len() > 1 && options.layers.contains(&Layer::Seen) {
        return render_with_seen(scene, camera, options, cancel, on_progress);
    }
    let scene = &scene.lit_for(options.layers, cancel)?;
    let reference = match options.reference {
        Some(options) => Some(Reference::new(scene, options, cancel)?),
        None => None,
    };
    let reference = reference.as_ref();
    let (height, done) = (camera.height, AtomicU32::new(0));
    let bands: Vec<Option<Parts>> = (0..height.div_ceil(BAND))
        .into_par_iter()
        .map_init(ShadeScratch::default, |scratch, band| {
            if cancel.load(Ordering::Relaxed) {
                return None;
            }
            let rows = band * BAND..((band + 1) * BAND).min(height);
            let parts = render_rows(scene, camera, (options, reference), rows, scratch);
            let rows = done.fetch_add(BAND, Ordering::Relaxed) + BAND;
            on_progress(rows.min(height) as f32 / height as f32);
            Some(parts)
        })
        .collect();
    let mut whole = Parts {
        width: camera.width,
        height,
        backdrop: options.backdrop,
        objects: options
            .layers
            .iter()
            .map(|layer| (*layer, Vec::new()))
            .collect(),
        ..Parts::default()
    };
    for band in bands {
        whole.append(band?);
    }
    (!cancel.load(Ordering::Relaxed)).then_some(whole)
}

/// [`render_parts`] of several layers with [`Layer::Seen`] among them.
fn render_with_seen(
    scene: &Scene,
    camera: &Camera,
    options: &PartsOptions<'_>,
    cancel: &AtomicBool,
    on_progress: &(dyn Fn(f32) + Sync),
) -> Option<Parts> {
    let layers = options.layers.iter().copied();
    let others: Vec<Layer> = layers.filter(|layer| *layer != Layer::Seen).collect();
    let part = |layers: &[Layer], share: [f32; 2]| {
        let options = PartsOptions { layers, ..*options };
        let on_progress = |done: f32| on_progress(share[0] + done * (share[1] - share[0]));
        render_parts(scene, camera, &options, cancel, &on_progress)
    };
    let mut parts = part(&others, [0.0, 0.5])?;
    let seen = part(&[Layer::Seen], [0.5, 1.0])?;
    parts.objects.extend(seen.objects);
    parts.marked = Some(seen.background);
    Some(parts)
}

fn render_rows(
    scene: &Scene,
    camera: &Camera,
    (options, reference): (&PartsOptions<'_>, Option<&Reference>),
    rows: Range<u32>,
    scratch: &mut ShadeScratch,
) -> Parts {
    let (layers, shows) = (options.layers, |test: fn(Layer) -> bool| {
        options.layers.iter().any(|layer| test(*layer))
    });
    let tracer = scene.object.as_ref().map(|object| &*object.tracer);
    let tracer = tracer.filter(|_| shows(Layer::shows_object));
    let gbuffer = GBuffer::trace(tracer, camera, rows.clone(), options.paths);
    let first = rows.start * camera.width;
    let n = gbuffer.coverage().len();
    let list = |keep: &dyn Fn(f32) -> bool| -> Vec<u32> {
        let coverage = gbuffer.coverage().iter().enumerate();
        let kept = coverage.filter(|(_, c)| keep(**c));
        kept.map(|(i, _)| first + i as u32).collect()
    };
    let spread = |pixels: &[u32], values: &[[f32; 3]]| {
        let mut all = vec![[0.0; 3]; n];
        for (pixel, value) in pixels.iter().zip(values) {
            all[(pixel - first) as usize] = *value;
        }
        all
    };
    let covered = list(&|c| c > 0.0);
    let has_backdrop = options.backdrop == Backdrop::Shown
        && layers.iter().any(|layer| scene.shows_background(*layer));
    let open = match has_backdrop {
        true if layers.contains(&Layer::Environment) => list(&|_| true),
        true => list(&|c| c < 1.0),
        false => Vec::new(),
    };
    let mut background = vec![[0.0; 3]; open.len()];
    shade_background(scene, camera, &open, &mut background, scratch);
    let mut objects: Vec<(Layer, Vec<[f32; 3]>)> = Vec::with_capacity(layers.len());
    for &layer in layers {
        let known = |wanted| objects.iter().find(|(layer, _)| *layer == wanted);
        let both = known(Layer::Final).zip(known(Layer::Diffuse));
        let values =
            if let Some(((_, all), (_, diffuse))) = both.filter(|_| layer == Layer::Specular) {
                // Light is what costs, and both others are known.
                difference(all, diffuse)
            } else {
                let mut out = vec![[0.0; 3]; covered.len()];
                if let Some(reference) = reference {
                    shade_object_reference(scene, &gbuffer, &covered, reference, &mut out, scratch);
                } else if options.settles {
                    shade_object(scene, &gbuffer, &covered, layer, &mut out, scratch);
                } else {
                    shade_object_once(scene, &gbuffer, &covered, layer, 1, &mut out, scratch);
                }
                spread(&covered, &out)
            };
        objects.push((layer, values));
    }
    Parts {
        coverage: gbuffer.coverage().to_vec(),
        depth: depths(&gbuffer, camera, first),
        background: spread(&open, &background),
        objects,
        ..Parts::default()
    }
}

fn difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let pixels = a.iter().zip(b);
    pixels
        .map(|(a, b)| std::array::from_fn(|c| a[c] - b[c]))
        .collect()
}

fn depths(gbuffer: &GBuffer, camera: &Camera, first: u32) -> Vec<f32> {
    let (eye, axis) = (camera.position(), camera.forward());
    let n = gbuffer.coverage().len() as u32;
    let nearest = |pixel| {
        let seen = gbuffer.paths_at(pixel).map(|path| path[0].point.position);
        seen.map(|p| (p - eye).dot(axis)).fold(FAR, f32::min)
    };
    (first..first + n).map(nearest).collect()
}

impl Parts {
    /// Adds the rows below.
    fn append(&mut self, below: Self) {
        self.coverage.extend(below.coverage);
        self.depth.extend(below.depth);
        self.background.extend(below.background);
        for ((_, values), (_, below)) in self.objects.iter_mut().zip(below.objects) {
            values.extend(below);
        }
    }

    /// A rendered layer as shown on a screen, `[0, 1]`, over the environment where it has one. Panics if it was not
    /// rendered.
    pub fn composed(&self, scene: &Scene, layer: Layer) -> impl Iterator<Item = [f32; 3]> {
        let (object, behind) = (self.object(layer), self.background_of(layer));
        (0..object.len()).map(move |i| {
            let coverage = self.coverage_of(layer, i);
            compose(scene, layer, coverage, object[i], behind[i])
        })
    }

    /// A rendered layer in 8 bits; over nothing, colours are the object's own and alpha its coverage. Panics if the
    /// layer was not rendered.
    pub fn to_rgba8(&self, scene: &Scene, layer: Layer) -> Rgba8 {
        let code = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let pixels = match self.backdrop {
            Backdrop::Shown => {
                let opaque = |color: [f32; 3]| {
                    let [r, g, b] = color.map(code);
                    [r, g, b, 255]
                };
                self.composed(scene, layer).map(opaque).collect()
            }
            Backdrop::Transparent => {
                let object = self.object(layer);
                let pixel = |i: usize| match code(self.coverage_of(layer, i)) {
                    0 => [0; 4],
                    alpha => {
                        let [r, g, b] = compose(scene, layer, 1.0, object[i], [0.0; 3]).map(code);
                        [r, g, b, alpha]
                    }
                };
                (0..object.len()).map(pixel).collect()
            }
        };
        Rgba8 {
            width: self.width,
            height: self.height,
            pixels,
        }
    }

    /// The channels of an EXR in linear light, without the picture's exposure: the final picture as `R G B`, its `A`,
    /// the object's depth as `Z`, and every other layer under its name.
    ///
    /// Light is multiplied by coverage, so that layers add up; roughness, tint and the normal (world, -1 to 1) are not.
    pub fn exr_channels(&self, scene: &Scene) -> Vec<ExrChannel> {
        let channel = |name: String, values: Vec<f32>| ExrChannel {
            name,
            values,
            sample: ExrSample::Half,
        };
        let alpha = match self.backdrop {
            Backdrop::Shown => vec![1.0; self.coverage.len()],
            Backdrop::Transparent => self.coverage.clone(),
        };
        let mut channels = vec![
            channel("A".to_owned(), alpha),
            ExrChannel {
                name: "Z".to_owned(),
                values: self.depth.clone(),
                sample: ExrSample::Float,
            },
        ];
        for &(layer, _) in &self.objects {
            let (prefix, names) = match layer {
                Layer::Final => (String::new(), &["R", "G", "B"][..]),
                Layer::Normal => (format!("{layer}."), &["X", "Y", "Z"][..]),
                Layer::Roughness | Layer::Depth | Layer::Visibility | Layer::Samples => {
                    (format!("{layer}."), &["Y"][..])
                }
                _ => (format!("{layer}."), &["R", "G", "B"][..]),
            };
            let linear = self.linear(scene, layer);
            for (c, name) in names.iter().enumerate() {
                let values = linear.iter().map(|value| value[c]).collect();
                channels.push(channel(format!("{prefix}{name}"), values));
            }
        }
        channels
    }

    /// A layer's values as they are stored for further work.
    fn linear(&self, scene: &Scene, layer: Layer) -> Vec<[f32; 3]> {
        let value = |(i, object): (usize, &[f32; 3])| -> [f32; 3] {
            let coverage = self.coverage[i];
            let behind = if scene.shows_background(layer) {
                self.background_of(layer)[i]
            } else {
                [0.0; 3]
            };
            std::array::from_fn(|c| match layer {
                Layer::Final | Layer::Seen => object[c] * coverage + behind[c] * (1.0 - coverage),
                Layer::Diffuse | Layer::Specular => object[c] * coverage,
                Layer::Normal if coverage > 0.0 => 2.0 * object[c] - 1.0,
                Layer::Environment => behind[c],
                _ => object[c],
            })
        };
        self.object(layer).iter().enumerate().map(value).collect()
    }

    fn background_of(&self, layer: Layer) -> &[[f32; 3]] {
        let marked = self.marked.as_ref().filter(|_| layer == Layer::Seen);
        marked.unwrap_or(&self.background)
    }

    fn object(&self, layer: Layer) -> &[[f32; 3]] {
        let rendered = self.objects.iter().find(|(known, _)| *known == layer);
        &rendered.expect("the layer was rendered").1
    }

    fn coverage_of(&self, layer: Layer, i: usize) -> f32 {
        if layer.shows_object() {
            self.coverage[i]
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests;
