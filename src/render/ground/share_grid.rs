//! Shares of light in a cube of cells, with coarser levels for blurred looks.

use std::iter::successors;

use glam::{IVec3, Vec3, Vec4};

use super::look::Share;
use super::sight::Sight;
use super::smoothstep;
use super::surfaces::Surfaces;

/// Share of the half side from which shares fade to 1.
const FADE_FROM: f32 = 0.8;
/// Share of a ray's light below which a sample counts for nothing.
const LEAST_WEIGHT: f32 = 1e-3;

/// The share of its light that an object leaves each patch of the surfaces around it, and means over 2 x 2 x 2, 4 x 4 x
/// 4, ... cells.
#[derive(Clone, Debug)]
pub(super) struct ShareGrid {
    /// What it is the share of.
    pub(super) surfaces: Surfaces,
    /// Fine to coarse.
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    side: usize,
    /// Share times weight, and the weight: 0 without a patch.
    values: Vec<Vec4>,
}

impl ShareGrid {
    /// `shares`: of each patch.
    pub(super) fn new(surfaces: Surfaces, shares: &[Share]) -> Self {
        let side = surfaces.cells.side;
        let mut values = vec![Vec4::ZERO; side.pow(3)];
        for (patch, share) in surfaces.patches.iter().zip(shares) {
            values[patch.cell] = share.light.extend(1.0);
        }
        let finest = Level { side, values };
        let levels = successors(Some(finest), Level::halved).collect();
        Self { surfaces, levels }
    }

    /// The mean share over the light of a ray, where `at` makes something of the share at a point.
    pub(super) fn along(&self, sight: &Sight<'_>, at: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let mut mean = Vec3::ONE;
        let cells = &self.surfaces.cells;
        let Some(inside) = sight.within(cells.center, cells.half_side) else {
            return mean;
        };
        for (distance, weight) in sight.samples() {
            if weight > LEAST_WEIGHT
                && inside.contains(&distance)
                && let Some(point) = self.surfaces.met(sight, distance)
            {
                mean += weight * (at(self.at(point, sight.blur(point))) - 1.0);
            }
        }
        mean
    }

    /// The share at a point of a surface, blurred by `blur` (standard deviation, field units); 1 away from surfaces.
    pub(super) fn at(&self, point: Vec3, blur: f32) -> Vec3 {
        let cells = &self.surfaces.cells;
        let from_middle = point.distance(cells.center) / cells.half_side;
        let fade = 1.0 - smoothstep(FADE_FROM, 1.0, from_middle);
        if fade == 0.0 {
            return Vec3::ONE;
        }
        // A box of 2^k cells has a deviation of 0.29 · 2^k, and interpolation adds 0.41 · 2^k.
        let level = (2.0 * blur / cells.size()).max(1.0).log2().min(16.0) as usize;
        let level = level.min(self.levels.len() - 1);
        let value = self.levels[level].between(cells.place(point) / (1 << level) as f32);
        if value.w < 1e-4 {
            return Vec3::ONE;
        }
        Vec3::ONE.lerp(value.truncate() / value.w, fade)
    }
}

impl Level {
    /// Means over 2 x 2 x 2 cells; `None` when there is but one.
    fn halved(&self) -> Option<Self> {
        if self.side == 1 {
            return None;
        }
        let side = self.side.div_ceil(2);
        let mut values = vec![Vec4::ZERO; side.pow(3)];
        for (i, value) in self.values.iter().enumerate() {
            let (x, y, z) = (
                i % self.side,
                i / self.side % self.side,
                i / self.side / self.side,
            );
            values[x / 2 + side * (y / 2 + side * (z / 2))] += *value / 8.0;
        }
        Some(Self { side, values })
    }

    /// Trilinear; nothing lies outside.
    fn between(&self, place: Vec3) -> Vec4 {
        let low = (place - 0.5).floor();
        let share = place - 0.5 - low;
        let (low, side) = (low.as_ivec3(), self.side as i32);
        let mut sum = Vec4::ZERO;
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let at = low + step;
            if at.cmplt(IVec3::ZERO).any() || at.cmpge(IVec3::splat(side)).any() {
                continue;
            }
            let far = step.as_vec3();
            let weights = far * share + (1.0 - far) * (1.0 - share);
            let index = (at.x + side * (at.y + side * at.z)) as usize;
            sum += self.values[index] * weights.element_product();
        }
        sum
    }
}
