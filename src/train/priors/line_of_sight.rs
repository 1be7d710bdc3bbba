//! Air through which photos see the object: nothing is there, for good.
//!
//! A ray to the object ends on its mesh and never asks the field what is before it. Reflections do ask, and what explains
//! one of them from close by can hang between the cameras and the object: unseen until the environment is moved. A cell
//! of the density cache all of whose corners lie before the object in one photo is empty.

use glam::{Affine3A, UVec2, UVec3, Vec3};
use rayon::prelude::*;

use super::some_views;
use crate::data::{Dataset, View};
use crate::geometry::{Projector, SurfaceTracer};
use crate::neif::field::cells::INNER_SIDE;
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::density_grid::DensityGrid;

/// Most photos that are asked.
const MOST_PHOTOS: usize = 64;
/// Cells along an axis of the blocks that are looked at together, and their corners.
const BLOCK: usize = 8;
const CORNERS: usize = BLOCK + 1;

/// Declares empty for good what lies between the object and a camera that sees it.
pub(in crate::train) fn clear_lines_of_sight(
    density: &mut DensityGrid,
    dataset: &Dataset,
    frame: &FieldFrame,
    tracer: &SurfaceTracer,
) {
    let views: Vec<&View> = some_views(dataset, MOST_PHOTOS).collect();
    let cell = DensityGrid::inner_cell() * frame.half_side;
    let sight = |view: &&View| Sight::of(view, tracer, cell);
    let sights: Vec<Sight> = views.par_iter().map(sight).collect();
    let side = INNER_SIDE / BLOCK;
    let blocks = (0..side * side * side).into_par_iter();
    let cells = blocks.flat_map_iter(|i| {
        let first = place(i, side) * BLOCK as u32;
        clear_cells(&sights, frame, first)
    });
    density.hollow_cells(cells.collect::<Vec<usize>>());
}

/// How far a photo sees before it meets the object, by blocks of pixels.
struct Sight {
    projector: Projector,
    eye: Vec3,
    /// To the middle of the object's box, a unit vector.
    axis: Vec3,
    /// Squared cosine of the angle around it that the box is within; -1 where the camera may be in it.
    cos_squared: f32,
    /// Side of a block, pixels.
    block: u32,
    size: UVec2,
    /// Distance up to which everything in a block and in those around it is clear, world units; 0 beside the object.
    clear: Vec<f32>,
}

impl Sight {
    /// Blocks are about as large as a cell at the object.
    fn of(view: &View, tracer: &SurfaceTracer, cell: f32) -> Self {
        let camera = &view.camera;
        let distance = camera.position().distance(tracer.mesh().bounds().center());
        let pixel = camera.pixel_angle() * distance;
        let block = ((cell / pixel) as u32).clamp(1, camera.width.max(1));
        let size = UVec2::new(camera.width.div_ceil(block), camera.height.div_ceil(block));
        let hit = |i: u32| -> f32 {
            let at = (UVec2::new(i % size.x, i / size.x) * block + block / 2)
                .min(UVec2::new(camera.width - 1, camera.height - 1));
            let pixel = (at.y * camera.width + at.x) as usize;
            let mask = view.mask.as_ref();
            if mask.is_some_and(|mask| !mask.is_object(pixel)) {
                return 0.0;
            }
            let ray = camera.ray(at.x as f32 + 0.5, at.y as f32 + 0.5);
            let hit = tracer.intersect(&ray, 0.0, f32::INFINITY);
            hit.map_or(0.0, |hit| (hit.t - cell).max(0.0))
        };
        let hits: Vec<f32> = (0..size.x * size.y).map(hit).collect();
        let around = |i: u32| {
            let (x, y) = (i % size.x, i / size.x);
            let columns = x.saturating_sub(1)..(x + 2).min(size.x);
            let rows = y.saturating_sub(1)..(y + 2).min(size.y);
            rows.flat_map(|y| columns.clone().map(move |x| (y * size.x + x) as usize))
                .map(|i| hits[i])
                .fold(f32::INFINITY, f32::min)
        };
        let bounds = tracer.mesh().bounds();
        let sin = 0.5 * bounds.extent().length() / distance;
        Self {
            projector: camera.projector(Affine3A::IDENTITY),
            eye: camera.position(),
            axis: (bounds.center() - camera.position()) / distance,
            cos_squared: if sin < 1.0 { 1.0 - sin * sin } else { -1.0 },
            block,
            size,
            clear: (0..size.x * size.y).map(around).collect(),
        }
    }

    /// Whether a ball may reach into the cone around the object's box.
    fn may_see(&self, middle: Vec3, radius: f32) -> bool {
        if self.cos_squared < 0.0 {
            return true;
        }
        let toward = middle - self.eye;
        let along = toward.dot(self.axis);
        let across = (toward.length_squared() - along * along).max(0.0).sqrt();
        let sin = (1.0 - self.cos_squared).sqrt();
        // Its distance from the cone's side, where that is nearest; behind the tip it is further.
        across * self.cos_squared.sqrt() - along * sin <= radius
    }

    /// Whether the photo sees the object through this point.
    fn is_clear(&self, p_world: Vec3) -> bool {
        // Most points are beside the object: that is determined without projecting them.
        let toward = p_world - self.eye;
        let along = toward.dot(self.axis);
        if along * along.abs() < self.cos_squared * toward.length_squared() {
            return false;
        }
        let Some((at, distance)) = self.projector.project(p_world) else {
            return false;
        };
        if at.min_element() < 0.0 {
            return false;
        }
        let block = at.as_uvec2() / self.block;
        block.cmplt(self.size).all()
            && distance < self.clear[(block.y * self.size.x + block.x) as usize]
    }
}

/// Cells of a block, from the one at `first` on, that are clear in a photo.
fn clear_cells(sights: &[Sight], frame: &FieldFrame, first: UVec3) -> Vec<usize> {
    let corner = |at: UVec3| {
        let p_field = (first + at).as_vec3() * DensityGrid::inner_cell() - 1.0;
        frame.world_from_field(p_field)
    };
    let [lowest, highest] = [0, BLOCK as u32].map(|i| corner(UVec3::splat(i)));
    let (middle, radius) = (0.5 * (lowest + highest), 0.5 * lowest.distance(highest));
    let mut is_clear = [false; BLOCK * BLOCK * BLOCK];
    let mut corners = [false; CORNERS * CORNERS * CORNERS];
    for sight in sights.iter().filter(|sight| sight.may_see(middle, radius)) {
        if is_clear == [true; BLOCK * BLOCK * BLOCK] {
            break;
        }
        for (i, clear) in corners.iter_mut().enumerate() {
            *clear = sight.is_clear(corner(place(i, CORNERS)));
        }
        for (i, clear) in is_clear.iter_mut().enumerate() {
            let [x, y, z] = place(i, BLOCK).to_array().map(|v| v as usize);
            let lowest = (z * CORNERS + y) * CORNERS + x;
            *clear |= [0, CORNERS * CORNERS].into_iter().all(|z| {
                let at = lowest + z;
                corners[at] && corners[at + 1] && corners[at + CORNERS] && corners[at + CORNERS + 1]
            });
        }
    }
    let cell = |i: usize| {
        let [x, y, z] = (first + place(i, BLOCK)).to_array().map(|v| v as usize);
        (z * INNER_SIDE + y) * INNER_SIDE + x
    };
    let clear = is_clear.iter().enumerate().filter(|(_, clear)| **clear);
    clear.map(|(i, _)| cell(i)).collect()
}

/// Where the `i`-th of a cube with `side` an axis lies.
fn place(i: usize, side: usize) -> UVec3 {
    let [x, y, z] = [i % side, i / side % side, i / side / side].map(|v| v as u32);
    UVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neif::field::cells::cell_index;
    use crate::train::placement::field_frame;
    use crate::train::test_scene::sphere_in_a_box;

    #[test]
    fn between_a_camera_and_the_object_is_air_and_elsewhere_is_not() {
        let dataset = sphere_in_a_box(6, 64);
        let frame = field_frame(&dataset, 1.1);
        let tracer = SurfaceTracer::new(dataset.mesh.clone().expect("a mesh"));
        let mut density = DensityGrid::default();
        clear_lines_of_sight(&mut density, &dataset, &frame, &tracer);
        let is_void = |p: Vec3| density.is_void(cell_index(frame.field_from_world(p).to_array()));
        let center = tracer.mesh().bounds().center();
        let radius = 0.5 * tracer.mesh().bounds().extent().x;
        for view in &dataset.train {
            let eye = view.camera.position();
            let toward = (eye - center).normalize_or(Vec3::Z);
            assert!(is_void(
                center + toward * (radius + 0.5 * (eye.distance(center) - radius))
            ));
            let across = toward.any_orthonormal_vector();
            let beside = center + toward * radius + across * 1.3 * radius;
            let others = dataset.train.iter().any(|other| {
                let ray = center - other.camera.position();
                ray.normalize_or(Vec3::Z).dot(toward) > -0.9 && other.name != view.name
            });
            assert!(others || !is_void(beside), "beside what {} sees", view.name);
        }
        assert!(!is_void(center), "the object itself is not cleared here");
    }
}
