//! A guess of the surface where neither outlines nor patterns determine it: a smooth one between what patterns show.

use std::collections::HashSet;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::fusion::{self, Depths};
use super::outline_check::Touch;
use crate::data::DepthMap;
use crate::geometry::ScalarGrid;
use crate::train::shape::stage_one::{GoOn, StageOneError};

/// Cells around the places where outlines touch the surface within which there is nothing to guess; up to twice as many, as they
/// are the sides of cubes.
const TOUCHED_CELLS: f32 = 3.0;
/// Weight from which the guesses made from several maps count.
const SURE_WEIGHT: f32 = 2.0;

/// Steps to a cube and its neighbours.
const AROUND: [IVec3; 27] = {
    let mut steps = [IVec3::ZERO; 27];
    let mut i = 0;
    while i < 27 {
        let n = i as i32;
        steps[i] = IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
        i += 1;
    }
    steps
};

/// The map with depths for all pixels of the object, in between those of others around them where it has none.
///
/// `grey`: `[height * width]` what the photo shows; NaN beside the object.
pub(super) fn between(map: &DepthMap, grey: &[f32]) -> DepthMap {
    let [width, height] = [map.camera.width, map.camera.height].map(|side| side as usize);
    // One over the depth of a plane is linear in the picture.
    let known = |depth: &f32| {
        if *depth > 0.0 {
            depth.recip()
        } else {
            f32::NAN
        }
    };
    let mut nearness: Vec<f32> = map.depths.iter().map(known).collect();
    interpolate(&mut nearness, [width, height]);
    let depths = nearness.iter().zip(grey);
    let depths = depths.map(|(v, grey)| {
        if grey.is_nan() || v.is_nan() {
            0.0
        } else {
            v.recip()
        }
    });
    DepthMap {
        camera: map.camera,
        depths: depths.collect(),
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

/// Distances to the surface that maps guess, which [`between`] filled, at the nodes of `phi`; far inside where they guess nothing,
/// and around the places where outlines touch the surface.
pub(in super::super) fn guess(
    maps: &[DepthMap],
    phi: &ScalarGrid,
    touches: &[Touch],
    (is_late, go_on): (&dyn Fn() -> bool, GoOn<'_>),
) -> Result<ScalarGrid, StageOneError> {
    let views: Vec<_> = maps.iter().map(|map| Depths::known(map, None)).collect();
    let mut grid = phi.clone();
    let may_be = |node: usize| phi.values[node] <= phi.cell;
    let seen = fusion::fill(&views, &mut grid, &may_be, is_late, go_on, &|_| ())?;
    let cube = |p: Vec3| {
        ((p - phi.origin) / (TOUCHED_CELLS * phi.cell))
            .floor()
            .as_ivec3()
    };
    let near = touches.iter().map(|touch| cube(touch.place));
    let near: HashSet<IVec3> = near.flat_map(|cube| AROUND.map(|by| cube + by)).collect();
    let nodes = grid.values.par_iter_mut().zip(&seen.weights).enumerate();
    nodes.for_each(|(node, (value, weight))| {
        if *weight < SURE_WEIGHT || near.contains(&cube(phi.position(phi.place(node)))) {
            *value = -fusion::REACH_CELLS * phi.cell;
        }
    });
    Ok(grid)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Aabb, Camera, Ray};
    use crate::train::random::SlotRandom;

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

    #[test]
    fn a_plane_is_continued_through_what_is_not_known() {
        let eye = Vec3::new(0.8, 0.3, 3.0);
        let whole = plane_from(eye, |_| true);
        let mut random = SlotRandom::new(3, 0, 0);
        let known = plane_from(eye, |p| p.length() > 0.3 && random.uniform() < 0.3);
        let mut grey = vec![0.5; known.depths.len()];
        grey[7] = f32::NAN;
        let filled = between(&known, &grey);
        assert_eq!(filled.depths[7], 0.0);
        let off = filled.depths.iter().zip(&whole.depths).skip(8);
        let worst = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.02, "{worst}");
        let nothing = between(&plane_from(eye, |_| false), &grey);
        assert!(nothing.depths.iter().all(|depth| *depth == 0.0));
    }

    #[test]
    fn the_hull_is_cut_down_to_the_guess_but_near_its_outlines() {
        let eyes = [-0.8, -0.3, 0.3, 0.8].map(|x| Vec3::new(x, 0.0, 3.0));
        let maps = eyes.map(|eye| plane_from(eye, |_| true));
        let bounds = Aabb::from_points([Vec3::splat(-0.5), Vec3::splat(0.5)]);
        let mut hull = ScalarGrid::over(&bounds, 24, 0.0);
        for node in 0..hull.values.len() {
            hull.values[node] = hull.position(hull.place(node)).length() - 0.4;
        }
        let touched = Vec3::new(0.4, 0.0, 0.0);
        let touch = Touch::by(
            &hull,
            &Ray {
                origin: touched - Vec3::Z,
                direction: Vec3::Z,
            },
        );
        let guess = guess(&maps, &hull, &[touch.unwrap()], (&|| false, &|| true)).unwrap();
        let above = guess.sample(Vec3::new(0.0, 0.0, 0.1));
        assert!((above - 0.1).abs() < 0.02, "{above}");
        assert!(guess.sample(touched + 0.05 * Vec3::Z) < -0.1);
    }
}
