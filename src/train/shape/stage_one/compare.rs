//! How far one mesh is from another, given the cameras that look at them.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use crate::data::View;
use crate::geometry::{Aabb, Camera, Mesh, Ray, SurfaceTracer};

/// Points drawn on each mesh.
const N_POINTS: usize = 250_000;
/// Pixels across and down of the pictures in which normals are compared.
const SIDE: u32 = 160;

/// The difference of two meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct MeshDifference {
    /// Longest side of the box around the reference, scene units.
    pub diameter: f32,
    /// Mean distance between the surfaces (of both directions), share of the diameter.
    pub chamfer: f64,
    /// The same over what the cameras see.
    pub chamfer_visible: f64,
    /// Median angle between the normals that a pixel shows, over all views, degrees.
    pub normal_median_deg: f64,
    /// The mean of that angle, degrees.
    pub normal_mean_deg: f64,
}

/// Compares `mesh` with `reference`, as seen by `cameras`.
pub fn compare(mesh: &Arc<Mesh>, reference: &Arc<Mesh>, cameras: &[Camera]) -> MeshDifference {
    let extent = reference.bounds().extent();
    let diameter = extent.max_element().max(f32::MIN_POSITIVE);
    let pair = [mesh, reference].map(|mesh| SurfaceTracer::new(Arc::clone(mesh)));
    let surfaces = [mesh, reference].map(|mesh| area_points(mesh));
    let indices = surfaces.each_ref().map(|points| PointIndex::new(points));
    let chamfer = |points: &[Vec<Vec3>; 2]| {
        let there = indices[1].mean_distance(&points[0]);
        let back = indices[0].mean_distance(&points[1]);
        0.5 * (there + back) / f64::from(diameter)
    };
    let looks = cameras.par_iter().map(|camera| look(&pair, camera));
    let by_camera: Vec<_> = looks.collect();
    let (mut seen, mut angles) = ([Vec::new(), Vec::new()], Vec::new());
    for ([a, b], degrees) in by_camera {
        seen[0].extend(a);
        seen[1].extend(b);
        angles.extend(degrees);
    }
    angles.sort_unstable_by(f64::total_cmp);
    let n = angles.len().max(1);
    MeshDifference {
        diameter,
        chamfer: chamfer(&surfaces),
        chamfer_visible: chamfer(&seen),
        normal_median_deg: angles.get(n / 2).copied().unwrap_or(0.0),
        normal_mean_deg: angles.iter().sum::<f64>() / n as f64,
    }
}

/// Points that a camera sees of each mesh, and the angles between the normals where it sees both.
fn look(pair: &[SurfaceTracer; 2], camera: &Camera) -> ([Vec<Vec3>; 2], Vec<f64>) {
    let (mut points, mut angles) = ([Vec::new(), Vec::new()], Vec::new());
    for ray in pixel_rays(&camera.resized(SIDE, SIDE)) {
        let hits = [0, 1].map(|i| pair[i].intersect(&ray, 0.0, f32::MAX));
        for (points, hit) in points.iter_mut().zip(&hits) {
            points.extend(hit.map(|hit| hit.position));
        }
        if let [Some(a), Some(b)] = hits {
            angles.push(f64::from(a.normal.angle_between(b.normal).to_degrees()));
        }
    }
    (points, angles)
}

/// The rays through the middles of a camera's pixels, row by row.
fn pixel_rays(camera: &Camera) -> impl Iterator<Item = Ray> {
    (0..camera.width * camera.height).map(|i| {
        let (x, y) = (i % camera.width, i / camera.width);
        camera.ray(x as f32 + 0.5, y as f32 + 0.5)
    })
}

/// Points spread evenly over the surface: one random number decides how far along the list of
/// areas the first lies, the rest follow at equal steps.
fn area_points(mesh: &Mesh) -> Vec<Vec3> {
    let step = mesh.surface_area() / N_POINTS as f64;
    let mut points = Vec::with_capacity(N_POINTS + 1);
    let mut left = 0.5 * step;
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i);
        let area = 0.5 * f64::from((b - a).cross(c - a).length());
        while left < area {
            // Plastic-number sequence over the triangle.
            let k = points.len() as f64;
            let (u, v) = (
                (0.754_877_67 * k).fract() as f32,
                (0.569_840_29 * k).fract() as f32,
            );
            let (u, v) = if u + v > 1.0 {
                (1.0 - u, 1.0 - v)
            } else {
                (u, v)
            };
            points.push(a + u * (b - a) + v * (c - a));
            left += step;
        }
        left -= area;
    }
    points
}

/// Points sorted into the cells of a grid, for the nearest of them.
struct PointIndex {
    low: Vec3,
    cell: f32,
    size: [i32; 3],
    /// Of each cell.
    points: Vec<Vec<Vec3>>,
}

impl PointIndex {
    fn new(points: &[Vec3]) -> Self {
        let bounds = Aabb::from_points(points.iter().copied());
        let cell = (bounds.extent().max_element() / 64.0).max(f32::MIN_POSITIVE);
        let size = (bounds.extent() / cell).to_array().map(|n| n as i32 + 1);
        let mut index = Self {
            low: bounds.min,
            cell,
            size,
            points: vec![Vec::new(); size.iter().product::<i32>() as usize],
        };
        for p in points {
            let number = index.number(index.cell_of(*p));
            index.points[number].push(*p);
        }
        index
    }

    fn mean_distance(&self, points: &[Vec3]) -> f64 {
        let sum_of =
            |points: &[Vec3]| -> f64 { points.iter().map(|p| f64::from(self.distance(*p))).sum() };
        // By chunks in order: the same sum on any number of threads.
        let sums: Vec<f64> = points.par_chunks(1024).map(sum_of).collect();
        sums.iter().sum::<f64>() / points.len().max(1) as f64
    }

    fn cell_of(&self, p: Vec3) -> [i32; 3] {
        let at = ((p - self.low) / self.cell).floor().to_array();
        std::array::from_fn(|i| (at[i] as i32).clamp(0, self.size[i] - 1))
    }

    fn number(&self, [x, y, z]: [i32; 3]) -> usize {
        ((z * self.size[1] + y) * self.size[0] + x) as usize
    }

    /// The distance of `p` from the nearest point, looking at shells of cells of growing size.
    fn distance(&self, p: Vec3) -> f32 {
        let middle = self.cell_of(p);
        let mut best = f32::INFINITY;
        let most = self.size.iter().copied().max().unwrap_or(1);
        // A point outside the box is as far from its cell as from the box.
        let high = self.low + self.cell * Vec3::from_array(self.size.map(|n| n as f32));
        let outside = p.distance(p.clamp(self.low, high));
        for shell in 0..=most {
            if best <= (shell - 1).max(0) as f32 * self.cell + outside {
                break;
            }
            for z in -shell..=shell {
                for y in -shell..=shell {
                    let is_face = z.abs() == shell || y.abs() == shell;
                    let step = if is_face || shell == 0 { 1 } else { 2 * shell };
                    for x in (-shell..=shell).step_by(step as usize) {
                        let cell = [middle[0] + x, middle[1] + y, middle[2] + z];
                        if (0..3).all(|i| (0..self.size[i]).contains(&cell[i])) {
                            best = best.min(self.nearest_in(cell, p));
                        }
                    }
                }
            }
        }
        best
    }

    fn nearest_in(&self, cell: [i32; 3], p: Vec3) -> f32 {
        let points = self.points[self.number(cell)].iter();
        points.map(|q| p.distance(*q)).fold(f32::INFINITY, f32::min)
    }
}

/// The mean over views of the share that the mesh's silhouette and the mask have in common, of
/// what either covers; `None` where no view has a mask.
pub fn silhouette_agreement<'a>(
    mesh: &Arc<Mesh>,
    views: impl Iterator<Item = &'a View>,
) -> Option<f64> {
    let tracer = SurfaceTracer::new(Arc::clone(mesh));
    let views: Vec<&View> = views.filter(|view| view.mask.is_some()).collect();
    let shares: Vec<f64> = views
        .par_iter()
        .filter_map(|view| {
            let mask = view.mask.as_ref()?;
            let (mut both, mut either) = (0_u32, 0_u32);
            for (i, ray) in pixel_rays(&view.camera).enumerate() {
                let is_hit = tracer.occluded(&ray, 0.0, f32::MAX);
                both += u32::from(is_hit && mask.is_object(i));
                either += u32::from(is_hit || mask.is_object(i));
            }
            (either > 0).then(|| f64::from(both) / f64::from(either))
        })
        .collect();
    (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
}
