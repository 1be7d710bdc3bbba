//! Where exactly a floor lies: the plane on which photos agree in detail.
//!
//! Taken from the mesh's lowest point and the capture's idea of up, a floor is off by a hundredth of the object and by most
//! of a degree: some pixels, as much as what it is woven of.

use glam::{Affine3A, UVec2, Vec3};
use rayon::prelude::*;

use super::ground::log_color;
use super::statistics::middle;
use crate::data::View;
use crate::geometry::{Projector, orthonormal_basis};

/// The longer side of the photos, pixels.
const PHOTO_SIDE: u32 = 400;
/// Most photos and points that are compared.
const MOST_PHOTOS: usize = 64;
const MOST_POINTS: usize = 8192;
/// Fewest photos that tell anything of a point.
const LEAST_PHOTOS: usize = 4;
/// Share of the points judged at the start that must be.
const LEAST_KEPT: f32 = 0.9;
/// Largest difference of logarithms that counts: more is something else.
const MOST_APART: f32 = 0.5;
/// First steps: along the normal, in the object's longest side, and of the normal, radians.
const FIRST_STEPS: [f32; 3] = [0.008, 0.008, 0.008];
/// How often the steps are halved.
const HALVINGS: usize = 5;

/// A plane, world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    pub(super) point: Vec3,
    /// Unit.
    pub(super) normal: Vec3,
}

impl Plane {
    /// Moved along its normal, and tilted about its point.
    fn moved(self, [along, tilt_x, tilt_y]: [f32; 3]) -> Self {
        let (x_axis, y_axis) = orthonormal_basis(self.normal);
        let normal = self.normal + tilt_x * x_axis + tilt_y * y_axis;
        Self {
            point: self.point + along * self.normal,
            normal: normal.normalize_or(self.normal),
        }
    }

    /// The point of the plane over or under another.
    fn at(self, p: Vec3) -> Vec3 {
        p - (p - self.point).dot(self.normal) * self.normal
    }
}

/// The plane near `start` on which the views agree best. `points`: near the plane, world, each with the views that show it;
/// `log_gains`: of the views; `size`: of the object, world units.
pub(super) fn settled_plane(
    start: Plane,
    size: f32,
    views: &[View],
    log_gains: &[Vec3],
    points: &[(Vec3, &[usize])],
) -> Plane {
    let photo_stride = views.len().div_ceil(MOST_PHOTOS).max(1);
    let photos: Vec<Option<LogPhoto>> = views
        .par_iter()
        .zip(log_gains)
        .enumerate()
        .map(|(i, (view, gain))| (i % photo_stride == 0).then(|| LogPhoto::new(view, *gain)))
        .collect();
    let stride = points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<_> = points.iter().step_by(stride).copied().collect();
    let mut steps = FIRST_STEPS;
    steps[0] *= size;
    let (mut least, n) = disagreement(start, &photos, &points);
    let mut best = start;
    for _ in 0..=HALVINGS {
        for (axis, step) in steps.into_iter().enumerate() {
            for step in [step, -step] {
                let mut by = [0.0; 3];
                by[axis] = step;
                loop {
                    let moved = best.moved(by);
                    let (found, n_judged) = disagreement(moved, &photos, &points);
                    // Photos that do not see it any more agree, too.
                    if found >= least || (n_judged as f32) < LEAST_KEPT * n as f32 {
                        break;
                    }
                    (best, least) = (moved, found);
                }
            }
        }
        steps = steps.map(|step| 0.5 * step);
    }
    best
}

/// Mean difference of what photos show of a point from its median there, over the points that enough photos show; and how
/// many do.
fn disagreement(
    plane: Plane,
    photos: &[Option<LogPhoto>],
    points: &[(Vec3, &[usize])],
) -> (f32, usize) {
    let difference = |(point, shown_in): &(Vec3, &[usize])| {
        let p = plane.at(*point);
        let photos = shown_in.iter().filter_map(|i| photos[*i].as_ref());
        let mut values: Vec<f32> = photos.filter_map(|photo| photo.at(p)).collect();
        if values.len() < LEAST_PHOTOS {
            return None;
        }
        let middle = middle(&mut values);
        let apart = |v: &f32| (v - middle).abs().min(MOST_APART);
        Some(values.iter().map(apart).sum::<f32>() / values.len() as f32)
    };
    let differences: Vec<f32> = points.par_iter().filter_map(difference).collect();
    let n = differences.len();
    (differences.iter().sum::<f32>() / n.max(1) as f32, n)
}

/// The logarithms of a photo's brightness, less that of its gain.
struct LogPhoto {
    projector: Projector,
    width: u32,
    /// NaN where nothing is to be seen.
    values: Vec<f32>,
}

impl LogPhoto {
    fn new(view: &View, log_gain: Vec3) -> Self {
        let view = view.within(PHOTO_SIDE);
        let (width, height) = (view.camera.width, view.camera.height);
        let value = |i: u32| {
            let color = log_color(&view, UVec2::new(i % width, i / width));
            color.map_or(f32::NAN, |color| (color - log_gain).element_sum() / 3.0)
        };
        Self {
            projector: view.camera.projector(Affine3A::IDENTITY),
            width,
            values: (0..width * height).map(value).collect(),
        }
    }

    /// Of a world point; `None` where it is not in the picture, or not usable.
    fn at(&self, p_world: Vec3) -> Option<f32> {
        let pixel = self.projector.pixel(p_world)?;
        let value = self.values[(pixel.y * self.width + pixel.x) as usize];
        value.is_finite().then_some(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_scene::{FLOOR, sphere_on_a_floor};

    #[test]
    fn a_plane_settles_where_photos_agree() {
        let dataset = sphere_on_a_floor(60, 128, |_| Vec3::ONE);
        let all: Vec<usize> = (0..dataset.train.len()).collect();
        let place = |i: usize| Vec3::new((i % 40) as f32, (i / 40) as f32, 0.0) / 10.0;
        let corner = Vec3::new(-2.0, -2.0, FLOOR);
        let points: Vec<_> = (0..1600).map(|i| (corner + place(i), &all[..])).collect();
        let start = Plane {
            point: Vec3::new(0.1, -0.2, FLOOR + 0.015),
            normal: Vec3::new(0.012, -0.007, 1.0).normalize_or_zero(),
        };
        let log_gains = vec![Vec3::ZERO; all.len()];
        let found = settled_plane(start, 1.0, &dataset.train, &log_gains, &points);
        let height = |plane: Plane, p: Vec3| plane.at(p).z - FLOOR;
        for p in [
            Vec3::ZERO,
            Vec3::new(1.5, 1.0, 0.0),
            Vec3::new(-1.0, 1.5, 0.0),
        ] {
            assert!(height(start, p).abs() > 0.004);
            assert!(height(found, p).abs() < 0.002, "{}", height(found, p));
        }
    }
}
