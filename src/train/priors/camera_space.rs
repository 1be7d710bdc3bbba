//! Air where cameras stood: nothing is there for good.
//!
//! Somebody carried a camera from one place to the next, around an object that it saw all the time. What the object mirrors of
//! the room behind the cameras may come from any distance, and what explains it from close by is fog or a wall in which the next
//! camera stands.

use glam::Vec3;
use rayon::prelude::*;

use super::some_projectors;
use crate::data::Dataset;
use crate::geometry::{ConvexSet, Projector};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;

/// Photos that must have a place in their frames for something to be there: what one alone shows may be anywhere.
const SHOWN_BY: usize = 2;
/// How far around the cameras and the object that is asked, mean distances of a camera from the middle: as far as a camera
/// stands beyond all others, within these limits.
const MARGINS: [f32; 2] = [0.1, 0.6];
/// Most photos that are asked about every cell.
const MOST_CAMERAS: usize = 256;

/// Declares empty for good what hardly any photo can show between and around the cameras and the object.
pub(in crate::train) fn clear_camera_space(
    density: &mut DensityGrid,
    dataset: &Dataset,
    frame: &FieldFrame,
) {
    let eyes = dataset.train.iter().map(|view| view.camera.position());
    let mut points: Vec<Vec3> = eyes.collect();
    let distances = points.iter().map(|eye| eye.distance(frame.center));
    let mean = distances.sum::<f32>() / points.len().max(1) as f32;
    let [least, most] = MARGINS.map(|margin| margin * mean);
    let margin = ConvexSet::outlying(&points).clamp(least, most);
    if let Some(bounds) = dataset.object_box() {
        points.extend(bounds.corners());
    }
    let space = ConvexSet::around(&points, margin);
    let photos = some_projectors(dataset, MOST_CAMERAS);
    let is_air = |index: &usize| {
        let p_field = Vec3::from(DensityGrid::point_in_cell(*index, [0.5; 3]));
        let p_world = frame.world_from_field(p_field);
        space.contains(p_world) && !is_shown(&photos, p_world)
    };
    let cells = (0..density.cells().len()).into_par_iter().filter(is_air);
    density.hollow_cells(cells.collect::<Vec<usize>>());
}

/// Whether enough photos have a place in their frames.
fn is_shown(photos: &[Projector], p_world: Vec3) -> bool {
    let showing = photos.iter().filter(|photo| photo.pixel(p_world).is_some());
    showing.take(SHOWN_BY).count() == SHOWN_BY
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::field::cells::cell_index;
    use crate::train::placement::field_frame;
    use crate::train::test_scene::sphere_on_a_floor;

    #[test]
    fn what_hardly_any_photo_shows_is_empty_where_cameras_stand_and_not_beyond() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let frame = field_frame(&dataset, 1.1);
        let mut density = DensityGrid::default();
        clear_camera_space(&mut density, &dataset, &frame);
        let eye = dataset.train[0].camera.position();
        let behind = frame.center + (eye - frame.center) * 1.05;
        let photos = some_projectors(&dataset, MOST_CAMERAS);
        assert!(!is_shown(&photos, behind));
        assert!(is_shown(&photos, frame.center));
        let is_void = |p: Vec3| density.is_void(cell_index(p.to_array()));
        assert!(is_void(frame.field_from_world(behind)));
        assert!(!is_void(frame.field_from_world(frame.center)));
        let sky = frame.field_from_world(Vec3::new(0.0, 0.0, 40.0));
        assert!(!is_void(sky), "which the object may reflect");
        assert!(!is_void(Vec3::splat(0.99)), "farther than any camera");
    }
}
