//! Makes a grid of numbers a grid of distances to its own zero surface.

use rayon::prelude::*;

use super::ScalarGrid;

impl ScalarGrid {
    /// The same zero surface with true distances, up to `reach` cells from it; beyond, the sign
    /// with the distance `reach`.
    ///
    /// Nodes beside the surface get their value over its slope; the rest by fast sweeping (Zhao
    /// 2005).
    pub fn redistance(&mut self, reach: f32) {
        let limit = reach * self.cell;
        let source = &*self;
        let near: Vec<Option<f32>> = (0..self.values.len())
            .into_par_iter()
            .map(|node| source.distance_beside(node))
            .collect();
        let mut distance: Vec<f32> = near.iter().map(|d| d.map_or(limit, f32::abs)).collect();
        for pass in 0..8 {
            self.sweep(pass, &near, &mut distance);
        }
        for (node, value) in self.values.iter_mut().enumerate() {
            *value = match near[node] {
                Some(exact) => exact,
                None => distance[node].min(limit).copysign(*value),
            };
        }
    }

    /// The signed distance of a node beside the surface; `None` for others.
    fn distance_beside(&self, node: usize) -> Option<f32> {
        let value = self.values[node];
        let place = self.place(node);
        let strides = self.strides();
        let is_beside = (0..3).any(|axis| {
            let differs = |other: usize| (self.values[other] < 0.0) != (value < 0.0);
            (place[axis] > 0 && differs(node - strides[axis]))
                || (place[axis] + 1 < self.size[axis] && differs(node + strides[axis]))
        });
        if !is_beside {
            return None;
        }
        let slope = self.gradient_at(place).length().max(1e-3);
        // No node beside the surface is further from it than the cell is long.
        Some((value / slope).clamp(-self.cell, self.cell))
    }

    /// One Gauss–Seidel pass; the bits of `pass` say along which axes it goes backward.
    fn sweep(&self, pass: usize, near: &[Option<f32>], distance: &mut [f32]) {
        let [nx, ny, nz] = self.size;
        let strides = self.strides();
        let turn = |i: usize, n: usize, axis: usize| {
            if (pass >> axis) & 1 == 1 {
                n - 1 - i
            } else {
                i
            }
        };
        for k in 0..nz {
            let z = turn(k, nz, 2);
            for j in 0..ny {
                let y = turn(j, ny, 1);
                for i in 0..nx {
                    let place = [turn(i, nx, 0), y, z];
                    let node = place[0] + y * strides[1] + z * strides[2];
                    if near[node].is_some() {
                        continue;
                    }
                    let lowest = std::array::from_fn(|axis| {
                        let has_next = place[axis] + 1 < self.size[axis];
                        let before = (place[axis] > 0).then(|| distance[node - strides[axis]]);
                        let after = has_next.then(|| distance[node + strides[axis]]);
                        before
                            .unwrap_or(f32::INFINITY)
                            .min(after.unwrap_or(f32::INFINITY))
                    });
                    distance[node] = distance[node].min(eikonal(lowest, self.cell));
                }
            }
        }
    }
}

/// The distance at a node from the nearest of its neighbours' along each axis: the solution of
/// `sum max(d - a_i, 0)^2 = cell^2`.
fn eikonal(mut a: [f32; 3], cell: f32) -> f32 {
    a.sort_unstable_by(f32::total_cmp);
    let one = a[0] + cell;
    if one <= a[1] {
        return one;
    }
    let apart = a[0] - a[1];
    let two = 0.5 * (a[0] + a[1] + (2.0 * cell * cell - apart * apart).max(0.0).sqrt());
    if two <= a[2] {
        return two;
    }
    let sum = a[0] + a[1] + a[2];
    let squares = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    let root = (sum * sum - 3.0 * (squares - cell * cell)).max(0.0).sqrt();
    (sum + root) / 3.0
}
