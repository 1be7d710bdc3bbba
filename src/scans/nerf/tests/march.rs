//! Rays through fields whose pictures are known.

use std::sync::atomic::Ordering;

use super::super::field::Field;
use super::super::march::{March, Steps};
use super::super::occupancy::{Cubes, Occupancy};
use super::*;
use crate::geometry::{Aabb, Ray};

/// A ball of one density around the origin, coloured by the direction in which it is seen.
#[derive(Debug)]
struct Ball {
    radius: f32,
    density: f32,
}

impl Field for Ball {
    fn n_features(&self) -> usize {
        1
    }

    fn densities(&self, points: &[Vec3], _scratch: &mut Scratch, answers: &mut Densities) {
        let density = |p: &Vec3| {
            if p.length() < self.radius {
                self.density
            } else {
                0.0
            }
        };
        answers.densities = points.iter().map(density).collect();
        answers.features = vec![0.5; points.len()];
    }

    fn colors(
        &self,
        features: &[f32],
        directions: &[Vec3],
        _scratch: &mut Scratch,
        colors: &mut Vec<[f32; 3]>,
    ) {
        let pairs = features.iter().zip(directions);
        *colors = pairs.map(|(x, d)| [*x, d.x.abs(), d.y.abs()]).collect();
    }
}

fn cubes(n_cascades: u32) -> Cubes {
    Cubes {
        center: Vec3::ZERO,
        half: 1.0,
        n_cascades,
        n: 32,
    }
}

fn see(ball: &Ball, cubes: &Cubes, rays: &[Ray]) -> Vec<super::super::march::Seen> {
    let occupancy = Occupancy::of_field(ball, cubes);
    let march = March {
        field: ball,
        occupancy: &occupancy,
        steps: Steps {
            min: 1.0 / 256.0,
            cone: 0.0,
            max_cells: 1.0,
            near: 0.0,
            far: f32::INFINITY,
        },
        shown: cubes.outer(),
    };
    let ray = |i: usize| rays[i];
    march.see(rays.len(), ray, &AtomicBool::new(false)).unwrap()
}

#[test]
fn a_ball_takes_the_light_that_its_chords_say() {
    let mut random = Random(5);
    for (n_cascades, radius, density) in [(1, 0.7, 2.0), (1, 0.7, 40.0), (3, 2.5, 0.4)] {
        let ball = Ball { radius, density };
        let rays: Vec<Ray> = (0..200)
            .map(|_| {
                let origin = 6.0 * random.direction();
                let target = random.point(radius);
                let direction = (target - origin).normalize_or(Vec3::X);
                Ray { origin, direction }
            })
            .collect();
        for (ray, seen) in rays.iter().zip(see(&ball, &cubes(n_cascades), &rays)) {
            // Beer's law along the chord, and the mean distance of what is absorbed on it.
            let middle = -ray.origin.dot(ray.direction);
            let away = (ray.origin + middle * ray.direction).length();
            let half = (radius * radius - away * away).max(0.0).sqrt();
            let thickness = density * 2.0 * half;
            let opacity = 1.0 - (-thickness).exp();
            assert!(
                (seen.opacity - opacity).abs() < 0.012,
                "{seen:?} and not {opacity}"
            );
            if half > 0.1 * radius {
                let left = 1.0 - opacity;
                let distance = middle - half + 1.0 / density - 2.0 * half * left / opacity;
                assert!(
                    (seen.distance - distance).abs() < 0.02,
                    "{seen:?} and not {distance}"
                );
                let color = ray.direction.x.abs() * seen.opacity;
                assert!(
                    (seen.color[1] - color).abs() < 1e-3,
                    "{seen:?} and not {color}"
                );
            }
        }
    }
}

#[test]
fn rays_that_miss_or_run_along_axes_come_to_an_end() {
    let ball = Ball {
        radius: 0.5,
        density: 10.0,
    };
    let axes = [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::ZERO];
    let rays: Vec<Ray> = axes
        .iter()
        .flat_map(|direction| {
            let starts = [
                -3.0 * *direction,
                2.0 * Vec3::ONE,
                Vec3::ZERO,
                Vec3::splat(1.0),
            ];
            starts.map(|origin| Ray {
                origin,
                direction: *direction,
            })
        })
        .collect();
    let seen = see(&ball, &cubes(2), &rays);
    for (i, seen) in seen.iter().enumerate().take(12) {
        let expected = if i % 2 == 0 { 0.99 } else { 0.0 };
        assert!(seen.opacity >= expected, "ray {i}: {seen:?}");
        assert_eq!(seen.distance.is_finite(), i % 2 == 0, "ray {i}: {seen:?}");
    }
}

#[test]
fn cells_are_occupied_where_something_is_and_almost_only_there() {
    let ball = Ball {
        radius: 0.6,
        density: 5.0,
    };
    let occupancy = Occupancy::of_field(&ball, &cubes(2));
    let mut random = Random(11);
    for _ in 0..2000 {
        let p = random.point(1.99);
        let (is_occupied, width) = occupancy.at(p).unwrap();
        let is_inner = p.abs().max_element() < 1.0;
        assert_eq!(width, if is_inner { 1.0 / 16.0 } else { 1.0 / 8.0 }, "{p}");
        let inside = p.length() < 0.6;
        let near = p.length() < 0.6 + 0.25;
        assert!(is_occupied || !inside, "{p} is in it");
        assert!(!is_occupied || near, "{p} is far from it");
    }
    assert!(occupancy.at(Vec3::splat(2.01)).is_none(), "outside");
    assert!(occupancy.at(Vec3::splat(f32::NAN)).is_none(), "nowhere");
}

#[test]
fn a_picture_can_be_cancelled() {
    let ball = Ball {
        radius: 0.5,
        density: 10.0,
    };
    let cubes = cubes(1);
    let occupancy = Occupancy::of_field(&ball, &cubes);
    let shown = Aabb {
        min: Vec3::splat(-1.0),
        max: Vec3::ONE,
    };
    let march = March {
        field: &ball,
        occupancy: &occupancy,
        steps: Steps {
            min: 0.01,
            cone: 0.0,
            max_cells: 1.0,
            near: 0.0,
            far: 9.0,
        },
        shown,
    };
    let ray = |_| Ray {
        origin: Vec3::splat(-2.0),
        direction: Vec3::ONE.normalize_or(Vec3::X),
    };
    let cancel = AtomicBool::new(false);
    assert!(march.see(10, ray, &cancel).is_some(), "to the end");
    cancel.store(true, Ordering::Relaxed);
    assert!(march.see(10, ray, &cancel).is_none(), "cancelled");
}
