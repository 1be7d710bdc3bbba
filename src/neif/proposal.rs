//! Where along a ray the samples go: inverse-CDF sampling of weights composited from a cached density.
//!
//! No proposal network and no hard pruning: a running mean of the density on two coarse grids (one finer, over
//! the inner box; one over all contracted space), a uniform share that keeps exploring, and a fixed number of
//! samples a ray. Hard occupancy pruning measured 3 dB worse: it prunes before the geometry is found.

use glam::IVec3;

use super::contraction::{expand, unit_cube};
use super::kernels::math::{bf16_from_f32, f32_from_bf16};
use super::kernels::{Baseline, Isa, dispatch, fma, math};

/// Cells per axis of the grid over all contracted space.
const OUTER_SIDE: usize = 96;
/// Cells per axis of the grid over the inner box.
const INNER_SIDE: usize = 128;
/// Equal steps from the origin to the inner box's far side.
const INNER_STEPS: usize = 48;
/// A cell that is empty for good: no running mean gets there.
const VOID: u16 = 0;
/// Cells of the inner grid, which come first.
const INNER_CELLS: u32 = (INNER_SIDE * INNER_SIDE * INNER_SIDE) as u32;
/// Steps beyond it, equal in `s / (1 + s)`.
const OUTER_STEPS: usize = 32;
/// Where the last of them ends, in half sides of the inner box beyond it.
const REACH: f32 = 48.0;
/// Look-ups a ray.
pub const N_STEPS: usize = INNER_STEPS + OUTER_STEPS;
/// Density of cells never seen, per field unit: faint, so that unknown space is looked at but hides nothing.
const INITIAL_DENSITY: f32 = 0.1;
/// Share of a new observation in the running mean.
const RATE: f32 = 0.1;

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

/// Running mean of the density, stored as the upper half of an `f32` (bf16): half the cache lines.
#[derive(Clone, Debug, PartialEq)]
pub struct DensityGrid {
    cells: Vec<u16>,
}

impl Default for DensityGrid {
    fn default() -> Self {
        Self {
            cells: vec![bf16_from_f32(INITIAL_DENSITY); INNER_SIDE.pow(3) + OUTER_SIDE.pow(3)],
        }
    }
}

impl DensityGrid {
    /// All cells: first the inner grid, then the outer one, x fastest.
    pub fn cells(&self) -> &[u16] {
        &self.cells
    }

    /// The grid of stored cells; `None` when the count is wrong.
    pub fn from_cells(cells: Vec<u16>) -> Option<Self> {
        (cells.len() == INNER_SIDE.pow(3) + OUTER_SIDE.pow(3)).then_some(Self { cells })
    }

    /// Declares every inner cell whose centre `is_void` (field coordinates) empty for good: the object's inside.
    ///
    /// No ray of a camera ever goes there, so what the field puts there is a ghost of the object that shows as soon
    /// as the environment is moved.
    pub fn hollow(&mut self, is_void: impl Fn([f32; 3]) -> bool) {
        for index in 0..INNER_CELLS as usize {
            if is_void(Self::point_in_cell(index, [0.5; 3])) {
                self.cells[index] = VOID;
            }
        }
    }

    /// Declares inner cells around void ones, within `reach` cells from centre to centre, empty for good too, where `may_be`
    /// (of the centre, field coordinates).
    pub fn widen_void(&mut self, reach: f32, may_be: impl Fn([f32; 3]) -> bool) {
        let (side, n) = (INNER_SIDE as i32, reach.floor() as i32);
        let line = || -n..=n;
        let steps: Vec<IVec3> = line()
            .flat_map(|x| line().flat_map(move |y| line().map(move |z| IVec3::new(x, y, z))))
            .filter(|step| step.length_squared() as f32 <= reach * reach)
            .collect();
        let void = (0..INNER_CELLS).filter(|index| self.is_void(*index));
        for index in void.collect::<Vec<_>>() {
            let i = index as i32;
            let cell = IVec3::new(i % side, i / side % side, i / side / side);
            for beside in steps.iter().map(|step| cell + step) {
                if beside.min_element() < 0 || beside.max_element() >= side {
                    continue;
                }
                let at = (beside.x + (beside.y + beside.z * side) * side) as usize;
                if self.cells[at] != VOID && may_be(Self::point_in_cell(at, [0.5; 3])) {
                    self.cells[at] = VOID;
                }
            }
        }
    }

    /// Side of an inner cell, field coordinates.
    pub const fn inner_cell() -> f32 {
        2.0 / INNER_SIDE as f32
    }

    /// Whether the cell is empty for good.
    #[inline(always)]
    pub fn is_void(&self, index: u32) -> bool {
        self.cells[index as usize] == VOID
    }

    /// Mixes an observed density into the cell with `index` (see [`cell_index`]).
    pub fn observe(&mut self, index: u32, density: f32) {
        let cell = &mut self.cells[index as usize];
        if *cell == VOID {
            return;
        }
        let mean = f32_from_bf16(*cell);
        // The cap keeps one absurd observation from outlasting a run.
        let mean = mean + RATE * (density.min(1e6) - mean);
        // A mean that underflowed would read as void.
        *cell = bf16_from_f32(mean.max(1e-30));
    }

    /// A point, in field coordinates, inside cell `index`, placed by three numbers in `[0, 1)`.
    pub fn point_in_cell(index: usize, u: [f32; 3]) -> [f32; 3] {
        let (index, side) = if index < INNER_SIDE.pow(3) {
            (index, INNER_SIDE)
        } else {
            (index - INNER_SIDE.pow(3), OUTER_SIDE)
        };
        let cell = [index % side, index / side % side, index / side / side];
        let unit: [f32; 3] =
            std::array::from_fn(|axis| (cell[axis] as f32 + u[axis]) / side as f32);
        if side == INNER_SIDE {
            unit.map(|v| v * 2.0 - 1.0)
        } else {
            expand(unit.map(|v| v * 4.0 - 2.0))
        }
    }

    /// The cells in eight bits each, two to a word: `8 log2(density) + 128`, steps of 9 %, 0 for void; for files.
    pub fn codes(&self) -> Vec<u16> {
        let code = |cell: u16| {
            let log = 8.0 * f32_from_bf16(cell).max(1e-30).log2() + 128.0;
            if cell == VOID {
                0
            } else {
                log.round().clamp(1.0, 255.0) as u16
            }
        };
        self.cells
            .chunks_exact(2)
            .map(|pair| code(pair[0]) | code(pair[1]) << 8)
            .collect()
    }

    /// The grid of stored codes; `None` when the count is wrong.
    pub fn from_codes(codes: &[u16]) -> Option<Self> {
        let decode = |code: u16| {
            let density = ((f32::from(code) - 128.0) / 8.0).exp2();
            if code == 0 {
                VOID
            } else {
                bf16_from_f32(density)
            }
        };
        Self::from_cells(
            codes
                .iter()
                .flat_map(|pair| [decode(pair & 0xff), decode(pair >> 8)])
                .collect(),
        )
    }

    /// Number of cells of both grids.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Never true: the grids have a fixed size.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }
}

/// The cell that holds a point in field coordinates.
#[inline(always)]
pub fn cell_index(x: [f32; 3]) -> u32 {
    let m = x[0].abs().max(x[1].abs()).max(x[2].abs());
    // Both, and then a choice: vectorises.
    let inner = cell_of(x.map(|v| v * 0.5 + 0.5), INNER_SIDE);
    let outer = INNER_CELLS + cell_of(unit_cube(contract_point(x)), OUTER_SIDE);
    if m < 1.0 { inner } else { outer }
}

/// The cell of a grid with `side` cells an axis that holds a point of the unit cube; points outside go to the rim.
#[inline(always)]
fn cell_of(unit: [f32; 3], side: usize) -> u32 {
    // The minimum and maximum also map NaN inside the grid.
    let top = side as f32 - 0.5;
    let [x, y, z] = unit.map(|v| math::floor_small((v * side as f32).max(0.0).min(top)).1);
    x + (y + z * side as u32) * side as u32
}

/// [`contract`] without the scale, which costs a cube root.
#[inline(always)]
fn contract_point(x: [f32; 3]) -> [f32; 3] {
    let m = x[0].abs().max(x[1].abs()).max(x[2].abs()).max(1.0);
    let inverse = 1.0 / m;
    x.map(|v| v * (2.0 - inverse) * inverse)
}

/// How samples are placed on a ray.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Total weight spread evenly over all steps, against at most about 1 for the weights themselves.
    pub uniform_share: f32,
    /// Shift of all interval ends, in intervals, `[-0.5, 0.5]`; 0 when rendering.
    pub shift: f32,
}

dispatch! {
    /// The interval ends of one ray: `edges`: `[n_samples + 1]` distances, increasing.
    pub fn place_samples(grid: &DensityGrid, ray: &ConeRay, placement: Placement, edges: &mut [f32]) = place_samples_body
}

#[inline(always)]
fn place_samples_body<I: Isa>(
    grid: &DensityGrid,
    ray: &ConeRay,
    placement: Placement,
    edges: &mut [f32],
) {
    let mut weights = [0.0; N_STEPS];
    let split = split_distance(ray);
    march::<I>(grid, ray, split, &mut weights);
    invert_cdf(
        &spread_weights(&weights, placement.uniform_share),
        split,
        placement.shift,
        edges,
    );
}

/// What the look-ups along a ray found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaySteps {
    /// All of them.
    pub n: usize,
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
    march::<Baseline>(grid, ray, split_distance(ray), &mut weights);
    let mut left = 1.0;
    let mut steps = RaySteps {
        n: N_STEPS,
        empty: 0,
        hidden: 0,
    };
    for weight in weights {
        if left < NEXT_TO_NOTHING {
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
    let mut alpha = [0.0; N_STEPS];
    for step in 0..N_STEPS {
        alpha[step] = f32_from_bf16(grid.cells[cells[step] as usize]);
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

/// Cuts the distribution at equal quantiles, shifted together by `shift` intervals.
#[inline(always)]
fn invert_cdf(weights: &[f32; N_STEPS], split: f32, shift: f32, edges: &mut [f32]) {
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
        *edge = step_distance(step as f32 + fraction, split);
    }
    edges[last] = step_distance(N_STEPS as f32, split);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray() -> ConeRay {
        ConeRay {
            origin: [0.8, 0.1, 0.0],
            direction: [-1.0, 0.0, 0.0],
            ..ConeRay::default()
        }
    }

    fn wall_at(x: f32) -> DensityGrid {
        let mut grid = DensityGrid {
            cells: vec![bf16_from_f32(1e-6); DensityGrid::default().len()],
        };
        for index in 0..grid.len() {
            if (DensityGrid::point_in_cell(index, [0.5; 3])[0] - x).abs() < 0.02 {
                grid.cells[index] = bf16_from_f32(1e3);
            }
        }
        grid
    }

    #[test]
    fn what_is_void_is_widened_as_a_ball_where_it_may_be() {
        let mut grid = DensityGrid::default();
        let middle = [0.5 * DensityGrid::inner_cell(); 3];
        grid.hollow(|x| x.iter().all(|v| (v - middle[0]).abs() < 1e-4));
        grid.widen_void(2.5, |x| x[1] > -DensityGrid::inner_cell());
        let is_void = |dx: i32, dy: i32, dz: i32| {
            let step = |d: i32| d as f32 * DensityGrid::inner_cell();
            let x = [
                middle[0] + step(dx),
                middle[1] + step(dy),
                middle[2] + step(dz),
            ];
            grid.is_void(cell_index(x))
        };
        assert!(is_void(0, 0, 0) && is_void(2, 0, 0) && is_void(-2, 1, 1) && is_void(0, 2, 0));
        assert!(!is_void(3, 0, 0) && !is_void(2, 2, 0), "beyond 2.5 cells");
        assert!(is_void(0, -1, 0) && !is_void(0, -2, 0), "it may not be");
        // 81 cells in the ball, 3 x 3 of them beyond the limit.
        let n_void = (0..INNER_CELLS).filter(|i| grid.is_void(*i)).count();
        assert_eq!(n_void, 72);
    }

    #[test]
    fn edges_increase_and_cover_the_ray() {
        for (shift, uniform_share) in [(0.0, 1.0), (0.5, 0.1), (-0.5, 0.1)] {
            let mut edges = [0.0; 17];
            place_samples(
                &wall_at(-0.5),
                &ray(),
                Placement {
                    uniform_share,
                    shift,
                },
                &mut edges,
            );
            assert!(edges.windows(2).all(|w| w[0] <= w[1]), "{edges:?}");
            assert!(edges[0] == 0.0 && edges[16] > 40.0, "{edges:?}");
        }
    }

    #[test]
    fn most_samples_fall_on_the_wall() {
        let mut edges = [0.0; 17];
        place_samples(
            &wall_at(-0.5),
            &ray(),
            Placement {
                uniform_share: 0.1,
                shift: 0.0,
            },
            &mut edges,
        );
        let near = edges.iter().filter(|&&t| (t - 1.3).abs() < 0.1).count();
        assert!(near >= 12, "{near} of 17 edges at the wall: {edges:?}");
    }

    #[test]
    fn steps_before_a_wall_are_empty_and_those_behind_it_hidden() {
        let steps = steps_of_ray(&wall_at(-0.5), &ray());
        // From 0.8 to -1 in 48 steps: the wall is 1.3 away.
        assert!((33..=36).contains(&steps.empty), "{steps:?}");
        assert!((40..=46).contains(&steps.hidden), "{steps:?}");
    }

    #[test]
    fn a_cell_contains_its_points() {
        for index in (0..DensityGrid::default().len()).step_by(7919) {
            let back = cell_index(DensityGrid::point_in_cell(index, [0.5; 3]));
            let point = DensityGrid::point_in_cell(index, [0.5; 3]);
            // Outer cells inside the inner box are never used.
            let unused = index >= INNER_SIDE.pow(3) && point.iter().all(|v| v.abs() < 1.0);
            let at_infinity = point.iter().any(|v| v.abs() > 50.0);
            assert!(
                back as usize == index || unused || at_infinity,
                "cell {index} came back as {back}"
            );
        }
    }

    #[test]
    fn odd_rays_still_get_increasing_edges() {
        let grid = DensityGrid::default();
        for (origin, direction) in [
            ([0.0; 3], [0.0; 3]),
            ([1e4, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0; 3], [0.0, 0.0, 1e-3]),
        ] {
            let mut edges = [0.0; 9];
            let ray = ConeRay {
                origin,
                direction,
                ..ConeRay::default()
            };
            place_samples(
                &grid,
                &ray,
                Placement {
                    uniform_share: 0.5,
                    shift: 0.0,
                },
                &mut edges,
            );
            assert!(
                edges.iter().all(|t| t.is_finite()) && edges.windows(2).all(|w| w[0] <= w[1]),
                "{edges:?}"
            );
        }
    }

    #[test]
    fn codes_keep_the_density_within_their_step() {
        let mut grid = DensityGrid::default();
        for (i, cell) in grid.cells.iter_mut().enumerate() {
            *cell = bf16_from_f32(1e-3 * 1.01_f32.powi((i % 1500) as i32));
        }
        let back = DensityGrid::from_codes(&grid.codes()).unwrap();
        for (a, b) in grid.cells.iter().zip(&back.cells) {
            let ratio = f32_from_bf16(*a) / f32_from_bf16(*b);
            assert!((0.94..1.06).contains(&ratio), "{ratio}");
        }
        assert!(
            DensityGrid::from_codes(&[0; 3]).is_none(),
            "a wrong count must be refused"
        );
    }

    #[test]
    fn the_running_mean_converges() {
        let mut grid = DensityGrid::default();
        for _ in 0..200 {
            grid.observe(5, 30.0);
        }
        assert!(
            (f32_from_bf16(grid.cells[5]) - 30.0).abs() < 1.5,
            "{}",
            f32_from_bf16(grid.cells[5])
        );
    }
}
