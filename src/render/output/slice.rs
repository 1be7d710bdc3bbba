//! A plane cut through the environment: how dense the field is there.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::neif::Environment;
use crate::neif::field::cells::cell_index;
use crate::neif::field::contraction::{contract, unit_cube};
use crate::neif::field::floor::Floor;
use crate::neif::field::radiance_field::FieldBatch;
use crate::neif::light::environment::EnvironmentField;
use crate::render::diagnostic::logarithmic_share;

/// Densities per field unit at both ends of the colours.
pub const DENSITY_RANGE: [f32; 2] = [0.1, 1000.0];

/// Where the plane lies in the field's inner box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlicePlane {
    /// The axis across the plane: 0, 1 or 2 for x, y or z.
    pub axis: usize,
    /// Place along it, 0 to 1 from one side of the inner box to the other.
    pub share: f32,
}

impl SlicePlane {
    /// The axes of the picture: to the right and up.
    pub fn picture_axes(&self) -> [usize; 2] {
        match self.axis {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        }
    }

    /// The point of the inner box's `[-1, 1]³` at a place of the picture, both 0 to 1 from its left top.
    fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let [right, up] = self.picture_axes();
        let mut point = [2.0 * self.share.clamp(0.0, 1.0) - 1.0; 3];
        point[right] = 2.0 * x - 1.0;
        point[up] = 1.0 - 2.0 * y;
        point
    }
}

/// Densities on a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct DensitySlice {
    /// Pixels a side.
    pub side: usize,
    /// `[side * side]` densities per field unit from the left top; NaN inside the object and under a floor, where nothing can be.
    pub densities: Vec<f32>,
}

/// The density of the environment on a plane of `side` by `side` points; `None` when cancelled, and for an environment
/// without a density: the paper's own, and an infinitely far one.
pub fn density_slice(
    environment: &Environment,
    plane: SlicePlane,
    side: usize,
    cancel: &AtomicBool,
) -> Option<DensitySlice> {
    let EnvironmentField::Grid { field, density } = environment.field() else {
        return None;
    };
    if environment.is_far() {
        return None;
    }
    let (mut batch, mut scratch) = (FieldBatch::default(), Vec::new());
    let mut densities = Vec::with_capacity(side * side);
    for row in 0..side {
        if cancel.load(Ordering::Relaxed) {
            return None;
        }
        let place = |i: usize| (i as f32 + 0.5) / side as f32;
        let points: Vec<[f32; 3]> = (0..side).map(|i| plane.at(place(i), place(row))).collect();
        let in_cube: Vec<_> = points
            .iter()
            .map(|x| (unit_cube(contract(*x).0), 0.0))
            .collect();
        let values = field.densities(&mut batch, &in_cube, &mut scratch);
        densities.extend(points.iter().zip(values).map(|(point, value)| {
            let is_below = |floor: Floor| floor.height(*point) < 0.0;
            if density.is_void(cell_index(*point)) || density.floor.is_some_and(is_below) {
                f32::NAN
            } else {
                value
            }
        }));
    }
    Some(DensitySlice { side, densities })
}

/// Place of a density in [`DENSITY_RANGE`] by its logarithm, 0 to 1.
pub fn density_share(density: f32) -> f32 {
    logarithmic_share(density, DENSITY_RANGE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::{NEVER, environment, environment_over_a_floor};

    #[test]
    fn a_slice_is_finite_outside_the_object_and_moves_with_its_plane() {
        let slice_of = |axis, share, side| {
            let plane = SlicePlane { axis, share };
            density_slice(&environment(3), plane, side, &NEVER).expect("a grid has a density")
        };
        let slice = |axis, share| slice_of(axis, share, 12);
        let middle = slice(2, 0.5);
        assert!(middle.densities.iter().all(|d| d.is_finite() && *d >= 0.0));
        assert_ne!(middle, slice(2, 0.9));
        assert_ne!(middle, slice(0, 0.5));
        // The middle lines of two planes are the same line of the field, seen the same way round.
        let (x, y) = (slice_of(0, 0.5, 11), slice_of(1, 0.5, 11));
        let column =
            |s: &DensitySlice| -> Vec<f32> { (0..11).map(|r| s.densities[r * 11 + 5]).collect() };
        assert_eq!(column(&x), column(&y), "the z axis through the centre");
    }

    #[test]
    fn under_a_floor_nothing_can_be() {
        let plane = SlicePlane {
            axis: 0,
            share: 0.5,
        };
        let over_a_floor = environment_over_a_floor(3);
        let slice = density_slice(&over_a_floor, plane, 8, &NEVER).expect("a slice");
        let free = density_slice(&environment(3), plane, 8, &NEVER).expect("a slice");
        let pairs = slice.densities.iter().zip(&free.densities);
        let below = pairs.clone().filter(|(d, _)| d.is_nan()).count();
        assert!((8..56).contains(&below), "{below} of 64 below it");
        assert!(pairs.into_iter().all(|(d, free)| d.is_nan() || d == free));
    }

    #[test]
    fn an_environment_without_density_has_no_slice() {
        use crate::neif::distant::{DistantConfig, DistantLight};
        let config = DistantConfig {
            width: 16,
            height: 8,
            world_from_picture: glam::Quat::IDENTITY,
            has_floor: false,
        };
        let light = DistantLight::new(config, &[0.5; 16 * 8 * 3]).expect("a picture");
        let sky = Environment::of_distant("sky".to_owned(), glam::Vec3::Z, light);
        let plane = SlicePlane {
            axis: 2,
            share: 0.5,
        };
        assert!(density_slice(&sky, plane, 4, &NEVER).is_none());
    }
}
