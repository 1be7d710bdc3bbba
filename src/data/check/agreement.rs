//! Do masks and mesh show the same object? And if not, what would make them?
//!
//! Silhouettes are traced on a small raster and compared with the masks. When they differ much,
//! the usual mistakes are tried: the 24 axis-aligned rotations (a y-up file in a z-up capture and
//! its kin), then a shift and scale estimated from the masks. The finding names the command-line
//! flag that cures it.

use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

use super::MaskAgreement;
use crate::data::{Dataset, Mask, MeshPlacement, Problem, Severity, View};
use crate::geometry::{Camera, Mesh, Ray, SurfaceTracer, nearest_point};

/// The longer side of the raster for the report.
const REPORT_SIDE: u32 = 160;
/// The longer side while guessing the fault.
const GUESS_SIDE: u32 = 64;
/// Views compared for the report; more say nothing new.
const MAX_REPORT_VIEWS: usize = 64;
/// Views compared while guessing.
const MAX_GUESS_VIEWS: usize = 6;
/// Below this the mesh is taken to be in another frame.
const LOW_IOU: f32 = 0.6;
/// Below this something small is off.
const FAIR_IOU: f32 = 0.85;

/// Compares masks with the mesh and reports a mismatch; `None` without either.
pub(super) fn compare(dataset: &Dataset, problems: &mut Vec<Problem>) -> Option<MaskAgreement> {
    let mesh = dataset.mesh.as_ref()?;
    let masked: Vec<&View> = dataset
        .views()
        .filter(|view| view.mask.as_ref().is_some_and(|mask| mask.mean() > 0.0))
        .collect();
    let tracer = SurfaceTracer::new(Arc::clone(mesh));
    let rasters = rasters(&masked, MAX_REPORT_VIEWS, REPORT_SIDE);
    let ious: Vec<f32> = rasters
        .par_iter()
        .map(|raster| raster.iou(&tracer, Affine3A::IDENTITY))
        .collect();
    let (worst, worst_iou) = ious
        .iter()
        .copied()
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let mean_iou = mean(&ious);
    let agreement = MaskAgreement {
        n_views: rasters.len(),
        mean_iou,
        worst_iou,
        worst_view: rasters[worst].view.name.clone(),
    };
    if mean_iou < LOW_IOU {
        let rasters = self::rasters(&masked, MAX_GUESS_VIEWS, GUESS_SIDE);
        problems.push(explain(mesh, &tracer, &rasters, mean_iou));
    } else if mean_iou < FAIR_IOU {
        let what = format!("masks and mesh agree only fairly (mean overlap {mean_iou:.2})");
        let advice = "poses, masks or mesh are a little off, and reflections will blur: if it is the poses, training corrects them in part";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    let few_are_off = mean_iou >= LOW_IOU && worst_iou < 0.5 * mean_iou;
    if few_are_off {
        let what = format!(
            "view {} does not fit the mesh (overlap {worst_iou:.2}, mean {mean_iou:.2})",
            agreement.worst_view
        );
        let advice = "its pose or mask may be wrong; consider removing it";
        problems.push(Problem::new(Severity::Warning, what, advice));
    }
    Some(agreement)
}

/// Finds the placement that makes mesh and masks agree, and words it.
fn explain(mesh: &Mesh, tracer: &SurfaceTracer, rasters: &[Raster<'_>], mean_iou: f32) -> Problem {
    let found = best_rotation(tracer, rasters)
        .into_iter()
        .chain(best_shift(mesh, tracer, rasters))
        .max_by(|a, b| a.iou.total_cmp(&b.iou))
        .filter(|guess| guess.iou > LOW_IOU && guess.iou > mean_iou + 0.15);
    let (likely, advice) = match &found {
        Some(guess) => (guess.words(), guess.flags()),
        None => (
            "it may belong to another capture, or be in another frame".to_owned(),
            "place it with --mesh-rotate, --mesh-scale and --mesh-translate, or leave it out"
                .to_owned(),
        ),
    };
    let what = format!("the mesh does not fit the masks (mean overlap {mean_iou:.2}): {likely}");
    Problem::new(Severity::Error, what, advice)
}

/// A placement and how well it fits.
struct Guess {
    placement: MeshPlacement,
    iou: f32,
}

impl Guess {
    fn words(&self) -> String {
        let MeshPlacement {
            rotate_deg_xyz: rotate,
            scale,
            translate,
        } = self.placement;
        let [x, y, z] = rotate.to_array();
        if rotate == Vec3::ZERO {
            return format!("it looks shifted or scaled (by {translate:.3} and {scale:.3})");
        }
        let kind = match (x, y, z) {
            (90.0, 0.0, 0.0) => "a y-up file beside a z-up capture",
            (-90.0, 0.0, 0.0) => "a z-up file beside a y-up capture",
            _ => "its axes are permuted or flipped",
        };
        format!("it looks rotated: {kind}")
    }

    fn flags(&self) -> String {
        let vector = |v: Vec3| format!("{},{},{}", round(v.x), round(v.y), round(v.z));
        let placement = &self.placement;
        let mut flags = Vec::new();
        if placement.rotate_deg_xyz != Vec3::ZERO {
            flags.push(format!(
                "--mesh-rotate {}",
                vector(placement.rotate_deg_xyz)
            ));
        }
        if placement.scale != 1.0 {
            flags.push(format!("--mesh-scale {}", round(placement.scale)));
        }
        if placement.translate != Vec3::ZERO {
            flags.push(format!("--mesh-translate {}", vector(placement.translate)));
        }
        format!("try {}", flags.join(" "))
    }
}

/// `v` with four significant digits, printed without an exponent.
fn round(v: f32) -> f32 {
    format!("{v:.3e}").parse().unwrap_or(v)
}

/// The best of the 24 axis-aligned rotations about the world's origin.
fn best_rotation(tracer: &SurfaceTracer, rasters: &[Raster<'_>]) -> Option<Guess> {
    best(tracer, rasters, &axis_rotations())
}

/// The 24 rotations that carry axes to axes; simplest first.
fn axis_rotations() -> Vec<MeshPlacement> {
    let turns = [0.0, 90.0, -90.0, 180.0];
    let mut candidates: Vec<Vec3> = Vec::new();
    for x in turns {
        for y in turns {
            candidates.extend(turns.map(|z| Vec3::new(x, y, z)));
        }
    }
    candidates.sort_by_key(|c| c.to_array().iter().filter(|turn| **turn != 0.0).count());
    let mut kept: Vec<MeshPlacement> = Vec::new();
    for rotate_deg_xyz in candidates {
        let placement = MeshPlacement {
            rotate_deg_xyz,
            ..MeshPlacement::default()
        };
        let rotation = placement.world_from_mesh();
        let is_new = |other: &MeshPlacement| !other.world_from_mesh().abs_diff_eq(rotation, 1e-3);
        if kept.iter().all(is_new) {
            kept.push(placement);
        }
    }
    kept
}

/// A shift and scale that put the mesh where the masks say the object is.
fn best_shift(mesh: &Mesh, tracer: &SurfaceTracer, rasters: &[Raster<'_>]) -> Option<Guess> {
    let center = mesh.bounds().center();
    let lines: Vec<(Vec3, Vec3)> = rasters.iter().map(Raster::axis_to_object).collect();
    let target = nearest_point(&lines);
    let move_only = MeshPlacement {
        translate: target - center,
        ..MeshPlacement::default()
    };
    // Silhouette areas go with the square of the size.
    let moved = move_only.world_from_mesh();
    let ratios: Vec<f32> = rasters
        .iter()
        .map(|raster| {
            let silhouette = raster.silhouette(tracer, moved);
            let n_seen = silhouette.iter().filter(|seen| **seen).count();
            let n_object = raster.object.iter().filter(|object| **object).count();
            (n_object as f32 / n_seen.max(1) as f32).sqrt()
        })
        .collect();
    let scale = mean(&ratios);
    let move_and_scale = MeshPlacement {
        scale,
        translate: target - scale * center,
        ..MeshPlacement::default()
    };
    best(tracer, rasters, &[move_only, move_and_scale])
}

fn best(
    tracer: &SurfaceTracer,
    rasters: &[Raster<'_>],
    placements: &[MeshPlacement],
) -> Option<Guess> {
    let guess = |placement: &MeshPlacement| {
        let world_from_mesh = placement.world_from_mesh();
        let ious = rasters.iter();
        let ious: Vec<f32> = ious.map(|r| r.iou(tracer, world_from_mesh)).collect();
        Guess {
            placement: *placement,
            iou: mean(&ious),
        }
    };
    let guesses: Vec<Guess> = placements.par_iter().map(guess).collect();
    // The first of equals wins: rotations are listed simplest first.
    guesses
        .into_iter()
        .reduce(|best, next| if next.iou > best.iou { next } else { best })
}

/// A view's mask on a small grid.
struct Raster<'a> {
    view: &'a View,
    camera: Camera,
    /// `[height * width]` of the small camera: is it object?
    object: Vec<bool>,
}

/// At most `max_views` of the views, evenly picked, shrunk to `side` pixels.
fn rasters<'a>(views: &[&'a View], max_views: usize, side: u32) -> Vec<Raster<'a>> {
    let step = views.len().div_ceil(max_views).max(1);
    let views = views.iter().step_by(step);
    let rasters = views.filter_map(|view| Some(Raster::new(view, view.mask.as_ref()?, side)));
    rasters.collect()
}

impl<'a> Raster<'a> {
    fn new(view: &'a View, mask: &Mask, side: u32) -> Self {
        let shrink = f64::from(side) / f64::from(mask.width.max(mask.height).max(side));
        let small = |length: u32| ((f64::from(length) * shrink).round() as u32).max(1);
        let camera = view.camera.resized(small(mask.width), small(mask.height));
        let mut object = Vec::new();
        for y in 0..camera.height {
            for x in 0..camera.width {
                // The mean over the small pixel's block; one pixel of it would be off-centre.
                let block = |i: u32, n: u32, full: u32| {
                    let start = i * full / n;
                    start..((i + 1) * full / n).max(start + 1)
                };
                let (mut sum, mut n) = (0_u32, 0_u32);
                for row in block(y, camera.height, mask.height) {
                    for column in block(x, camera.width, mask.width) {
                        sum += u32::from(mask.coverage[(row * mask.width + column) as usize]);
                        n += 1;
                    }
                }
                object.push(2 * sum > 255 * n);
            }
        }
        Self {
            view,
            camera,
            object,
        }
    }

    /// Which pixels see the mesh placed by `world_from_mesh`.
    fn silhouette(&self, tracer: &SurfaceTracer, world_from_mesh: Affine3A) -> Vec<bool> {
        let mesh_from_world = world_from_mesh.inverse();
        let width = self.camera.width;
        let is_seen = |i: u32| {
            let ray = self
                .camera
                .ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let direction = mesh_from_world.transform_vector3(ray.direction);
            let ray = Ray {
                origin: mesh_from_world.transform_point3(ray.origin),
                direction: direction.normalize_or_zero(),
            };
            tracer.occluded(&ray, 0.0, f32::INFINITY)
        };
        (0..self.object.len() as u32).map(is_seen).collect()
    }

    fn iou(&self, tracer: &SurfaceTracer, world_from_mesh: Affine3A) -> f32 {
        let silhouette = self.silhouette(tracer, world_from_mesh);
        let pairs = || self.object.iter().zip(&silhouette);
        let both = pairs().filter(|(a, b)| **a && **b).count();
        let either = pairs().filter(|(a, b)| **a || **b).count();
        // Neither sees anything at this resolution: no contradiction.
        if either == 0 {
            1.0
        } else {
            both as f32 / either as f32
        }
    }

    /// The ray towards the mask's centroid, as point and direction.
    fn axis_to_object(&self) -> (Vec3, Vec3) {
        let (mut sum, mut n, width) = (Vec2::ZERO, 0.0_f32, self.camera.width);
        for (i, _) in (0_u32..).zip(&self.object).filter(|(_, object)| **object) {
            sum += Vec2::new((i % width) as f32, (i / width) as f32);
            n += 1.0;
        }
        let center = sum / n.max(1.0) + 0.5;
        let ray = self.camera.ray(center.x, center.y);
        (ray.origin, ray.direction)
    }
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_24_axis_rotations_and_the_plain_one_is_first() {
        let rotations = axis_rotations();
        assert_eq!(rotations.len(), 24, "count");
        let mut angles = rotations.iter().map(|rotation| rotation.rotate_deg_xyz);
        assert_eq!(angles.next(), Some(Vec3::ZERO), "first");
        assert!(angles.any(|angles| angles == 90.0 * Vec3::X), "by name");
    }
}
