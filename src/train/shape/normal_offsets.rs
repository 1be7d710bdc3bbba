//! Corrections of a mesh's normals, learned with everything else.
//!
//! A mirror doubles the error of its normal, and a mesh made of outlines alone has ripples of a degree and no fine relief. A
//! correction is a small vector in the tangent plane, the plain sum over the levels of a grid around the object: coarse
//! levels learn what many pixels agree on, fine ones the rest.

use glam::Vec3;
use rayon::prelude::*;

use crate::data::files::tensor_file::TensorFile;
use crate::geometry::{Aabb, Mesh};
use crate::neif::kernels::math::all_finite;
use crate::neif::networks::hash_grid::{
    FEATURES, FeatureColumns, GridConfig, Level, SamplePoints, encode_level, scatter_level,
};
use crate::train::TrainError;
use crate::train::photos::picture_shift::SAMPLING_PX;
use crate::train::statistics::share_beyond;
use crate::train::step::part::{finite, insert};

/// The grid, in a cube around the object. A mesh of outlines has 144 cells along its longest side.
const GRID: GridConfig = GridConfig {
    n_levels: 8,
    coarsest: 6,
    finest: 144,
    log2_table_size: 16,
    least_weight: 0.0,
};
/// Cells of further levels, and the size of their tables, for photos that show finer relief.
const FINER: [u32; 2] = [227, 357];
const LOG2_FINER_TABLE: u32 = 18;
/// Pixels that a cell is wide at least.
const CELL_PX: f32 = 1.6;
/// Of the running means of gradient and squared gradient.
const BETA1: f32 = 0.95;
const BETA2: f32 = 0.99;
/// By how much further a value moves at first, and the updates after which that is halved: relief is steep, and is to be there
/// before roughness stands for it.
const HASTE: f32 = 9.0;
const HASTY_UPDATES: f32 = 300.0;
/// Strength of the pull towards the mesh's own normals: a pixel's squared error (sRGB, summed over the colours) that is
/// worth a correction of one radian. What hardly shows, as on rough and diffuse surfaces, is left to the mesh. It is for
/// meshes of exact outlines: the square of the ripples of others grows as that of the outlines' error.
const PULL: f32 = 3.0;
/// Length of a level's correction from which on the pull grows no further, as of a Cauchy distribution: ripples of a mesh are small
/// everywhere, relief is large where there is some.
const RELIEF: f32 = 0.01;
/// Gradient below which a value moves less than the rate, of a pixel's squared error by radians.
const LEAST_GRADIENT: f32 = 0.005;

/// The corrections of one object's normals.
#[derive(Debug)]
pub(in crate::train) struct NormalOffsets {
    corner: Vec3,
    side: f32,
    pull: f32,
    tables: Vec<LevelTable>,
}

/// One level: `[n_entries][4]` each.
#[derive(Debug)]
struct LevelTable {
    level: Level,
    /// All that was ever learned, which is pulled towards 0, and the number of updates.
    total: Vec<f32>,
    /// What was learned since the pixels were traced, which their normals lack; the fourth is 0.
    recent: Vec<f32>,
    /// Zero between steps; the fourth is the weight of the pixels that touched the entry.
    gradient: Vec<f32>,
    /// Running means of the gradient and of its squared length.
    moments: Vec<f32>,
}

/// Working memory for one batch of points.
#[derive(Debug, Default)]
pub(in crate::train) struct OffsetBatch {
    positions: Vec<[f32; 3]>,
    footprints: Vec<f32>,
    level: Vec<f32>,
    /// Result of [`NormalOffsets::evaluate`], `[n][4]`.
    values: Vec<f32>,
    /// The gradient by it.
    d_values: Vec<f32>,
}

impl NormalOffsets {
    /// No correction anywhere in the cube around `bounds`, of a mesh of outlines that err by `outline_error_px` pixels, of width
    /// `pixel` at the object, scene units.
    pub(in crate::train) fn new(bounds: &Aabb, outline_error_px: f32, pixel: f32) -> Self {
        // A margin, so that the rim of the cube is never needed.
        let side = 1.05 * bounds.extent().max_element();
        let is_seen = |cells: &u32| side / *cells as f32 >= CELL_PX * pixel;
        let finer = |cells: u32| GridConfig {
            n_levels: 1,
            coarsest: cells,
            finest: cells,
            log2_table_size: LOG2_FINER_TABLE,
            ..GRID
        };
        let finer = FINER.into_iter().filter(is_seen).map(finer);
        let levels = std::iter::once(GRID)
            .chain(finer)
            .flat_map(|grid| grid.levels());
        Self {
            corner: bounds.center() - Vec3::splat(0.5 * side),
            side,
            pull: PULL / (1.0 + (outline_error_px / SAMPLING_PX).powi(2)),
            tables: levels.map(LevelTable::new).collect(),
        }
    }

    /// The mesh has taken them up and is another, but for relief that is finer than its cells and stays as it was.
    pub(super) fn restart(&mut self) {
        let (taken_up, finer) = self.tables.split_at_mut(GRID.n_levels);
        for table in taken_up {
            for values in [&mut table.total, &mut table.moments, &mut table.recent] {
                values.fill(0.0);
            }
        }
        for table in finer {
            table.recent.copy_from_slice(&table.total);
            // The fourth of a total counts its updates.
            for recent in table.recent.as_chunks_mut::<FEATURES>().0 {
                recent[FEATURES - 1] = 0.0;
            }
        }
    }

    /// The pixels were traced anew, on a mesh that has all that was learned.
    pub(super) fn forget_recent(&mut self) {
        for table in &mut self.tables {
            table.recent.fill(0.0);
        }
    }

    /// Evaluates what was learned since the last tracing at `points`, world coordinates.
    pub(in crate::train) fn evaluate(
        &self,
        points: impl Iterator<Item = Vec3>,
        batch: &mut OffsetBatch,
    ) {
        batch.positions.clear();
        batch
            .positions
            .extend(points.map(|p| ((p - self.corner) / self.side).to_array()));
        let n = batch.positions.len();
        batch.footprints.clear();
        batch.footprints.resize(n, 0.0);
        for values in [&mut batch.values, &mut batch.d_values] {
            values.clear();
            values.resize(n * FEATURES, 0.0);
        }
        batch.level.resize(n * FEATURES, 0.0);
        for table in &self.tables {
            let at = SamplePoints {
                positions: &batch.positions,
                footprints: &batch.footprints,
            };
            encode_level(&table.level, &table.recent, at, &mut batch.level);
            for (sum, value) in batch.values.iter_mut().zip(&batch.level) {
                *sum += value;
            }
        }
    }

    /// The mesh that the pixels were traced on, with what was learned since.
    pub(super) fn applied_to(&self, traced: &Mesh) -> Mesh {
        const BLOCK: usize = 4096;
        let mut normals = traced.normals.clone();
        normals
            .par_chunks_mut(BLOCK)
            .zip(traced.positions.par_chunks(BLOCK))
            .for_each_init(OffsetBatch::default, |batch, (normals, positions)| {
                self.evaluate(positions.iter().copied(), batch);
                for (i, normal) in normals.iter_mut().enumerate() {
                    *normal = batch.corrected(i, *normal);
                }
            });
        Mesh {
            normals,
            ..traced.clone()
        }
    }

    /// Adds the batches' gradients.
    pub(super) fn gather(&mut self, batches: &[&OffsetBatch]) {
        self.tables.par_iter_mut().rev().for_each(|table| {
            for batch in batches {
                table.scatter(batch);
            }
        });
    }

    /// One step from what was gathered of `n_pixels` drawn pixels; `rate` in radians, of values that were updated often.
    pub(super) fn update(&mut self, rate: f32, n_pixels: usize) {
        let epsilon = LEAST_GRADIENT / n_pixels.max(1) as f32;
        let pull = self.pull;
        let tables = self.tables.par_iter_mut().rev();
        tables.for_each(|table| table.update(rate, epsilon, pull));
    }
}

/// Arrays of a checkpoint, level by level: what was learned in all, and the moments.
const TOTAL: &str = "normals.total";
const MOMENTS: &str = "normals.moments";

impl NormalOffsets {
    /// Adds them to a checkpoint.
    pub(super) fn store(&self, file: &mut TensorFile) {
        let all = |of: fn(&LevelTable) -> &[f32]| self.tables.iter().map(of).collect::<Vec<_>>();
        insert(file, TOTAL, &all(|t| &t.total).concat());
        insert(file, MOMENTS, &all(|t| &t.moments).concat());
    }

    /// Goes on from there with a mesh that has all that was learned.
    pub(super) fn restore(&mut self, file: &TensorFile) -> Result<(), TrainError> {
        let n = self.tables.iter().map(|table| table.total.len()).sum();
        let [total, moments] = [finite(file, TOTAL, n)?, finite(file, MOMENTS, n)?];
        let mut start = 0;
        for table in &mut self.tables {
            let range = start..start + table.total.len();
            start = range.end;
            table.total.copy_from_slice(&total[range.clone()]);
            table.moments.copy_from_slice(&moments[range]);
        }
        self.forget_recent();
        Ok(())
    }
}

impl LevelTable {
    fn new(level: Level) -> Self {
        let zero = vec![0.0; level.n_entries * FEATURES];
        Self {
            level,
            total: zero.clone(),
            recent: zero.clone(),
            gradient: zero.clone(),
            moments: zero,
        }
    }

    fn scatter(&mut self, batch: &OffsetBatch) {
        let at = SamplePoints {
            positions: &batch.positions,
            footprints: &batch.footprints,
        };
        let layout = FeatureColumns {
            stride: FEATURES,
            column: 0,
        };
        scatter_level(&self.level, at, &batch.d_values, layout, &mut self.gradient);
    }

    /// A step of Adam (Kingma and Ba, arXiv:1412.6980) with one second moment an entry, so that it does not matter how the
    /// axes lie, as far as its mean gradient is more than chance: Adam's steps are as long where pixels disagree, and a
    /// mirror shows them as ripples. What no pixel touched is left alone.
    fn update(&mut self, rate: f32, epsilon: f32, pull: f32) {
        let totals = self.total.as_chunks_mut::<FEATURES>().0.iter_mut();
        let entries = totals
            .zip(self.recent.as_chunks_mut::<FEATURES>().0)
            .zip(self.gradient.as_chunks_mut::<FEATURES>().0)
            .zip(self.moments.as_chunks_mut::<FEATURES>().0);
        for (((total, recent), gradient), moments) in entries {
            if *gradient == [0.0; FEATURES] {
                continue;
            }
            total[3] += 1.0;
            let n_updates = total[3];
            let unbias = [BETA1, BETA2].map(|beta| 1.0 - beta.powf(n_updates));
            let weight = gradient[3];
            let length_squared: f32 = total[..3].iter().map(|v| v * v).sum();
            let pull = pull / (1.0 + length_squared / (RELIEF * RELIEF));
            let mut square = 0.0;
            for k in 0..3 {
                let d = gradient[k] + weight * pull * total[k];
                moments[k] += (1.0 - BETA1) * (d - moments[k]);
                square += d * d;
            }
            moments[3] += (1.0 - BETA2) * (square - moments[3]);
            let mean_square = moments[3] / unbias[1];
            let square_mean = moments[..3].iter().map(|m| m * m).sum::<f32>() / unbias[0].powi(2);
            // What chance alone leaves of the mean of gradients that know of no direction.
            let chance = (1.0 - BETA1) / (1.0 + BETA1) * (2.0 - unbias[0]) / unbias[0];
            let sure = share_beyond(square_mean, chance * mean_square);
            let rate = rate * (1.0 + HASTE / (1.0 + n_updates / HASTY_UPDATES));
            let share = sure * rate / (unbias[0] * (mean_square.sqrt() + epsilon));
            for k in 0..3 {
                let step = share * moments[k];
                total[k] -= step;
                recent[k] -= step;
            }
            gradient.fill(0.0);
        }
    }
}

impl OffsetBatch {
    /// The unit normal at point `i`, which was `normal`.
    pub(in crate::train) fn corrected(&self, i: usize, normal: Vec3) -> Vec3 {
        let offset = Vec3::from_slice(&self.values[i * FEATURES..]);
        (normal + offset - normal * normal.dot(offset)).normalize_or(normal)
    }

    /// Whether its gradient is.
    pub(in crate::train) fn is_finite(&self) -> bool {
        all_finite(&self.d_values)
    }

    /// Adds to the gradient by the correction of point `i`, from so large a share of a step's pixels.
    pub(in crate::train) fn add(&mut self, i: usize, d: Vec3, share: f32) {
        let d = [d.x, d.y, d.z, share];
        for (sum, d) in self.d_values[i * FEATURES..].iter_mut().zip(d) {
            *sum += d;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::random::SlotRandom;

    /// Of the normals in a cube of side 2.
    fn in_a_cube(error_px: f32, pixel: f32) -> NormalOffsets {
        let (min, max) = (-Vec3::ONE, Vec3::ONE);
        NormalOffsets::new(&Aabb { min, max }, error_px, pixel)
    }

    /// The correction at a place after `n` steps of that rate, by `gradient` of it from so large a share of the pixels.
    fn learned(
        offsets: &mut NormalOffsets,
        (n, rate, share): (usize, f32, f32),
        mut gradient: impl FnMut(Vec3) -> Vec3,
    ) -> Vec3 {
        let mut batch = OffsetBatch::default();
        let value = |offsets: &NormalOffsets, batch: &mut OffsetBatch| {
            offsets.evaluate(std::iter::once(Vec3::splat(0.1)), batch);
            Vec3::from_slice(&batch.values)
        };
        for _ in 0..n {
            let value = value(offsets, &mut batch);
            batch.add(0, gradient(value), share);
            offsets.gather(&[&batch]);
            offsets.update(rate, 1);
        }
        value(offsets, &mut batch)
    }

    #[test]
    fn relief_finer_than_the_mesh_outlives_its_moves() {
        let around_a_move = |pixel: f32| {
            let mut offsets = in_a_cube(0.0, pixel);
            let before = learned(&mut offsets, (10, 1e-3, 1.0), |_| Vec3::X).x;
            offsets.restart();
            (before, learned(&mut offsets, (0, 0.0, 0.0), |v| v).x)
        };
        let (before, after) = around_a_move(0.1);
        assert!(before < 0.0 && after == 0.0, "{before} became {after}");
        let (before, after) = around_a_move(0.002);
        let share = after / before;
        // Two of ten levels, less at a point between their corners.
        assert!((0.05..0.4).contains(&share), "{before} became {after}");
    }

    /// What becomes of a correction that pixels ask for with as much force as the pull at an exact mesh, as its share.
    fn corrected(wanted: f32, error_px: f32) -> f32 {
        let force = PULL / GRID.n_levels as f32;
        let gradient = |value: Vec3| force * (value - wanted * Vec3::X);
        learned(&mut in_a_cube(error_px, 0.1), (3000, 1e-4, 1.0), gradient).x / wanted
    }

    #[test]
    fn meshes_of_uncertain_outlines_are_corrected_further() {
        let [exact, uncertain] = [0.0, 1.2].map(|error_px| corrected(0.01, error_px));
        assert!((exact - 0.5).abs() < 0.05, "{exact}");
        assert!((uncertain - 0.93).abs() < 0.05, "{uncertain}");
    }

    #[test]
    fn pixels_that_disagree_bend_nothing() {
        let moved = |sign: &mut dyn FnMut() -> f32| {
            let gradient = |_| sign() * Vec3::X;
            learned(&mut in_a_cube(0.0, 0.1), (200, 1e-3, 1e-3), gradient)
                .x
                .abs()
        };
        let mut random = SlotRandom::new(1, 0, 0);
        let agreeing = moved(&mut || 1.0);
        let disagreeing = moved(&mut || if random.uniform() < 0.5 { -1.0 } else { 1.0 });
        let share = disagreeing / agreeing;
        assert!(share < 0.02, "{disagreeing} beside {agreeing}");
    }

    #[test]
    fn relief_is_hardly_pulled_back() {
        let steep = corrected(0.4, 0.0);
        assert!(steep > 0.9, "{steep}");
    }
}
