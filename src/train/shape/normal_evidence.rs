//! How sure the normals are that the photos ask for.
//!
//! A pixel whose light changes fast as its normal turns says a lot of it, unless the pixel is wrong all the same: then
//! something else is, its place or what it mirrors. By as much as a normal would have to turn to explain the error, it may
//! itself be wrong: `deviation² = mean error² / mean slope²`, as in least squares of one unknown.

use glam::Vec3;

use crate::geometry::{Aabb, ScalarGrid};

/// Cells along the longest side of the object in which pixels are taken together.
const N_CELLS: usize = 48;
/// Squared error of a pixel that noise alone explains, sRGB, summed over the colours.
const NOISE: f32 = 1e-4;
/// Squared slope that says nothing, sRGB a radian.
const FLAT: f32 = 1e-2;

/// What one pixel says of the normal at a place.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct NormalRow {
    /// The place, world.
    pub(in crate::train) position: Vec3,
    /// Squared error of the pixel, sRGB, summed over the colours.
    pub(in crate::train) error: f32,
    /// Squared slope of what it shows by the normal, sRGB a radian, summed over the colours and both directions.
    pub(in crate::train) slope: f32,
}

/// Sums over the pixels that showed a place since they were last traced.
#[derive(Clone, Debug)]
pub(in crate::train) struct NormalEvidence {
    /// Of errors, of slopes, and of pixels.
    sums: [ScalarGrid; 3],
}

impl NormalEvidence {
    /// Nothing is known in the box.
    pub(in crate::train) fn new(bounds: &Aabb) -> Self {
        Self {
            sums: std::array::from_fn(|_| ScalarGrid::over(bounds, N_CELLS, 0.0)),
        }
    }

    /// Takes up what pixels say; what is not finite says nothing.
    pub(in crate::train) fn add<'a>(&mut self, rows: impl Iterator<Item = &'a NormalRow>) {
        for row in rows.filter(|row| (row.error + row.slope).is_finite()) {
            let corners = self.sums[0].corners(row.position);
            for (node, weight) in corners.nodes.iter().zip(corners.weights) {
                for (sum, value) in self.sums.iter_mut().zip([row.error, row.slope, 1.0]) {
                    sum.values[*node] += weight * value;
                }
            }
        }
    }

    /// Standard deviation of the normals at `p`, radians; infinite where no pixel has shown it.
    pub(in crate::train) fn deviation(&self, p: Vec3) -> f32 {
        let [_, slope, count] = self.sums.each_ref().map(|sum| sum.sample(p));
        if count <= 0.0 {
            return f32::INFINITY;
        }
        ((NOISE + self.error(p)) / (FLAT + slope / count)).sqrt()
    }

    /// Mean squared error of the pixels that have shown `p`, 0 where none has.
    pub(in crate::train) fn error(&self, p: Vec3) -> f32 {
        let [error, _, count] = self.sums.each_ref().map(|sum| sum.sample(p));
        error / count.max(f32::MIN_POSITIVE)
    }

    /// Forgets all: the surface is another.
    pub(in crate::train) fn clear(&mut self) {
        for sum in &mut self.sums {
            sum.values.fill(0.0);
        }
    }

    /// The sums.
    pub(in crate::train) fn state(&self) -> [&[f32]; 3] {
        self.sums.each_ref().map(|sum| sum.values.as_slice())
    }

    /// Goes on from sums as long as those of [`Self::state`].
    pub(in crate::train) fn set_state(&mut self, state: [&[f32]; 3]) {
        for (sum, values) in self.sums.iter_mut().zip(state) {
            sum.values.copy_from_slice(values);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_as_sure_as_pixels_are_right_and_steep() {
        let [min, max] = [Vec3::ZERO, Vec3::ONE];
        let bounds = Aabb { min, max };
        let mut evidence = NormalEvidence::new(&bounds);
        let [mirror, matt, unseen] = [0.2, 0.5, 0.8].map(Vec3::splat);
        assert_eq!(evidence.deviation(mirror), f32::INFINITY);
        let row = |position, error, slope| NormalRow {
            position,
            error,
            slope,
        };
        // By 0.02 radians a mirror explains its errors, by 0.5 a matt surface.
        let rows = [0.5, 1.5].map(|share| row(mirror, share * 0.0036 - NOISE, 9.0 - FLAT));
        evidence.add(rows.iter());
        evidence.add([row(matt, 0.01 - NOISE, 0.04 - FLAT)].iter());
        for (place, deviation) in [(mirror, 0.02), (matt, 0.5)] {
            let found = evidence.deviation(place);
            assert!((found - deviation).abs() < 0.01 * deviation, "{found}");
        }
        assert_eq!(evidence.deviation(unseen), f32::INFINITY);
        evidence.add([row(unseen, f32::NAN, 1.0), row(unseen, 0.1, f32::INFINITY)].iter());
        assert_eq!(evidence.deviation(unseen), f32::INFINITY);
        let mut other = NormalEvidence::new(&bounds);
        other.set_state(evidence.state());
        assert_eq!(other.deviation(mirror), evidence.deviation(mirror));
        evidence.clear();
        assert_eq!(evidence.deviation(mirror), f32::INFINITY);
    }
}
