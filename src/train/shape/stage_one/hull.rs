//! The visual hull: what no silhouette cuts away.

use glam::Vec3;
use rayon::prelude::*;

use super::silhouette::Silhouette;
use super::{GoOn, StageOneError, unless_cancelled};
use crate::geometry::{Aabb, ScalarGrid};

/// Views from which one may be wrong about a point without carving it away.
const VIEWS_FOR_OUTLIER: usize = 12;
/// A point of the object is seen by at least one of this many views.
const FEWEST_OF: usize = 6;
/// The distance of points that are not the object for other reasons than a silhouette, scene units.
const FAR: f32 = 1e30;
/// Nodes on a side of the blocks that are looked at as a whole first.
const BLOCK: usize = 8;
/// Cells along the longest side while the object is searched.
const SEARCH_CELLS: usize = 48;
/// How often the search looks closer.
const SEARCHES: usize = 4;

/// How far `p` lies outside the hull, negative inside, scene units; a lower bound of the true
/// distance. One view of many may err: the second largest of the views' distances counts.
fn outside_by(silhouettes: &[Silhouette], p: Vec3) -> f32 {
    let (mut largest, mut second, mut n) = (f32::NEG_INFINITY, f32::NEG_INFINITY, 0);
    for by in silhouettes.iter().filter_map(|s| s.outside_by(p)) {
        n += 1;
        if by > largest {
            second = largest;
            largest = by;
        } else if by > second {
            second = by;
        }
    }
    // What hardly any view sees, near a camera or beside most pictures, is not the object.
    if n < (silhouettes.len() / FEWEST_OF).max(2) {
        return largest.max(FAR);
    }
    if n >= VIEWS_FOR_OUTLIER {
        second
    } else {
        largest
    }
}

/// Fills `grid` with the distance to the hull.
pub(super) fn fill(
    silhouettes: &[Silhouette],
    grid: &mut ScalarGrid,
    go_on: GoOn<'_>,
) -> Result<(), StageOneError> {
    let frame = ScalarGrid {
        origin: grid.origin,
        cell: grid.cell,
        size: grid.size,
        values: Vec::new(),
    };
    let [nx, ny, _] = frame.size;
    grid.values
        .par_chunks_mut(BLOCK * nx * ny)
        .enumerate()
        .for_each(|(slab, values)| {
            for y in (0..ny).step_by(BLOCK) {
                for x in (0..nx).step_by(BLOCK) {
                    if go_on() {
                        fill_block(silhouettes, &frame, [x, y, slab * BLOCK], values);
                    }
                }
            }
        });
    unless_cancelled(go_on)
}

/// Distances to the hull up to `reach` cells from the surface of a grid, at the same nodes; beyond, it bounds nothing.
pub(super) fn near(silhouettes: &[Silhouette], surface: &ScalarGrid, reach: f32) -> ScalarGrid {
    let mut hull = surface.clone();
    let values = hull.values.par_iter_mut().enumerate();
    values.for_each(|(node, value)| {
        *value = if value.abs() < reach * surface.cell {
            outside_by(silhouettes, surface.position(surface.place(node)))
        } else {
            f32::NEG_INFINITY
        };
    });
    hull
}

/// Leaves nothing outside `bounds`: where no camera looks from, the hull has no end.
pub(super) fn cut(grid: &mut ScalarGrid, bounds: &Aabb) {
    let beyond = |p: Vec3| (p - bounds.center()).abs() - 0.5 * bounds.extent();
    raise(grid, |p| beyond(p).max_element());
}

/// Leaves nothing in `grid` below what `least` says of the place.
pub(super) fn raise(grid: &mut ScalarGrid, least: impl Fn(Vec3) -> f32 + Sync) {
    let mut values = std::mem::take(&mut grid.values);
    values.par_iter_mut().enumerate().for_each(|(node, value)| {
        *value = value.max(least(grid.position(grid.place(node))));
    });
    grid.values = values;
}

/// Fills the block of nodes from `start` on; `values`: those of the block's layers in `frame`.
fn fill_block(
    silhouettes: &[Silhouette],
    frame: &ScalarGrid,
    start: [usize; 3],
    values: &mut [f32],
) {
    let [nx, ny, _] = frame.size;
    let end: [usize; 3] = std::array::from_fn(|axis| (start[axis] + BLOCK).min(frame.size[axis]));
    let (low, high) = (frame.position(start), frame.position(end.map(|n| n - 1)));
    let middle = outside_by(silhouettes, 0.5 * (low + high));
    // Distances in a picture grow a little faster than in space off its centre.
    let is_far = middle.abs() > 0.75 * (high - low).length() && middle < FAR;
    for z in start[2]..end[2] {
        for y in start[1]..end[1] {
            for x in start[0]..end[0] {
                values[((z - start[2]) * ny + y) * nx + x] = if is_far {
                    middle
                } else {
                    outside_by(silhouettes, frame.position([x, y, z]))
                };
            }
        }
    }
}

/// The box around the hull, found from the masks and cameras alone; `None` where the silhouettes
/// have nothing in common or leave the object unbounded.
pub(super) fn bounds(
    silhouettes: &[Silhouette],
    go_on: GoOn<'_>,
) -> Result<Option<Aabb>, StageOneError> {
    let Some(mut search) = first_box(silhouettes) else {
        return Ok(None);
    };
    for _ in 0..SEARCHES {
        let mut grid = ScalarGrid::over(&search, SEARCH_CELLS, 0.0);
        fill(silhouettes, &mut grid, go_on)?;
        let slack = grid.cell;
        let inside = (0..grid.values.len()).filter(|i| grid.values[*i] < slack);
        let found = Aabb::from_points(inside.map(|i| grid.position(grid.place(i))));
        if found.is_empty() {
            return Ok(None);
        }
        let closer = found.widened(slack);
        let shrinks = closer.extent().max_element() < 0.8 * search.extent().max_element();
        search = closer;
        if !shrinks {
            break;
        }
    }
    Ok(Some(search))
}

/// A cube that holds the object: around the point nearest to the middles of all silhouettes, as
/// wide as the widest of them seen from there, doubled.
fn first_box(silhouettes: &[Silhouette]) -> Option<Aabb> {
    // The ray through the middle of each, and the angle that it reaches to from there.
    let cone = |silhouette: &Silhouette| {
        let (middle, reach_px) = silhouette.disc();
        let angle = reach_px * silhouette.camera.pixel_angle();
        (silhouette.ray(middle), angle)
    };
    let cones: Vec<_> = silhouettes.iter().map(cone).collect();
    // Least squares over the distances to the rays: sum (I - d dT) (p - o) = 0.
    let (mut matrix, mut right) = (glam::DMat3::ZERO, glam::DVec3::ZERO);
    for (ray, _) in &cones {
        let d = ray.direction.as_dvec3();
        let across = glam::DMat3::IDENTITY - glam::DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * ray.origin.as_dvec3();
    }
    // Parallel rays meet nowhere.
    if matrix.determinant() < 1e-6 * (cones.len() as f64).powi(3) {
        return None;
    }
    let middle = (matrix.inverse() * right).as_vec3();
    let radii = cones
        .iter()
        .map(|(ray, angle)| angle * ray.origin.distance(middle));
    let radius = 2.0 * radii.fold(0.0, f32::max);
    (middle.is_finite() && radius > 0.0 && radius.is_finite()).then(|| Aabb {
        min: middle - radius,
        max: middle + radius,
    })
}
