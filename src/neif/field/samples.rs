//! The samples of a batch of rays: where they are, how blurred, and how long the intervals they stand for.

use super::cells::cell_index;
use super::contraction::{contract, unit_cube};
use super::density_grid::DensityGrid;
use super::proposal::{ConeRay, OPAQUE_LENGTH, place_samples};
use crate::neif::kernels::{Isa, dispatch};
use crate::neif::networks::hash_grid::SamplePoints;

/// Samples located together, in loops that vectorise.
const LANES: usize = 8;

/// Samples of rays, `n_per_ray` each, ray after ray.
#[derive(Clone, Debug, Default)]
pub struct RaySamples {
    /// Samples a ray.
    pub(in crate::neif) n_per_ray: usize,
    edges: Vec<f32>,
    /// `[n]` distances along the rays, field units.
    pub(in crate::neif) distances: Vec<f32>,
    /// `[n]` lengths of the intervals, field units; 0 where nothing can be, [`OPAQUE_LENGTH`] or more on the floor.
    pub(in crate::neif) deltas: Vec<f32>,
    /// `[n]` in the unit cube.
    pub(in crate::neif) positions: Vec<[f32; 3]>,
    /// `[n]` standard deviations in cube sides.
    pub(in crate::neif) footprints: Vec<f32>,
    /// `[n]` cells of the density cache that the samples fall into.
    pub(in crate::neif) cells: Vec<u32>,
}

/// One ray to place samples on.
#[derive(Clone, Copy, Debug)]
pub struct SampledRay {
    /// The ray, field coordinates.
    pub cone: ConeRay,
    /// Shift of the interval ends, and of the samples inside them, in intervals, `[-0.5, 0.5]`; 0 when rendering.
    pub jitter: [f32; 2],
    /// Distance before which the ray meets nothing.
    pub start: f32,
}

impl RaySamples {
    /// Number of samples of all rays.
    pub fn n(&self) -> usize {
        self.positions.len()
    }

    /// Where the samples are and how blurred.
    pub fn points(&self) -> SamplePoints<'_> {
        SamplePoints {
            positions: &self.positions,
            footprints: &self.footprints,
        }
    }

    /// Takes points of the unit cube with their footprints instead of rays.
    pub fn set_points(&mut self, points: &[([f32; 3], f32)]) {
        self.positions.clear();
        self.positions.extend(points.iter().map(|p| p.0));
        self.footprints.clear();
        self.footprints.extend(points.iter().map(|p| p.1));
    }

    /// Places `n_per_ray` samples on each ray.
    pub fn place(
        &mut self,
        grid: &DensityGrid,
        n_per_ray: usize,
        uniform_share: f32,
        rays: impl ExactSizeIterator<Item = SampledRay>,
    ) {
        let n = rays.len() * n_per_ray;
        self.n_per_ray = n_per_ray;
        self.edges.resize(n_per_ray + 1, 0.0);
        self.distances.resize(n, 0.0);
        self.deltas.resize(n, 0.0);
        self.positions.resize(n, [0.0; 3]);
        self.footprints.resize(n, 0.0);
        self.cells.resize(n, 0);
        for (index, ray) in rays.enumerate() {
            let [shift, inside] = ray.jitter;
            place_samples(grid, &ray.cone, uniform_share, shift, &mut self.edges);
            let samples = index * n_per_ray..(index + 1) * n_per_ray;
            let inside = 0.5 + inside;
            let intervals = self.edges.windows(2);
            let out = self.distances[samples.clone()].iter_mut();
            for ((pair, t), delta) in intervals.zip(out).zip(&mut self.deltas[samples.clone()]) {
                *delta = pair[1] - pair[0];
                // The last interval reaches far out: its sample is where its near half lies in disparity, or on the floor.
                *t = if *delta >= OPAQUE_LENGTH {
                    pair[0]
                } else {
                    pair[0] + delta.min(1.0) * inside
                };
            }
            locate(
                &ray.cone,
                &self.distances[samples.clone()],
                &mut self.positions[samples.clone()],
                &mut self.footprints[samples.clone()],
                &mut self.cells[samples.clone()],
            );
            for i in samples {
                // A lobe's ray must not find its light on the surface it starts from, nor inside the object.
                let is_unseen = self.distances[i] < ray.start || grid.is_void(self.cells[i]);
                if is_unseen && self.deltas[i] < OPAQUE_LENGTH {
                    self.deltas[i] = 0.0;
                }
            }
        }
    }
}

dispatch! {
    /// Position in the unit cube, footprint in cube sides and cell of the samples at `distances` of a ray.
    fn locate(ray: &ConeRay, distances: &[f32], positions: &mut [[f32; 3]], footprints: &mut [f32], cells: &mut [u32]) = locate_body
}

#[inline(always)]
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled once an instruction set"
)]
fn locate_body<I: Isa>(
    ray: &ConeRay,
    distances: &[f32],
    positions: &mut [[f32; 3]],
    footprints: &mut [f32],
    cells: &mut [u32],
) {
    let blocks = distances
        .chunks(LANES)
        .zip(positions.chunks_mut(LANES))
        .zip(footprints.chunks_mut(LANES).zip(cells.chunks_mut(LANES)));
    for ((distances, positions), (footprints, cells)) in blocks {
        let mut t = [0.0; LANES];
        t[..distances.len()].copy_from_slice(distances);
        let mut position = [[0.0; 3]; LANES];
        let (mut footprint, mut cell) = ([0.0; LANES], [0; LANES]);
        for s in 0..LANES {
            let x = ray.at(t[s]);
            let (contracted, scale) = contract(x);
            position[s] = unit_cube(contracted);
            // The contraction scales lengths locally; the cube's side is 4.
            footprint[s] = ray.variance(t[s]).sqrt() * scale * 0.25;
            cell[s] = cell_index(x);
        }
        positions.copy_from_slice(&position[..distances.len()]);
        footprints.copy_from_slice(&footprint[..distances.len()]);
        cells.copy_from_slice(&cell[..distances.len()]);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::neif::field::floor::Floor;

    /// The distances and interval lengths of nine samples on a ray to `(0.3, 0.4, -1)`.
    fn placed(floor: Option<Floor>, inside: f32) -> (Vec<f32>, Vec<f32>) {
        let mut grid = DensityGrid::default();
        grid.floor = floor;
        let direction = Vec3::new(0.3, 0.4, -1.0).normalize_or_zero().to_array();
        let ray = SampledRay {
            cone: ConeRay {
                direction,
                ..ConeRay::default()
            },
            jitter: [0.3, inside],
            start: 0.0,
        };
        let mut samples = RaySamples::default();
        samples.place(&grid, 9, 0.1, [ray].into_iter());
        (samples.distances, samples.deltas)
    }

    #[test]
    fn the_last_sample_lies_on_the_floor() {
        for (height, inside) in [(0.4_f32, -0.5), (0.4, 0.5), (7.0, 0.2)] {
            let floor = Floor::new(Vec3::new(0.0, 0.0, -height), Vec3::Z);
            let (distances, deltas) = placed(Some(floor), inside);
            let expected = height * 1.25_f32.sqrt();
            assert!((distances[8] - expected).abs() < 1e-4 * expected);
            assert!(deltas[8] >= OPAQUE_LENGTH);
            assert!(distances.is_sorted() && distances[7] <= distances[8]);
            let length: f32 = deltas[..8].iter().sum();
            assert!((length - expected).abs() < 1e-4 * expected, "{length}");
        }
    }

    #[test]
    fn rays_that_meet_no_floor_stay_as_they_are() {
        let behind = Floor::new(Vec3::new(0.0, 0.0, 0.4), Vec3::Z);
        assert_eq!(placed(Some(behind), 0.2), placed(None, 0.2));
    }
}
