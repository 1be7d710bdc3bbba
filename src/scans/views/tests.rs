//! A room of Gaussians is photographed from within.

use std::sync::atomic::AtomicBool;

use glam::{Quat, Vec3};

use super::capture::photographs;
use super::survey::Survey;
use crate::data::{CaptureChoices, Photo, Split, Splits, View};
use crate::scans::{Scan, Splat, Splats};

/// Half sides of the room.
const HALF: Vec3 = Vec3::new(3.0, 2.5, 1.4);
/// Distance of neighbouring Gaussians.
const SPACING: f32 = 0.1;

/// A room about the origin, y down as structure from motion leaves it, with a table; each wall has a colour of its own.
fn room() -> Survey {
    let mut splats = Splats::default();
    let mut wall = |center: Vec3, u: Vec3, v: Vec3, color: [f32; 3]| {
        let steps = |side: Vec3| (2.0 * side.length() / SPACING) as i32;
        for i in 0..=steps(u) {
            for j in 0..=steps(v) {
                let place = |k: i32, side: Vec3| side * (2.0 * k as f32 / steps(side) as f32 - 1.0);
                splats.splats.push(Splat {
                    center: center + place(i, u) + place(j, v),
                    scale: Vec3::splat(0.6 * SPACING),
                    rotation: Quat::IDENTITY,
                    opacity: 0.98,
                });
                splats
                    .harmonics
                    .push(color.map(|c| (c - 0.5) / 0.282_094_8));
            }
        }
    };
    // From z up to y down.
    let turned = |p: Vec3| Vec3::new(p.x, -p.z, p.y);
    let [x, y, z] = [HALF.x * Vec3::X, HALF.y * Vec3::Y, HALF.z * Vec3::Z].map(turned);
    let up = turned(Vec3::Z);
    wall(x, y, z, [0.9, 0.2, 0.2]);
    wall(-x, y, z, [0.2, 0.9, 0.2]);
    wall(y, x, z, [0.2, 0.2, 0.9]);
    wall(-y, x, z, [0.9, 0.9, 0.2]);
    wall(z, x, y, [0.8; 3]);
    wall(-z, x, y, [0.4; 3]);
    wall(-0.7 * up, 0.25 * x, 0.25 * y, [0.6, 0.4, 0.2]);
    let scan = Scan::Splats(splats);
    Survey::of_scan(scan, &CaptureChoices::default()).unwrap()
}

fn photos(splits: Splits) -> Vec<View> {
    let go_on = AtomicBool::new(false);
    let taken = photographs(&room(), splits, &go_on, &|_, _| ()).unwrap();
    taken.into_iter().map(|(view, _)| view).collect()
}

#[test]
fn up_size_and_place_are_found() {
    let room = room();
    assert!(room.up.dot(Vec3::NEG_Y) > 0.999, "up is {}", room.up);
    assert!((4.0..6.5).contains(&room.size), "{}", room.size);
    let is_free = room.points.iter().all(|p| p.distance(room.at) > 0.3);
    assert!(
        is_free && room.at.length() < 1.5,
        "the place is {}",
        room.at
    );
}

#[test]
fn all_cameras_are_in_the_room_and_see_all_of_it() {
    let views = photos(Splits::TEST);
    assert_eq!(views.len(), 12, "one of twelve");
    let turned = |p: Vec3| Vec3::new(p.x, p.z, -p.y);
    let mut seen = [false; 7];
    for view in &views {
        let eye = turned(view.camera.position());
        assert!(eye.abs().cmplt(HALF - 0.1).all(), "{}: at {eye}", view.name);
        assert!(
            view.camera.up().dot(Vec3::NEG_Y) > -0.01,
            "{}: held upright",
            view.name
        );
        let Photo::Ldr { pixels, .. } = &view.photo else {
            panic!("16 bits a colour");
        };
        let n_black = pixels.iter().filter(|p| **p == [0; 3]).count();
        assert_eq!(n_black, 0, "{}: there is a wall everywhere", view.name);
        let colors = [
            [0.9, 0.2, 0.2],
            [0.2, 0.9, 0.2],
            [0.2, 0.2, 0.9],
            [0.9, 0.9, 0.2],
            [0.8; 3],
            [0.4; 3],
            [0.6, 0.4, 0.2],
        ];
        for (seen, color) in seen.iter_mut().zip(colors) {
            let is_it = |p: &[u16; 3]| {
                p.iter()
                    .zip(color)
                    .all(|(a, b): (&u16, f32)| (f32::from(*a) / 65535.0 - b).abs() < 0.03)
            };
            *seen |= pixels.iter().any(is_it);
        }
    }
    assert_eq!(seen, [true; 7], "four walls, ceiling, floor and table");
}

#[test]
fn only_wanted_splits_are_taken_and_cancelling_ends_it() {
    let splits = Splits {
        train: false,
        val: true,
        test: false,
    };
    let views = photos(splits);
    assert!(
        !views.is_empty() && views.iter().all(|v| v.split == Split::Val),
        "validation alone"
    );
    let cancelled = photographs(&room(), splits, &AtomicBool::new(true), &|_, _| ());
    assert!(cancelled.is_none(), "cancelled");
}
