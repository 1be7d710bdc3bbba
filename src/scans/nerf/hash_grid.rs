//! Features of points from grids of several resolutions, whose corners share a table (arXiv:2201.05989).
//!
//! Two programs number the corners differently: tiny-cuda-nn (`include/tiny-cuda-nn/encodings/grid.h`, `common_device.h`)
//! shifts each level by half a cell and leaves coarse levels dense, nerfstudio's own code (`HashEncoding`) does neither.

use glam::Vec3;

/// The primes of `coherent_prime_hash`; the first is 1.
const PRIMES: [u32; 2] = [2_654_435_761, 805_459_861];
/// Resolution above which a level is never dense: its cube overflows.
const MAX_DENSE_RESOLUTION: u32 = 0x659;

/// How the table of a level that is too fine for it is shared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sharing {
    /// Corners are spread by a hash.
    Hash,
    /// There is a place for each.
    Dense,
    /// The grid repeats.
    Tiled,
}

/// What a grid looks like.
#[derive(Clone, Copy, Debug)]
pub(super) struct GridShape {
    pub(super) n_levels: u32,
    pub(super) n_features_per_level: usize,
    pub(super) log2_table: u32,
    pub(super) base_resolution: u32,
    pub(super) per_level_scale: f32,
    pub(super) sharing: Sharing,
    pub(super) is_smooth: bool,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    /// Cells along a side of the unit cube.
    scale: f32,
    /// What is added to a position in cells.
    shift: f32,
    /// Corners along a side.
    resolution: u32,
    /// Index of the first corner in the table.
    first: usize,
    /// Corners in the table.
    n: u32,
    is_hashed: bool,
}

/// A grid and its features.
#[derive(Clone, Debug)]
pub(super) struct HashGrid {
    levels: Vec<Level>,
    n_features_per_level: usize,
    is_smooth: bool,
    /// `[corners of all levels][n_features_per_level]`.
    table: Vec<f32>,
}

impl GridShape {
    /// The levels as tiny-cuda-nn lays them out.
    fn levels(&self) -> Vec<Level> {
        let log2_scale = self.per_level_scale.log2();
        let mut first = 0;
        let level = |i: u32| {
            // The base resolution counts corners, not cells.
            let scale = (i as f32 * log2_scale).exp2() * self.base_resolution as f32 - 1.0;
            let resolution = (scale.ceil() as u32).saturating_add(1);
            let most = u64::from(u32::MAX / 2);
            let n_dense = u64::from(resolution).saturating_pow(3).min(most);
            let n_dense = (n_dense as u32).next_multiple_of(8);
            let n = match self.sharing {
                Sharing::Hash => n_dense.min(1 << self.log2_table),
                Sharing::Dense => n_dense,
                Sharing::Tiled => n_dense.min(self.base_resolution.saturating_pow(3)),
            };
            let stride = if resolution <= MAX_DENSE_RESOLUTION {
                resolution.pow(3)
            } else {
                u32::MAX
            };
            let level = Level {
                scale,
                shift: 0.5,
                resolution,
                first,
                n: n.max(1),
                is_hashed: self.sharing == Sharing::Hash && n < stride,
            };
            first += level.n as usize;
            level
        };
        (0..self.n_levels).map(level).collect()
    }

    /// Features at each point.
    pub(super) fn n_out(&self) -> usize {
        self.n_levels as usize * self.n_features_per_level
    }

    /// Numbers in tiny-cuda-nn's table.
    pub(super) fn n_params(&self) -> usize {
        let n = self
            .levels()
            .iter()
            .map(|level| level.n as usize)
            .sum::<usize>();
        n * self.n_features_per_level
    }
}

impl HashGrid {
    /// As tiny-cuda-nn stores it, with [`GridShape::n_params`] numbers.
    pub(super) fn of_tcnn(shape: &GridShape, table: Vec<f32>) -> Self {
        assert_eq!(table.len(), shape.n_params(), "the whole table");
        Self {
            levels: shape.levels(),
            n_features_per_level: shape.n_features_per_level,
            is_smooth: shape.is_smooth,
            table,
        }
    }

    /// As nerfstudio's own code stores it: every level hashed, `2^log2_table` corners each.
    pub(super) fn of_nerfstudio(shape: &GridShape, table: Vec<f32>) -> Self {
        let n = 1_u32 << shape.log2_table;
        let n_numbers = n as usize * shape.n_out();
        assert_eq!(table.len(), n_numbers, "the whole table");
        let levels = (0..shape.n_levels).map(|i| {
            // In single precision as there: whether the last is 2048 or 2047 hangs on it.
            let growth = shape.per_level_scale.powf(i as f32);
            let scale = (shape.base_resolution as f32 * growth).floor();
            Level {
                scale,
                shift: 0.0,
                resolution: scale as u32,
                first: i as usize * n as usize,
                n,
                is_hashed: true,
            }
        });
        Self {
            levels: levels.collect(),
            n_features_per_level: shape.n_features_per_level,
            is_smooth: false,
            table,
        }
    }

    pub(super) fn n_out(&self) -> usize {
        self.levels.len() * self.n_features_per_level
    }

    /// Features `[n][n_out]` of points in the unit cube.
    pub(super) fn encode(&self, points: &[Vec3], features: &mut Vec<f32>) {
        features.clear();
        features.resize(points.len() * self.n_out(), 0.0);
        match self.n_features_per_level {
            1 => self.encode_levels::<1>(points, features),
            2 => self.encode_levels::<2>(points, features),
            4 => self.encode_levels::<4>(points, features),
            _ => self.encode_levels::<8>(points, features),
        }
    }

    fn encode_levels<const F: usize>(&self, points: &[Vec3], features: &mut [f32]) {
        let n_out = self.n_out();
        let (table, _) = self.table.as_chunks::<F>();
        // Level by level, so that one level's part of the table is in the cache.
        for (l, level) in self.levels.iter().enumerate() {
            let table = &table[level.first..][..level.n as usize];
            for (point, row) in points.iter().zip(features.chunks_exact_mut(n_out)) {
                let sums = level.interpolate(table, *point, self.is_smooth);
                row[l * F..(l + 1) * F].copy_from_slice(&sums);
            }
        }
    }
}

impl Level {
    #[inline]
    fn interpolate<const F: usize>(
        &self,
        table: &[[f32; F]],
        p: Vec3,
        is_smooth: bool,
    ) -> [f32; F] {
        let at = p * self.scale + self.shift;
        // Not below zero, so that cutting off is rounding down, which takes a call without newer instructions.
        let low = at.as_uvec3();
        let mut to = at - low.as_vec3();
        if is_smooth {
            to = to * to * (3.0 - 2.0 * to);
        }
        let from = 1.0 - to;
        let (x, y, z) = if self.is_hashed {
            (1, PRIMES[0], PRIMES[1])
        } else {
            (
                1,
                self.resolution,
                self.resolution.wrapping_mul(self.resolution),
            )
        };
        let xs = [low.x, low.x.wrapping_add(1)].map(|i| i.wrapping_mul(x));
        let ys = [low.y, low.y.wrapping_add(1)].map(|i| i.wrapping_mul(y));
        let zs = [low.z, low.z.wrapping_add(1)].map(|i| i.wrapping_mul(z));
        let (wx, wy, wz) = ([from.x, to.x], [from.y, to.y], [from.z, to.z]);
        let mut sums = [0.0; F];
        for corner in 0..8 {
            let (i, j, k) = (corner & 1, corner >> 1 & 1, corner >> 2);
            let index = if self.is_hashed {
                xs[i] ^ ys[j] ^ zs[k]
            } else {
                xs[i].wrapping_add(ys[j]).wrapping_add(zs[k])
            };
            let weight = wx[i] * wy[j] * wz[k];
            let corner = &table[self.place(index)];
            for f in 0..F {
                sums[f] += weight * corner[f];
            }
        }
        sums
    }

    /// `index % n`, without a division where there is another way.
    #[inline]
    fn place(&self, index: u32) -> usize {
        let place = if self.n.is_power_of_two() {
            index & (self.n - 1)
        } else if index < self.n {
            index
        } else {
            index % self.n
        };
        place as usize
    }
}
