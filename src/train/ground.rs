//! The exposures of a capture's photos before training, from the ground that the object stands on: the plane through its
//! lowest point.
//!
//! Photos from all sides show the same ground, on which they can be compared. Automatic exposure follows what a photo
//! shows besides the object (a window behind it darkens everything), and no fields are needed to tell it from here.

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

use super::placement::up_direction;
use super::relative_exposures::{median, relative_log_gains};
use crate::data::{Dataset, Mask, Photo, View};
use crate::geometry::{Mesh, orthonormal_basis};

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
/// Fewest photos that tell whether a point is on the ground.
const LEAST_PHOTOS: usize = 4;
/// Most that the logarithms of a point's colours, in photos made equally bright, may be from their median, in the median.
const MOST_APART: f32 = 0.25;
/// Share of the points beside the object, within its longest side, that must look the same in most photos: an object in
/// the air, or on a spike, stands on nothing.
const LEAST_ALIKE: f32 = 0.6;

/// The logarithm of each training photo's gain a colour, of mean 0; `None` where there is no mesh, or photos do not show the
/// same around the object's foot.
pub(super) fn gains_by_ground(dataset: &Dataset) -> Option<Vec<Vec3>> {
    let mesh = dataset.mesh.as_ref()?;
    let ground = Ground::under(mesh, up_direction(dataset), dataset.train.len());
    let points: Vec<Vec3> = (0..ground.n_points()).map(|i| ground.point(i)).collect();
    let seen: Vec<Vec<Option<Vec3>>> = dataset
        .train
        .par_iter()
        .map(|view| {
            let is_above = (view.camera.position() - ground.center).dot(ground.up) > 0.0;
            let none = || vec![None; points.len()];
            if is_above {
                log_colors(view, &points)
            } else {
                none()
            }
        })
        .collect();
    let log_gains = relative_log_gains(&seen);
    let beside: Vec<usize> = (0..points.len()).filter(|i| ground.is_beside(*i)).collect();
    let is_alike = |i: &&usize| looks_alike(**i, &seen, &log_gains);
    let n_alike = beside.iter().filter(is_alike).count();
    (n_alike as f32 >= LEAST_ALIKE * beside.len() as f32).then_some(log_gains)
}

/// A square of points on the plane.
#[derive(Debug)]
struct Ground {
    /// Its middle, under the object.
    center: Vec3,
    /// Unit, away from the ground.
    up: Vec3,
    axes: [Vec3; 2],
    /// Points along each side of the square.
    side: usize,
    /// Half that side, world units.
    reach: f32,
}

impl Ground {
    /// For so many photos.
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
        }
    }

    fn n_points(&self) -> usize {
        self.side * self.side
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

/// Whether most photos show the same at a point.
fn looks_alike(point: usize, seen: &[Vec<Option<Vec3>>], log_gains: &[Vec3]) -> bool {
    let photos = seen.iter().zip(log_gains);
    let colors: Vec<Vec3> = photos
        .filter_map(|(seen, gain)| Some(seen[point]? - *gain))
        .collect();
    if colors.len() < LEAST_PHOTOS {
        return false;
    }
    let middle = median(&colors);
    let apart: Vec<Vec3> = colors.iter().map(|c| (*c - middle).abs()).collect();
    median(&apart).max_element() <= MOST_APART
}

/// The logarithms of what a photo shows at the points; `None` beside the picture, near the object, and where unusable.
fn log_colors(view: &View, points: &[Vec3]) -> Vec<Option<Vec3>> {
    let View {
        camera,
        photo,
        mask,
        ..
    } = view.within(PHOTO_SIDE);
    let (w, h) = (camera.width, camera.height);
    let projector = camera.projector(Affine3A::IDENTITY);
    let log_color = |point: &Vec3| {
        let (pixel, _) = projector.project(*point)?;
        let size = Vec2::new(w as f32, h as f32);
        let is_inside = pixel.cmpge(Vec2::ZERO).all() && pixel.cmplt(size).all();
        let (x, y) = (pixel.x as u32, pixel.y as u32);
        if !is_inside || mask.as_ref().is_some_and(|mask| is_near(mask, x, y)) {
            return None;
        }
        usable(&photo, (y * w + x) as usize).map(|color| color.map(f32::ln))
    };
    points.iter().map(log_color).collect()
}

/// Whether there is some of the object around a pixel.
fn is_near(mask: &Mask, x: u32, y: u32) -> bool {
    let around = |at: u32, n: u32| at.saturating_sub(HALO)..(at + HALO + 1).min(n);
    around(y, mask.height).any(|y| {
        let mut columns = around(x, mask.width);
        columns.any(|x| mask.coverage[(y * mask.width + x) as usize] > 0)
    })
}

fn usable(photo: &Photo, i: usize) -> Option<Vec3> {
    let color = photo.linear(i);
    let is_usable = |v: &f32| *v >= USABLE.start && (photo.is_linear_hdr() || *v < USABLE.end);
    color.iter().all(is_usable).then(|| Vec3::from(color))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_scene::{sphere_in_a_box, sphere_on_a_floor};

    #[test]
    fn exposures_are_read_off_the_ground() {
        let log_gain = |i: usize| {
            let turn = 2.0 * i as f32;
            0.5 * Vec3::new(turn.sin(), turn.cos(), (1.3 * turn).sin())
        };
        let dataset = sphere_on_a_floor(60, 64, |i| log_gain(i).exp());
        let found = gains_by_ground(&dataset).expect("a floor");
        let n = dataset.train.len();
        assert_eq!(found.len(), n);
        let mean = (0..n).map(log_gain).sum::<Vec3>() / n as f32;
        for (i, found) in found.iter().enumerate() {
            let apart = (*found - (log_gain(i) - mean)).abs().max_element();
            assert!(
                apart < 0.05,
                "photo {i}: {found}, not {}",
                log_gain(i) - mean
            );
        }
    }

    #[test]
    fn what_hangs_in_the_air_stands_on_nothing() {
        assert!(gains_by_ground(&sphere_in_a_box(60, 64)).is_none());
    }

    #[test]
    fn very_many_photos_are_compared_on_fewer_points() {
        let mesh = sphere_in_a_box(2, 4).mesh.expect("a sphere");
        let side = |n_photos: usize| Ground::under(&mesh, Vec3::Z, n_photos).side;
        assert_eq!([side(1), side(100)], [SIDE, SIDE]);
        assert!(side(10_000).pow(2) * 10_000 <= MOST_COLORS);
    }
}
