//! Air over a floor, where nothing is for good.
//!
//! A few dozen photos of a room are explained as well by fog in front of each camera. What they show of the floor says
//! where none can be.

use glam::Vec3;

use super::ground::SeenGround;
use crate::data::Dataset;
use crate::neif::field::cells::cell_index;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;

/// What may lie on the floor, cells.
const CELLS_ABOVE: f32 = 1.0;

/// Lays the floor where the `ground` is one, and clears the air over it.
pub(in crate::train) fn lay_floor(
    density: &mut DensityGrid,
    dataset: &Dataset,
    frame: &FieldFrame,
    ground: &SeenGround,
) {
    if ground.is_a_floor(dataset) {
        clear_air(density, dataset, frame, ground);
        density.floor = Some(ground.floor(frame));
    }
}

/// Declares the air empty for good through which photos see the floor.
fn clear_air(density: &mut DensityGrid, dataset: &Dataset, frame: &FieldFrame, floor: &SeenGround) {
    let cell = DensityGrid::inner_cell() * frame.half_side;
    for (point, photos) in floor.sightings() {
        for photo in photos {
            let eye = dataset.train[*photo].camera.position();
            let end = 1.0 - CELLS_ABOVE * cell / floor.height(eye);
            density.hollow_cells(cells_between(frame, eye, point, end, 0.5 * cell));
        }
    }
}

/// Inner cells along the first part of the way from `eye` to `point`, up to the share `end` of it; some more than once.
fn cells_between(
    frame: &FieldFrame,
    eye: Vec3,
    point: Vec3,
    end: f32,
    step: f32,
) -> impl Iterator<Item = usize> {
    let length = eye.distance(point);
    let n = (end.max(0.0) * length / step) as usize;
    (0..n).filter_map(move |k| {
        let p_world = eye.lerp(point, (k as f32 + 0.5) * step / length);
        let p = frame.field_from_world(p_world);
        (p.abs().max_element() < 1.0).then(|| cell_index(p.to_array()) as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::placement::field_frame;
    use crate::train::test_scene::{FLOOR, sphere_on_a_floor};

    fn cleared(dataset: &Dataset) -> (DensityGrid, FieldFrame) {
        let frame = field_frame(dataset, 1.1);
        let floor = SeenGround::of(dataset).expect("a floor");
        let mut density = DensityGrid::default();
        clear_air(&mut density, dataset, &frame, &floor);
        (density, frame)
    }

    #[test]
    fn the_air_is_empty_and_the_floor_is_not() {
        let (density, frame) = cleared(&sphere_on_a_floor(60, 64, |_| Vec3::ONE));
        let is_void = |x: f32, y: f32, z: f32| {
            let p = frame.field_from_world(Vec3::new(x, y, z));
            density.is_void(cell_index(p.to_array()))
        };
        for (x, y) in [(0.9, 0.0), (-0.6, 0.7), (0.1, -0.9)] {
            assert!(is_void(x, y, FLOOR + 0.3), "air over {x} {y}");
            assert!(!is_void(x, y, FLOOR), "floor at {x} {y}");
        }
        assert!(
            !is_void(0.0, 0.0, 40.0),
            "the sky, which the object may reflect"
        );
    }
}
