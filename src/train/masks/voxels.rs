//! A regular grid of cubes in space, and sets of them.

use glam::Vec3;

use crate::geometry::{Aabb, ScalarGrid};
use crate::train::statistics::{mean_121, with_neighbours};

/// Blurs by 1, 2, 1 along each axis that make voxels a smooth surface: a normal of about 1.4 cells.
const BLURS: usize = 4;

/// Cubes of a larger cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VoxelGrid {
    /// Its lowest corner, world.
    origin: Vec3,
    /// Side of a voxel, scene units.
    pub(super) cell: f32,
    /// Voxels along an axis.
    n: usize,
}

impl VoxelGrid {
    /// `n` voxels along the sides of the cube around `center` that reaches so far from it.
    pub(super) fn around(center: Vec3, reach: f32, n: usize) -> Self {
        Self {
            origin: center - reach,
            cell: 2.0 * reach / n as f32,
            n,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.n.pow(3)
    }

    /// The voxel that a point lies in, if one.
    #[inline]
    pub(super) fn index(&self, p: Vec3) -> Option<usize> {
        let at = (p - self.origin) / self.cell;
        let n = self.n as f32;
        // Written so that NaN is outside.
        let is_inside = at.cmpge(Vec3::ZERO).all() && at.cmplt(Vec3::splat(n)).all();
        is_inside.then(|| (at.z as usize * self.n + at.y as usize) * self.n + at.x as usize)
    }

    /// The middle of a voxel, world.
    #[inline]
    pub(super) fn center(&self, index: usize) -> Vec3 {
        let [x, y, z] = self.place(index);
        self.origin + self.cell * (Vec3::new(x as f32, y as f32, z as f32) + 0.5)
    }

    /// The larger cube.
    pub(super) fn bounds(&self) -> Aabb {
        Aabb {
            min: self.origin,
            max: self.origin + self.cell * self.n as f32,
        }
    }

    fn place(&self, index: usize) -> [usize; 3] {
        [
            index % self.n,
            index / self.n % self.n,
            index / self.n / self.n,
        ]
    }

    /// The voxels around one; the six that share a side, or all 26.
    fn around_voxel(&self, index: usize, all: bool) -> impl Iterator<Item = usize> {
        let (place, n) = (self.place(index).map(|v| v as isize), self.n as isize);
        (0..27_isize).filter_map(move |k| {
            let step = [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
            let distance = step.iter().map(|s| s.abs()).sum::<isize>();
            if distance == 0 || (distance > 1 && !all) {
                return None;
            }
            let [x, y, z] = std::array::from_fn(|i| place[i] + step[i]);
            let is_inside = [x, y, z].iter().all(|v| (0..n).contains(v));
            is_inside.then(|| ((z * n + y) * n + x) as usize)
        })
    }
}

/// Some voxels of a grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct VoxelSet {
    pub(super) grid: VoxelGrid,
    /// Whether each is in the set.
    has: Vec<bool>,
    /// Those that are, in no order.
    pub(super) members: Vec<usize>,
}

impl VoxelSet {
    pub(super) fn empty(grid: VoxelGrid) -> Self {
        Self {
            grid,
            has: vec![false; grid.len()],
            members: Vec::new(),
        }
    }

    pub(super) fn of(grid: VoxelGrid, voxels: impl IntoIterator<Item = usize>) -> Self {
        let mut set = Self::empty(grid);
        for voxel in voxels {
            set.insert(voxel);
        }
        set
    }

    pub(super) fn insert(&mut self, voxel: usize) {
        if !self.has[voxel] {
            self.has[voxel] = true;
            self.members.push(voxel);
        }
    }

    pub(super) fn contains(&self, voxel: usize) -> bool {
        self.has[voxel]
    }

    /// Whether a point lies in one of them.
    #[inline]
    pub(super) fn contains_point(&self, p: Vec3) -> bool {
        self.grid.index(p).is_some_and(|voxel| self.has[voxel])
    }

    /// With those that share a side with it, `steps` times.
    pub(super) fn grown(&self, steps: usize) -> Self {
        let mut grown = self.clone();
        let mut first_new = 0;
        for _ in 0..steps {
            let end = grown.members.len();
            for i in first_new..end {
                for beside in self.grid.around_voxel(grown.members[i], false) {
                    grown.insert(beside);
                }
            }
            first_new = end;
        }
        grown
    }

    /// Its connected parts (edges and corners connect too).
    pub(super) fn parts(&self) -> Vec<Self> {
        let mut is_taken = vec![false; self.has.len()];
        let mut parts = Vec::new();
        for &first in &self.members {
            if is_taken[first] {
                continue;
            }
            is_taken[first] = true;
            let mut part = vec![first];
            let mut next = 0;
            while next < part.len() {
                for beside in self.grid.around_voxel(part[next], true) {
                    if self.has[beside] && !is_taken[beside] {
                        is_taken[beside] = true;
                        part.push(beside);
                    }
                }
                next += 1;
            }
            parts.push(part);
        }
        let sets = parts.into_iter();
        sets.map(|part| Self::of(self.grid, part)).collect()
    }

    /// Distances to its surface, scene units, negative inside; true near it alone, and smooth.
    pub(super) fn distances(&self) -> ScalarGrid {
        let n = self.grid.n;
        let mut inside: Vec<f32> = self.has.iter().map(|has| f32::from(*has)).collect();
        for _ in 0..BLURS {
            for stride in [1, n, n * n] {
                inside = with_neighbours(&inside, (n, stride), mean_121);
            }
        }
        // A blurred step rises from 0 to 1 within about this many cells.
        let scale = self.grid.cell * (2.0 * std::f32::consts::PI * 0.5 * BLURS as f32).sqrt();
        ScalarGrid {
            origin: self.grid.center(0),
            cell: self.grid.cell,
            size: [n; 3],
            values: inside.iter().map(|share| scale * (0.5 - share)).collect(),
        }
    }

    pub(super) fn filtered(&self, keep: impl Fn(usize) -> bool) -> Self {
        let kept = self.members.iter().copied().filter(|voxel| keep(*voxel));
        Self::of(self.grid, kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> VoxelGrid {
        VoxelGrid::around(Vec3::new(1.0, 2.0, 3.0), 2.0, 8)
    }

    #[test]
    fn a_voxel_s_middle_lies_in_it_and_nothing_outside_does() {
        let grid = grid();
        for index in [0, 7, 8, 77, 511] {
            assert_eq!(grid.index(grid.center(index)), Some(index));
        }
        for outside in [Vec3::ZERO, Vec3::splat(f32::NAN), Vec3::new(1.0, 4.01, 3.0)] {
            assert_eq!(grid.index(outside), None, "{outside}");
        }
    }

    #[test]
    fn parts_fall_apart_where_nothing_touches() {
        let grid = grid();
        // Two that share a corner, and one alone.
        let set = VoxelSet::of(grid, [0, 1 + 8 + 64, 500]);
        let sizes: Vec<usize> = set.parts().iter().map(|part| part.members.len()).collect();
        assert_eq!(sizes, [2, 1]);
        let grown = VoxelSet::of(grid, [3 + 3 * 8 + 3 * 64]).grown(2);
        assert_eq!(grown.members.len(), 25, "an octahedron");
        assert_eq!(
            VoxelSet::of(grid, [0]).grown(1).members.len(),
            4,
            "a corner"
        );
    }

    #[test]
    fn distances_to_a_ball_of_voxels_are_those_to_the_ball() {
        let grid = VoxelGrid::around(Vec3::new(1.0, 2.0, 3.0), 2.0, 32);
        let radius = |p: Vec3| p.distance(Vec3::new(1.0, 2.0, 3.0));
        let ball = (0..grid.len()).filter(|voxel| radius(grid.center(*voxel)) < 1.2);
        let distances = VoxelSet::of(grid, ball).distances();
        for along in [Vec3::X, Vec3::new(-0.6, 0.8, 0.0), Vec3::splat(0.577)] {
            for true_distance in [-0.1, 0.0, 0.1] {
                let p = Vec3::new(1.0, 2.0, 3.0) + along * (1.2 + true_distance);
                let distance = distances.sample(p);
                assert!(
                    (distance - true_distance).abs() < 0.06,
                    "{along} {distance}"
                );
            }
        }
    }
}
