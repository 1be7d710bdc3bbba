//! Which pixels of a photo show the object and which its surroundings, where the outlines of masks are uncertain.
//!
//! Where masks and the mesh agree, the masks say. Where masks wander about the mesh that all of them together gave, a pixel near
//! the outline of a mask is on the side of the mesh's silhouette that it lies on, and neither as near to that silhouette as it errs.

use glam::{Mat2, Vec2};
use rayon::prelude::*;

use super::mask_outline::MaskOutline;
use super::pixels::bands;
use super::statistics::scatter;
use crate::data::{Dataset, Mask, View};
use crate::geometry::{Camera, SurfaceTracer};
use crate::render::GBuffer;
use crate::render::gbuffer::PathOptions;

/// Coverage from which a pixel counts as all object; below its complement as all background.
const SOLID: u8 = 250;
/// Distance in pixels up to which the mesh's silhouette is searched about a mask's outline.
const SEARCHED_PX: f32 = 8.0;
/// Scatter of exact outlines about those of an exact surface, pixels: both are sampled.
const SAMPLING_PX: f32 = 0.35;
/// Error up to which outlines count as exact, pixels: masks cut hard err by as much.
const EXACT_PX: f32 = 0.5;
/// Rounds of reweighting in which a picture's shift is found, and what keeps it at nothing, in pieces of the outline.
const SHIFTINGS: usize = 4;
const RIDGE: f32 = 1.0;
/// Standard deviations of the outlines' error within which the mesh says what is object, and within which of its silhouette
/// nothing does.
const UNCERTAIN: f32 = 3.0;
const NEITHER: f32 = 1.5;

/// What each pixel of a view shows.
#[derive(Debug)]
pub(super) struct Sides {
    /// `[n_pixels]` whether nothing but the object.
    pub(super) object: Vec<bool>,
    /// `[n_pixels]` whether nothing but the surroundings.
    pub(super) background: Vec<bool>,
}

impl Sides {
    /// Of a view taken by `camera`, whose mask's outline errs by `error_px` pixels (standard deviation, 0: exact).
    pub(super) fn new(
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
                let coverage = traced_coverage(tracer, camera, 1, |_| true);
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
        let Some(outline) = MaskOutline::new(mask) else {
            return sides;
        };
        let silhouette = traced_near(mask, &outline, camera, tracer, near + band);
        let silhouette = MaskOutline::new(&silhouette);
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
    let traced = traced_coverage(tracer, camera, 2, is_near);
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

/// `[n_pixels]` share of each wanted pixel that the mesh covers, by `subpixels * subpixels` rays where its silhouette passes.
fn traced_coverage(
    tracer: &SurfaceTracer,
    camera: &Camera,
    subpixels: usize,
    is_wanted: impl Fn(u32) -> bool,
) -> Vec<f32> {
    let options = PathOptions {
        max_vertices: 1,
        torn: subpixels,
        ..PathOptions::PLAIN
    };
    let of_rows = |rows| GBuffer::trace_some(tracer, camera, rows, options, &is_wanted);
    bands(camera)
        .flat_map(|rows| of_rows(rows).coverage().to_vec())
        .collect()
}

/// Standard deviation of the masks' outlines about the mesh's silhouettes as `cameras` see them, pixels, but for what cameras
/// are off; 0 where they are exact, and without masks or mesh.
pub(super) fn outline_error_px(
    dataset: &Dataset,
    cameras: &[Camera],
    tracer: Option<&SurfaceTracer>,
) -> f32 {
    let Some(tracer) = tracer else {
        return 0.0;
    };
    let of_view = |(view, camera): (&View, &Camera)| -> Option<Vec<f32>> {
        let mask = view.mask.as_ref()?;
        let outline = MaskOutline::new(mask)?;
        let silhouette = traced_near(mask, &outline, camera, tracer, SEARCHED_PX);
        Some(off_px(&outline, &MaskOutline::new(&silhouette)?))
    };
    let views = dataset.train.par_iter().zip(cameras);
    error_from(views.filter_map(of_view).flatten_iter().collect())
}

/// Distances of a mask's outline from a silhouette in pixels, less what a shift of the whole picture explains: there the camera
/// is off and the mask is right.
fn off_px(outline: &MaskOutline, silhouette: &MaskOutline) -> Vec<f32> {
    let slope_at = |at: Vec2| {
        let along =
            |step: Vec2| silhouette.distance_at(at + step) - silhouette.distance_at(at - step);
        0.5 * Vec2::new(along(Vec2::X), along(Vec2::Y))
    };
    let places = outline.middles.iter();
    let off: Vec<(f32, Vec2)> = places
        .map(|at| (silhouette.distance_at(*at), slope_at(*at)))
        .collect();
    let rest = |shift: Vec2| off.iter().map(move |(off, slope)| off - slope.dot(shift));
    let mut shift = Vec2::ZERO;
    for _ in 0..SHIFTINGS {
        let (mut matrix, mut right) = (RIDGE * Mat2::IDENTITY, Vec2::ZERO);
        for ((off, slope), rest) in off.iter().zip(rest(shift)) {
            let weight = 1.0 / (1.0 + rest * rest);
            matrix += weight * Mat2::from_cols(*slope * slope.x, *slope * slope.y);
            right += weight * off * *slope;
        }
        shift = matrix.inverse() * right;
    }
    rest(shift).collect()
}

/// Standard deviation of the error of outlines that lie `off_px` pixels from a surface's; 0 where sampling explains them.
pub(super) fn error_from(off_px: Vec<f32>) -> f32 {
    let scatter = scatter(off_px);
    let error = (scatter * scatter - SAMPLING_PX * SAMPLING_PX)
        .max(0.0)
        .sqrt();
    if error > EXACT_PX { error } else { 0.0 }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::train::preparation::given_cameras;
    use crate::train::test_scene::sphere_in_a_box;

    /// Moves a mask's outline by a smooth noise of that standard deviation, pixels; another for each `seed`.
    pub(in crate::train) fn wander(mask: &mut Mask, error_px: f32, seed: usize) {
        let outline = MaskOutline::new(mask).expect("an outline");
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
            *coverage = if outline.distance[pixel] + moved > 0.0 {
                255
            } else {
                0
            };
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
        let error_of = |dataset: &Dataset| outline_error_px(dataset, &cameras, Some(&tracer));
        assert_eq!(error_of(&exact), 0.0);
        let error_px = error_of(&wandering);
        assert!((1.0..1.6).contains(&error_px), "{error_px} pixels");

        let turned = exact.train.iter().map(|view| {
            let mut camera = view.camera;
            camera.cx += 1.5;
            camera
        });
        let turned: Vec<Camera> = turned.collect();
        assert_eq!(outline_error_px(&exact, &turned, Some(&tracer)), 0.0);

        let (mut n_wrong, mut n_wrong_by_mask, mut n_sure) = (0, 0, 0);
        for (view, truth) in wandering.train.iter().zip(&exact.train) {
            let truth = Sides::of_coverage(&truth.mask.as_ref().unwrap().coverage);
            let by_mask = Sides::new(view, &view.camera, Some(&tracer), 0.0);
            let by_mesh = Sides::new(view, &view.camera, Some(&tracer), error_px);
            let wrong = |sides: &Sides| {
                let pixels = 0..truth.object.len();
                let is_wrong = |i: &usize| {
                    (sides.object[*i] && !truth.object[*i])
                        || (sides.background[*i] && !truth.background[*i])
                };
                pixels.filter(is_wrong).count()
            };
            n_wrong += wrong(&by_mesh);
            n_wrong_by_mask += wrong(&by_mask);
            let sure = by_mesh.object.iter().zip(&by_mesh.background);
            n_sure += sure
                .filter(|(object, background)| **object || **background)
                .count();
        }
        assert!(n_wrong_by_mask > 500, "{n_wrong_by_mask} pixels");
        assert!(
            100 * n_wrong < n_wrong_by_mask,
            "{n_wrong}, by the masks {n_wrong_by_mask}"
        );
        assert!(n_sure > 20 * 90 * 96, "{n_sure} pixels");
    }
}
