//! A regular grid of numbers, such as signed distances to a surface (negative inside).

use glam::Vec3;

use crate::geometry::{Aabb, Ray};

/// Steps along a ray.
const MAX_STEPS: usize = 512;

/// Numbers at the nodes of a regular grid with cubic cells; linear between them.
#[derive(Clone, Debug)]
pub struct ScalarGrid {
    /// The first node, world.
    pub origin: Vec3,
    /// Side of a cell, scene units.
    pub cell: f32,
    /// Nodes along x, y, z; at least 2 each.
    pub size: [usize; 3],
    /// `[size z][size y][size x]` values.
    pub values: Vec<f32>,
}

/// The nodes around a point with their shares in the value there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners {
    /// Indices into [`ScalarGrid::values`]; bit 0, 1, 2 of the place chooses the next node in x, y, z.
    pub nodes: [usize; 8],
    /// Weights that sum to one.
    pub weights: [f32; 8],
}

impl Corners {
    /// The gradients of the weights, per cell.
    pub fn slopes(&self) -> [Vec3; 8] {
        // The share of the next node along an axis is the sum of the weights on that side.
        let share = |axis: usize| -> f32 {
            (0..8)
                .filter(|i| (i >> axis) & 1 == 1)
                .map(|i| self.weights[i])
                .sum()
        };
        let shares = [share(0), share(1), share(2)];
        std::array::from_fn(|i| {
            let is_next = |axis: usize| (i >> axis) & 1 == 1;
            let along = |axis: usize| {
                if is_next(axis) {
                    shares[axis]
                } else {
                    1.0 - shares[axis]
                }
            };
            let sign = |axis: usize| if is_next(axis) { 1.0 } else { -1.0 };
            Vec3::new(
                sign(0) * along(1) * along(2),
                sign(1) * along(0) * along(2),
                sign(2) * along(0) * along(1),
            )
        })
    }
}

impl ScalarGrid {
    /// A grid of one value over `bounds`, `n_cells` along its longest side.
    pub fn over(bounds: &Aabb, n_cells: usize, value: f32) -> Self {
        let extent = bounds.extent();
        let cell = (extent.max_element() / n_cells.max(1) as f32).max(f32::MIN_POSITIVE);
        let nodes = |side: f32| (side / cell - 1e-3).ceil().max(1.0) as usize + 1;
        let size = [nodes(extent.x), nodes(extent.y), nodes(extent.z)];
        Self {
            origin: bounds.min,
            cell,
            size,
            values: vec![value; size.iter().product()],
        }
    }

    /// Steps of the index from a node to the next in x, y and z.
    #[inline]
    pub fn strides(&self) -> [usize; 3] {
        [1, self.size[0], self.size[0] * self.size[1]]
    }

    /// The place of a node along x, y, z.
    #[inline]
    pub fn place(&self, node: usize) -> [usize; 3] {
        let row = node / self.size[0];
        [node % self.size[0], row % self.size[1], row / self.size[1]]
    }

    /// The neighbours of a node along x, y, z: the ones before and after it, where there are any.
    #[inline]
    pub fn neighbours(&self, node: usize) -> [[Option<usize>; 2]; 3] {
        let (place, strides) = (self.place(node), self.strides());
        std::array::from_fn(|axis| {
            let has_next = place[axis] + 1 < self.size[axis];
            [
                (place[axis] > 0).then(|| node - strides[axis]),
                has_next.then(|| node + strides[axis]),
            ]
        })
    }

    /// Where a node lies, world.
    #[inline]
    pub fn position(&self, [x, y, z]: [usize; 3]) -> Vec3 {
        self.origin + self.cell * Vec3::new(x as f32, y as f32, z as f32)
    }

    /// The box from the first node to the last.
    pub fn bounds(&self) -> Aabb {
        Aabb {
            min: self.origin,
            max: self.position(self.size.map(|n| n - 1)),
        }
    }

    /// The nodes around `p`; points outside the grid are moved to its border.
    #[inline]
    pub fn corners(&self, p: Vec3) -> Corners {
        let at = (p - self.origin) / self.cell;
        let axis = |at: f32, n: usize| {
            let at = at.clamp(0.0, (n - 1) as f32);
            let first = (at as usize).min(n - 2);
            (first, at - first as f32)
        };
        let (x, u) = axis(at.x, self.size[0]);
        let (y, v) = axis(at.y, self.size[1]);
        let (z, w) = axis(at.z, self.size[2]);
        let [sx, sy, sz] = self.strides();
        let first = x + y * sy + z * sz;
        let share = |t: f32, next: usize| if next == 1 { t } else { 1.0 - t };
        let bits = |i: usize| [i & 1, (i >> 1) & 1, i >> 2];
        Corners {
            nodes: std::array::from_fn(|i| {
                let [a, b, c] = bits(i);
                first + a * sx + b * sy + c * sz
            }),
            weights: std::array::from_fn(|i| {
                let [a, b, c] = bits(i);
                share(u, a) * share(v, b) * share(w, c)
            }),
        }
    }

    /// The value at `p`.
    #[inline]
    pub fn sample(&self, p: Vec3) -> f32 {
        let corners = self.corners(p);
        let terms = corners.nodes.iter().zip(corners.weights);
        terms
            .map(|(node, weight)| weight * self.values[*node])
            .sum()
    }

    /// Where the ray first meets values that are not positive; the grid holds distances to a surface, negative inside.
    pub fn entered_by(&self, ray: &Ray) -> Option<Vec3> {
        let (mut t, end) = self.bounds().span(ray)?;
        for _ in 0..MAX_STEPS {
            if t >= end {
                break;
            }
            let value = self.sample(ray.at(t));
            if value <= 0.0 {
                // Back to where it was zero, as far as the distance is true.
                return Some(ray.at(t + value));
            }
            t += (0.8 * value).max(0.25 * self.cell);
        }
        None
    }

    /// The gradient at a node by differences of its neighbours, per scene unit.
    #[inline]
    pub fn gradient_at(&self, place: [usize; 3]) -> Vec3 {
        let strides = self.strides();
        let node = place[0] + place[1] * strides[1] + place[2] * strides[2];
        let slope = |axis: usize| {
            let before = usize::from(place[axis] > 0);
            let after = usize::from(place[axis] + 1 < self.size[axis]);
            let difference = self.values[node + after * strides[axis]]
                - self.values[node - before * strides[axis]];
            difference / ((before + after) as f32 * self.cell)
        };
        Vec3::new(slope(0), slope(1), slope(2))
    }

    /// The gradient at `p`, linear between those of the nodes, per scene unit.
    #[inline]
    pub fn gradient(&self, p: Vec3) -> Vec3 {
        let corners = self.corners(p);
        let terms = corners.nodes.iter().zip(corners.weights);
        terms
            .map(|(node, weight)| weight * self.gradient_at(self.place(*node)))
            .sum()
    }
}
