//! A guess of the surface where neither outlines nor patterns determine it: as far behind the outlines' hull as around there.

use rayon::prelude::*;

use super::fusion;
use crate::data::DepthMap;
use crate::geometry::ScalarGrid;
use crate::train::shape::stage_one::{GoOn, StageOneError};

/// Cells by which the hull must be off before a guess is better.
const SLACK_CELLS: f32 = 1.0;

/// Distances to the surface that maps and what lies between their depths guess, less a slack, at the nodes of `phi`, distances to
/// the hull; far inside where they guess nothing.
pub(in super::super) fn guess(
    maps: &[DepthMap],
    phi: &ScalarGrid,
    (is_late, go_on): (&dyn Fn() -> bool, GoOn<'_>),
) -> Result<ScalarGrid, StageOneError> {
    let maps = maps.par_iter().map(|map| filled(map, phi));
    let maps: Vec<DepthMap> = maps.collect();
    let may_be = |node: usize| phi.values[node] <= phi.cell;
    let seen = fusion::sure(&maps, phi, &may_be, (is_late, go_on))?;
    let (nothing, slack) = (-fusion::REACH_CELLS * phi.cell, SLACK_CELLS * phi.cell);
    let mut grid = phi.clone();
    let nodes = seen.distances.iter().zip(&seen.weights);
    for (value, (distance, weight)) in grid.values.iter_mut().zip(nodes) {
        *value = if *weight > 0.0 {
            *distance - slack
        } else {
            nothing
        };
    }
    Ok(grid)
}

/// The map with a depth in every pixel that shows the surface `phi`.
fn filled(map: &DepthMap, phi: &ScalarGrid) -> DepthMap {
    let camera = &map.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let hull: Vec<f32> = (0..width * height)
        .map(|i| {
            let ray = camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let at = phi.entered_by(&ray);
            at.map_or(f32::NAN, |at| {
                (at - ray.origin).dot(camera.forward()).recip()
            })
        })
        .collect();
    let known = hull.iter().zip(&map.depths);
    // One over the depth of a plane is linear in the picture.
    let mut behind: Vec<f32> = known
        .map(|(hull, depth)| {
            if *depth > 0.0 {
                (hull - depth.recip()).max(0.0)
            } else {
                f32::NAN
            }
        })
        .collect();
    interpolate(&mut behind, [width, height]);
    let nearness = hull.iter().zip(&behind).map(|(hull, behind)| hull - behind);
    DepthMap {
        camera: *camera,
        depths: nearness
            .map(|v| if v > 0.0 { v.recip() } else { 0.0 })
            .collect(),
    }
}

/// Fills in what is NaN, from ever coarser pictures (pull-push, Gortler et al. 1996); nothing where all is.
fn interpolate(values: &mut [f32], [width, height]: [usize; 2]) {
    if values.len() <= 1 || values.iter().all(|v| v.is_nan()) {
        return;
    }
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let mut sums = vec![(0.0_f32, 0.0_f32); half[0] * half[1]];
    for (i, value) in values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
        let sum = &mut sums[i / width / 2 * half[0] + i % width / 2];
        *sum = (sum.0 + value, sum.1 + 1.0);
    }
    // 0 / 0 where nothing is known.
    let mut coarse: Vec<f32> = sums.iter().map(|(sum, n)| sum / n).collect();
    interpolate(&mut coarse, half);
    for (i, value) in values.iter_mut().enumerate().filter(|(_, v)| v.is_nan()) {
        let along = |at: usize, n: usize| {
            let at = (0.5 * at as f32 - 0.25).clamp(0.0, (n - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(n - 1), at - low as f32)
        };
        let (x0, x1, fx) = along(i % width, half[0]);
        let (y0, y1, fy) = along(i / width, half[1]);
        let row = |y: usize| {
            let [left, right] = [x0, x1].map(|x| coarse[y * half[0] + x]);
            left + fx * (right - left)
        };
        let (top, bottom) = (row(y0), row(y1));
        *value = top + fy * (bottom - top);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    use crate::geometry::{Aabb, Camera};
    use crate::train::random::SlotRandom;
    use crate::train::shape::stage_one::hull::raise;

    const SIDE: u32 = 64;

    /// A map of the plane z = 0 from above, but of what `is_known`.
    fn plane_from(eye: Vec3, mut is_known: impl FnMut(Vec3) -> bool) -> DepthMap {
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.5, SIDE, SIDE);
        let depths = (0..SIDE * SIDE).map(|i| {
            let ray = camera.ray((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5);
            let t = -ray.origin.z / ray.direction.z;
            let depth = t * ray.direction.dot(camera.forward());
            if is_known(ray.at(t)) { depth } else { 0.0 }
        });
        DepthMap {
            camera,
            depths: depths.collect(),
        }
    }

    /// A ball over the plane.
    fn ball() -> ScalarGrid {
        let bounds = Aabb::from_points([Vec3::splat(-0.5), Vec3::splat(0.5)]);
        let mut hull = ScalarGrid::over(&bounds, 24, f32::NEG_INFINITY);
        raise(&mut hull, |p| p.length() - 0.4);
        hull
    }

    #[test]
    fn a_plane_is_continued_through_what_is_not_known() {
        let eye = Vec3::new(0.2, 0.1, 3.0);
        let whole = plane_from(eye, |_| true);
        let mut random = SlotRandom::new(3, 0, 0);
        let known = plane_from(eye, |p| p.x.abs() > 0.08 && random.uniform() < 0.3);
        let filled = filled(&known, &ball());
        assert_eq!(filled.depths[0], 0.0, "beside the ball");
        let middle = (SIDE / 2 * SIDE + SIDE / 2) as usize;
        let off = filled.depths[middle] - whole.depths[middle];
        assert!(off.abs() < 0.08, "{off}, of 0.4");
    }

    #[test]
    fn the_hull_stays_where_it_is_what_maps_show_around() {
        let nothing = plane_from(3.0 * Vec3::Z, |_| false);
        assert!(
            filled(&nothing, &ball())
                .depths
                .iter()
                .all(|depth| *depth == 0.0)
        );
        // Maps show the ball itself, but of its middle nothing.
        let mut rim = plane_from(3.0 * Vec3::Z, |p| p.length() > 0.3);
        for (i, depth) in (0..SIDE * SIDE).zip(&mut rim.depths) {
            let ray = rim
                .camera
                .ray((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5);
            let at = ball().entered_by(&ray).filter(|_| *depth > 0.0);
            *depth = at.map_or(0.0, |at| 3.0 - at.z);
        }
        let filled = filled(&rim, &ball());
        let middle = (SIDE / 2 * SIDE + SIDE / 2) as usize;
        assert!(
            (filled.depths[middle] - 2.6).abs() < 0.06,
            "{}",
            filled.depths[middle]
        );
    }

    #[test]
    fn the_hull_is_cut_down_to_the_guess() {
        let eyes = [-0.8, -0.3, 0.3, 0.8].map(|x| Vec3::new(x, 0.0, 3.0));
        let maps = eyes.map(|eye| plane_from(eye, |_| true));
        let hull = ball();
        let guess = guess(&maps, &hull, (&|| false, &|| true)).unwrap();
        let above = guess.sample(Vec3::new(0.0, 0.0, 0.1));
        assert!((above - 0.1 + hull.cell).abs() < 0.02, "{above}");
        assert!(
            guess.sample(Vec3::new(0.0, 0.0, -0.3)) < -0.1,
            "what is behind it"
        );
    }
}
