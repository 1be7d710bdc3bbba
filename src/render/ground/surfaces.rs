//! The surfaces of the environment near an object: where looks from its middle end, a patch in each cell of a cube.
//!
//! What gets an object's shadow or its light sees the object, so that the object sees it. Neighbouring looks span
//! triangles; the sum of their area vectors over a neighbourhood depends on its rim alone, which takes the noise of the
//! field's depth out of normals.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::GroundResolution;
use super::sight::Sight;
use super::square::Square;
use crate::neif::Environment;
use crate::neif::field::radiance_field::{FieldBatch, FieldRay};
use crate::neif::light::environment::LightScratch;

/// Least cosine between a triangle's normal and the look at it: below lies an edge with nothing in between.
const LEAST_COSINE: f32 = 0.08;
/// How surely photos showed what a patch is made of, at least.
const LEAST_SEEN: f32 = 0.9;
/// Cosine from which neighbours belong to the same surface.
const SAME_SURFACE: f32 = 0.8;
/// Cells by which planes grow into gaps between looks.
const GROWTH: usize = 3;
/// Cells within which a point belongs to a patch.
const NEAR: i32 = 2;
/// Distance of a plane from the middle of a cell that it passes through, cells.
const PASSES: f32 = 0.87;
const NO_PATCH: u32 = u32::MAX;

/// Cubic cells of a cube, field coordinates.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    pub(super) center: Vec3,
    pub(super) half_side: f32,
    /// Cells an axis.
    pub(super) side: usize,
}

impl Cells {
    pub(super) fn size(&self) -> f32 {
        2.0 * self.half_side / self.side as f32
    }

    /// Number of cells.
    fn len(&self) -> usize {
        self.side.pow(3)
    }

    /// Where a point lies, in cells from the low corner.
    pub(super) fn place(&self, point: Vec3) -> Vec3 {
        (point - self.center + self.half_side) / self.size()
    }

    /// The cell that holds a point.
    fn holding(&self, point: Vec3) -> Option<usize> {
        self.index(self.place(point).floor().as_ivec3())
    }

    fn index(&self, at: IVec3) -> Option<usize> {
        let side = self.side as i32;
        let is_in = at.cmpge(IVec3::ZERO).all() && at.cmplt(IVec3::splat(side)).all();
        is_in.then(|| (at.x + side * (at.y + side * at.z)) as usize)
    }

    fn at(&self, index: usize) -> IVec3 {
        let side = self.side;
        IVec3::new(
            (index % side) as i32,
            (index / side % side) as i32,
            (index / side / side) as i32,
        )
    }

    fn middle(&self, index: usize) -> Vec3 {
        self.middle_of(self.at(index))
    }

    fn middle_of(&self, at: IVec3) -> Vec3 {
        let low = self.center - self.half_side;
        low + (at.as_vec3() + 0.5) * self.size()
    }

    /// The cells around one, itself included, within `reach` of it along each axis.
    fn around(&self, index: usize, reach: i32) -> impl Iterator<Item = usize> + '_ {
        let steps = self.steps(self.at(index), reach);
        steps.map(|(cell, _)| cell)
    }

    /// The same, each with the way there.
    fn steps(&self, at: IVec3, reach: i32) -> impl Iterator<Item = (usize, IVec3)> + '_ {
        let steps = move || -reach..=reach;
        steps().flat_map(move |z| {
            steps().flat_map(move |y| {
                steps().filter_map(move |x| {
                    let step = IVec3::new(x, y, z);
                    Some((self.index(at + step)?, step))
                })
            })
        })
    }
}

/// A piece of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// The cell that it lies in.
    pub(super) cell: usize,
    pub(super) point: Vec3,
    /// Unit, towards the object.
    pub(super) normal: Vec3,
}

impl Patch {
    /// Height of a point over its plane.
    fn height(&self, point: Vec3) -> f32 {
        (point - self.point).dot(self.normal)
    }
}

/// The surfaces around an object.
#[derive(Clone, Debug)]
pub(super) struct Surfaces {
    pub(super) cells: Cells,
    pub(super) patches: Vec<Patch>,
    /// Of each cell the patch that points in it belong to.
    nearest: Vec<u32>,
}

/// Sums over the triangles in a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    /// Area times normal.
    area: Vec3,
    /// Moments of the area.
    moment: Vec3,
    weight: f32,
}

impl Found {
    fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.moment += other.moment;
        self.weight += other.weight;
    }
}

impl Surfaces {
    /// Looks around from the middle of the cube, through each of its faces. What lies nearer than `outside` (of a unit
    /// direction) is inside the object.
    pub(super) fn around(
        environment: &Environment,
        cells: Cells,
        resolution: GroundResolution,
        outside: impl Fn(Vec3) -> f32 + Sync,
    ) -> Self {
        let mut found = vec![Found::default(); cells.len()];
        if environment.has_surfaces() {
            look_around(environment, &cells, (resolution, &outside), &mut found);
        }
        let patches = smoothed(&cells, &found);
        let mut surfaces = Self {
            nearest: vec![NO_PATCH; cells.len()],
            patches,
            cells,
        };
        for _ in 0..GROWTH {
            surfaces.grow();
        }
        surfaces.find_nearest();
        surfaces
    }

    /// Where a ray meets the surface that its sample at this distance belongs to; `None` where there is none. A sample lies
    /// somewhere in a stretch of the ray, the surface at one place of it.
    #[inline]
    pub(super) fn met(&self, sight: &Sight<'_>, distance: f32) -> Option<Vec3> {
        let point = sight.point(distance);
        let patch = self.near(point)?.1;
        let fall = -patch.normal.dot(Vec3::from(sight.ray.cone.direction));
        let onward = patch.height(point) / fall;
        let reach = NEAR as f32 * self.cells.size();
        let is_close = onward.abs() * sight.speed() < reach;
        Some(if is_close {
            sight.point(distance + onward)
        } else {
            point
        })
    }

    /// The patch that a point belongs to, and its number.
    #[inline]
    pub(super) fn near(&self, point: Vec3) -> Option<(usize, &Patch)> {
        let number = self.nearest[self.cells.holding(point)?] as usize;
        self.patches.get(number).map(|patch| (number, patch))
    }

    /// Takes what lies within `slab` of a plane and faces its way to lie on it, and adds patches at those of its points that
    /// `is_known`, where there are none.
    pub(super) fn lay(&mut self, plane: &Square, slab: f32, is_known: impl Fn(Vec3) -> bool) {
        for patch in &mut self.patches {
            let height = plane.height(patch.point);
            if height.abs() < slab && patch.normal.dot(plane.up) > SAME_SURFACE {
                patch.point -= height * plane.up;
                patch.normal = plane.up;
            }
        }
        let is_taken = self.taken();
        for cell in (0..self.cells.len()).filter(|cell| !is_taken[*cell]) {
            let middle = self.cells.middle(cell);
            let height = plane.height(middle);
            let point = middle - height * plane.up;
            if height.abs() < PASSES * self.cells.size() && is_known(point) {
                let normal = plane.up;
                self.patches.push(Patch {
                    cell,
                    point,
                    normal,
                });
            }
        }
        self.find_nearest();
    }

    /// Numbers of the patches in the cells around one that face the same way.
    pub(super) fn beside(&self, patch: &Patch) -> impl Iterator<Item = usize> {
        let cells = self.cells.around(patch.cell, 1);
        let cells = cells.filter(|cell| *cell != patch.cell);
        cells.filter_map(move |cell| {
            let number = self.nearest[cell] as usize;
            let other = self.patches.get(number)?;
            let is_beside = other.cell == cell && other.normal.dot(patch.normal) > SAME_SURFACE;
            is_beside.then_some(number)
        })
    }

    fn taken(&self) -> Vec<bool> {
        let mut taken = vec![false; self.cells.len()];
        for patch in &self.patches {
            taken[patch.cell] = true;
        }
        taken
    }

    /// Lets planes pass into empty cells beside them.
    fn grow(&mut self) {
        let is_taken = self.taken();
        // Of each cell the sums of the normals and heights of the planes that pass through it, and their number.
        let mut passing = vec![(Vec3::ZERO, 0.0, 0.0); self.cells.len()];
        for patch in &self.patches {
            for cell in self.cells.around(patch.cell, 1) {
                let height = patch.height(self.cells.middle(cell));
                if !is_taken[cell] && height.abs() < PASSES * self.cells.size() {
                    let (normals, heights, n) = &mut passing[cell];
                    *normals += patch.normal;
                    *heights += height;
                    *n += 1.0;
                }
            }
        }
        for (cell, (normals, heights, n)) in passing.into_iter().enumerate() {
            if let Some(normal) = normals.try_normalize() {
                self.patches.push(Patch {
                    cell,
                    point: self.cells.middle(cell) - heights / n * normal,
                    normal,
                });
            }
        }
    }

    /// A cell's own patch, or of those in the cells around it one that is near and whose plane passes near.
    fn find_nearest(&mut self) {
        let mut nearest = vec![f32::INFINITY; self.cells.len()];
        for (number, patch) in self.patches.iter().enumerate() {
            let at = self.cells.at(patch.cell);
            for (cell, step) in self.cells.steps(at, NEAR) {
                let distance = if step == IVec3::ZERO {
                    0.0
                } else {
                    let height = patch.height(self.cells.middle_of(at + step)).abs();
                    step.as_vec3().length() * self.cells.size() + height
                };
                if distance < nearest[cell] {
                    nearest[cell] = distance;
                    self.nearest[cell] = number as u32;
                }
            }
        }
    }
}

/// Adds the triangles between where neighbouring looks end.
fn look_around(
    environment: &Environment,
    cells: &Cells,
    (resolution, outside): (GroundResolution, &(impl Fn(Vec3) -> f32 + Sync)),
    found: &mut [Found],
) {
    let n_looks = resolution.n_looks;
    let ends: Vec<Vec<Option<Vec3>>> = (0..6 * n_looks)
        .into_par_iter()
        .map_init(Default::default, |scratch, row| {
            let row = (row / n_looks, row % n_looks);
            look_through(environment, cells, row, (resolution, outside), scratch)
        })
        .collect();
    for face in ends.chunks_exact(n_looks) {
        for rows in face.windows(2) {
            add_triangles(cells, &rows[0], &rows[1], found);
        }
    }
}

/// Where the looks end that pass through a row of a face of the cube; `None` outside of it, and where photos saw nothing.
fn look_through(
    environment: &Environment,
    cells: &Cells,
    (face, row): (usize, usize),
    (resolution, outside): (GroundResolution, &impl Fn(Vec3) -> f32),
    (batch, scratch): &mut (FieldBatch, LightScratch),
) -> Vec<Option<Vec3>> {
    let n_looks = resolution.n_looks;
    let axis = Vec3::AXES[face % 3] * if face < 3 { 1.0 } else { -1.0 };
    let (right, up) = (Vec3::AXES[(face + 1) % 3], Vec3::AXES[(face + 2) % 3]);
    let at = |i: usize| 2.0 * i as f32 / (n_looks - 1) as f32 - 1.0;
    let spread = 0.6 / n_looks as f32;
    batch.rays.clear();
    batch.rays.extend((0..n_looks).map(|x| {
        let direction = (axis + right * at(x) + up * at(row)).normalize_or(axis);
        FieldRay::of_pixel(cells.center.to_array(), direction.to_array(), 0.0, spread)
    }));
    environment.light_by(resolution.most_samples, batch, scratch);
    let end = |i: usize| {
        let sight = Sight::of(batch, i);
        let end = sight.end()?;
        let point = sight.point(end);
        let is_known = cells.holding(point).is_some()
            && environment.seen_share(batch, i) > LEAST_SEEN
            && end >= outside(Vec3::from(sight.ray.direction));
        is_known.then_some(point)
    };
    (0..n_looks).map(end).collect()
}

/// Adds the triangles between two rows of ends.
fn add_triangles(cells: &Cells, row: &[Option<Vec3>], next: &[Option<Vec3>], found: &mut [Found]) {
    for (row, next) in row.windows(2).zip(next.windows(2)) {
        for corners in [[row[0], row[1], next[0]], [next[1], next[0], row[1]]] {
            if let [Some(a), Some(b), Some(c)] = corners {
                add_triangle(cells, [a, b, c], found);
            }
        }
    }
}

fn add_triangle(cells: &Cells, [a, b, c]: [Vec3; 3], found: &mut [Found]) {
    let middle = (a + b + c) / 3.0;
    let area = 0.5 * (b - a).cross(c - a);
    let toward = cells.center - middle;
    let cosine = area.dot(toward);
    if cosine.abs() < LEAST_COSINE * area.length() * toward.length() {
        return;
    }
    if let Some(cell) = cells.holding(middle) {
        let weight = area.length();
        found[cell].add(&Found {
            area: area * cosine.signum(),
            moment: middle * weight,
            weight,
        });
    }
}

/// A patch in each cell with triangles, by those around it that face the same way.
fn smoothed(cells: &Cells, found: &[Found]) -> Vec<Patch> {
    let patch = |cell: usize| {
        let own = &found[cell];
        if own.weight <= 0.0 {
            return None;
        }
        let first = cells
            .around(cell, 1)
            .map(|cell| found[cell].area)
            .sum::<Vec3>();
        let first = first.try_normalize()?;
        let mut sum = Found::default();
        for near in cells.around(cell, 2).map(|cell| &found[cell]) {
            if near.area.dot(first) > SAME_SURFACE * near.area.length() {
                sum.add(near);
            }
        }
        let normal = sum.area.try_normalize()?;
        // The mean of its own triangles, moved onto the plane of all.
        let middle = own.moment / own.weight;
        let height = (sum.moment / sum.weight - middle).dot(normal);
        let point = middle + height * normal;
        Some(Patch {
            cell,
            point,
            normal,
        })
    };
    (0..found.len()).filter_map(patch).collect()
}
