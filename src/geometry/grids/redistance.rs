//! Makes a grid of numbers a grid of distances to its own zero surface.

use rayon::prelude::*;

use crate::geometry::ScalarGrid;

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
        let rows = self.rows_within(reach, &near);
        for pass in 0..8 {
            self.sweep(pass, &rows, &mut distance);
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
        let differs = |other: usize| (self.values[other] < 0.0) != (value < 0.0);
        let mut others = self.neighbours(node).into_iter().flatten().flatten();
        if !others.any(differs) {
            return None;
        }
        let slope = self.gradient_at(self.place(node)).length().max(1e-3);
        // No node beside the surface is further from it than the cell is long.
        Some((value / slope).clamp(-self.cell, self.cell))
    }

    /// The nodes that may be nearer than `reach` cells, row by row, without those beside the surface.
    fn rows_within(&self, reach: f32, near: &[Option<f32>]) -> Rows {
        let mut is_reached: Vec<bool> = near.iter().map(Option::is_some).collect();
        let mut front: Vec<usize> = (0..near.len()).filter(|node| is_reached[*node]).collect();
        // From one node to the next along an axis the distance grows by a cell over the root of three at least.
        for _ in 0..(reach * 3.0_f32.sqrt()).ceil() as usize {
            let mut next = Vec::new();
            for node in front {
                for other in self.neighbours(node).into_iter().flatten().flatten() {
                    if !std::mem::replace(&mut is_reached[other], true) {
                        next.push(other);
                    }
                }
            }
            front = next;
        }
        let mut rows = Rows::default();
        for (row, is_reached) in is_reached.chunks(self.size[0]).enumerate() {
            rows.starts.push(rows.nodes.len());
            let nodes = row * self.size[0]..;
            let reached = nodes.zip(is_reached).filter(|(_, is_reached)| **is_reached);
            let reached = reached.map(|(node, _)| node);
            rows.nodes
                .extend(reached.filter(|node| near[*node].is_none()));
        }
        rows.starts.push(rows.nodes.len());
        rows
    }

    /// One Gauss–Seidel pass over `rows`; the bits of `pass` say along which axes it goes backward.
    fn sweep(&self, pass: usize, rows: &Rows, distance: &mut [f32]) {
        let [_, ny, nz] = self.size;
        let is_backward = |axis: usize| (pass >> axis) & 1 == 1;
        let turn = |i: usize, n: usize, axis: usize| if is_backward(axis) { n - 1 - i } else { i };
        let mut update = |node: usize| {
            let lowest = self.neighbours(node).map(|pair| {
                let pair = pair.into_iter().flatten().map(|other| distance[other]);
                pair.fold(f32::INFINITY, f32::min)
            });
            distance[node] = distance[node].min(eikonal(lowest, self.cell));
        };
        for k in 0..nz {
            for j in 0..ny {
                let row = turn(j, ny, 1) + ny * turn(k, nz, 2);
                let nodes = rows.nodes[rows.starts[row]..rows.starts[row + 1]].iter();
                if is_backward(0) {
                    nodes.rev().for_each(|node| update(*node));
                } else {
                    nodes.for_each(|node| update(*node));
                }
            }
        }
    }
}

/// Some nodes of a grid, in order.
#[derive(Debug, Default)]
struct Rows {
    nodes: Vec<usize>,
    /// Where in `nodes` those of each row along x start; one more than there are rows.
    starts: Vec<usize>,
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::Aabb;

    /// A ball and a block that touch the grid's end, with values that are no distances.
    fn grid() -> ScalarGrid {
        let bounds = Aabb {
            min: Vec3::splat(-1.0),
            max: Vec3::new(1.0, 0.8, 0.9),
        };
        let mut grid = ScalarGrid::over(&bounds, 40, 0.0);
        for node in 0..grid.values.len() {
            let p = grid.position(grid.place(node));
            let ball = p.distance(Vec3::new(-0.3, 0.1, 0.0)) - 0.5;
            let block = (p - Vec3::new(0.9, 0.5, 0.6)).abs().max_element() - 0.25;
            grid.values[node] = 3.0 * ball.min(block);
        }
        grid
    }

    #[test]
    fn distances_are_those_of_a_ball() {
        let mut grid = grid();
        grid.redistance(5.0);
        for node in 0..grid.values.len() {
            let p = grid.position(grid.place(node));
            let ball = p.distance(Vec3::new(-0.3, 0.1, 0.0)) - 0.5;
            let is_alone = p.x < 0.2;
            if is_alone && ball.abs() < 4.0 * grid.cell {
                let error = (grid.values[node] - ball).abs() / grid.cell;
                assert!(error < 0.25, "{error} cells at {p}");
            }
        }
    }

    #[test]
    fn nodes_out_of_reach_change_nothing() {
        let (mut near, mut all) = (grid(), grid());
        let limit = 5.0 * near.cell;
        near.redistance(5.0);
        all.redistance(1e4);
        for (near, all) in near.values.iter().zip(&all.values) {
            assert_eq!(*near, all.clamp(-limit, limit));
        }
    }
}
