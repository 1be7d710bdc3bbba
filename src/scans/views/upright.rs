//! Which way is up in a scan: across the planes that most of its points lie in, as floors, tables and ceilings are.

use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::fibonacci_sphere;

/// Directions that are tried first.
const N_DIRECTIONS: usize = 1000;
/// The best of them that are refined: layers are thinner than the directions are dense, so the first scores say little.
const N_REFINED: usize = 32;
/// Rounds of smaller and smaller changes to each.
const N_ROUNDS: usize = 6;
/// The first changes, radians; each round's are half of the last.
const FIRST_CHANGE: f32 = 0.06;
/// Cells across the scan's size, in each of which one point counts: a surface counts by its area, not by its detail.
const N_CELLS: f32 = 48.0;
/// Layers across the scan's size.
const N_LAYERS: f32 = 150.0;
/// How many times as much as others a direction counts that is one of the file format's own up axes ...
const AXIS_WEIGHT: f64 = 1.5;
/// ... within this cosine.
const ON_AXIS: f32 = 0.995;
/// Cosine to a file format's own up axis from which its sign is believed.
const ALIGNED: f32 = 0.6;

/// The unit up direction of points, of a scan of this `size`. `conventions` are the axes that are up by convention, the most
/// usual first: they decide between a direction and its opposite.
pub(super) fn up_direction(points: &[Vec3], size: f32, conventions: &[Vec3]) -> Vec3 {
    let points = &evenly(points, size / N_CELLS)[..];
    let score = |direction: Vec3| {
        let along = conventions
            .iter()
            .any(|axis| axis.dot(direction).abs() > ON_AXIS);
        concentration(points, size, direction) * if along { AXIS_WEIGHT } else { 1.0 }
    };
    if points.is_empty() {
        return conventions.first().copied().unwrap_or(Vec3::Z);
    }
    let mut first: Vec<(f64, Vec3)> = fibonacci_sphere(N_DIRECTIONS)
        .into_par_iter()
        .chain(conventions.to_vec())
        .map(|direction| (score(direction), direction))
        .collect();
    // Stable: ties go to the first, whatever the number of threads.
    first.sort_by(|a, b| b.0.total_cmp(&a.0));
    first.truncate(N_REFINED);
    let refined: Vec<(f64, Vec3)> = first
        .into_par_iter()
        .map(|candidate| refined(candidate, score))
        .collect();
    let better = |a: (f64, Vec3), b: (f64, Vec3)| if b.0 > a.0 { b } else { a };
    let (_, best) = refined
        .into_iter()
        .fold((f64::NEG_INFINITY, Vec3::Z), better);
    let known = conventions
        .iter()
        .find(|axis| best.dot(**axis).abs() > ALIGNED);
    match known {
        Some(axis) => best * best.dot(*axis).signum(),
        None => best * upper_side(points, best),
    }
}

/// The best direction, with its score, that smaller and smaller changes lead to.
fn refined(mut best: (f64, Vec3), score: impl Fn(Vec3) -> f64) -> (f64, Vec3) {
    let mut change = FIRST_CHANGE;
    for _ in 0..N_ROUNDS {
        let center = best.1;
        let (t, b) = center.any_orthonormal_pair();
        for i in 0..8_u8 {
            let (sin, cos) = (f32::from(i) * std::f32::consts::FRAC_PI_4).sin_cos();
            let direction = (center + change * (cos * t + sin * b)).normalize_or(center);
            let scored = score(direction);
            if scored > best.0 {
                best = (scored, direction);
            }
        }
        change *= 0.5;
    }
    best
}

/// The first of the points in each cell of this size.
fn evenly(points: &[Vec3], cell: f32) -> Vec<Vec3> {
    let cell = cell.max(f32::MIN_POSITIVE);
    let in_cell = |p: &Vec3| ((*p / cell).floor().as_i64vec3().to_array(), *p);
    let mut cells: Vec<_> = points.iter().map(in_cell).collect();
    cells.sort_by_key(|(cell, _)| *cell);
    cells.dedup_by_key(|(cell, _)| *cell);
    cells.into_iter().map(|(_, point)| point).collect()
}

/// How much of the points lies in few layers across a direction: the sum of the squares of the layers' shares.
fn concentration(points: &[Vec3], size: f32, direction: Vec3) -> f64 {
    let layer = (size / N_LAYERS).max(f32::MIN_POSITIVE);
    let mut layers: Vec<i64> = points
        .iter()
        .map(|p| (p.dot(direction) / layer).floor() as i64)
        .collect();
    layers.sort_unstable();
    let runs = layers.chunk_by(|a, b| a == b).map(|run| run.len() as f64);
    runs.map(|n| n * n).sum::<f64>() / (points.len() as f64).powi(2)
}

/// 1 where the sparser half of the points' heights is above, else -1: things stand on floors, not below ceilings.
fn upper_side(points: &[Vec3], direction: Vec3) -> f32 {
    let mut heights: Vec<f32> = points.iter().map(|p| p.dot(direction)).collect();
    heights.sort_unstable_by(f32::total_cmp);
    let at = |share: usize| heights[(heights.len() - 1) * share / 20];
    if at(10) - at(1) < at(19) - at(10) {
        1.0
    } else {
        -1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A room of 6 x 5 x 3 with a table, its corner in the origin, z up.
    fn room() -> Vec<Vec3> {
        let grid = |n: usize| {
            (0..n * n).map(move |i| ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32))
        };
        let mut points = Vec::new();
        for (u, v) in grid(40) {
            points.push(Vec3::new(6.0 * u, 5.0 * v, 0.0));
            points.push(Vec3::new(6.0 * u, 5.0 * v, 3.0));
            points.push(Vec3::new(2.0 + u, 2.0 + v, 0.7));
        }
        for (u, v) in grid(30) {
            points.push(Vec3::new(0.0, 5.0 * u, 3.0 * v));
            points.push(Vec3::new(6.0, 5.0 * u, 3.0 * v));
            points.push(Vec3::new(6.0 * u, 0.0, 3.0 * v));
            points.push(Vec3::new(6.0 * u, 5.0, 3.0 * v));
        }
        points
    }

    #[test]
    fn floors_and_tables_lie_across_it() {
        for turn in [
            Quat::IDENTITY,
            Quat::from_rotation_x(0.3),
            Quat::from_euler(glam::EulerRot::XYZ, 1.2, 0.4, -2.0),
        ] {
            let points: Vec<Vec3> = room().iter().map(|p| turn * *p).collect();
            let up = up_direction(&points, 6.0, &[]);
            let off = up.angle_between(turn * Vec3::Z).to_degrees();
            assert!(off < 1.5, "{turn}: off by {off} degrees");
        }
    }

    #[test]
    fn walls_with_more_detail_do_not_win() {
        // Along the long walls fifty times as many points as anywhere else.
        let wall = (0..40_000).map(|i| {
            let (u, v) = ((i % 200) as f32 / 200.0, (i / 200) as f32 / 200.0);
            Vec3::new(6.0 * u, 0.0, 3.0 * v)
        });
        let points: Vec<Vec3> = room().into_iter().chain(wall).collect();
        let turn = Quat::from_euler(glam::EulerRot::XYZ, -0.7, 2.0, 0.5);
        for turn in [Quat::IDENTITY, turn] {
            let turned: Vec<Vec3> = points.iter().map(|p| turn * *p).collect();
            let up = up_direction(&turned, 6.0, &[]);
            let off = up.angle_between(turn * Vec3::Z).to_degrees();
            assert!(off.min(180.0 - off) < 1.5, "{turn}: off by {off} degrees");
        }
    }

    #[test]
    fn among_equals_the_format_s_axis_is_up() {
        let n = 30;
        let cube: Vec<Vec3> = (0..n * n)
            .flat_map(|i| {
                let (u, v) = ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32);
                [0.0, 1.0].map(|w| [Vec3::new(u, v, w), Vec3::new(u, w, v), Vec3::new(w, u, v)])
            })
            .flatten()
            .collect();
        for axis in [Vec3::Y, Vec3::NEG_Y, Vec3::Z] {
            let up = up_direction(&cube, 1.0, &[axis]);
            assert!(up.dot(axis) > 0.99, "{up}");
        }
    }

    #[test]
    fn the_format_s_axis_says_which_way() {
        let upside_down: Vec<Vec3> = room()
            .iter()
            .map(|p| *p * Vec3::new(1.0, 1.0, -1.0))
            .collect();
        let up = up_direction(&upside_down, 6.0, &[Vec3::NEG_Y, Vec3::Z]);
        assert!(up.dot(Vec3::Z) > 0.99, "{up}");
        assert_eq!(
            up_direction(&[], 0.0, &[Vec3::NEG_Y]),
            Vec3::NEG_Y,
            "of nothing"
        );
    }
}
