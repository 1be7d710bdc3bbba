//! What the photos show of the ground that the object stands on: the plane through its lowest point.
//!
//! Photos from all sides show the same ground, on which they can be compared. Automatic exposure follows what a photo
//! shows besides the object (a window behind it darkens everything), and no fields are needed to estimate it from the
//! ground.

use glam::{Affine3A, UVec2, Vec2, Vec3};
use rayon::prelude::*;

use crate::data::{Dataset, Mask, View};
use crate::geometry::{Mesh, orthonormal_basis};
use crate::neif::field::contraction::FieldFrame;
use crate::neif::field::floor::Floor;
use crate::train::photos::relative_exposures::{pairs_at_points, relative_log_gains};
use crate::train::placement::up_direction;
use crate::train::statistics::median;

/// The longer side of the photos that are compared, pixels: coarser than cameras and ground are wrong, and than what
/// the ground is woven of.
const PHOTO_SIDE: u32 = 100;
/// Points of the ground along each side of the square that is compared, and along those of captures with very many photos.
const SIDE: usize = 160;
const LEAST_SIDE: usize = 32;
/// Points times photos that are kept in memory, about.
const MOST_COLORS: usize = 16_000_000;
/// Half the side of the square, in the object's longest side.
const REACH: f32 = 4.0;
/// Linear values of 8-bit photos that are neither noise nor clipped.
const USABLE: std::ops::Range<f32> = 0.002..0.9;
/// Pixels around the object that show some of it.
const HALO: u32 = 2;
/// Fewest photos that determine whether a point is on the ground.
const LEAST_PHOTOS: usize = 4;
/// Most that the logarithms of a point's colours, in photos made equally bright, may be from their median, in the median.
const MOST_APART: f32 = 0.25;
/// Share of the points beside the object, within its longest side, that must look the same in most photos: an object in
/// the air, or on a spike, stands on nothing.
const LEAST_ALIKE: f32 = 0.6;

/// Most that the logarithm of one photo's colour may be from that median, for the photo to show the ground there.
const MOST_APART_ALONE: f32 = 0.5;
/// Share of the photos that are taken from over the ground, for it to be a floor: who photographs what stands on a table
/// stands beside it.
const LEAST_OVER: f32 = 0.3;
/// Points on each side of one whose majority decides whether there is ground.
const AROUND: usize = 2;

/// A square of points on the plane, and the photos that show it.
#[derive(Debug)]
pub(in crate::train) struct SeenGround {
    /// Its middle, under the object.
    center: Vec3,
    /// Unit, away from the ground.
    up: Vec3,
    axes: [Vec3; 2],
    /// Points along each side of the square.
    side: usize,
    /// Half that side, world units.
    reach: f32,
    /// The logarithm of each training photo's gain a colour, of mean 0.
    log_gains: Vec<Vec3>,
    /// `[side * side]`: the photos that show the ground here; none where most differ.
    shown_in: Vec<Vec<usize>>,
}

impl SeenGround {
    /// The ground of a capture; `None` where there is no mesh, or photos do not show the same around the object's foot.
    pub(in crate::train) fn of(dataset: &Dataset) -> Option<Self> {
        let mesh = dataset.mesh.as_ref()?;
        let mut ground = Self::under(mesh, up_direction(dataset), dataset.train.len());
        let n_points = ground.side * ground.side;
        let points: Vec<Vec3> = (0..n_points).map(|i| ground.point(i)).collect();
        let colors = |view: &View| {
            if ground.height(view.camera.position()) > 0.0 {
                log_colors(view, &points)
            } else {
                vec![None; n_points]
            }
        };
        let seen: Vec<Vec<Option<Vec3>>> = dataset.train.par_iter().map(colors).collect();
        let log_gains = relative_log_gains(seen.len(), &pairs_at_points(&seen));
        let shown_in = |i| photos_alike(i, &seen, &log_gains);
        ground.shown_in = (0..n_points).into_par_iter().map(shown_in).collect();
        ground.log_gains = log_gains;
        let beside = || (0..n_points).filter(|i| ground.is_beside(*i));
        let n_alike = beside().filter(|i| !ground.shown_in[*i].is_empty()).count();
        let is_there = n_alike as f32 >= LEAST_ALIKE * beside().count() as f32;
        is_there.then_some(ground)
    }

    /// The plane alone, for so many photos.
    fn under(mesh: &Mesh, up: Vec3, n_photos: usize) -> Self {
        let affordable = (MOST_COLORS / n_photos.max(1)).isqrt();
        let heights = mesh.positions.iter().map(|p| p.dot(up));
        let lowest = heights.fold(f32::INFINITY, f32::min);
        let bounds = mesh.bounds();
        let (x_axis, y_axis) = orthonormal_basis(up);
        Self {
            center: bounds.center() + (lowest - bounds.center().dot(up)) * up,
            up,
            axes: [x_axis, y_axis],
            side: affordable.clamp(LEAST_SIDE, SIDE),
            reach: REACH * bounds.extent().max_element(),
            log_gains: Vec::new(),
            shown_in: Vec::new(),
        }
    }

    /// The logarithm of each training photo's gain a colour, of mean 0.
    pub(in crate::train) fn log_gains(&self) -> &[Vec3] {
        &self.log_gains
    }

    /// It as a floor of the field.
    pub(in crate::train) fn floor(&self, frame: &FieldFrame) -> Floor {
        Floor::new(frame.field_from_world(self.center), self.up)
    }

    /// Height of a world point above it; negative below.
    pub(in crate::train) fn height(&self, p_world: Vec3) -> f32 {
        (p_world - self.center).dot(self.up)
    }

    /// The points, each with the photos that show the ground there.
    pub(super) fn sightings(&self) -> impl Iterator<Item = (Vec3, &[usize])> {
        let photos = self.shown_in.iter().enumerate();
        photos.map(|(i, photos)| (self.point(i), photos.as_slice()))
    }

    /// Whether the photographer walked on it: then it goes on, and there is nothing to see below it.
    pub(super) fn is_a_floor(&self, dataset: &Dataset) -> bool {
        let cameras = dataset.train.iter().map(|view| view.camera.position());
        let n_over = cameras.filter(|eye| self.is_below(*eye)).count();
        n_over as f32 >= LEAST_OVER * dataset.train.len() as f32
    }

    /// Whether photos show ground straight below a point.
    fn is_below(&self, p_world: Vec3) -> bool {
        let [x, y] = self.axes.map(|axis| {
            let along = (p_world - self.center).dot(axis) / self.reach;
            ((along + 1.0) * 0.5 * self.side as f32).floor()
        });
        let is_inside = [x, y].iter().all(|i| (0.0..self.side as f32).contains(i));
        let around =
            |i: f32| (i as usize).saturating_sub(AROUND)..(i as usize + AROUND + 1).min(self.side);
        let points = || around(y).flat_map(|y| around(x).map(move |x| y * self.side + x));
        let n_alike = || points().filter(|i| !self.shown_in[*i].is_empty()).count();
        self.height(p_world) > 0.0 && is_inside && 2 * n_alike() > points().count()
    }

    /// The `i`-th point, world.
    fn point(&self, i: usize) -> Vec3 {
        let p = self.place(i);
        self.center + p.x * self.axes[0] + p.y * self.axes[1]
    }

    /// The same, from the middle along the axes.
    fn place(&self, i: usize) -> Vec2 {
        let at = |i: usize| ((i as f32 + 0.5) / self.side as f32 * 2.0 - 1.0) * self.reach;
        Vec2::new(at(i % self.side), at(i / self.side))
    }

    /// Whether the object is near.
    fn is_beside(&self, i: usize) -> bool {
        self.place(i).length() < self.reach / REACH
    }
}

/// The photos that show what most do at a point; none where most differ, or there are too few.
fn photos_alike(point: usize, seen: &[Vec<Option<Vec3>>], log_gains: &[Vec3]) -> Vec<usize> {
    let shown = seen.iter().zip(log_gains).enumerate();
    let (photos, colors): (Vec<usize>, Vec<Vec3>) = shown
        .filter_map(|(photo, (seen, gain))| Some((photo, seen[point]? - *gain)))
        .unzip();
    if photos.len() < LEAST_PHOTOS {
        return Vec::new();
    }
    let middle = median(&colors);
    let apart: Vec<Vec3> = colors.iter().map(|c| (*c - middle).abs()).collect();
    if median(&apart).max_element() > MOST_APART {
        return Vec::new();
    }
    let pairs = photos.into_iter().zip(apart);
    let near = pairs.filter(|(_, apart)| apart.max_element() <= MOST_APART_ALONE);
    near.map(|(photo, _)| photo).collect()
}

/// The logarithms of what a photo shows at the points; `None` beside the picture, near the object, and where unusable.
fn log_colors(view: &View, points: &[Vec3]) -> Vec<Option<Vec3>> {
    let view = view.within(PHOTO_SIDE);
    let projector = view.camera.projector(Affine3A::IDENTITY);
    let at_point = |point: &Vec3| log_color(&view, projector.pixel(*point)?);
    points.iter().map(at_point).collect()
}

/// The logarithm of a pixel's colour; `None` near the object, and where it is noise or clipped.
fn log_color(view: &View, pixel: UVec2) -> Option<Vec3> {
    if view.mask.as_ref().is_some_and(|mask| is_near(mask, pixel)) {
        return None;
    }
    let index = pixel.y * view.camera.width + pixel.x;
    let color = view.photo.linear(index as usize);
    let is_usable = |v: &f32| *v >= USABLE.start && (view.photo.is_linear_hdr() || *v < USABLE.end);
    let is_usable = color.iter().all(is_usable);
    is_usable.then(|| Vec3::from(color).map(f32::ln))
}

/// Whether there is some of the object around a pixel.
fn is_near(mask: &Mask, pixel: UVec2) -> bool {
    let around = |at: u32, n: u32| at.saturating_sub(HALO)..(at + HALO + 1).min(n);
    around(pixel.y, mask.height).any(|y| {
        let mut columns = around(pixel.x, mask.width);
        columns.any(|x| mask.coverage[(y * mask.width + x) as usize] > 0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_scene::{FLOOR, sphere_in_a_box, sphere_on_a_floor};

    #[test]
    fn exposures_are_read_off_the_ground() {
        let log_gain = |i: usize| {
            let turn = 2.0 * i as f32;
            0.5 * Vec3::new(turn.sin(), turn.cos(), (1.3 * turn).sin())
        };
        let dataset = sphere_on_a_floor(60, 64, |i| log_gain(i).exp());
        let ground = SeenGround::of(&dataset).expect("a floor");
        let found = ground.log_gains();
        let n = dataset.train.len();
        assert_eq!(found.len(), n);
        let mean = (0..n).map(log_gain).sum::<Vec3>() / n as f32;
        for (i, found) in found.iter().enumerate() {
            let apart = (*found - (log_gain(i) - mean)).abs().max_element();
            assert!(apart < 0.05, "photo {i}: {found}, off by {apart}");
        }
    }

    #[test]
    fn what_hangs_in_the_air_stands_on_nothing() {
        assert!(SeenGround::of(&sphere_in_a_box(60, 64)).is_none());
    }

    #[test]
    fn a_floor_is_what_photos_are_taken_over() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let ground = SeenGround::of(&dataset).expect("a floor");
        assert!(ground.is_a_floor(&dataset));
        assert!((ground.height(Vec3::new(3.0, 2.0, 1.0)) - (1.0 - FLOOR)).abs() < 0.01);
        let (point, photos) = ground.sightings().max_by_key(|s| s.1.len()).unwrap();
        assert!(photos.len() > 10, "{} photos at {point}", photos.len());
        let mut distant = dataset;
        for view in &mut distant.train {
            view.camera.world_from_camera.translation.x += 50.0;
        }
        assert!(!ground.is_a_floor(&distant), "they stand beside it");
    }

    #[test]
    fn very_many_photos_are_compared_on_fewer_points() {
        let mesh = sphere_in_a_box(2, 4).mesh.expect("a sphere");
        let side = |n_photos: usize| SeenGround::under(&mesh, Vec3::Z, n_photos).side;
        assert_eq!([side(1), side(100)], [SIDE, SIDE]);
        assert!(side(10_000).pow(2) * 10_000 <= MOST_COLORS);
    }
}
