//! Where in a scan an object may stand, and how far one sees from there.

use std::sync::atomic::AtomicBool;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::geometry::Camera;
use crate::scans::Scan;

/// Places that are tried along each axis around the middle.
const N_TRIED: i32 = 9;
/// How far from the middle they reach, as a share of the scan's size.
const REACH: f32 = 0.25;
/// Free space around an object that is enough, as a share of the scan's size.
const ENOUGH: f32 = 0.08;
/// What a step away from the middle costs in free space.
const COST_OF_DISTANCE: f32 = 0.3;
/// Pixels along the sides of the six pictures of all directions.
const FACE: u32 = 64;
/// How far cameras may go, as a share of how far one sees in the median.
const VIEW_SHARE: f32 = 0.75;
/// The same as a share of the scan's size.
const SIZE_SHARE: f32 = 0.5;

/// A place in a scan with what is seen from it.
#[derive(Clone, Debug)]
pub(super) struct Stand {
    /// The place, scene units.
    pub(super) at: Vec3,
    /// How far from it cameras may go, scene units.
    pub(super) radius: f32,
    /// Cameras that look along ±x, ±y, ±z, and how far each of their pixels sees.
    faces: Vec<(Camera, Vec<f32>)>,
}

/// Distance to the nearest of the points, infinite where there is none.
pub(super) fn clearance(points: &[Vec3], at: Vec3) -> f32 {
    let squared = points.iter().map(|p| p.distance_squared(at));
    squared.fold(f32::INFINITY, f32::min).sqrt()
}

/// A free place near the middle of the scan.
pub(super) fn free_place(points: &[Vec3], middle: Vec3, size: f32) -> Vec3 {
    let half = N_TRIED / 2;
    let step = REACH * size / half as f32;
    let n = N_TRIED * N_TRIED * N_TRIED;
    let places = (0..n).map(|i| {
        let cell = [i % N_TRIED, i / N_TRIED % N_TRIED, i / (N_TRIED * N_TRIED)];
        middle + Vec3::from(cell.map(|c| (c - half) as f32)) * step
    });
    let places: Vec<Vec3> = places.collect();
    let worth = |place: &Vec3| {
        let free = clearance(points, *place).min(ENOUGH * size);
        free - COST_OF_DISTANCE * ENOUGH * place.distance(middle)
    };
    let worths: Vec<f32> = places.par_iter().map(worth).collect();
    let best = (0..places.len()).fold(0, |best, i| if worths[i] > worths[best] { i } else { best });
    places[best]
}

impl Stand {
    /// Looks around at a place of a scan of this `size`; `None` when cancelled.
    pub(super) fn at(scan: &Scan, at: Vec3, size: f32, cancel: &AtomicBool) -> Option<Self> {
        let mut faces = Vec::new();
        for axis in Vec3::AXES {
            for direction in [axis, -axis] {
                let right_angle = std::f32::consts::FRAC_PI_2;
                let camera = Camera::look_at(at, at + direction, Vec3::Z, right_angle, FACE, FACE);
                faces.push((camera, scan.picture(&camera, cancel)?.distance));
            }
        }
        let mut distances: Vec<f32> = faces.iter().flat_map(|(_, face)| face).copied().collect();
        distances.sort_unstable_by(f32::total_cmp);
        let median = distances[distances.len() / 2];
        let radius = (VIEW_SHARE * median).min(SIZE_SHARE * size);
        let radius = if radius > 0.0 { radius } else { 1.0 };
        Some(Self { at, radius, faces })
    }

    /// How far one sees from the place in a direction, at least in the pixels next to it.
    pub(super) fn sight(&self, direction: Vec3) -> f32 {
        let seen = self.faces.iter().filter_map(|(camera, distances)| {
            let pixel = camera.project(self.at + direction)?;
            let is_inside =
                pixel.cmpge(Vec2::ZERO).all() && pixel.cmplt(Vec2::splat(FACE as f32)).all();
            is_inside.then(|| {
                let [x, y] = pixel.to_array().map(|v| v as i32);
                let side = FACE as i32;
                let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
                let inside = near.filter(|(x, y)| (0..side).contains(x) && (0..side).contains(y));
                inside
                    .map(|(x, y)| distances[(y * side + x) as usize])
                    .fold(f32::INFINITY, f32::min)
            })
        });
        seen.fold(f32::INFINITY, f32::min)
    }
}
