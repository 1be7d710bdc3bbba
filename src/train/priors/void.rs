//! Air over a floor, where nothing is for good.
//!
//! A few dozen photos of a room are explained as well by fog in front of each camera. What they show of the floor says
//! where none can be.

use glam::Vec3;
use rayon::prelude::*;

use super::ground::SeenGround;
use super::some_projectors;
use crate::data::Dataset;
use crate::geometry::Projector;
use crate::neif::field::cells::cell_index;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;

/// Photos that must have a place in their frames for something to be there, as far out as cameras stand: no second photo
/// says what it is, and cameras nearby would stand in it.
const SEEN_BY: usize = 2;
/// How far out that is asked, in largest distances of a camera from the object.
const REACH: f32 = 1.1;
/// What may lie on the floor, cells.
const CELLS_ABOVE: f32 = 1.0;
/// Most photos that are asked about every cell.
const MOST_CAMERAS: usize = 256;

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

/// Declares empty for good: the air through which photos see the floor, and what hardly any photo can show as far out as
/// cameras stand.
fn clear_air(density: &mut DensityGrid, dataset: &Dataset, frame: &FieldFrame, floor: &SeenGround) {
    let cell = DensityGrid::inner_cell() * frame.half_side;
    for (point, photos) in floor.sightings() {
        for photo in photos {
            let eye = dataset.train[*photo].camera.position();
            let end = 1.0 - CELLS_ABOVE * cell / floor.height(eye);
            density.hollow_cells(cells_between(frame, eye, point, end, 0.5 * cell));
        }
    }
    let photos = some_projectors(dataset, MOST_CAMERAS);
    let eyes = dataset.train.iter().map(|view| view.camera.position());
    let distances = eyes.map(|eye| eye.distance(frame.center));
    let reach = REACH * distances.fold(0.0, f32::max);
    let is_unseen = |index: &usize| {
        let p_field = Vec3::from(DensityGrid::point_in_cell(*index, [0.5; 3]));
        let p_world = frame.world_from_field(p_field);
        p_world.distance(frame.center) < reach && n_showing(&photos, p_world) < SEEN_BY
    };
    let cells = (0..density.cells().len()).into_par_iter().filter(is_unseen);
    density.hollow_cells(cells.collect::<Vec<usize>>());
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

/// How many photos have a place in their frames.
fn n_showing(photos: &[Projector], p_world: Vec3) -> usize {
    let shows = |photo: &&Projector| photo.pixel(p_world).is_some();
    photos.iter().filter(shows).count()
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

    #[test]
    fn what_hardly_any_photo_shows_is_empty_as_far_as_cameras_stand() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let (density, frame) = cleared(&dataset);
        let eye = dataset.train[0].camera.position();
        let behind = frame.center + (eye - frame.center) * 1.05;
        let photos = some_projectors(&dataset, MOST_CAMERAS);
        assert_eq!(n_showing(&photos, behind), 0);
        assert_eq!(n_showing(&photos, frame.center), dataset.train.len());
        let is_void = |p: Vec3| density.is_void(cell_index(p.to_array()));
        assert!(is_void(frame.field_from_world(behind)));
        assert!(!is_void(Vec3::splat(0.99)), "farther than any camera");
    }
}
