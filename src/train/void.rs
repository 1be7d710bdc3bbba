//! Space that is empty for good, by what the photos of a capture show of its ground.
//!
//! A few dozen photos of a room are explained as well by fog in front of each camera, and by a translucent ground with
//! something under it. What photos show of the ground says where neither can be.

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

use super::ground::Ground;
use crate::data::Dataset;
use crate::geometry::{Camera, Projector};
use crate::neif::contraction::FieldFrame;
use crate::neif::proposal::{DensityGrid, cell_index};

/// Photos that must have a place in their frames for something to be there, as far out as cameras stand: no second photo
/// says what it is, and cameras nearby would stand in it.
const SEEN_BY: usize = 2;
/// How far out that is asked, in largest distances of a camera from the object.
const REACH: f32 = 1.1;
/// Thickness of the ground, cells: what may be above the plane, and below it.
const CELLS_ABOVE: f32 = 2.0;
const CELLS_BELOW: f32 = 1.5;
/// Share of the photos with a place in their frames that the ground hides it from, for nothing to be there.
const HIDDEN: f32 = 0.9;
/// Most photos that are asked about every cell.
const MOST_CAMERAS: usize = 256;

/// Declares empty for good: the air through which photos see the ground, what the ground hides, and what hardly any photo
/// can show as far out as cameras stand.
pub(super) fn empty(
    density: &mut DensityGrid,
    dataset: &Dataset,
    frame: &FieldFrame,
    ground: &Ground,
) {
    let cell = DensityGrid::inner_cell() * frame.half_side;
    for (point, photos) in ground.sightings() {
        for photo in photos {
            let eye = dataset.train[*photo].camera.position();
            let end = 1.0 - CELLS_ABOVE * cell / ground.height(eye);
            density.hollow_cells(cells_between(frame, eye, point, end, 0.5 * cell));
        }
    }
    let views = Views::of(dataset);
    let distances = views
        .0
        .iter()
        .map(|(c, _)| c.position().distance(frame.center));
    let reach = REACH * distances.fold(0.0, f32::max);
    let is_empty = |index: &usize| {
        let p_world =
            frame.world_from_field(Vec3::from(DensityGrid::point_in_cell(*index, [0.5; 3])));
        let is_near = p_world.distance(frame.center) < reach;
        let is_deep = ground.height(p_world) < -CELLS_BELOW * cell;
        (is_near || is_deep) && {
            let (n, n_hidden) =
                views.showing(p_world, |eye| is_deep && ground.is_between(eye, p_world));
            let is_hidden = n > 0 && n_hidden as f32 >= HIDDEN * n as f32;
            is_hidden || (is_near && n < SEEN_BY)
        }
    };
    let cells: Vec<usize> = (0..density.len())
        .into_par_iter()
        .filter(is_empty)
        .collect();
    density.hollow_cells(cells);
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

/// Cameras of training photos, ready for many points; of very many photos, some.
struct Views(Vec<(Camera, Projector)>);

impl Views {
    fn of(dataset: &Dataset) -> Self {
        let stride = dataset.train.len().div_ceil(MOST_CAMERAS).max(1);
        let cameras = dataset.train.iter().step_by(stride).map(|v| v.camera);
        Self(
            cameras
                .map(|c| (c, c.projector(Affine3A::IDENTITY)))
                .collect(),
        )
    }

    /// How many photos have a place in their frames, and how many of those with an eye that `is_hidden_from`.
    fn showing(&self, p_world: Vec3, is_hidden_from: impl Fn(Vec3) -> bool) -> (usize, usize) {
        let (mut n, mut n_hidden) = (0, 0);
        for (camera, projector) in &self.0 {
            let is_inside = projector.project(p_world).is_some_and(|(pixel, _)| {
                let size = Vec2::new(camera.width as f32, camera.height as f32);
                pixel.cmpge(Vec2::ZERO).all() && pixel.cmplt(size).all()
            });
            if is_inside {
                n += 1;
                n_hidden += usize::from(is_hidden_from(camera.position()));
            }
        }
        (n, n_hidden)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::placement::field_frame;
    use crate::train::test_scene::{FLOOR, sphere_on_a_floor};

    #[test]
    fn air_and_what_is_under_the_ground_are_empty_and_the_ground_is_not() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let frame = field_frame(&dataset, 1.1);
        let ground = Ground::of(&dataset).expect("a floor");
        let mut density = DensityGrid::default();
        empty(&mut density, &dataset, &frame, &ground);
        let is_void = |x: f32, y: f32, z: f32| {
            let p = frame.field_from_world(Vec3::new(x, y, z));
            density.is_void(cell_index(p.to_array()))
        };
        for (x, y) in [(0.9, 0.0), (-0.6, 0.7), (0.1, -0.9)] {
            assert!(is_void(x, y, FLOOR + 0.3), "air over {x} {y}");
            assert!(!is_void(x, y, FLOOR), "ground at {x} {y}");
            assert!(is_void(x, y, FLOOR - 0.3), "under {x} {y}");
        }
        assert!(
            !is_void(0.0, 0.0, 40.0),
            "the sky, which the object may reflect"
        );
    }

    #[test]
    fn what_hardly_any_photo_shows_is_empty_as_far_as_cameras_stand() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let frame = field_frame(&dataset, 1.1);
        let ground = Ground::of(&dataset).expect("a floor");
        let eye = dataset.train[0].camera.position();
        let behind = frame.center + (eye - frame.center) * 1.05;
        let n_seen = |p_world: Vec3| Views::of(&dataset).showing(p_world, |_| false).0;
        assert_eq!(n_seen(behind), 0);
        assert_eq!(n_seen(frame.center), dataset.train.len());
        let mut density = DensityGrid::default();
        empty(&mut density, &dataset, &frame, &ground);
        let is_void = |p: Vec3| density.is_void(cell_index(p.to_array()));
        assert!(is_void(frame.field_from_world(behind)));
        assert!(!is_void(Vec3::splat(0.99)), "farther than any camera");
    }
}
