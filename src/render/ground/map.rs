//! Values on a square, with coarser levels for blurred looks and for filling gaps.

use std::iter::successors;

use glam::{Vec2, Vec4};

/// Four values at each of `side` x `side` points, and their means over 2 x 2, 4 x 4, ... of them.
#[derive(Clone, Debug)]
pub(super) struct Map {
    /// Fine to coarse.
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    side: usize,
    values: Vec<Vec4>,
}

impl Map {
    /// `values`: `side * side`, row by row.
    pub(super) fn new(side: usize, values: Vec<Vec4>) -> Self {
        assert_eq!(values.len(), side * side, "a value each point");
        let finest = Level { side, values };
        Self {
            levels: successors(Some(finest), Level::halved).collect(),
        }
    }

    /// The map of values that are known in part: `known[i]` in `[0, 1]`. What is not known comes from around it.
    pub(super) fn filled(side: usize, values: &[Vec4], known: &[f32]) -> Self {
        let weighted = |weights: &dyn Fn(usize) -> Vec4| {
            Self::new(side, (0..values.len()).map(weights).collect())
        };
        let sums = weighted(&|i| values[i] * known[i]);
        let weights = weighted(&|i| Vec4::splat(known[i]));
        // From coarse to fine: each level keeps what it knows and takes the rest from the one above.
        let mut above: Option<Level> = None;
        for (sum, weight) in sums.levels.iter().zip(&weights.levels).rev() {
            let side = sum.side;
            let mut level = Level {
                side,
                values: Vec::with_capacity(side * side),
            };
            for i in 0..side * side {
                let share = weight.values[i].x;
                let known = sum.values[i] / share.max(1e-6);
                let share = (share * 2.0).min(1.0);
                let place = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
                let rest = above
                    .as_ref()
                    .map_or(known, |above| above.between(place * 2.0 - 1.0));
                level.values.push(rest + (known - rest) * share);
            }
            above = Some(level);
        }
        let finest = above.map_or_else(Vec::new, |level| level.values);
        Self::new(side, finest)
    }

    /// The value at a place in `[-1, 1]²`, blurred by `blur` points (standard deviation).
    pub(super) fn at(&self, place: Vec2, blur: f32) -> Vec4 {
        // A box of 2^k points has a deviation of 0.29 · 2^k, and interpolation adds 0.41 · 2^k.
        let level = (2.0 * blur).max(1.0).log2().min(16.0) as usize;
        self.levels[level.min(self.levels.len() - 1)].between(place)
    }
}

impl Level {
    /// Means over 2 x 2 points; `None` when there is but one. An odd row at the end is left out.
    fn halved(&self) -> Option<Self> {
        let side = self.side / 2;
        let at = |x: usize, y: usize| self.values[y * self.side + x];
        (side > 0).then(|| Self {
            side,
            values: (0..side * side)
                .map(|i| {
                    let (x, y) = (2 * (i % side), 2 * (i / side));
                    0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
                })
                .collect(),
        })
    }

    /// Bilinear; beyond the rim as on it.
    fn between(&self, place: Vec2) -> Vec4 {
        let last = (self.side - 1) as f32;
        let at =
            ((place * 0.5 + 0.5) * self.side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
        let (x, y) = (at.x as usize, at.y as usize);
        let (right, down) = ((x + 1).min(self.side - 1), (y + 1).min(self.side - 1));
        let share = at - at.floor();
        let row = |y: usize| {
            let (a, b) = (
                self.values[y * self.side + x],
                self.values[y * self.side + right],
            );
            a + (b - a) * share.x
        };
        row(y) + (row(down) - row(y)) * share.y
    }
}
