//! Cameras that are a little off are put right by what they see, and stay so over a checkpoint.

use std::sync::atomic::AtomicBool;

use glam::{Mat3A, Quat, Vec3, Vec3A};

use super::pose_step::slope_by_direction;
use crate::data::Dataset;
use crate::geometry::{Camera, Distortion};
use crate::train::config::{PhotoFit, TrainConfig};
use crate::train::fast::Fast;
use crate::train::placement::given_cameras;
use crate::train::random::SlotRandom;
use crate::train::scene_model::SceneModel as _;
use crate::train::shape::retracing::RETRACE_AT;
use crate::train::step::trainer::Trainer;
use crate::train::test_scene::{retrace, small_fields, sphere_in_a_box};

/// The scene, its training cameras turned and moved by a pixel or two, and the right cameras.
fn shaken(n_views: usize, size: u32) -> (Dataset, Vec<Camera>) {
    let mut dataset = sphere_in_a_box(n_views, size);
    let right = given_cameras(&dataset);
    for (index, view) in dataset.train.iter_mut().enumerate() {
        let mut random = SlotRandom::new(7, index as u64, 0);
        let mut vector =
            |most: f32| Vec3::from_array([0; 3].map(|_| (2.0 * random.uniform() - 1.0) * most));
        let pixel = view.camera.pixel_angle();
        let (turn, shift) = (vector(1.5 * pixel), vector(1.0 * pixel));
        let pose = &mut view.camera.world_from_camera;
        pose.matrix3 = Mat3A::from_quat(Quat::from_scaled_axis(turn)) * pose.matrix3;
        pose.translation += Vec3A::from(shift);
    }
    (dataset, right)
}

/// By how many pixels cameras show the walls elsewhere than the right ones do, mean over the photos.
fn off_px(cameras: &[Camera], right: &[Camera]) -> f32 {
    off_at(cameras, right, |camera| {
        [(0.2, 0.2), (0.8, 0.3), (0.5, 0.9)].map(|(x, y)| {
            let ray = camera.ray(x * camera.width as f32, y * camera.height as f32);
            ray.at(3.5)
        })
    })
}

/// The same of the points that `points` makes of the right cameras.
fn off_at<const N: usize>(
    cameras: &[Camera],
    right: &[Camera],
    points: impl Fn(&Camera) -> [Vec3; N],
) -> f32 {
    let off = cameras.iter().zip(right).flat_map(|(camera, right)| {
        points(right).map(|point| {
            let [a, b] = [camera, right].map(|c| c.project(point).expect("before the camera"));
            a.distance(b)
        })
    });
    off.sum::<f32>() / (N * right.len()) as f32
}

fn trainer(dataset: &Dataset, fit: PhotoFit) -> Trainer<Fast> {
    let config = TrainConfig {
        refine_poses: fit,
        ..small_fields()
    };
    Fast::trainer(&config, dataset, &AtomicBool::new(false), &|_| ()).unwrap()
}

#[test]
fn shaken_cameras_are_put_right_and_kept() {
    let (dataset, right) = shaken(40, 48);
    let given = given_cameras(&dataset);
    let mut first = trainer(&dataset, PhotoFit::On);
    let due = RETRACE_AT.map(|at| (at * 1000.0) as u32);
    for step in 0..1000 {
        // As in a run: the object's light paths begin at the corrected cameras.
        if due.contains(&step) {
            retrace(&mut first, &dataset);
        }
        first.step(step as f32 / 1000.0);
    }
    let checkpoint = first.checkpoint();
    let poses = first.model.poses().unwrap();
    let (before, after) = (off_px(&given, &right), off_px(&poses.cameras(), &right));
    assert!(before > 0.9, "{before} px: nothing to put right");
    assert!(
        after < 0.75 * before,
        "{before} px before, {after} px after"
    );
    let moved: f32 = poses.moved_px().iter().sum();
    assert!(moved / right.len() as f32 > 0.3 * before, "{moved}");
    let mut second = trainer(&dataset, PhotoFit::On);
    second.restore(&checkpoint).unwrap();
    let off = off_px(&second.model.poses().unwrap().cameras(), &poses.cameras());
    assert!(off < 1e-3, "{off} px lost by the checkpoint");
    // The object's light paths begin at the corrected cameras too.
    retrace(&mut second, &dataset);
    let corrected = second.model.poses().unwrap().cameras();
    assert_eq!(second.model.pixels.cameras()[3], corrected[3]);
}

#[test]
fn cameras_begin_where_outlines_show_them_to_be() {
    let (dataset, right) = shaken(40, 48);
    let given = given_cameras(&dataset);
    let begun = trainer(&dataset, PhotoFit::Auto).model.pixels.cameras();
    let at_object = |cameras: &[Camera]| off_at(cameras, &right, |_| [Vec3::ZERO]);
    let (before, after) = (at_object(&given), at_object(&begun));
    assert!(before > 0.9, "{before} px: nothing to put right");
    assert!(after < 0.4 * before, "{before} px before, {after} px after");
    let (before, after) = (off_px(&given, &right), off_px(&begun, &right));
    assert!(
        after < before,
        "walls: {before} px before, {after} px after"
    );
}

#[test]
fn cameras_that_are_right_stay_as_they_are_until_found_wrong() {
    let right = sphere_in_a_box(40, 48);
    let mut trainer = trainer(&right, PhotoFit::Auto);
    for step in 0..510 {
        trainer.step(step as f32 / 510.0);
    }
    let mut poses = trainer
        .model
        .photos
        .poses
        .take()
        .expect("they are looked at");
    let found: f32 = poses.moved_px().iter().sum();
    assert!(found > 0.0, "something is always found");
    assert_eq!(poses.cameras(), given_cameras(&right));
    assert!(!poses.are_corrected());
    // Three degrees about each axis.
    poses.set_corrections(&vec![0.05; 6 * right.train.len()]);
    assert!(poses.are_corrected());
    assert_ne!(poses.cameras(), given_cameras(&right));
}

#[test]
fn slopes_by_the_direction_are_those_by_the_pixel() {
    let camera = Camera {
        distortion: Distortion {
            k1: -0.2,
            ..Distortion::default()
        },
        ..Camera::look_at(Vec3::X, Vec3::ZERO, Vec3::Z, 1.2, 300, 200)
    };
    let (x, y) = (40.0, 150.0);
    let slope = slope_by_direction(&camera, x, y, [0.3, -0.2]);
    let direction = |x: f32, y: f32| camera.ray(x, y).direction;
    for (dx, dy) in [(1.0, 0.0), (0.0, 1.0), (-0.7, 0.4)] {
        let change = slope.dot(direction(x + dx, y + dy) - direction(x, y));
        let expected = 0.3 * dx - 0.2 * dy;
        assert!((change - expected).abs() < 0.02, "{change}, {expected}");
    }
}
