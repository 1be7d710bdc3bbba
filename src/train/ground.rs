//! What the photos show of the ground that the object stands on: the plane through its lowest point.
//!
//! Photos from all sides show the same ground, on which they can be compared. Automatic exposure follows what a photo
//! shows besides the object (a window behind it darkens everything), and no fields are needed to tell it from here.

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

use super::placement::up_direction;
use super::relative_exposures::{median, relative_log_gains};
use crate::data::shrink::{shrunk_mask, shrunk_photo};
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
/// Most that the logarithms of a point's colours, in photos of equal exposure, may be from their median.
const MOST_APART: f32 = 0.8;
/// Share of the points beside the object, within its longest side, that must look the same in all photos: an object in the
/// air, or on a spike, stands on nothing.
const LEAST_ALIKE: f32 = 0.6;
/// Share of the cameras that stand over it, for it to be a floor.
const LEAST_OVER: f32 = 0.3;
/// Points on each side of one whose majority decides whether it is ground.
const CLOSING: usize = 2;

/// A square of points on the plane, and the photos' view of it.
#[derive(Debug)]
pub(super) struct Ground {
    /// Its middle, under the object.
    center: Vec3,
    /// Unit, away from the ground.
    pub(super) up: Vec3,
    axes: [Vec3; 2],
    /// Points along each side of the square.
    side: usize,
    /// Half that side, world units.
    reach: f32,
    /// Corners of the object's outline in the plane, from the middle along the axes.
    outline: [Vec2; 2],
    /// The logarithm of each training photo's gain a colour; their mean is 0.
    pub(super) log_gains: Vec<Vec3>,
    /// `[side * side]`: the photos that show the ground here as the others do.
    shown_in: Vec<Vec<usize>>,
    /// `[side * side]`: whether it is ground, by most points around it, as far as it goes on from under the object.
    known: Vec<bool>,
}

impl Ground {
    /// The ground of a capture with a mesh; `None` where the photos do not show the same all around the object.
    pub(super) fn of(dataset: &Dataset) -> Option<Self> {
        let mesh = dataset.mesh.as_ref()?;
        let mut ground = Self::under(mesh, up_direction(dataset), dataset.train.len());
        let n = ground.side * ground.side;
        let points: Vec<Vec3> = (0..n).map(|i| ground.point(i)).collect();
        let seen: Vec<Vec<Option<Vec3>>> = dataset
            .train
            .par_iter()
            .map(|view| {
                let is_above = ground.height(view.camera.position()) > 0.0;
                let none = || vec![None; points.len()];
                if is_above {
                    log_colors(view, &points)
                } else {
                    none()
                }
            })
            .collect();
        ground.log_gains = relative_log_gains(&seen);
        ground.compare(&seen);
        let is_beside = |i: &usize| ground.place(*i).length() < ground.reach / REACH;
        let is_alike = |i: &usize| !ground.shown_in[*i].is_empty();
        let n_beside = (0..n).filter(is_beside).count();
        let n_alike = (0..n).filter(is_beside).filter(is_alike).count();
        (n_alike as f32 >= LEAST_ALIKE * n_beside as f32).then_some(ground)
    }

    /// The plane alone, for so many photos.
    fn under(mesh: &Mesh, up: Vec3, n_photos: usize) -> Self {
        let affordable = (MOST_COLORS / n_photos.max(1)).isqrt();
        let heights = mesh.positions.iter().map(|p| p.dot(up));
        let lowest = heights.fold(f32::INFINITY, f32::min);
        let bounds = mesh.bounds();
        let (x_axis, y_axis) = orthonormal_basis(up);
        let center = bounds.center() + (lowest - bounds.center().dot(up)) * up;
        let flat = mesh.positions.iter().map(|p| *p - center);
        let flat = flat.map(|p| Vec2::new(p.dot(x_axis), p.dot(y_axis)));
        let outline = flat.fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[a, b], p| {
            [a.min(p), b.max(p)]
        });
        Self {
            center,
            up,
            side: affordable.clamp(LEAST_SIDE, SIDE),
            axes: [x_axis, y_axis],
            reach: REACH * bounds.extent().max_element(),
            outline,
            log_gains: Vec::new(),
            shown_in: Vec::new(),
            known: Vec::new(),
        }
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

    /// Height of a world point above it; negative below.
    pub(super) fn height(&self, p_world: Vec3) -> f32 {
        (p_world - self.center).dot(self.up)
    }

    /// The points, each with the photos that show the ground there.
    pub(super) fn sightings(&self) -> impl Iterator<Item = (Vec3, &[usize])> {
        let photos = self.shown_in.iter().enumerate();
        photos.map(|(i, photos)| (self.point(i), photos.as_slice()))
    }

    /// Whether the photographer walked on it: then there is nothing to see below it, as there is beside a table.
    pub(super) fn is_a_floor(&self, dataset: &Dataset) -> bool {
        let is_over = |view: &&View| {
            let eye = view.camera.position();
            let below = eye - (self.height(eye) + self.reach) * self.up;
            self.is_between(eye, below)
        };
        let n_over = dataset.train.iter().filter(is_over).count();
        n_over as f32 >= LEAST_OVER * dataset.train.len() as f32
    }

    /// Whether there is ground between `eye`, above it, and `below`, under it.
    pub(super) fn is_between(&self, eye: Vec3, below: Vec3) -> bool {
        let (above, under) = (self.height(eye), -self.height(below));
        if above <= 0.0 || under <= 0.0 {
            return false;
        }
        let crossing = eye.lerp(below, above / (above + under)) - self.center;
        let index = |axis: Vec3| {
            let i = (crossing.dot(axis) / self.reach + 1.0) * 0.5 * self.side as f32;
            (0.0..self.side as f32).contains(&i).then_some(i as usize)
        };
        let (x, y) = (index(self.axes[0]), index(self.axes[1]));
        x.zip(y).is_some_and(|(x, y)| self.known[y * self.side + x])
    }

    /// Finds where photos show the same.
    fn compare(&mut self, seen: &[Vec<Option<Vec3>>]) {
        self.shown_in = (0..self.side * self.side)
            .into_par_iter()
            .map(|i| {
                let (photos, colors): (Vec<usize>, Vec<Vec3>) = seen
                    .iter()
                    .zip(&self.log_gains)
                    .enumerate()
                    .filter_map(|(photo, (seen, gain))| Some((photo, seen[i]? - *gain)))
                    .unzip();
                photos_alike(photos, &colors)
            })
            .collect();
        // The object hides what it stands on.
        let [least, most] = self.outline;
        let is_under = |i: usize| {
            let p = self.place(i);
            p.cmpge(least).all() && p.cmple(most).all()
        };
        let photos = self.shown_in.iter().enumerate();
        let alike: Vec<bool> = photos.map(|(i, s)| !s.is_empty() || is_under(i)).collect();
        let side = self.side;
        let starts = (0..side * side).filter(|i| is_under(*i)).collect();
        let around = |at: usize| at.saturating_sub(CLOSING)..(at + CLOSING + 1).min(side);
        let closed: Vec<bool> = (0..side * side)
            .map(|i| {
                let (columns, rows) = (around(i % side), around(i / side));
                let n = columns.len() * rows.len();
                let cells = rows.flat_map(|y| columns.clone().map(move |x| y * side + x));
                2 * cells.filter(|i| alike[*i]).count() >= n
            })
            .collect();
        self.known = connected(&closed, side, starts);
        for (photos, is_known) in self.shown_in.iter_mut().zip(&self.known) {
            if !is_known {
                photos.clear();
            }
        }
    }
}

/// Which of the `is_ground`, rows of `side`, can be reached from the `starts`: beyond the edge of a table photos disagree, and
/// what looks alike farther out is chance.
fn connected(is_ground: &[bool], side: usize, mut starts: Vec<usize>) -> Vec<bool> {
    let mut reached = vec![false; is_ground.len()];
    while let Some(i) = starts.pop() {
        if reached[i] || !is_ground[i] {
            continue;
        }
        reached[i] = true;
        let (x, y) = (i % side, i / side);
        starts.extend((x > 0).then(|| i - 1));
        starts.extend((x + 1 < side).then_some(i + 1));
        starts.extend((y > 0).then(|| i - side));
        starts.extend((y + 1 < side).then_some(i + side));
    }
    reached
}

/// The photos whose colours of a point, logarithms, are near the median; none where they are too few or the median itself is
/// only one of many.
fn photos_alike(photos: Vec<usize>, colors: &[Vec3]) -> Vec<usize> {
    if photos.len() < LEAST_PHOTOS {
        return Vec::new();
    }
    let middle = median(colors);
    let apart: Vec<Vec3> = colors.iter().map(|c| (*c - middle).abs()).collect();
    if median(&apart).max_element() > 0.5 * MOST_APART {
        return Vec::new();
    }
    let pairs = photos.into_iter().zip(apart);
    let near = pairs.filter(|(_, apart)| apart.max_element() < MOST_APART);
    near.map(|(photo, _)| photo).collect()
}

/// The logarithms of what a photo shows at the points; `None` beside the picture, near the object, and where unusable.
fn log_colors(view: &View, points: &[Vec3]) -> Vec<Option<Vec3>> {
    let (width, height) = (view.photo.width(), view.photo.height());
    let scale = (f64::from(PHOTO_SIDE) / f64::from(width.max(height))).min(1.0);
    let side = |full: u32| ((f64::from(full) * scale).round() as u32).clamp(1, full);
    let (w, h) = (side(width), side(height));
    let photo = shrunk_photo(&view.photo, None, w, h);
    let mask = view.mask.as_ref().map(|mask| shrunk_mask(mask, w, h));
    let projector = view.camera.resized(w, h).projector(Affine3A::IDENTITY);
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
    use crate::train::test_scene::{FLOOR, sphere_in_a_box, sphere_on_a_floor};

    #[test]
    fn exposures_are_read_off_the_ground() {
        let log_gain = |i: usize| {
            let turn = 2.0 * i as f32;
            0.5 * Vec3::new(turn.sin(), turn.cos(), (1.3 * turn).sin())
        };
        let dataset = sphere_on_a_floor(60, 64, |i| log_gain(i).exp());
        let ground = Ground::of(&dataset).expect("a floor");
        let n = dataset.train.len();
        let mean = (0..n).map(log_gain).sum::<Vec3>() / n as f32;
        for (i, found) in ground.log_gains.iter().enumerate() {
            let apart = (*found - (log_gain(i) - mean)).abs().max_element();
            assert!(
                apart < 0.05,
                "photo {i}: {found}, not {}",
                log_gain(i) - mean
            );
        }
    }

    #[test]
    fn the_ground_hides_what_is_below_it() {
        let dataset = sphere_on_a_floor(60, 64, |_| Vec3::ONE);
        let ground = Ground::of(&dataset).expect("a floor");
        let eye = Vec3::new(1.0, 1.0, 1.0);
        let above = Vec3::new(-0.8, 0.5, FLOOR + 0.1);
        assert!((ground.height(eye) - (1.0 - FLOOR)).abs() < 0.01);
        assert!(ground.is_between(eye, Vec3::new(-0.8, 0.5, FLOOR - 0.2)));
        assert!(!ground.is_between(eye, above));
        let far = Vec3::new(-500.0, 0.0, FLOOR - 0.2);
        assert!(
            !ground.is_between(eye, far),
            "the photos do not show so much of it"
        );
        assert!(ground.is_a_floor(&dataset));
        let mut distant = dataset;
        for view in &mut distant.train {
            view.camera.world_from_camera.translation.x += 50.0;
        }
        assert!(!ground.is_a_floor(&distant), "they stand beside it");
        let (point, photos) = ground.sightings().max_by_key(|s| s.1.len()).unwrap();
        assert!(photos.len() > 10, "{} photos at {point}", photos.len());
    }

    #[test]
    fn the_ground_ends_at_its_edge() {
        let rows = ["110001", "110001", "011001"].concat();
        let is_ground: Vec<bool> = rows.chars().map(|c| c == '1').collect();
        let reached = connected(&is_ground, 6, vec![0]);
        let shown: String = reached.iter().map(|r| if *r { '1' } else { '0' }).collect();
        assert_eq!(shown, ["110000", "110000", "011000"].concat());
    }

    #[test]
    fn what_hangs_in_the_air_stands_on_nothing() {
        assert!(Ground::of(&sphere_in_a_box(60, 64)).is_none());
    }
}
