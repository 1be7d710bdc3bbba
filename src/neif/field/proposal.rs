//! Where along a ray the samples go: inverse-CDF sampling of weights composited from a cached density.
//!
//! No proposal network and no hard pruning: a running mean of the density, a uniform share that keeps exploring, and a
//! fixed number of samples a ray. Hard occupancy pruning measured 3 dB worse: it prunes before the geometry is found.

use super::cells::{INNER_CELLS, INNER_SIDE, OUTER_SIDE, cell_of, contract_point};
use super::contraction::unit_cube;
use super::density_grid::DensityGrid;
use crate::neif::kernels::math::{self, f32_from_bf16};
use crate::neif::kernels::{Baseline, Isa, dispatch, fma};

/// Equal steps from the origin to the inner box's far side.
const INNER_STEPS: usize = 48;
/// Steps beyond it, equal in `s / (1 + s)`.
const OUTER_STEPS: usize = 32;
/// Where the last of them ends, in half sides of the inner box beyond it.
const REACH: f32 = 48.0;
/// Look-ups a ray.
pub const N_STEPS: usize = INNER_STEPS + OUTER_STEPS;

/// A ray of the field: field coordinates, with the growth of its footprint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ConeRay {
    /// Origin.
    pub origin: [f32; 3],
    /// Where the mean of the cone goes: the unit direction times the lobe's mean length.
    pub direction: [f32; 3],
    /// Standard deviation of the footprint at the origin.
    pub base: f32,
    /// Growth of it with distance (curvature and pixel cone), radians.
    pub spread: f32,
    /// Variance of the lobe's unit directions per transverse axis.
    pub lobe_variance: f32,
}

impl ConeRay {
    /// Variance of the footprint at distance `t`: `(base + spread t)² + lobe_variance t²`.
    #[inline(always)]
    pub fn variance(&self, t: f32) -> f32 {
        let pixel = self.base + self.spread * t;
        pixel * pixel + self.lobe_variance * t * t
    }

    /// The mean of the cone at distance `t`.
    #[inline(always)]
    pub fn at(&self, t: f32) -> [f32; 3] {
        std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis])
    }
}

/// Length of the last interval of a ray that ends on the floor, field units, at least: nothing shines through, whatever the
/// density there.
pub const OPAQUE_LENGTH: f32 = 1e30;

dispatch! {
    /// The interval ends of one ray: `edges`: `[n_samples + 1]` distances, increasing.
    ///
    /// `uniform_share` is the total weight spread evenly over all steps, against at most about 1 for the weights themselves;
    /// `shift` that of all interval ends, in intervals, `[-0.5, 0.5]`, 0 when rendering.
    pub fn place_samples(grid: &DensityGrid, ray: &ConeRay, uniform_share: f32, shift: f32, edges: &mut [f32]) = place_samples_body
}

#[inline(always)]
fn place_samples_body<I: Isa>(
    grid: &DensityGrid,
    ray: &ConeRay,
    uniform_share: f32,
    shift: f32,
    edges: &mut [f32],
) {
    let mut weights = [0.0; N_STEPS];
    let split = split_distance(ray);
    march::<I>(grid, ray, split, &mut weights);
    let weights = spread_weights(&weights, uniform_share);
    match (floor_step(grid, ray, split), edges) {
        (Some(end), [edges @ .., last]) => {
            invert_cdf(&weights, split, end, shift, edges);
            *last = 2.0 * OPAQUE_LENGTH;
        }
        (_, edges) => invert_cdf(&weights, split, N_STEPS as f32, shift, edges),
    }
}

/// What the [`N_STEPS`] look-ups along a ray found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaySteps {
    /// Those in the open that hold next to nothing of the ray's light.
    pub empty: usize,
    /// Those behind something opaque.
    pub hidden: usize,
}

/// Share of a ray's light below which a step counts as empty, and what is left of it behind something opaque.
const NEXT_TO_NOTHING: f32 = 1e-3;

/// Counts the look-ups of a ray by what the cached density says of them.
pub fn steps_of_ray(grid: &DensityGrid, ray: &ConeRay) -> RaySteps {
    let mut weights = [0.0; N_STEPS];
    let split = split_distance(ray);
    march::<Baseline>(grid, ray, split, &mut weights);
    let end = floor_step(grid, ray, split).unwrap_or(N_STEPS as f32);
    let mut left = 1.0;
    let mut steps = RaySteps {
        empty: 0,
        hidden: 0,
    };
    for (step, weight) in weights.into_iter().enumerate() {
        if left < NEXT_TO_NOTHING || step as f32 >= end {
            steps.hidden += 1;
        } else if weight < NEXT_TO_NOTHING {
            steps.empty += 1;
        }
        left -= weight;
    }
    steps
}

/// Weights of all steps, composited front to back from the cached density.
#[inline(always)]
fn march<I: Isa>(grid: &DensityGrid, ray: &ConeRay, split: f32, weights: &mut [f32; N_STEPS]) {
    // Index arithmetic first, in loops without branches or loads, so that it vectorises.
    let mut cells = [0_u32; N_STEPS];
    let mut lengths = [split / INNER_STEPS as f32; N_STEPS];
    for step in 0..INNER_STEPS {
        let t = (step as f32 + 0.5) * lengths[step];
        cells[step] = cell_of(ray.at(t).map(|v| v * 0.5 + 0.5), INNER_SIDE);
    }
    for step in INNER_STEPS..N_STEPS {
        let (near, far) = (
            outer_distance(step as f32, split),
            outer_distance(step as f32 + 1.0, split),
        );
        lengths[step] = far - near;
        cells[step] = INNER_CELLS
            + cell_of(
                unit_cube(contract_point(ray.at(0.5 * (near + far)))),
                OUTER_SIDE,
            );
    }
    let densities = grid.cells();
    let mut alpha = [0.0; N_STEPS];
    for step in 0..N_STEPS {
        alpha[step] = f32_from_bf16(densities[cells[step] as usize]);
    }
    for step in 0..N_STEPS {
        alpha[step] = 1.0 - math::exp::<I>(-alpha[step] * lengths[step]);
    }
    let mut transmittance = 1.0;
    for step in 0..N_STEPS {
        weights[step] = alpha[step] * transmittance;
        transmittance = fma::<I>(-alpha[step], transmittance, transmittance);
    }
}

/// Distance where the ray leaves the inner box, or where it is about as far as the box when it misses it.
#[inline(always)]
fn split_distance(ray: &ConeRay) -> f32 {
    let mut far = f32::INFINITY;
    let mut near = 0.0_f32;
    for axis in 0..3 {
        let (o, d) = (ray.origin[axis], ray.direction[axis]);
        // A zero component gives ±infinity, which min and max handle; 0/0 gives NaN, which they ignore.
        let (a, b) = ((-1.0 - o) / d, (1.0 - o) / d);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    let reach = ray.origin.iter().fold(0.5_f32, |m, v| m.max(v.abs()));
    if far > near && far.is_finite() {
        far.max(0.05)
    } else {
        reach
    }
}

/// Distance of a fractional step.
#[inline(always)]
fn step_distance(step: f32, split: f32) -> f32 {
    if step <= INNER_STEPS as f32 {
        step * (split / INNER_STEPS as f32)
    } else {
        outer_distance(step, split)
    }
}

/// The fractional step at which a ray ends on the floor.
#[inline(always)]
fn floor_step(grid: &DensityGrid, ray: &ConeRay, split: f32) -> Option<f32> {
    let distance = grid.floor?.distance(ray.origin, ray.direction)?;
    Some(step_at(distance, split))
}

/// The fractional step at a distance; [`N_STEPS`] from where the steps end.
#[inline(always)]
fn step_at(distance: f32, split: f32) -> f32 {
    let beyond = distance - split;
    let step = if beyond <= 0.0 {
        distance / (split / INNER_STEPS as f32)
    } else {
        let u = beyond / (1.0 + beyond);
        INNER_STEPS as f32 + u / (REACH / (REACH + 1.0) / OUTER_STEPS as f32)
    };
    step.min(N_STEPS as f32)
}

/// Distance of a fractional step beyond the inner box.
#[inline(always)]
fn outer_distance(step: f32, split: f32) -> f32 {
    let u = (step - INNER_STEPS as f32) * (REACH / (REACH + 1.0) / OUTER_STEPS as f32);
    split + u / (1.0 - u)
}

/// The greatest of each weight and its neighbours, plus the uniform share.
#[inline(always)]
fn spread_weights(weights: &[f32; N_STEPS], uniform_share: f32) -> [f32; N_STEPS] {
    let uniform = uniform_share / N_STEPS as f32;
    std::array::from_fn(|i| {
        let before = weights[i.saturating_sub(1)];
        let after = weights[(i + 1).min(N_STEPS - 1)];
        weights[i].max(before).max(after) + uniform
    })
}

/// Cuts the distribution up to the fractional step `end` at equal quantiles, shifted together by `shift` intervals.
#[inline(always)]
fn invert_cdf(weights: &[f32; N_STEPS], split: f32, end: f32, shift: f32, edges: &mut [f32]) {
    let part = |step: usize| (end - step as f32).clamp(0.0, 1.0);
    let weights: [f32; N_STEPS] = std::array::from_fn(|step| weights[step] * part(step));
    let total: f32 = weights.iter().sum();
    let last = edges.len() - 1;
    let mut below = 0.0;
    let mut step = 0;
    edges[0] = 0.0;
    for (k, edge) in edges.iter_mut().enumerate().take(last).skip(1) {
        let target = total * (k as f32 + shift) / last as f32;
        while step < N_STEPS - 1 && below + weights[step] < target {
            below += weights[step];
            step += 1;
        }
        // Rounding in the running sum may leave the target slightly outside the step.
        let fraction = ((target - below) / weights[step].max(1e-20)).clamp(0.0, 1.0);
        *edge = step_distance(step as f32 + fraction * part(step), split);
    }
    edges[last] = step_distance(end, split);
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::neif::field::floor::Floor;
    use crate::neif::kernels::math::bf16_from_f32;

    fn ray() -> ConeRay {
        ConeRay {
            origin: [0.8, 0.1, 0.0],
            direction: [-1.0, 0.0, 0.0],
            ..ConeRay::default()
        }
    }

    fn wall_at(x: f32) -> DensityGrid {
        let cells = (0..DensityGrid::default().cells().len()).map(|index| {
            let apart = (DensityGrid::point_in_cell(index, [0.5; 3])[0] - x).abs();
            bf16_from_f32(if apart < 0.02 { 1e3 } else { 1e-6 })
        });
        DensityGrid::from_cells(cells.collect()).expect("as many cells")
    }

    fn placed<const N: usize>(
        grid: &DensityGrid,
        ray: &ConeRay,
        uniform_share: f32,
        shift: f32,
    ) -> [f32; N] {
        let mut edges = [0.0; N];
        place_samples(grid, ray, uniform_share, shift, &mut edges);
        edges
    }

    #[test]
    fn edges_increase_and_cover_the_ray() {
        for (shift, uniform_share) in [(0.0, 1.0), (0.5, 0.1), (-0.5, 0.1)] {
            let edges: [f32; 17] = placed(&wall_at(-0.5), &ray(), uniform_share, shift);
            assert!(edges.windows(2).all(|w| w[0] <= w[1]), "{edges:?}");
            assert!(edges[0] == 0.0 && edges[16] > 40.0, "{edges:?}");
        }
    }

    #[test]
    fn most_samples_fall_on_the_wall() {
        let edges: [f32; 17] = placed(&wall_at(-0.5), &ray(), 0.1, 0.0);
        let near = edges.iter().filter(|&&t| (t - 1.3).abs() < 0.1).count();
        assert!(near >= 12, "{near} of 17 edges at the wall: {edges:?}");
    }

    #[test]
    fn steps_before_a_wall_are_empty_and_those_behind_it_hidden() {
        let mut floored = wall_at(-2.0);
        floored.floor = Some(Floor::new(Vec3::ZERO, Vec3::X));
        let steps = steps_of_ray(&floored, &ray());
        // The box ends after 1.8: 48 steps, 21.3 of them before the floor.
        assert_eq!(steps.hidden, N_STEPS - 22);
        let steps = steps_of_ray(&wall_at(-0.5), &ray());
        // From 0.8 to -1 in 48 steps: the wall is 1.3 away.
        assert!((33..=36).contains(&steps.empty), "{steps:?}");
        assert!((40..=46).contains(&steps.hidden), "{steps:?}");
    }

    #[test]
    fn odd_rays_still_get_increasing_edges() {
        let grid = DensityGrid::default();
        for (origin, direction) in [
            ([0.0; 3], [0.0; 3]),
            ([1e4, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0; 3], [0.0, 0.0, 1e-3]),
        ] {
            let ray = ConeRay {
                origin,
                direction,
                ..ConeRay::default()
            };
            let edges: [f32; 9] = placed(&grid, &ray, 0.5, 0.0);
            assert!(
                edges.iter().all(|t| t.is_finite()) && edges.windows(2).all(|w| w[0] <= w[1]),
                "{edges:?}"
            );
        }
    }
}
