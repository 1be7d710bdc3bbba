//! Which pixels of a photo show the object and which its background, where the outlines of masks are uncertain.
//!
//! Where masks and the mesh agree, the masks say. Where masks wander about the mesh that all of them together gave, a pixel near
//! the outline of a mask is on the side of the mesh's silhouette that it lies on, and neither as near to that silhouette as it errs.

use std::ops::Range;

use glam::Vec2;
use rayon::prelude::*;

use super::mask_outline::MaskOutline;
use crate::data::{Dataset, Mask, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::render::GBuffer;
use crate::render::path::gbuffer::PathOptions;
use crate::train::photos::picture_shift::{Off, PictureShift, SAMPLING_PX, rests};
use crate::train::statistics::scatter;

/// Coverage from which a pixel counts as all object; below its complement as all background.
const SOLID: u8 = 250;
/// Distance in pixels up to which the mesh's silhouette is searched about a mask's outline.
const SEARCHED_PX: f32 = 8.0;
/// Error up to which outlines count as exact, pixels: masks cut hard err by as much.
const EXACT_PX: f32 = 0.5;
/// Standard deviations of the outlines' error within which the mesh says what is object, and within which of its silhouette
/// nothing does.
const UNCERTAIN: f32 = 3.0;
const NEITHER: f32 = 1.5;

/// What each pixel of a view shows.
#[derive(Debug)]
pub(in crate::train) struct Sides {
    /// `[n_pixels]` whether nothing but the object.
    pub(in crate::train) object: Vec<bool>,
    /// `[n_pixels]` whether nothing but the background.
    pub(in crate::train) background: Vec<bool>,
}

impl Sides {
    /// Of a view taken by `camera`, whose mask's outline errs by `error_px` pixels (standard deviation, 0: exact).
    pub(in crate::train) fn new(
        view: &View,
        camera: &Camera,
        tracer: Option<&SurfaceTracer>,
        error_px: f32,
    ) -> Self {
        match (&view.mask, tracer) {
            (Some(mask), Some(tracer)) if error_px > 0.0 => {
                Self::by_mesh_near(mask, camera, tracer, error_px)
            }
            (Some(mask), _) => Self::of_coverage(&mask.coverage),
            (None, Some(tracer)) => {
                let coverage = traced_coverage(tracer, camera, |_| true);
                Self {
                    object: coverage.iter().map(|share| *share > 0.0).collect(),
                    background: coverage.iter().map(|share| *share <= 0.0).collect(),
                }
            }
            (None, None) => Self {
                object: vec![false; view.photo.n_pixels()],
                background: vec![true; view.photo.n_pixels()],
            },
        }
    }

    fn of_coverage(coverage: &[u8]) -> Self {
        Self {
            object: coverage.iter().map(|share| *share >= SOLID).collect(),
            background: coverage
                .iter()
                .map(|share| *share <= u8::MAX - SOLID)
                .collect(),
        }
    }

    fn by_mesh_near(mask: &Mask, camera: &Camera, tracer: &SurfaceTracer, error_px: f32) -> Self {
        let mut sides = Self::of_coverage(&mask.coverage);
        let (near, band) = (UNCERTAIN * error_px, NEITHER * error_px);
        let reach = near + band;
        let Some(outline) = MaskOutline::new(mask, reach) else {
            return sides;
        };
        let silhouette = traced_near(mask, &outline, camera, tracer, reach);
        let silhouette = MaskOutline::new(&silhouette, reach);
        for (pixel, by_mask) in outline.distance.iter().enumerate() {
            // Without a silhouette the mesh lies elsewhere.
            let by_mesh = silhouette.as_ref().map_or(0.0, |s| s.distance[pixel]);
            if by_mask.abs() < near {
                sides.object[pixel] = by_mesh > band;
                sides.background[pixel] = by_mesh < -band;
            }
        }
        sides
    }
}

/// The mask with the mesh's silhouette in its place up to `reach` pixels from its outline.
fn traced_near(
    mask: &Mask,
    outline: &MaskOutline,
    camera: &Camera,
    tracer: &SurfaceTracer,
    reach: f32,
) -> Mask {
    let is_near = |pixel: u32| outline.distance[pixel as usize].abs() < reach;
    let traced = traced_coverage(tracer, camera, is_near);
    let share = |(pixel, share): (usize, &f32)| {
        if is_near(pixel as u32) {
            (255.0 * share).round() as u8
        } else {
            mask.coverage[pixel]
        }
    };
    Mask {
        coverage: traced.iter().enumerate().map(share).collect(),
        ..*mask
    }
}

/// `[n_pixels]` share of each wanted pixel that the mesh covers.
fn traced_coverage(
    tracer: &SurfaceTracer,
    camera: &Camera,
    is_wanted: impl Fn(u32) -> bool,
) -> Vec<f32> {
    let options = PathOptions {
        max_vertices: 1,
        most: 1,
        ..PathOptions::PLAIN
    };
    let of_rows = |rows| GBuffer::trace_some(tracer, camera, rows, options, &is_wanted);
    bands(camera)
        .flat_map(|rows| of_rows(rows).coverage().to_vec())
        .collect()
}

/// How masks lie about the mesh's silhouettes.
#[derive(Debug, Default)]
pub(in crate::train) struct OutlineFit {
    /// Standard deviation of the outlines' error but for the pictures' shifts, pixels: where a whole picture is shifted, its
    /// camera is off and its mask is right. 0 where they are exact, and without masks or mesh.
    pub(in crate::train) error_px: f32,
    /// Shift of each picture; empty without a mesh.
    pub(in crate::train) shifts: Vec<PictureShift>,
}

impl OutlineFit {
    /// Of the masks of at most so many of the training views, evenly chosen, which `cameras` took.
    pub(in crate::train) fn new(
        dataset: &Dataset,
        cameras: &[Camera],
        tracer: Option<&SurfaceTracer>,
        most: usize,
    ) -> Self {
        let Some(tracer) = tracer else {
            return Self::default();
        };
        let stride = dataset.train.len().div_ceil(most).max(1);
        let of_view = |(view, camera): (&View, &Camera)| -> Option<_> {
            let mask = view.mask.as_ref()?;
            let outline = MaskOutline::new(mask, SEARCHED_PX)?;
            let silhouette = traced_near(mask, &outline, camera, tracer, SEARCHED_PX);
            let off = off(&outline, &MaskOutline::new(&silhouette, SEARCHED_PX)?);
            let shift = PictureShift::of(&off);
            Some((shift, rests(&off, shift.by).collect()))
        };
        let views = dataset.train.par_iter().zip(cameras).step_by(stride);
        let (shifts, rests): (Vec<_>, Vec<Vec<f32>>) =
            views.map(|view| of_view(view).unwrap_or_default()).unzip();
        Self {
            error_px: error_from(rests.concat()),
            shifts,
        }
    }
}

/// How far the places of a mask's outline are from a silhouette.
fn off(outline: &MaskOutline, silhouette: &MaskOutline) -> Vec<Off> {
    let distance = |at: Vec2| silhouette.distance_at(at);
    let off = |at: &Vec2| {
        let along = |step: Vec2| distance(*at + step) - distance(*at - step);
        (
            distance(*at),
            0.5 * Vec2::new(along(Vec2::X), along(Vec2::Y)),
        )
    };
    outline.middles.iter().map(off).collect()
}

/// Standard deviation of the error of outlines that lie `off_px` pixels from a surface's; 0 where sampling explains them.
pub(in crate::train) fn error_from(off_px: Vec<f32>) -> f32 {
    let variance = scatter(off_px).powi(2) - SAMPLING_PX.powi(2);
    let error = variance.max(0.0).sqrt();
    if error > EXACT_PX { error } else { 0.0 }
}

/// Pixels traced at once: what is kept of them is smaller than what tracing needs.
const BAND_PIXELS: usize = 1 << 15;

/// Rows that are traced at once.
pub(in crate::train) fn bands(camera: &Camera) -> impl Iterator<Item = Range<u32>> {
    let (width, height) = (camera.width.max(1) as usize, camera.height);
    let step = (BAND_PIXELS / width).max(1);
    (0..height)
        .step_by(step)
        .map(move |y| y..(y + step as u32).min(height))
}

#[cfg(test)]
pub(in crate::train) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::train::photos::picture_shift::known_share;
    use crate::train::placement::given_cameras;
    use crate::train::test_scene::sphere_in_a_box;

    /// Moves a mask's outline by a smooth noise of that standard deviation, pixels; another for each `seed`.
    pub(in crate::train) fn wander(mask: &mut Mask, error_px: f32, seed: usize) {
        let outline = MaskOutline::new(mask, f32::INFINITY).expect("an outline");
        let seed = seed as f32;
        // Six plane waves about twenty pixels long, whose squares have a mean of a half.
        let waves: [[f32; 3]; 6] = std::array::from_fn(|k| {
            let turn = 1.05 * k as f32 + 0.7 * seed;
            let frequency = 0.25 + 0.03 * k as f32;
            let phase = (3.7 + k as f32) * (1.0 + seed);
            [frequency * turn.cos(), frequency * turn.sin(), phase]
        });
        for (pixel, coverage) in mask.coverage.iter_mut().enumerate() {
            let (x, y) = (pixel % outline.size[0], pixel / outline.size[0]);
            let wave = |[u, v, phase]: [f32; 3]| (u * x as f32 + v * y as f32 + phase).sin();
            let moved = error_px * waves.map(wave).iter().sum::<f32>() / 3.0_f32.sqrt();
            let is_object = outline.distance[pixel] + moved > 0.0;
            *coverage = u8::MAX * u8::from(is_object);
        }
    }

    #[test]
    fn the_mesh_decides_where_masks_wander_and_masks_do_where_they_fit() {
        let exact = sphere_in_a_box(25, 96);
        let mut wandering = sphere_in_a_box(25, 96);
        for (i, view) in wandering.train.iter_mut().enumerate() {
            wander(view.mask.as_mut().unwrap(), 1.3, i);
        }
        let tracer = SurfaceTracer::new(Arc::clone(exact.mesh.as_ref().unwrap()));
        let cameras = given_cameras(&exact);
        let fit = |dataset: &Dataset, cameras: &[Camera]| {
            OutlineFit::new(dataset, cameras, Some(&tracer), usize::MAX)
        };
        let fitting = fit(&exact, &cameras);
        assert_eq!(fitting.error_px, 0.0);
        assert_eq!(known_share(&fitting.shifts), 0.0);
        let error_px = fit(&wandering, &cameras).error_px;
        assert!((1.0..1.6).contains(&error_px), "{error_px} pixels");

        let mut turned = cameras;
        for camera in &mut turned {
            camera.cx += 1.5;
        }
        let turned = fit(&exact, &turned);
        assert_eq!(turned.error_px, 0.0);
        for shift in &turned.shifts {
            assert!(shift.by.distance(Vec2::new(-1.5, 0.0)) < 0.1, "{shift:?}");
        }
        let share = known_share(&turned.shifts);
        assert!(share > 0.9, "a share of {share}");

        let (mut n_wrong, mut n_wrong_by_mask, mut n_sure) = (0, 0, 0);
        for (view, truth) in wandering.train.iter().zip(&exact.train) {
            let truth = Sides::of_coverage(&truth.mask.as_ref().unwrap().coverage);
            let by_mask = Sides::new(view, &view.camera, Some(&tracer), 0.0);
            let by_mesh = Sides::new(view, &view.camera, Some(&tracer), error_px);
            let wrong = |sides: &Sides| {
                let is_wrong = |i: &usize| {
                    (sides.object[*i] && !truth.object[*i])
                        || (sides.background[*i] && !truth.background[*i])
                };
                (0..truth.object.len()).filter(is_wrong).count()
            };
            n_wrong += wrong(&by_mesh);
            n_wrong_by_mask += wrong(&by_mask);
            let sides = by_mesh.object.iter().zip(&by_mesh.background);
            n_sure += sides.filter(|(a, b)| **a || **b).count();
        }
        assert!(n_wrong_by_mask > 500, "{n_wrong_by_mask} pixels");
        assert!(
            100 * n_wrong < n_wrong_by_mask,
            "{n_wrong}, by the masks {n_wrong_by_mask}"
        );
        assert!(n_sure > 20 * 90 * 96, "{n_sure} pixels");
    }
}
