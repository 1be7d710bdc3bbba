//! Points spread over the surface at which light is gathered, and how others are interpolated between them.
//!
//! Distances are measured in position and normal together, so that a thin sheet has probes on both sides and a strongly
//! curved part more of them. The k-th probe is the candidate farthest from all before it (Gonzalez 1985), hence the
//! first few already cover the surface.

use glam::Vec3;

use crate::geometry::{Aabb, Mesh};

/// Candidates for each probe.
const CANDIDATES: usize = 8;
/// What a whole unit of difference between normals counts, in half diagonals of the mesh.
const NORMAL_WEIGHT: f32 = 0.15;
/// How far a probe reaches, in distances from the farthest surface point to its nearest probe: below 1 there would be
/// points without any.
const REACH: f32 = 2.0;
/// Most cells of the look-up grid per axis.
const MAX_CELLS: f32 = 48.0;

/// A surface point that gathers light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// World coordinates.
    pub position: Vec3,
    /// Unit shading normal, outwards.
    pub normal: Vec3,
    /// Unit normal of the triangle, on the same side.
    pub face_normal: Vec3,
}

/// Probes on a mesh with a grid to find those near a point.
#[derive(Clone, Debug)]
pub struct Probes {
    points: Vec<Probe>,
    /// World units that a unit of difference between normals counts.
    normal_scale: f32,
    /// Distance at which a probe's weight falls to 0, world units.
    reach: f32,
    bounds: Aabb,
    cell_size: f32,
    n_cells: [usize; 3],
    /// Of each cell, the probes that reach into it; x fastest.
    cells: Vec<Vec<u32>>,
}

impl Probes {
    /// At most `n` probes on a mesh, always the same ones.
    pub fn on_mesh(mesh: &Mesh, n: usize) -> Self {
        let bounds = mesh.bounds();
        let radius = (0.5 * bounds.diagonal()).max(f32::MIN_POSITIVE);
        let normal_scale = NORMAL_WEIGHT * radius;
        let candidates = candidates(mesh, CANDIDATES * n);
        let (points, farthest) = farthest_points(&candidates, n, normal_scale);
        // Fewer different candidates than probes leave no gap at all.
        let reach = REACH * farthest.max(1e-3 * radius);
        let cell_size = reach.max(2.0 * radius / MAX_CELLS);
        let extent = (bounds.max - bounds.min) / cell_size;
        let n_cells = extent.to_array().map(|cells| cells as usize + 1);
        let mut found = Self {
            points,
            normal_scale,
            reach,
            bounds,
            cell_size,
            n_cells,
            cells: vec![Vec::new(); n_cells.iter().product()],
        };
        found.fill_cells();
        found
    }

    fn fill_cells(&mut self) {
        for (i, probe) in self.points.iter().enumerate() {
            let low = self.cell_of(probe.position - Vec3::splat(self.reach));
            let high = self.cell_of(probe.position + Vec3::splat(self.reach));
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    for x in low[0]..=high[0] {
                        let cell = (z * self.n_cells[1] + y) * self.n_cells[0] + x;
                        self.cells[cell].push(i as u32);
                    }
                }
            }
        }
    }

    /// The cell that holds a point, or the nearest one.
    fn cell_of(&self, position: Vec3) -> [usize; 3] {
        let cell = ((position - self.bounds.min) / self.cell_size).to_array();
        // Negative and NaN become 0.
        std::array::from_fn(|axis| (cell[axis] as usize).min(self.n_cells[axis] - 1))
    }

    /// The probes, each farthest from those before it.
    pub fn probes(&self) -> &[Probe] {
        &self.points
    }

    /// Calls `visit(probe, weight)` for the probes near a surface point: weights fall smoothly from 1 to 0.
    #[inline]
    pub fn near(&self, position: Vec3, normal: Vec3, mut visit: impl FnMut(usize, f32)) {
        let [x, y, z] = self.cell_of(position);
        let inverse = 1.0 / (self.reach * self.reach);
        for &i in &self.cells[(z * self.n_cells[1] + y) * self.n_cells[0] + x] {
            let probe = &self.points[i as usize];
            let inside =
                1.0 - inverse * distance_squared(probe, position, normal, self.normal_scale);
            if inside > 0.0 {
                visit(i as usize, inside * inside);
            }
        }
    }
}

fn distance_squared(probe: &Probe, position: Vec3, normal: Vec3, normal_scale: f32) -> f32 {
    probe.position.distance_squared(position)
        + normal_scale * normal_scale * probe.normal.distance_squared(normal)
}

/// Points at equal steps of the surface area; within a triangle by the R2 sequence (Roberts 2018).
fn candidates(mesh: &Mesh, n: usize) -> Vec<Probe> {
    let mut ends = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0_f64;
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i).map(|p: Vec3| p.as_dvec3());
        total += 0.5 * (b - a).cross(c - a).length();
        ends.push(total);
    }
    (0..n)
        .map(|k| {
            let area = (k as f64 + 0.5) / n as f64 * total;
            let triangle = ends.partition_point(|end| *end < area).min(ends.len() - 1);
            let u =
                [0.754_877_666, 0.569_840_291].map(|a: f64| ((k as f64 + 0.5) * a % 1.0) as f32);
            probe_on(mesh, triangle, u)
        })
        .collect()
}

/// A point of a triangle, from two numbers in 0..1.
fn probe_on(mesh: &Mesh, triangle: usize, u: [f32; 2]) -> Probe {
    let root = u[0].sqrt();
    let weights = [1.0 - root, root * (1.0 - u[1]), root * u[1]];
    let [a, b, c] = mesh.corners(triangle);
    let [na, nb, nc] = mesh.triangles[triangle].map(|vertex| mesh.normals[vertex as usize]);
    let face = (b - a).cross(c - a).normalize_or(na);
    // Vertex normals say where outside is, as in the tracer.
    let face_normal = if face.dot(na + nb + nc) < 0.0 {
        -face
    } else {
        face
    };
    Probe {
        position: a + weights[1] * (b - a) + weights[2] * (c - a),
        normal: (weights[0] * na + weights[1] * nb + weights[2] * nc).normalize_or(face_normal),
        face_normal,
    }
}

/// `n` of the candidates, each farthest from those before it; and how far the farthest of the rest is from them all.
fn farthest_points(candidates: &[Probe], n: usize, normal_scale: f32) -> (Vec<Probe>, f32) {
    let mut chosen: Vec<Probe> = Vec::with_capacity(n);
    let mut gaps = vec![f32::INFINITY; candidates.len()];
    let (mut next, mut gap) = (0, f32::INFINITY);
    while chosen.len() < n.max(1) && gap > 0.0 {
        let probe = candidates[next];
        chosen.push(probe);
        (next, gap) = (0, -1.0);
        for (i, (candidate, nearest)) in candidates.iter().zip(&mut gaps).enumerate() {
            let distance =
                distance_squared(&probe, candidate.position, candidate.normal, normal_scale);
            *nearest = nearest.min(distance);
            if *nearest > gap {
                (next, gap) = (i, *nearest);
            }
        }
    }
    (chosen, gap.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::meshes::test_mesh::ellipsoid;

    #[test]
    fn probes_lie_apart_on_the_surface_and_are_near_every_point_of_it() {
        let mesh = ellipsoid(Vec3::ONE, Vec3::splat(2.0), 24);
        let probes = Probes::on_mesh(&mesh, 200);
        assert_eq!(probes.probes().len(), 200);
        for probe in probes.probes() {
            assert!(
                (probe.position.distance(Vec3::ONE) - 2.0).abs() < 0.03,
                "{probe:?}"
            );
            assert!(probe.normal.is_normalized() && probe.face_normal.dot(probe.normal) > 0.9);
        }
        for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
            let mut count = 0;
            probes.near(*position, *normal, |_, weight| {
                assert!(weight > 0.0 && weight <= 1.0, "{weight}");
                count += 1;
            });
            assert!((2..40).contains(&count), "{count} probes near {position}");
        }
    }

    #[test]
    fn the_other_side_of_a_thin_sheet_is_far() {
        let mesh = ellipsoid(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.01), 24);
        let probes = Probes::on_mesh(&mesh, 200);
        probes.near(Vec3::new(0.1, 0.1, 0.01), Vec3::Z, |i, _| {
            assert!(
                probes.probes()[i].normal.z > 0.0,
                "{:?}",
                probes.probes()[i]
            );
        });
    }

    #[test]
    fn strange_points_find_no_probe_rather_than_a_panic() {
        let probes = Probes::on_mesh(&ellipsoid(Vec3::ZERO, Vec3::splat(1e-3), 8), 20);
        for position in [Vec3::NAN, Vec3::INFINITY, Vec3::splat(-1e30)] {
            probes.near(position, Vec3::Z, |i, weight| panic!("{i} at {weight}"));
        }
    }
}
